"""Geometry of the paper's network: Conv(8,4,8), Conv(4,2,16), Conv(3,1,16), FC(N), FC(|A|).

A fully connected layer is a convolution whose kernel covers its whole input, so all five layers have
one form: every output integer is the dot product of a patch, flattened in the order (kernel row,
kernel column, input channel), with one row of signs.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

IMAGE_SIZE_PX = 84
MAX_CHANNELS = 16
MAX_HIDDEN_UNITS = 1024
MAX_ACTIONS = 64
MAX_PIXEL = 255
LAYERS = ("conv1", "conv2", "conv3", "fc1", "fc2")


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


@dataclass(frozen=True)
class NetworkSpec:
    """The network's free sizes.

    Args:
        channels: C, image channels of an observation (stacked frames included), 1..16.
        hidden_units: N, units of the first fully connected layer, 1..1024.
        actions: |A|, action preferences, 2..64.

    Raises:
        ValueError, TypeError: a size is outside its range; the message names it.
    """

    channels: int
    hidden_units: int
    actions: int

    def __post_init__(self) -> None:
        _check("channels", self.channels, 1, MAX_CHANNELS)
        _check("hidden_units", self.hidden_units, 1, MAX_HIDDEN_UNITS)
        _check("actions", self.actions, 2, MAX_ACTIONS)

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        """The five layers, from the pixels to o_5."""
        conv1 = Layer(LAYERS[0], IMAGE_SIZE_PX, self.channels, 8, 4, 8, MAX_PIXEL)
        conv2 = Layer(LAYERS[1], conv1.out_size, conv1.out_channels, 4, 2, 16, 1)
        conv3 = Layer(LAYERS[2], conv2.out_size, conv2.out_channels, 3, 1, 16, 1)
        fc1 = Layer(
            LAYERS[3], conv3.out_size, conv3.out_channels, conv3.out_size, 1, self.hidden_units, 1
        )
        fc2 = Layer(LAYERS[4], fc1.out_size, fc1.out_channels, 1, 1, self.actions, 1)
        return conv1, conv2, conv3, fc1, fc2

    @property
    def observation_shape(self) -> tuple[int, int, int]:
        """[C, 84, 84]."""
        return self.channels, IMAGE_SIZE_PX, IMAGE_SIZE_PX

    def probe(self) -> npt.NDArray[np.uint8]:
        """The observation, uint8[C, 84, 84], on which a kernel's arithmetic is tried.

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
        return f"C={self.channels}, N={self.hidden_units}, |A|={self.actions}"
