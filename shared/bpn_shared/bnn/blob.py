"""The weight blob: one binarized policy as bytes, about 12 KB, the form in which it travels and rests.

docs/weight-blob.md defines it, schema 2, which is written, and schema 1, which is read for ever; whoever changes
something here changes that page, from which others write their own decoders.
"""

import hashlib
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self
from uuid import UUID

import numpy as np
import numpy.typing as npt

from bpn_shared.bnn.envelope import NO_RUN, BlobError, Envelope, Header, aligned, check_provenance
from bpn_shared.spec.network import Layer, NetworkSpec

Signs = npt.NDArray[np.int8]
Thresholds = npt.NDArray[np.int32]
Parameters = dict[str, npt.NDArray[Any]]
"""Of a policy, by name."""

MAGIC = b"BPNW"
_ENVELOPE = Envelope("weight blob", MAGIC, own="f")
_WORD_BITS = 32


@dataclass(frozen=True, eq=False)
class WeightBlob:
    """A binarized policy with its provenance.

    Attributes:
        weights: per layer int8[out, fan_in] of -1 and +1 (see `Layer.weight_shape`).
        thresholds: tau of all layers but the last, int32[out]; the activation is +1 iff o >= tau.
        scale: lambda of P = lambda * o of the last layer, a finite float32 above 0.
        attempt: how many learners have owned the run.
        version: policy updates done; 0 is the initial policy.

    Raises:
        BlobError: a part has another shape, dtype or value.
    """

    spec: NetworkSpec
    weights: tuple[Signs, ...]
    thresholds: tuple[Thresholds, ...]
    scale: float
    run: UUID = NO_RUN
    attempt: int = 0
    version: int = 0

    def __post_init__(self) -> None:
        layers = self.spec.layers
        _check_arrays("weights", self.weights, [layer.weight_shape for layer in layers], np.int8)
        _check_arrays(
            "thresholds",
            self.thresholds,
            [(layer.out_channels,) for layer in layers[:-1]],
            np.int32,
        )
        for layer, signs in zip(layers, self.weights, strict=True):
            if not np.all(np.abs(signs) == 1):
                raise BlobError(f"weights of {layer.name} hold values other than -1 and +1")
        if not (np.isfinite(np.float32(self.scale)) and np.float32(self.scale) > 0):
            raise BlobError(f"scale (lambda) = {self.scale} must be a finite float32 above 0")
        check_provenance(self.attempt, self.version)

    @classmethod
    def random(cls, spec: NetworkSpec, rng: np.random.Generator) -> Self:
        """A blob with random signs, and thresholds spread over where each layer's sums lie."""
        weights = tuple(
            rng.choice(np.array([-1, 1], np.int8), size=layer.weight_shape) for layer in spec.layers
        )
        thresholds = tuple(
            np.rint(
                rng.normal(0, np.sqrt(layer.fan_in) * layer.max_input, layer.out_channels)
            ).astype(np.int32)
            for layer in spec.layers[:-1]
        )
        return cls(spec, weights, thresholds, scale=float(np.float32(rng.uniform(0.05, 0.5))))

    def parameters(self) -> Parameters:
        """Every weight and threshold by name, as what is read back from a kernel's memory is compared with.

        Of the thresholds that decide alike for every sum o that can occur, the one that stands for all.
        """
        layers = self.spec.layers
        weights = {
            f"weights of {layer.name}": signs
            for layer, signs in zip(layers, self.weights, strict=True)
        }
        thresholds = {
            f"thresholds of {layer.name}": canonical_thresholds(layer, tau)
            for layer, tau in zip(layers[:-1], self.thresholds, strict=True)
        }
        return weights | thresholds

    def content_sha256(self) -> str:
        """SHA-256 (hex) of what the policy computes: geometry, signs, thresholds, lambda.

        Run, attempt and version are left out: equal policies have equal digests whoever made them. Of the paper's
        shape it is that of all versions of this program: C, N, |A|, lambda, and schema 1's signs and thresholds.
        """
        digest = hashlib.sha256(
            struct.pack(
                "<HHHf", self.spec.channels, self.spec.hidden_units, self.spec.actions, self.scale
            )
        )
        if not self.spec.is_paper_shape:
            digest.update(_shape_bytes(self.spec))
        for signs in self.weights:
            digest.update(np.packbits(signs > 0, bitorder="little").tobytes())
        for tau in self.thresholds:
            digest.update(tau.astype("<i4").tobytes())
        return digest.hexdigest()

    def encode(self) -> bytes:
        """The blob as bytes, `encoded_size(spec)` of them."""
        header = Header(self.spec, self.run, self.attempt, self.version, self.scale)
        sections = [
            *map(_packed_rows, self.weights),
            *(tau.astype("<i4").tobytes() for tau in self.thresholds),
        ]
        body = b"".join(section.ljust(aligned(len(section)), b"\0") for section in sections)
        return _ENVELOPE.seal(header, body)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Reads `encode`'s bytes, and those of schema 1.

        Raises:
            BlobError: truncated, oversized, altered, of another schema, or not a blob at all.
        """
        opened = _ENVELOPE.open(data)
        form = _FORMS[opened.schema]
        header = opened.header
        body = _ENVELOPE.body(data, opened, form.size(header.spec))
        weights, thresholds = form.split(header.spec, body)
        return cls(
            header.spec, weights, thresholds, header.own, header.run, header.attempt, header.version
        )


def canonical_thresholds(layer: Layer, tau: Thresholds) -> Thresholds:
    """int32[out]: each the largest that decides as tau does for every sum that the layer can have.

    Sums of pixels are any integer in -max..max, sums of n signs are n, n-2, ... -n.
    """
    wide, most = tau.astype(np.int64), layer.max_output
    if layer.max_input == 1:
        wide = layer.fan_in - 2 * ((layer.fan_in - wide) // 2)
        return np.clip(wide, -most, most + 2).astype(np.int32)
    return np.clip(wide, -most, most + 1).astype(np.int32)


def encoded_size(spec: NetworkSpec) -> int:
    """Bytes of a blob with this geometry."""
    return _ENVELOPE.size(spec, _aligned_bytes(spec))


def _shape_bytes(spec: NetworkSpec) -> bytes:
    numbers = [spec.image_px, len(spec.convolutions), len(spec.action_dims)]
    numbers += [number for convolution in spec.convolutions for number in convolution]
    return struct.pack(f"<{len(numbers) + len(spec.action_dims)}H", *numbers, *spec.action_dims)


_Parts = tuple[tuple[Signs, ...], tuple[Thresholds, ...]]


@dataclass(frozen=True)
class _Form:
    """How a schema lays a policy's parameters out: in how many bytes, and how they are read."""

    size: Callable[[NetworkSpec], int]
    split: Callable[[NetworkSpec, bytes], _Parts]


