"""Geometry of a policy's network: convolutions, then FC(N), then FC(|A|).

The paper's convolutions are Conv(8,4,8), Conv(4,2,16), Conv(3,1,16), over images of 84 x 84.

A fully connected layer is a convolution whose kernel covers its whole input, so all layers have one form: every
output integer is the dot product of a patch, flattened in the order (kernel row, kernel column, input channel),
with one row of signs.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

IMAGE_SIZE_PX = 84
"""The paper's."""

MIN_IMAGE_SIZE_PX, MAX_IMAGE_SIZE_PX = 8, 128
MAX_CHANNELS = 16
MAX_CONVOLUTIONS = 6
MAX_KERNEL = 16
MAX_CONVOLUTION_CHANNELS = 128
MAX_HIDDEN_UNITS = 1024
MAX_ACTIONS = 64
MAX_ACTION_DIMS = 32
MAX_WEIGHTS = 4_000_000
"""Of a whole network: as float32 they fit a message."""

MAX_MACS = 200_000_000
MAX_PIXEL = 255


class Convolution(NamedTuple):
    """Conv(kernel, stride, channels): a square kernel, the step between two patches, output channels."""

    kernel: int
    stride: int
    channels: int

    def __str__(self) -> str:
        return f"{self.kernel}x{self.stride}x{self.channels}"


