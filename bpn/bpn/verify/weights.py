"""How two versions of the weights compare, and the digest of one."""

import hashlib
import struct

import numpy as np
import torch
from torch import Tensor

from bpn.verify.play import Policy
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.weights import Weights
from bpn_shared.spec.network import NetworkSpec


def same_bits(one: Policy, other: Policy) -> bool:
    """Whether they compute the same, bit by bit."""
    return one.scale == other.scale and all(
        torch.equal(a, b) for a, b in zip(_parts(one), _parts(other), strict=True)
    )


def distance(found: Policy, expected: Policy) -> float:
    """Of float weights relative to their norm, the largest of all layers; of binarized ones the share of signs."""
    pairs = zip(_parts(found), _parts(expected), strict=True)
    if found.binary:
        return different_signs(found, expected)
    return max(float((a - b).norm() / b.norm().clamp_min(1e-12)) for a, b in pairs)


def different_signs(found: Policy, expected: Policy) -> float:
    """Share of signs that differ, where channels may have all of theirs turned."""
    unequal, total = 0.0, 0
    for a, b in zip(found.rows, expected.rows, strict=True):
        share = (a != b).float().mean(dim=1)
        unequal += float(torch.minimum(share, 1 - share).sum()) * a.shape[1]
        total += a.numel()
    return unequal / total


def described(found: Policy, expected: Policy) -> tuple[str, str]:
    """The difference in words."""
    if not found.binary:
        return f"weights {distance(found, expected):.2g} of their norm away", "those trained again"
    signs = sum(int((a != b).sum()) for a, b in zip(found.rows, expected.rows, strict=True))
    taus = sum(
        int((a != b).sum()) for a, b in zip(found.thresholds, expected.thresholds, strict=True)
    )
    total = sum(rows.numel() for rows in found.rows)
    channels = sum(len(tau) for tau in found.thresholds)
    return (
        f"{signs} of {total} signs and {taus} of {channels} thresholds differ, lambda {found.scale:.6g}",
        f"the same bits, lambda {expected.scale:.6g}",
    )


def digest(weights: Weights) -> str:
    """SHA-256 of what a policy computes: geometry, then lambda, signs and thresholds, or the ONNX model.

    Of another shape than the paper's, layers and dimensions of actions stand behind lambda.
    """
    spec = weights.spec
    sizes = struct.pack("<HHH", spec.channels, spec.hidden_units, spec.actions)
    if isinstance(weights, FloatWeights):
        return hashlib.sha256(sizes + weights.model).hexdigest()
    bits = [
        np.packbits(signs.ravel() == 1, bitorder="little").tobytes() for signs in weights.weights
    ]
    taus = [tau.astype("<i4").tobytes() for tau in weights.thresholds]
    paper = NetworkSpec(spec.channels, spec.hidden_units, spec.actions)
    numbers = [spec.image_px, len(spec.convolutions), len(spec.action_dims)]
    numbers += [n for convolution in spec.convolutions for n in convolution] + [*spec.action_dims]
    shape = b"" if spec == paper else struct.pack(f"<{len(numbers)}H", *numbers)
    return hashlib.sha256(
        sizes + struct.pack("<f", weights.scale) + shape + b"".join(bits + taus)
    ).hexdigest()


def _parts(policy: Policy) -> list[Tensor]:
    return [*policy.rows, *policy.thresholds, *policy.biases]
