"""A trained network as the policy that the robots run."""

from uuid import UUID

import torch

from bpn_learner.fold import fold
from bpn_learner.networks import BinaryNetwork, FloatNetwork, PNetwork, as_kernels
from bpn_shared.bnn.envelope import NO_RUN
from bpn_shared.bnn.float_weights import FloatWeights
from bpn_shared.bnn.onnx_model import onnx_model
from bpn_shared.bnn.weights import Weights


def export(network: PNetwork, *, run: UUID = NO_RUN, attempt: int = 0, version: int = 0) -> Weights:
    """The evaluated network: a binarized one folded, a float one as an ONNX model.

    Raises:
        BlobError: a value is not finite.
        TypeError: the network is of neither kind.
    """
    if isinstance(network, BinaryNetwork):
        return fold(network, run=run, attempt=attempt, version=version)
    if isinstance(network, FloatNetwork):
        return float_weights(network, run=run, attempt=attempt, version=version)
    raise TypeError(f"a {type(network).__name__} cannot be exported")


@torch.no_grad()
def float_weights(
    network: FloatNetwork, *, run: UUID = NO_RUN, attempt: int = 0, version: int = 0
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
