"""The C++ kernels' constants of network shapes, which `python -m checks.shapes` writes from the specification."""

from collections.abc import Iterator
from pathlib import Path

from bpn_shared.spec import network

HEADERS = tuple(f"services/{service}/src/shapes.h" for service in ("edge", "learner"))


def header() -> str:
    """The header that both kernels include."""
    paper = network.PAPER_CONVOLUTIONS
    limits = {
        "kMaxLayers": network.MAX_CONVOLUTIONS + 2,
        "kMaxChannels": network.MAX_CHANNELS,
        "kMinImagePx": network.MIN_IMAGE_SIZE_PX,
        "kMaxImagePx": network.MAX_IMAGE_SIZE_PX,
        "kMaxKernel": network.MAX_KERNEL,
        "kMaxConvolutionChannels": network.MAX_CONVOLUTION_CHANNELS,
        "kMaxOutputs": max(
            network.MAX_HIDDEN_UNITS, network.MAX_ACTIONS, network.MAX_CONVOLUTION_CHANNELS
        ),
        "kMaxActions": network.MAX_ACTIONS,
        "kMaxActionDims": network.MAX_ACTION_DIMS,
        "kMaxWeights": network.MAX_WEIGHTS,
        "kMaxMacs": network.MAX_MACS,
        "kMaxPixel": network.MAX_PIXEL,
    }
    rows = ", ".join(f"{{{c.kernel}, {c.stride}, {c.channels}}}" for c in paper)
    return "\n".join(
        [
            "// Generated from bpn_shared/spec/network.py by `python -m checks.shapes`; change it there.",
            "#pragma once",
            "",
            "namespace bpn {",
            "",
            *(f"constexpr int {name} = {value};" for name, value in limits.items()),
            "",
            "struct Convolution {",
            "  int kernel, stride, outputs;",
            "};",
            f"constexpr int kPaperImagePx = {network.IMAGE_SIZE_PX};",
            f"constexpr int kPaperConvolutions = {len(paper)};",
            f"constexpr Convolution kPaper[kPaperConvolutions] = {{{rows}}};",
            "",
            "}  // namespace bpn",
            "",
        ]
    )


def check(root: Path) -> Iterator[str]:
    """Headers of the repository at `root` that are not those."""
    text = header()
    for name in HEADERS:
        if (root / name).read_text() != text:
            yield f"{name} is not what `python -m checks.shapes` writes"


def main(root: Path) -> None:
    """Writes the headers."""
    for name in HEADERS:
        (root / name).write_text(header())


if __name__ == "__main__":
    main(Path.cwd())
