"""Networks and minibatches, the same for equal seeds, and what a float64 computation makes of them."""

import copy

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from bpn_learner.batch_norm import BATCH_NORM_EPSILON
from bpn_learner.minibatch import Gradients
from bpn_learner.networks import BinaryNetwork, FloatNetwork, PNetwork, dot_products
from bpn_shared.spec.network import NetworkSpec

TRANSITIONS = 12


def binary_network(spec: NetworkSpec, seed: int) -> BinaryNetwork:
    generator = torch.Generator().manual_seed(seed)
    network = BinaryNetwork(spec, scale_initial=0.2, generator=generator).train()
    network.latent.data.uniform_(-1.2, 1.2, generator=generator)  # some beyond the gate of Sign
    network.gamma.data.normal_(generator=generator)
    network.beta.data.normal_(generator=generator)
    return network


def float_network(spec: NetworkSpec, seed: int) -> FloatNetwork:
    network = FloatNetwork(spec, generator=torch.Generator().manual_seed(seed)).train()
    network.weights.data.mul_(2)  # so that the signal reaches the last layer
    return network


def data(spec: NetworkSpec, seed: int) -> tuple[Tensor, Tensor, Tensor]:
    rng = np.random.default_rng(seed)
    pixels = rng.integers(
        0, 256, (TRANSITIONS, spec.image_px, spec.image_px, spec.channels), np.uint8
    )
    actions = rng.integers(0, spec.actions, TRANSITIONS)
    y = rng.normal(size=TRANSITIONS).astype(np.float32)
    return torch.from_numpy(pixels), torch.from_numpy(actions), torch.from_numpy(y)


def named_gradients(network: PNetwork, gradients: Gradients, batch: Tensor) -> dict[str, Tensor]:
    network.zero_grad()
    loss = torch.as_tensor(float(gradients(batch)))
    named = {name: p.grad.clone() for name, p in network.named_parameters() if p.grad is not None}
    return {"loss": loss, **named}


@torch.no_grad()
def margin(network: BinaryNetwork, pixels: Tensor) -> float:
    """How far the nearest normalized value is from where Sign or its gradient jumps, in float64."""
    sizes = [layer.out_channels for layer in network.spec.layers[:-1]]
    gammas, betas = network.gamma.double().split(sizes), network.beta.double().split(sizes)
    x, nearest = pixels.double().permute(0, 3, 1, 2), float("inf")
    for layer, signs, gamma, beta in zip(
        network.spec.layers, network.signs(), gammas, betas, strict=False
    ):
        o = dot_products(layer, signs.double(), x)
        z = functional.batch_norm(o, None, None, gamma, beta, training=True, eps=BATCH_NORM_EPSILON)
        nearest = min(nearest, float(z.abs().min()), float((z.abs() - 1).abs().min()))
        x = torch.where(z >= 0, 1.0, -1.0).double()
    return nearest


def exact_gradients(
    network: PNetwork, pixels: Tensor, actions: Tensor, y: Tensor, batch: Tensor
) -> dict[str, Tensor]:
    double = copy.deepcopy(network).double()
    P = double(pixels[batch].double().permute(0, 3, 1, 2))
    loss = (y[batch] - P.gather(1, actions[batch, None]).squeeze(1)).square().mean() / 2
    loss.backward()
    named = {name: p.grad for name, p in double.named_parameters() if p.grad is not None}
    return {"loss": loss.detach(), **named}


def distance(found: Tensor, exact: Tensor) -> float:
    return float((found - exact).norm() / exact.norm().clamp_min(1e-12))
