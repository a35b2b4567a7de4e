"""Gradients of one minibatch's loss J (section IV-C): by autograd, or by the kernel written for it.

`autograd_gradients` is the definition. `native_gradients` is what training runs: the same sums in C++
(`src/`), without unfolded patches, graphs or small operators; docs/learner-speed.md has its measurements.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from bpn_learner import _native
from bpn_learner.networks import BinaryNetwork, FloatNetwork, PNetwork
from bpn_shared.config import Engine

Gradients = Callable[[Tensor], Tensor | float]
"""Sets every parameter's `grad` from the transitions int64[B] of D, and returns their mean loss."""


def available_paths() -> tuple[str, ...]:
    """The kernel's instruction-set paths that this machine can run, best first."""
    return tuple(_native.available_paths())


def minibatch_gradients(
    engine: Engine, network: PNetwork, observations: Tensor, actions: Tensor, y: Tensor
) -> Gradients:
    """The engine's gradients of a network in training mode.

    "fast" is the kernel, on a CPU; there is none for a GPU, which computes as "plain" does.

    Args:
        observations: uint8[n, C, 84, 84], channels-last in memory.
        actions: int64[n].
        y: targets, float32[n].
    """
    pixels = observations.permute(0, 2, 3, 1)
    if engine == "fast" and not pixels.is_cuda:
        if isinstance(network, BinaryNetwork):
            return native_gradients(network, pixels, actions, y)
        if isinstance(network, FloatNetwork):
            return native_float_gradients(network, pixels, actions, y)
    return autograd_gradients(network, pixels, actions, y)


def autograd_gradients(network: PNetwork, pixels: Tensor, actions: Tensor, y: Tensor) -> Gradients:
    """By torch's autograd, for any network.

    Args:
        pixels: uint8[n, 84, 84, C]: rows that index_select copies whole.
    """

    def gradients(batch: Tensor) -> Tensor:
        P = network(pixels.index_select(0, batch).float().permute(0, 3, 1, 2))
        P_taken = P.gather(1, actions[batch, None]).squeeze(1)
        loss = (y[batch] - P_taken).square().mean() / 2  # J, section IV-C
        network.zero_grad()
        loss.backward()
        mean: Tensor = loss.detach()
        return mean

    return gradients


def native_gradients(
    network: BinaryNetwork, pixels: Tensor, actions: Tensor, y: Tensor, *, path: str | None = None
) -> Gradients:
    """By the kernel. Equal inputs give equal bits on one path, wherever memory lies.

    Args:
        pixels: uint8[n, 84, 84, C], contiguous.
        path: one of `available_paths`; by default the best.

    Raises:
        ValueError: this machine cannot run that path, or the arrays are not of this network.
    """
    spec = network.spec
    kernel = _native.Kernel(path or available_paths()[0], spec.channels, spec.nodes, spec.actions)
    vectors = (network.latent, network.gamma, network.beta)
    parameters = (*vectors, network.log_scale)
    grads = [torch.zeros_like(parameter) for parameter in parameters]
    # The kernel reads parameters and writes gradients in place: these arrays share the tensors' memory.
    latent, gamma, beta = (parameter.detach().numpy() for parameter in vectors)
    d_latent, d_gamma, d_beta = (grad.numpy() for grad in grads[:-1])
    observations, taken, targets = pixels.numpy(), actions.numpy(), y.numpy()

    def gradients(batch: Tensor) -> float:
        loss, d_log_scale = kernel.gradients(
            observations, batch.numpy(), taken, targets,
            latent, gamma, beta, network.log_scale.item(), d_latent, d_gamma, d_beta,
        )  # fmt: skip
        grads[-1].fill_(d_log_scale)
        for parameter, grad in zip(parameters, grads, strict=True):
            parameter.grad = grad
        return loss

    return gradients


def native_float_gradients(
    network: FloatNetwork, pixels: Tensor, actions: Tensor, y: Tensor, *, path: str | None = None
) -> Gradients:
    """By the kernel for float networks; otherwise as `native_gradients`."""
    spec = network.spec
    kernel = _native.FloatKernel(
        path or available_paths()[0], spec.channels, spec.nodes, spec.actions
    )
    parameters = (network.weights, network.biases)
    grads = [torch.zeros_like(parameter) for parameter in parameters]
    arrays = [t.detach().numpy() for t in (*parameters, *grads)]  # they share the tensors' memory
    observations, taken, targets = pixels.numpy(), actions.numpy(), y.numpy()

    def gradients(batch: Tensor) -> float:
        loss = kernel.gradients(observations, batch.numpy(), taken, targets, *arrays)
        for parameter, grad in zip(parameters, grads, strict=True):
            parameter.grad = grad
        return loss

    return gradients
