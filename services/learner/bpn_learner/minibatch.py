"""Gradients of one minibatch's loss J (section IV-C): by autograd, or by the kernel written for it.

`autograd_gradients` is the definition. `native_gradients` is what training runs: the same sums in C++
(`src/`), without unfolded patches, graphs or small operators; docs/learner-speed.md has its measurements.
Either computes one member's part where a group of learners shares the minibatch, and adds the parts up.
"""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from bpn_learner import _native
from bpn_learner.group import SINGLE_PROCESS, Group
from bpn_learner.networks import BinaryNetwork, FloatNetwork, PNetwork
from bpn_shared.spec.network import NetworkSpec
from bpn_shared.spec.sections import Backend

Gradients = Callable[[Tensor], Tensor | float]
"""Sets every parameter's `grad` from the transitions int64[B] of D, and returns their mean loss.

A group's members all call it with the same transitions, and all get the same.
"""


def available_paths() -> tuple[str, ...]:
    """The kernel's instruction-set paths that this machine can run, best first."""
    return tuple(_native.available_paths())


def kernel_layers(spec: NetworkSpec) -> list[tuple[int, int, int, int, int]]:
    """The layers as the kernel is told them."""
    return [
        (layer.in_size, layer.in_channels, layer.kernel, layer.stride, layer.out_channels)
        for layer in spec.layers
    ]


def minibatch_gradients(
    backend: Backend,
    network: PNetwork,
    observations: Tensor,
    actions: Tensor,
    y: Tensor,
    *,
    group: Group = SINGLE_PROCESS,
) -> Gradients:
    """The backend's gradients of a network in training mode.

    "native" is the kernel, on a CPU; there is none for a GPU, which computes as "torch" does.

    Args:
        observations: uint8[n, C, rows, columns], channels-last in memory.
        actions: int64[n]; of D dimensions int64[n, D], the outputs that an action takes (`cvi.outputs_taken`).
        y: targets, float32[n].
        group: who shares the minibatches.
    """
    pixels = observations.permute(0, 2, 3, 1)
    if backend == "native" and not pixels.is_cuda:
        if isinstance(network, BinaryNetwork):
            return native_gradients(network, pixels, actions, y, group=group)
        if isinstance(network, FloatNetwork):
            return native_float_gradients(network, pixels, actions, y, group=group)
    return autograd_gradients(network, pixels, actions, y, group=group)


class _Gradients:
    """The gradients of all parameters and the loss, in one vector: a group adds them up in one exchange."""

    def __init__(self, parameters: Sequence[nn.Parameter]) -> None:
        self._parameters = parameters
        sizes = [parameter.numel() for parameter in parameters]
        self.vector = torch.zeros(sum(sizes) + 1, device=parameters[0].device)
        *parts, loss = torch.split(self.vector, [*sizes, 1])
        self.parts = [
            part.view(parameter.shape) for part, parameter in zip(parts, parameters, strict=True)
        ]
        self.loss = loss.squeeze()

    def set(self) -> None:
        """Makes the parts their parameters' `grad`."""
        for parameter, part in zip(self._parameters, self.parts, strict=True):
            parameter.grad = part


def autograd_gradients(
    network: PNetwork, pixels: Tensor, actions: Tensor, y: Tensor, *, group: Group = SINGLE_PROCESS
) -> Gradients:
    """By torch's autograd, for any network.

    Args:
        pixels: uint8[n, rows, columns, C]: rows that index_select copies whole.
    """
    together = _Gradients(list(network.parameters()))
    taken = actions.reshape(len(actions), -1)

    def gradients(batch: Tensor) -> Tensor:
        part = group.shard(batch)
        P = network(pixels.index_select(0, part).float().permute(0, 3, 1, 2), group)
        P_taken = P.gather(1, taken[part]).sum(dim=1)
        loss = (y[part] - P_taken).square().sum() / (2 * len(batch))  # J, section IV-C
        together.vector.zero_()
        together.set()
        loss.backward()
        together.loss.copy_(loss.detach())
        group.all_reduce_sum(together.vector)
        return together.loss.clone()

    return gradients


def native_gradients(
    network: BinaryNetwork,
    pixels: Tensor,
    actions: Tensor,
    y: Tensor,
    *,
    group: Group = SINGLE_PROCESS,
    path: str | None = None,
) -> Gradients:
    """By the kernel. Equal inputs give equal bits on one path, wherever memory lies.

    Args:
        pixels: uint8[n, rows, columns, C], contiguous.
        path: one of `available_paths`; by default the best.

    Raises:
        ValueError: this machine cannot run that path, or the arrays are not of this network.
    """
    kernel = _native.Kernel(path or available_paths()[0], kernel_layers(network.spec))
    vectors = (network.latent, network.gamma, network.beta)
    together = _Gradients([*vectors, network.log_scale])
    # The kernel reads parameters and writes gradients in place: these arrays share the tensors' memory.
    latent, gamma, beta = (parameter.detach().numpy() for parameter in vectors)
    d_latent, d_gamma, d_beta = (part.numpy() for part in together.parts[:-1])
    observations, targets = pixels.numpy(), y.numpy()
    taken = actions.reshape(len(actions), -1).contiguous().numpy()
    # Batch norm's statistics are the whole minibatch's.
    add_up = None if group.size == 1 else lambda sums: group.all_reduce_sum(torch.from_numpy(sums))

    def gradients(batch: Tensor) -> float:
        loss, d_log_scale = kernel.gradients(
            observations, group.shard(batch).numpy(), taken, targets,
            latent, gamma, beta, network.log_scale.item(), d_latent, d_gamma, d_beta,
            len(batch), add_up,
        )  # fmt: skip
        together.parts[-1].fill_(d_log_scale)
        together.loss.fill_(loss)
        group.all_reduce_sum(together.vector)
        together.set()
        return together.loss.item()

    return gradients


def native_float_gradients(
    network: FloatNetwork,
    pixels: Tensor,
    actions: Tensor,
    y: Tensor,
    *,
    group: Group = SINGLE_PROCESS,
    path: str | None = None,
) -> Gradients:
    """By the kernel for float networks; otherwise as `native_gradients`."""
    kernel = _native.FloatKernel(path or available_paths()[0], kernel_layers(network.spec))
    parameters = (network.weights, network.biases)
    together = _Gradients(parameters)
    # They share the tensors' memory.
    weights, biases = (parameter.detach().numpy() for parameter in parameters)
    d_weights, d_biases = (part.numpy() for part in together.parts)
    observations, targets = pixels.numpy(), y.numpy()
    taken = actions.reshape(len(actions), -1).contiguous().numpy()

    def gradients(batch: Tensor) -> float:
        loss = kernel.gradients(
            observations, group.shard(batch).numpy(), taken, targets,
            weights, biases, d_weights, d_biases, len(batch),
        )  # fmt: skip
        together.loss.fill_(loss)
        group.all_reduce_sum(together.vector)
        together.set()
        return together.loss.item()

    return gradients