PAPER_CONVOLUTIONS = (Convolution(8, 4, 8), Convolution(4, 2, 16), Convolution(3, 1, 16))


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer l: `out_channels` dot products over each of `out_size`² patches, without padding."""

    name: str
    in_size: int
    in_channels: int
    kernel: int
    stride: int
    out_channels: int
    max_input: int
    """Largest magnitude of an input value: 255 for pixels, 1 for signs."""

    @property
    def out_size(self) -> int:
        return (self.in_size - self.kernel) // self.stride + 1

    @property
    def is_fully_connected(self) -> bool:
        """Whether its kernel covers all of its input."""
        return self.kernel == self.in_size

    @property
    def fan_in(self) -> int:
        """Inputs of one dot product (the paper's N in Eq. 11a)."""
        return self.kernel * self.kernel * self.in_channels

    @property
    def weight_shape(self) -> tuple[int, int]:
        """(out_channels, fan_in), fan_in in the order (kernel row, kernel column, input channel)."""
        return self.out_channels, self.fan_in

    @property
    def max_output(self) -> int:
        """Largest magnitude that an output integer o can have."""
        return self.fan_in * self.max_input

    @property
    def macs(self) -> int:
        """Multiply-accumulates per inference; XNORs for all layers but the first."""
        return self.out_size**2 * self.out_channels * self.fan_in


def _check(name: str, value: int, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"{name} = {value!r} must be an int in {low}..{high}")
    if not low <= value <= high:
        raise ValueError(f"{name} = {value} is outside {low}..{high}")


def parse_convolutions(text: str) -> tuple[Convolution, ...]:
    """Reads "8x4x8,4x2x16,3x1x16": kernel x stride x channels of each layer.

    Raises:
        ValueError: it is no such list; whether the layers fit an image, `NetworkSpec` checks.
    """
    layers = []
    for part in text.split(","):
        numbers = part.strip().split("x")
        if len(numbers) != len(Convolution._fields) or not all(
            n.isascii() and n.isdigit() and len(n) <= 4 for n in numbers
        ):
            raise ValueError(
                f"{part.strip()!r} is no layer: each is KERNELxSTRIDExCHANNELS, such as 8x4x32,4x2x64,3x1x64"
            )
        layers.append(Convolution(*map(int, numbers)))
    return tuple(layers)


def format_convolutions(convolutions: tuple[Convolution, ...]) -> str:
    """What `parse_convolutions` reads."""
    return ",".join(map(str, convolutions))


@dataclass(frozen=True)
class NetworkSpec:
    """The network's sizes.

    Args:
        channels: C, image channels of an observation (stacked frames included), 1..16.
        hidden_units: N, units of the first fully connected layer, 1..1024.
        actions: |A|, action preferences, 2..64.
        convolutions: from the pixels on, 1..6: kernels of 1..16, strides of 1 up to the kernel, 1..128 channels.
        image_px: rows and columns of an observation, 8..128.
        action_dims: choices of each dimension of an action, every one 2 or more, |A| of them together; by default
            one dimension of |A|.

    Raises:
        ValueError, TypeError: a size is outside its range, or they do not fit together; the message names it.
    """

    channels: int
    hidden_units: int
    actions: int
    convolutions: tuple[Convolution, ...] = PAPER_CONVOLUTIONS
    image_px: int = IMAGE_SIZE_PX
    action_dims: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        _check("channels", self.channels, 1, MAX_CHANNELS)
        _check("hidden_units", self.hidden_units, 1, MAX_HIDDEN_UNITS)
        _check("actions", self.actions, 2, MAX_ACTIONS)
        _check("image_px", self.image_px, MIN_IMAGE_SIZE_PX, MAX_IMAGE_SIZE_PX)
        _check("convolutions: number of layers", len(self.convolutions), 1, MAX_CONVOLUTIONS)
        self._check_convolutions()
        object.__setattr__(self, "action_dims", tuple(self.action_dims) or (self.actions,))
        _check("action_dims: number of dimensions", len(self.action_dims), 1, MAX_ACTION_DIMS)
        for choices in self.action_dims:
            _check("action_dims: choices", choices, 2, MAX_ACTIONS)
        if sum(self.action_dims) != self.actions:
            raise ValueError(
                f"action_dims = {list(self.action_dims)} have {sum(self.action_dims)} choices together, "
                f"|A| is {self.actions}"
            )
        if self.weight_bits > MAX_WEIGHTS:
            raise ValueError(
                f"the network has {self.weight_bits:,} weights, at most {MAX_WEIGHTS:,} are allowed: choose fewer "
                "hidden_units or channels, or larger strides"
            )
        if self.macs > MAX_MACS:
            raise ValueError(
                f"an inference takes {self.macs:,} multiplications, at most {MAX_MACS:,} are allowed: choose "
                "fewer channels, or larger strides"
            )

    def _check_convolutions(self) -> None:
        size = self.image_px
        for index, convolution in enumerate(self.convolutions, 1):
            kernel, stride, channels = convolution
            name = f"convolutions: layer {index} ({kernel}x{stride}x{channels})"
            _check(f"{name}, kernel", kernel, 1, MAX_KERNEL)
            _check(f"{name}, stride", stride, 1, kernel)
            _check(f"{name}, channels", channels, 1, MAX_CONVOLUTION_CHANNELS)
            if kernel > size:
                raise ValueError(f"{name}: its kernel is larger than its input, {size} x {size}")
            size = (size - kernel) // stride + 1

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        """From the pixels to the outputs: conv1, conv2, ..., fc1, fc2."""
        layers: list[Layer] = []
        size, channels, largest = self.image_px, self.channels, MAX_PIXEL

        def append(name: str, kernel: int, stride: int, outputs: int) -> None:
            nonlocal size, channels, largest
            layers.append(Layer(name, size, channels, kernel, stride, outputs, largest))
            size, channels, largest = layers[-1].out_size, outputs, 1

        for index, convolution in enumerate(self.convolutions, 1):
            append(f"conv{index}", *convolution)
        append("fc1", size, 1, self.hidden_units)
        append("fc2", 1, 1, self.actions)
        return tuple(layers)

    @property
    def is_paper_shape(self) -> bool:
        """Whether only C, N and |A| are chosen: the paper's convolutions, its image, one dimension of actions."""
        return (
            self.convolutions == PAPER_CONVOLUTIONS
            and self.image_px == IMAGE_SIZE_PX
            and len(self.action_dims) == 1
        )

    @property
    def observation_shape(self) -> tuple[int, int, int]:
        """[C, rows, columns]; the paper's is [C, 84, 84]."""
        return self.channels, self.image_px, self.image_px

    def probe(self) -> npt.NDArray[np.uint8]:
        """The observation, uint8[C, rows, columns], on which a kernel's arithmetic is tried.

        It tests the arithmetic alone: thresholds swallow most wrong weight bits, so that the outputs of one
        picture, or of many, do not show them. The parameters are read back for that (`Kernel.read_back`).
        """
        return np.random.default_rng(0).integers(0, 256, self.observation_shape, dtype=np.uint8)

    @property
    def macs(self) -> int:
        """Multiply-accumulates per inference."""
        return sum(layer.macs for layer in self.layers)

    @property
    def weight_bits(self) -> int:
        """Signs in the whole network."""
        return sum(layer.out_channels * layer.fan_in for layer in self.layers)

    def __str__(self) -> str:
        sizes = f"C={self.channels}, N={self.hidden_units}, |A|={self.actions}"
        if len(self.action_dims) > 1:
            sizes += f" ({'+'.join(map(str, self.action_dims))})"
        if self.convolutions != PAPER_CONVOLUTIONS:
            sizes += f", conv {format_convolutions(self.convolutions)}"
        if self.image_px != IMAGE_SIZE_PX:
            sizes += f", {self.image_px} px"
        return sizes
