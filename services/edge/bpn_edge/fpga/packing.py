"""What the core is fed with: weight sets as words, pictures as beats; and back from its memories.

A set is one stream of 32-bit words: there is no address map on which generator and hardware could disagree:
identity, sizes and bank, epoch, the words of conv1's memory, its thresholds, the words of the engine's memory, and
the CRC-32 of all before (`services/edge/rtl/bpn_loader.sv`).
"""

import zlib
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from bpn_edge.fpga.build import BLOCK_PX, LANES, Build, groups
from bpn_edge.fpga.package import set_identity
from bpn_shared.bnn.blob import Parameters, WeightBlob, canonical_thresholds
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.golden import Observation
from bpn_shared.spec.network import Layer, NetworkSpec

Words = npt.NDArray[np.uint32]
Bits = npt.NDArray[np.uint8]
_NEVER = -785
"""Bias of a unit that is none: it stays inactive, and what follows has +1 at it, so that they never agree."""


def weight_set(build: Build, blob: WeightBlob, *, bank: int, epoch: int) -> Words:
    """The set that loads a policy into a bank, uint32[n]."""
    spec = blob.spec
    stacked = build.frames(spec.channels) - 1
    sizes = spec.channels | stacked << 6 | bank << 7 | spec.actions << 8 | spec.hidden_units << 16
    header = np.array([set_identity(build), sizes, epoch], np.uint32)
    body = np.concatenate((header, *memories(build, blob)))
    return np.append(body, np.uint32(zlib.crc32(body.astype("<u4").tobytes())))


def memories(build: Build, blob: WeightBlob) -> tuple[Words, Words, Words]:
    """What a policy is in the core: conv1's weights, its thresholds, the engine's words; uint32[...] each."""
    conv1, conv2, conv3, fc1, _ = blob.spec.layers
    thresholds = canonical_thresholds(conv1, blob.thresholds[0]).view(np.uint32)
    bits = [(signs > 0).astype(np.uint8) for signs in blob.weights]
    node_groups = groups(fc1.out_channels)
    convolutions = [
        part
        for layer, tau, bit in zip((conv2, conv3), blob.thresholds[1:], bits[1:], strict=False)
        for part in (_biases(layer, tau), _words(bit.reshape(LANES, -1, LANES)))
    ]
    fc1_bits = _padded(bits[3], node_groups * LANES, axis=0, with_=0).reshape(
        node_groups, LANES, -1, LANES
    )
    fc2_bits = _padded(bits[4], node_groups * LANES, axis=1, with_=1)
    fc2_bits = _padded(fc2_bits, groups(blob.spec.actions) * LANES, axis=0, with_=1).reshape(
        -1, LANES, node_groups, LANES
    )
    engine = np.concatenate(
        (
            *convolutions,
            _biases(fc1, blob.thresholds[3]),
            _packed(fc1_bits.transpose(2, 0, 1, 3)),  # input word, group, output, input
            _packed(fc2_bits.transpose(0, 2, 1, 3)),  # group, input word, output, input
        )
    )
    return _conv1_words(build, conv1, bits[0]), thresholds, engine


