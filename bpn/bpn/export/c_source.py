"""A binarized policy as one C99 file: weights, thresholds and the arithmetic, no heap, no floating point."""

import string
from collections.abc import Iterable, Iterator
from importlib.resources import files

import numpy as np
import numpy.typing as npt

from bpn_shared.bnn.blob import WeightBlob, canonical_thresholds
from bpn_shared.spec.network import Layer
from bpn_shared.spec.tasks import TaskSpec
from bpn_shared.version import VERSION

_WORD_BITS = 32
_PER_LINE = 8
_SAFE = (string.ascii_letters + string.digits + " +-_.,:;()[]").encode()


def c_source(blob: WeightBlob, task: TaskSpec) -> str:
    """The text of the file.

    Args:
        task: what the actions are called, and how many frames an observation has.
    """
    layers = blob.spec.layers
    template = files("bpn.export").joinpath("policy.c").read_text()
    template = template.replace("@ABOUT@", _about(blob, task))
    parts = {
        "SIZES": "\n".join(_sizes(blob)),
        "ACTIONS": _listed(map(_quoted, task.action_names), per_line=1),
        "CHOICES": _listed(map(str, blob.spec.action_dims)),
        "WEIGHTS": "\n".join(
            text
            for index, layer in enumerate(layers)
            for text in _arrays(layer, blob.weights[index], _thresholds(blob, index))
        ),
        "LAYERS": _listed(map(_layer, layers), per_line=1),
        "SCALE": f"{float(np.float32(blob.scale)).hex()}f",
    }
    for name, text in parts.items():
        template = template.replace(f"/*@{name}@*/", text)
    return template


def _about(blob: WeightBlob, task: TaskSpec) -> str:
    lines = [
        f"task {task.name}, {blob.spec}",
        f"run {blob.run}, attempt {blob.attempt}, weights version {blob.version}",
        f"an observation: {task.frames_stacked} frames of {task.frame_channels} channels, oldest first",
        f"a control period: {1000 * task.control_period_s:g} ms; hold action: {task.hold_action}",
        f"written by bpn {VERSION}",
    ]
    return "\n".join(f" * {_plain(line)}" for line in lines)


def _sizes(blob: WeightBlob) -> Iterator[str]:
    spec, layers = blob.spec, blob.spec.layers
    _, rows, columns = spec.observation_shape
    maps = [layer.out_size**2 * layer.out_channels for layer in layers]
    sizes = {
        "CHANNELS": spec.channels,
        "ROWS": rows,
        "COLUMNS": columns,
        "ACTIONS": spec.actions,
        "DIMENSIONS": len(spec.action_dims),
        "LAYERS": len(layers),
        "MOST_PIXELS": layers[0].fan_in,
        "MOST_PATCH_WORDS": max(_words(layer.fan_in) for layer in layers),
        "MOST_MAP_WORDS": max(_words(bits) for bits in maps),
    }
    return (f"#define BPN_{name} {size}" for name, size in sizes.items())


def _thresholds(blob: WeightBlob, index: int) -> npt.NDArray[np.int32] | None:
    if index == len(blob.thresholds):
        return None
    return canonical_thresholds(blob.spec.layers[index], blob.thresholds[index])


def _arrays(
    layer: Layer, signs: npt.NDArray[np.int8], tau: npt.NDArray[np.int32] | None
) -> Iterator[str]:
    padded = np.zeros((layer.out_channels, _words(layer.fan_in) * _WORD_BITS), bool)
    padded[:, : layer.fan_in] = signs > 0
    words = np.packbits(padded, axis=1, bitorder="little").view("<u4").reshape(-1)
    values = _listed(f"0x{word:08x}u" for word in words.tolist())
    yield f"static const uint32_t {layer.name}_signs[{len(words)}] = {{\n{values}\n}};"
    if tau is not None:
        values = _listed(map(str, tau.tolist()))
        yield f"static const int32_t {layer.name}_thresholds[{len(tau)}] = {{\n{values}\n}};"


def _layer(layer: Layer) -> str:
    numbers = (
        layer.in_size,
        layer.in_channels,
        layer.kernel,
        layer.stride,
        layer.out_channels,
        layer.out_size,
        layer.fan_in,
        _words(layer.fan_in),
    )
    # The last layer has none: its sums are the outputs.
    tau = "0" if layer.name == "fc2" else f"{layer.name}_thresholds"
    return f"{{{', '.join(map(str, numbers))}, {layer.name}_signs, {tau}}}"


def _listed(values: Iterable[str], per_line: int = _PER_LINE) -> str:
    listed = [f"{value}," for value in values]
    lines = (" ".join(listed[at : at + per_line]) for at in range(0, len(listed), per_line))
    return "\n".join(f"    {line}" for line in lines)


def _words(bits: int) -> int:
    return -(-bits // _WORD_BITS)


def _quoted(text: str) -> str:
    """A C string; whatever is not plain, in octal."""
    said = "".join(chr(byte) if byte in _SAFE else f"\\{byte:03o}" for byte in text.encode())
    return f'"{said}"'


def _plain(text: str) -> str:
    """What may stand in a comment."""
    return "".join(one if one.isprintable() and one not in "*/\\?" else "_" for one in text)
