"""The definition of correct: the network's forward pass in plain integer numpy, nothing packed.

Every other kernel, the learner's export and the hardware are tested against `forward`.
"""

import numpy as np
import numpy.typing as npt

from bpn_shared.bnn.blob import WeightBlob
from bpn_shared.spec.network import Layer, NetworkSpec

Observation = npt.NDArray[np.uint8]
Integers = npt.NDArray[np.int32]


def check_observation(spec: NetworkSpec, observation: Observation) -> None:
    """Refuses anything but uint8[C, rows, columns] of the network.

    Raises:
        ValueError: the dtype or the shape is another; the message names both.
    """
    if observation.dtype != np.uint8 or observation.shape != spec.observation_shape:
        raise ValueError(
            f"observation is {observation.dtype}{list(observation.shape)}, "
            f"the network ({spec}) takes uint8{list(spec.observation_shape)}"
        )


def patches(layer: Layer, x: Integers) -> Integers:
    """The layer's input patches.

    Args:
        x: int32[in_size, in_size, in_channels].

    Returns:
        int32[out_size, out_size, fan_in], fan_in in the order (kernel row, kernel column, channel).
    """
    windows = np.lib.stride_tricks.sliding_window_view(x, (layer.kernel, layer.kernel), axis=(0, 1))
    strided = windows[:: layer.stride, :: layer.stride]  # [row, column, channel, kernel, kernel]
    return strided.transpose(0, 1, 3, 4, 2).reshape(layer.out_size, layer.out_size, layer.fan_in)


def forward(blob: WeightBlob, observation: Observation) -> tuple[Integers, ...]:
    """Every layer's o, the paper's Eq. 11a, with the activation of Eq. 13: x = +1 iff o >= tau, else -1.

    o is the true ±1 sum, 2·popcount(XNOR) - n for n inputs (the paper's Eq. 12 leaves 2p - n out).

    Args:
        blob: the weights.
        observation: uint8[C, rows, columns].

    Returns:
        Every layer's integers, int32[out_size, out_size, out_channels], or int32[out_channels] where out_size
        is 1; of the paper's shape int32[20,20,8], int32[9,9,16], int32[7,7,16], int32[N], int32[|A|].

    Raises:
        ValueError: the observation does not fit the blob's geometry.
    """
    check_observation(blob.spec, observation)
    x = observation.transpose(1, 2, 0).astype(np.int32)
    outputs: list[Integers] = []
    for index, (layer, signs) in enumerate(zip(blob.spec.layers, blob.weights, strict=True)):
        o = patches(layer, x) @ signs.T.astype(np.int32)
        outputs.append(o if layer.out_size > 1 else o.reshape(-1))
        if index < len(blob.thresholds):
            x = np.where(o >= blob.thresholds[index], np.int32(1), np.int32(-1))
    return tuple(outputs)
