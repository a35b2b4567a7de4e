"""A policy as it travels and rests: a weight blob (binarized) or a float policy, told apart by their magic."""

from bpn_shared.bnn.blob import MAGIC as BINARY_MAGIC
from bpn_shared.bnn.blob import WeightBlob, encoded_size
from bpn_shared.bnn.envelope import BlobError
from bpn_shared.bnn.float_weights import MAGIC as FLOAT_MAGIC
from bpn_shared.bnn.float_weights import FloatWeights, max_encoded_size
from bpn_shared.spec.algorithms import NetworkKind
from bpn_shared.spec.network import NetworkSpec

Weights = WeightBlob | FloatWeights
Rank = tuple[int, int]
NO_RANK: Rank = (-1, -1)
"""Below every policy's."""

_KINDS: dict[bytes, type[WeightBlob] | type[FloatWeights]] = {
    BINARY_MAGIC: WeightBlob,
    FLOAT_MAGIC: FloatWeights,
}


def decode_weights(data: bytes) -> Weights:
    """Reads the bytes of either kind.

    Raises:
        BlobError: they are neither, or damaged.
    """
    kind = _KINDS.get(data[:4])
    if kind is None:
        raise BlobError(f"starts with {data[:4]!r}, a policy starts with {sorted(_KINDS)}")
    return kind.decode(data)


def rank_of(weights: Weights) -> Rank:
    """What tells which of two policies of a run is newer: (attempt, version)."""
    return weights.attempt, weights.version


def network_kind(weights: Weights) -> NetworkKind:
    """What computes the policy's P."""
    return "binary" if isinstance(weights, WeightBlob) else "float"


def max_weights_bytes(kind: NetworkKind, spec: NetworkSpec) -> int:
    """The most bytes that a policy of that kind and geometry has."""
    return encoded_size(spec) if kind == "binary" else max_encoded_size(spec)
