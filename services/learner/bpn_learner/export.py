"""A float network as the policy that the robots run."""

from typing import TYPE_CHECKING
from uuid import UUID

import torch

from bpn_learner.layers import as_kernels
from bpn_shared.bnn.envelope import NO_RUN
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.onnx_model import onnx_model

if TYPE_CHECKING:
    from bpn_learner.networks import FloatNetwork


@torch.no_grad()
def float_weights(
    network: "FloatNetwork", *, run: UUID = NO_RUN, attempt: int = 0, version: int = 0
) -> FloatWeights:
    """The network as an ONNX model, with P of the probe for whoever loads it.

    Raises:
        BlobError: P of the probe is not finite.
    """
    spec = network.spec
    weights, biases = [], []
    for layer, (weight, bias) in zip(spec.layers, network.affine(), strict=True):
        weights.append(as_kernels(layer, weight).cpu().contiguous().numpy())
        biases.append(bias.cpu().numpy())
    probe = torch.from_numpy(spec.probe())[None].float().to(network.weights.device)
    outputs = network(probe)[0].cpu().numpy()
    return FloatWeights(spec, onnx_model(spec, weights, biases), outputs, run, attempt, version)
