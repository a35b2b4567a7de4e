"""What the robot's side does with a policy: observations, the network's outputs, the choice of an action."""

import io
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor
from torch.nn import functional

from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.weights import Weights
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.network import NetworkSpec

_PART = 256
_ROUNDING = 1e-9


def observations(frames: Tensor, stacked: int, *, difference: bool = False) -> Tensor:
    """Every s_t of an episode: uint8[T+1, c, h, w] to uint8[T+1, stacked * c, h, w], oldest frame first.

    At an episode's start the first frame stands in for those before it. With `difference`, all but the newest are
    replaced by twice what the newest is brighter, around 128.
    """
    shifted = [
        torch.cat([frames[:1].expand(back, -1, -1, -1), frames[: len(frames) - back]])
        for back in reversed(range(min(stacked, len(frames))))
    ]
    missing = [frames[:1].expand_as(frames)] * (stacked - len(shifted))
    seen = [*missing, *shifted]
    if difference:
        now = frames.to(torch.int32)
        seen = [(128 + (now - then.int()) * 2).clamp(0, 255).to(torch.uint8) for then in seen[:-1]]
        seen.append(frames)
    return torch.cat(seen, dim=1)


def as_kernels(rows: Tensor, size: int) -> Tensor:
    """Weights [out, (row, column, channel)] as torch's [out, channel, row, column], kernels of that size."""
    return rows.view(len(rows), size, size, -1).permute(0, 3, 1, 2)


@dataclass(frozen=True, eq=False)
class Policy:
    """A version of the weights, unpacked.

    Attributes:
        rows: per layer [out, fan_in], float32; of a binarized network -1 and 1.
        thresholds: of all layers but the last, int32[out]; none of a float network.
        biases: of every layer, float32[out]; none of a binarized one.
        scale: lambda; 1 of a float network.
        kernels, strides: of each layer; a fully connected one's kernel covers its input.
    """

    rows: tuple[Tensor, ...]
    thresholds: tuple[Tensor, ...]
    biases: tuple[Tensor, ...]
    scale: float
    kernels: tuple[int, ...]
    strides: tuple[int, ...]

    @property
    def binary(self) -> bool:
        return not self.biases

    @torch.no_grad()
    def layers(self, seen: Tensor) -> list[Tensor]:
        """What each layer sums up: float32[n, out, h, w], of a binarized network integers.

        Args:
            seen: uint8[n, C, h, w].
        """
        sums: list[Tensor] = []
        x = seen.float()
        for layer, rows in enumerate(self.rows):
            bias = None if self.binary else self.biases[layer]
            kernels = as_kernels(rows, self.kernels[layer])
            s = functional.conv2d(x, kernels, bias, stride=self.strides[layer])
            sums.append(s.round() if self.binary else s)
            if self.binary and layer < len(self.thresholds):
                x = torch.where(sums[-1] >= self.thresholds[layer][:, None, None], 1.0, -1.0)
            else:
                x = s.relu()
        return sums

    def outputs(self, seen: Tensor) -> Tensor:
        """O of a binarized network, P of a float one: float32[n, |A|]."""
        parts = [self.layers(part)[-1].flatten(1) for part in torch.split(seen, _PART)]
        return torch.cat(parts)

    def preferences(self, seen: Tensor) -> Tensor:
        """P, float32[n, |A|]."""
        return torch.tensor(self.scale, dtype=torch.float32) * self.outputs(seen)


def sizes(spec: NetworkSpec) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Kernels and strides of a network's layers."""
    fully_connected = spec.image_px
    for kernel, stride, _ in spec.convolutions:
        fully_connected = (fully_connected - kernel) // stride + 1
    kernels = (*(kernel for kernel, _, _ in spec.convolutions), fully_connected, 1)
    return kernels, (*(stride for _, stride, _ in spec.convolutions), 1, 1)


def unpacked(weights: Weights) -> Policy:
    """A blob's or a float policy's parts."""
    if isinstance(weights, WeightBlob):
        rows = tuple(torch.from_numpy(signs).float() for signs in weights.weights)
        thresholds = tuple(torch.from_numpy(tau) for tau in weights.thresholds)
        return Policy(rows, thresholds, (), weights.scale, *sizes(weights.spec))
    return _of_model(weights)


def _of_model(weights: FloatWeights) -> Policy:
    graph = onnx.load(io.BytesIO(weights.model)).graph
    constants = {
        c.name: torch.from_numpy(numpy_helper.to_array(c).copy()) for c in graph.initializer
    }
    layers = [node for node in graph.node if node.op_type in ("Conv", "Gemm")]
    kernel_sizes, strides = sizes(weights.spec)
    rows = []
    for size, node in zip(kernel_sizes, layers, strict=True):
        kernels = constants[node.input[1]]
        if node.op_type == "Gemm":  # of a flattened [channel, row, column]
            kernels = kernels.view(len(kernels), -1, size, size)
        rows.append(kernels.permute(0, 2, 3, 1).flatten(1))
    biases = tuple(constants[node.input[2]] for node in layers)
    return Policy(tuple(rows), (), biases, 1.0, kernel_sizes, strides)


def inverse_temperature(config: RunConfig, iteration: int) -> float:
    """Beta of an iteration: on a line over the run, to `beta_run_final_factor` of it in the last one."""
    share = iteration / (config.iterations - 1) if config.iterations > 1 else 0.0
    return config.beta * (1 + share * (config.beta_run_final_factor - 1))


def parts(numbers: npt.NDArray[np.float64], dims: tuple[int, ...]) -> list[npt.NDArray[np.float64]]:
    """Of what is side by side for every choice of every dimension: each dimension's own."""
    return [numbers[sum(dims[:d]) : sum(dims[: d + 1])] for d in range(len(dims))]


def softmax_choice(P: npt.NDArray[np.float64], beta: float, uniform: float) -> set[int]:
    """Actions that exp(beta P) / sum and a uniform number may mean: one, or more where rounding decides."""
    weights = np.exp(beta * (P - P.max()))
    shares = np.cumsum(weights) / weights.sum()
    first, last = (min(int((shares <= u).sum()), len(P) - 1) for u in _around(uniform))
    return set(range(first, last + 1))


def greedy_choice(P: npt.NDArray[np.float64], epsilon: float, uniform: float) -> set[int]:
    """With probability epsilon any action, else the first of the best, from one uniform number."""
    return {
        min(int(u / epsilon * len(P)), len(P) - 1) if u < epsilon else int(np.argmax(P))
        for u in _around(uniform)
    }


def _around(uniform: float) -> tuple[float, float]:
    """The numbers that rounding does not tell from this one."""
    return max(0.0, uniform - _ROUNDING), uniform + _ROUNDING