def parameters(build: Build, spec: NetworkSpec, held: tuple[Words, Words, Words]) -> Parameters:
    """The policy that is in the core's memories, as `WeightBlob.parameters` names it.

    Raises:
        BlobError: they hold what no policy is stored as.
    """
    conv1, conv2, conv3, fc1, fc2 = spec.layers
    node_groups, action_groups = groups(spec.hidden_units), groups(spec.actions)
    frames = build.frames(spec.channels)
    sides = _unpacked(held[0]).reshape(
        4, build.beats(spec.channels), frames, 2, 2, conv1.out_channels, build.pixel_bytes
    )
    sides = sides.transpose(5, 3, 0, 4, 2, 1, 6).reshape(
        conv1.out_channels, 2, 4, 2, frames, -1
    )  # output, half, row, half, frame, byte
    sides = sides[..., : BLOCK_PX * spec.channels // frames].reshape(*sides.shape[:5], BLOCK_PX, -1)
    words = held[2].reshape(-1, 8)
    at = np.cumsum((0, 1, 8, 1, 9, node_groups, 49 * node_groups, action_groups * node_groups))
    parts = [words[begin:end] for begin, end in pairwise(at)]
    bits = {
        "conv1": sides[..., ::-1, :, :].transpose(0, 1, 2, 3, 5, 4, 6).reshape(conv1.weight_shape),
        "conv2": _unpacked(parts[1])
        .reshape(-1, LANES, LANES)
        .transpose(1, 0, 2)
        .reshape(conv2.weight_shape),
        "conv3": _unpacked(parts[3])
        .reshape(-1, LANES, LANES)
        .transpose(1, 0, 2)
        .reshape(conv3.weight_shape),
        "fc1": _unpacked(parts[5])
        .reshape(49, -1, LANES)
        .transpose(1, 0, 2)
        .reshape(-1, fc1.fan_in)[: spec.hidden_units],
        "fc2": _unpacked(parts[6])
        .reshape(action_groups, node_groups, LANES, LANES)
        .transpose(0, 2, 1, 3)
        .reshape(-1, node_groups * LANES)[: spec.actions, : fc2.fan_in],
    }
    taus = {"conv1": held[1].view(np.int32)} | {
        layer.name: _thresholds(layer, part)
        for layer, part in ((conv2, parts[0]), (conv3, parts[2]), (fc1, parts[4]))
    }
    found = WeightBlob(
        spec,
        tuple((bits[name].astype(np.int8) * 2 - 1) for name in bits),
        tuple(taus[name] for name in taus),
        scale=1.0,
    )
    if any(not np.array_equal(a, b) for a, b in zip(memories(build, found), held, strict=True)):
        raise BlobError("the core's memory holds what no policy is stored as")
    return found.parameters()


def beats(build: Build, frame: Observation) -> Bits:
    """What is sent of an observation, uint8[c, 84, 84], as the stream of pixels: uint8[beats, pixel_bytes].

    In raster order: row, column, channel; each block of 4 pixels begins with a beat of its own.
    """
    blocks = frame.transpose(1, 2, 0).reshape(-1, BLOCK_PX * len(frame))
    return _padded(blocks, _whole(build, blocks.shape[1]), axis=1, with_=0).reshape(
        -1, build.pixel_bytes
    )


def _whole(build: Build, size: int) -> int:
    """Bytes of the beats that so many bytes take."""
    return -(-size // build.pixel_bytes) * build.pixel_bytes


def _conv1_words(build: Build, conv1: Layer, bits: Bits) -> Words:
    frames = build.frames(conv1.in_channels)
    block = BLOCK_PX * conv1.in_channels // frames
    sides = bits.reshape(
        conv1.out_channels, 2, 4, 2, BLOCK_PX, frames, -1
    )  # output, half, row, half, pixel, frame, channel
    sides = sides.transpose(0, 1, 2, 3, 5, 4, 6).reshape(*sides.shape[:4], frames, block)
    sides = _padded(sides[..., ::-1, :], _whole(build, block), axis=5, with_=0)
    sides = sides.reshape(*sides.shape[:5], -1, build.pixel_bytes)
    # row, beat, frame | half, half, output, byte
    return _packed(sides.transpose(2, 5, 4, 1, 3, 0, 6))


def _words(bits: Bits) -> Words:
    """[output, word, input] as the engine reads it: a word has 16 inputs of 16 outputs."""
    return _packed(bits.transpose(1, 0, 2))


def _biases(layer: Layer, tau: npt.NDArray[np.int32]) -> Words:
    """A sum of agreeing inputs that begins here is not below 0 iff o >= tau."""
    least = (canonical_thresholds(layer, tau) + layer.fan_in) // 2
    return (
        _padded(-least.astype(np.int16), groups(len(tau)) * LANES, axis=0, with_=_NEVER)
        .view("<u4")
        .astype(np.uint32)
    )


def _thresholds(layer: Layer, biases: Words) -> npt.NDArray[np.int32]:
    least = -biases.reshape(-1).astype("<u4").view("<i2")[: layer.out_channels].astype(np.int32)
    return (2 * least - layer.fan_in).astype(np.int32)


def _padded(values: npt.NDArray[Any], size: int, *, axis: int, with_: int) -> npt.NDArray[Any]:
    widths = [(0, 0)] * values.ndim
    widths[axis] = (0, size - values.shape[axis])
    return np.pad(values, widths, constant_values=with_)


def _packed(bits: Bits) -> Words:
    return (
        np.packbits(np.ascontiguousarray(bits).reshape(-1), bitorder="little")
        .view("<u4")
        .astype(np.uint32)
    )


def _unpacked(words: Words) -> Bits:
    return np.unpackbits(words.astype("<u4").reshape(-1).view(np.uint8), bitorder="little")
