"""The algorithms: two independent choices, what computes P and how P is learned (docs/algorithms)."""

from dataclasses import dataclass
from typing import Any, Literal

NetworkKind = Literal["binary", "float"]
UpdateKind = Literal["cvi", "dqn"]
AlgorithmName = Literal["bpn", "bqn", "cvi", "dqn", "dpp"]


@dataclass(frozen=True, slots=True)
class Algorithm:
    """One algorithm.

    Attributes:
        network: binary is the paper's, which an FPGA evaluates; float has the same geometry in floating point.
        update: cvi learns and plays a softmax policy; dqn learns greedily and explores epsilon-greedily.
    """

    network: NetworkKind
    update: UpdateKind


ALGORITHMS: dict[AlgorithmName, Algorithm] = {
    "bpn": Algorithm("binary", "cvi"),
    "bqn": Algorithm("binary", "dqn"),
    "cvi": Algorithm("float", "cvi"),  # the paper's CVI-Max is the best return of its runs
    "dqn": Algorithm("float", "dqn"),
    "dpp": Algorithm("float", "cvi"),  # Dynamic Policy Programming: CVI at alpha = 1
}

KERNELS: dict[NetworkKind, tuple[str, ...]] = {
    "binary": ("native", "golden"),
    "float": ("onnx",),
}
"""Which of the project's own kernels run a network; the first is the default."""


def implied(name: str) -> dict[str, Any]:
    """Values of a run's configuration that follow from its algorithm; {} for an unknown one."""
    algorithm = next((a for known, a in ALGORITHMS.items() if known == name), None)
    if algorithm is None:
        return {}
    values: dict[str, Any] = {"kernel": KERNELS[algorithm.network][0]}
    return values | ({"alpha": 1.0} if name == "dpp" else {})