# Schema 2: every section begins at a multiple of 64 bytes, every row of signs at one of 4.


def _row_words(layer: Layer) -> int:
    return -(-layer.fan_in // _WORD_BITS)


def _packed_rows(signs: Signs) -> bytes:
    bits = np.packbits(signs > 0, axis=1, bitorder="little")
    missing = -bits.shape[1] % (_WORD_BITS // 8)
    return np.pad(bits, ((0, 0), (0, missing))).tobytes()


def _aligned_bytes(spec: NetworkSpec) -> int:
    signs = sum(aligned(4 * layer.out_channels * _row_words(layer)) for layer in spec.layers)
    return signs + sum(aligned(4 * layer.out_channels) for layer in spec.layers[:-1])


def _split_aligned(spec: NetworkSpec, body: bytes) -> _Parts:
    offset = 0

    def section(what: str, size: int) -> bytes:
        nonlocal offset
        found = body[offset : offset + aligned(size)]
        if any(found[size:]):
            raise BlobError(f"padding behind the {what} is not zero")
        offset += len(found)
        return found[:size]

    weights = []
    for layer in spec.layers:
        what = f"signs of {layer.name}"
        raw = np.frombuffer(section(what, 4 * layer.out_channels * _row_words(layer)), np.uint8)
        bits = np.unpackbits(raw.reshape(layer.out_channels, -1), axis=1, bitorder="little")
        if bits[:, layer.fan_in :].any():
            raise BlobError(f"padding bits of the {what} are not zero")
        weights.append(bits[:, : layer.fan_in].astype(np.int8) * 2 - 1)
    thresholds = tuple(
        np.frombuffer(section(f"thresholds of {layer.name}", 4 * layer.out_channels), "<i4").astype(
            np.int32
        )
        for layer in spec.layers[:-1]
    )
    return tuple(weights), thresholds


# Schema 1: one after the other, each layer's signs padded to a whole byte.


def _packed_bytes(layer: Layer) -> int:
    return (layer.out_channels * layer.fan_in + 7) // 8


def _dense_bytes(spec: NetworkSpec) -> int:
    thresholds = sum(4 * layer.out_channels for layer in spec.layers[:-1])
    return sum(map(_packed_bytes, spec.layers)) + thresholds


def _split_dense(spec: NetworkSpec, body: bytes) -> _Parts:
    raw = np.frombuffer(body, np.uint8)
    weights: list[Signs] = []
    thresholds: list[Thresholds] = []
    offset = 0
    for layer in spec.layers:
        count = layer.out_channels * layer.fan_in
        bits = np.unpackbits(raw[offset : offset + _packed_bytes(layer)], bitorder="little")
        if bits[count:].any():
            raise BlobError(f"padding bits of {layer.name} are not zero")
        weights.append((bits[:count].astype(np.int8) * 2 - 1).reshape(layer.weight_shape))
        offset += _packed_bytes(layer)
    for layer in spec.layers[:-1]:
        thresholds.append(np.frombuffer(body, "<i4", layer.out_channels, offset).astype(np.int32))
        offset += 4 * layer.out_channels
    return tuple(weights), tuple(thresholds)


_FORMS = {1: _Form(_dense_bytes, _split_dense), 2: _Form(_aligned_bytes, _split_aligned)}


def _check_arrays(
    name: str,
    arrays: Sequence[npt.NDArray[np.generic]],
    shapes: Sequence[tuple[int, ...]],
    dtype: type[np.generic],
) -> None:
    found = [(str(array.dtype), array.shape) for array in arrays]
    expected = [(np.dtype(dtype).name, shape) for shape in shapes]
    if found != expected:
        raise BlobError(f"{name} are {found}, the geometry needs {expected}")
