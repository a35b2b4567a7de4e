"""P-networks: binarized (BPN, BQN) and floating point (CVI, DPP, DQN).

All weights of a network (of a binarized one, the latent weights) are one vector in the weight blob's
order (layer; out, kernel row, kernel column, input channel). That is also the memory order of
channels-last convolution kernels, so export is `sign` alone; and one vector is one kernel launch for
signs, optimizer and clipping.

Inputs are pixel values 0..255 in float32. Every sum a binarized layer can form is an integer below
2**24 (conv1: at most 255 * 256 * 16), so float32 holds it exactly, in any order of summation.
"""

from collections.abc import Callable, Iterable
from typing import Any
from uuid import UUID

import torch
from torch import Tensor, nn

from bpn_learner.batch_norm import BATCH_NORM_EPSILON, batch_norm
from bpn_learner.binarize import sign
from bpn_learner.calibrate import reestimate_batch_norm
from bpn_learner.export import float_weights
from bpn_learner.fold import fold
from bpn_learner.group import SINGLE_PROCESS, Group
from bpn_learner.layers import activation, dot_products, exact_dot_products
from bpn_shared.bnn.envelope import NO_RUN
from bpn_shared.bnn.weights import Weights
from bpn_shared.spec.algorithms import NetworkKind
from bpn_shared.spec.network import MAX_PIXEL, Layer, NetworkSpec

SCALE_RATE_FACTOR = 3.0
LATENT_INITIAL = 0.1  # small against the clip at 1: early on, signs are free to flip


class PNetwork(nn.Module):
    """Action preferences P(s, .): pixels float32[B, C, rows, columns] of 0..255 to float32[B, |A|].

    In training the pixels may be one member's part of a minibatch that a group shares.

    Attributes:
        offset: float64[], what all preferences lack alike, see `update.targets`; no policy depends on it.
    """

    offset: Tensor

    def __init__(self, spec: NetworkSpec) -> None:
        super().__init__()
        self.spec = spec
        self.register_buffer("offset", torch.zeros((), dtype=torch.float64))

    def clip_latent_weights(self) -> None:
        """What every optimizer step is followed by; nothing where no weight is binarized."""

    def scale(self) -> Tensor:
        """The factor lambda of P, float32[]; 1 where there is none."""
        return torch.ones(())

    def max_preference(self) -> float:
        """Largest |P| that the network can express."""
        return float("inf")

    def parameter_groups(self, learning_rate: float) -> list[dict[str, Any]]:  # noqa: ARG002
        """What an optimizer is made of, whose rate is `learning_rate` where a group has none of its own."""
        return [{"params": list(self.parameters())}]

    def finish_update(self, observations: Callable[[], Iterable[Tensor]]) -> None:
        """What every policy update ends with: makes all but the parameters belong to them.

        Args:
            observations: makes those of D, some at once, uint8[n, C, rows, columns] each.
        """

    def export(self, *, run: UUID = NO_RUN, attempt: int = 0, version: int = 0) -> Weights:
        """The evaluated network as the policy that the robots run.

        Raises:
            BlobError: a value is not finite.
        """
        raise NotImplementedError


class BinaryNetwork(PNetwork):
    """The paper's network (sections IV-A, IV-B): binary weights and activations, P = lambda o_5.

    Batch normalization follows all layers but the last. It keeps no running averages, which lag behind weights
    that flip: training uses the minibatch's own statistics, and `mean` and `var` belong to the evaluated and
    exported network alone; `calibrate.reestimate_batch_norm` sets them.

    Attributes:
        latent: float32[weight_bits], in [-1, 1].
        gamma, beta: float32[channels of those layers together].
        mean, var: float64, of the same shape.
        log_scale: float32[], log lambda.

    Args:
        spec: geometry.
        scale_initial: lambda at the start, above 0.
        generator: draws the latent weights, uniform in +-LATENT_INITIAL.
    """

    mean: Tensor
    var: Tensor

    def __init__(
        self, spec: NetworkSpec, *, scale_initial: float, generator: torch.Generator
    ) -> None:
        super().__init__(spec)
        self._weight_sizes = [layer.out_channels * layer.fan_in for layer in spec.layers]
        self._norm_sizes = [layer.out_channels for layer in spec.layers[:-1]]
        channels = sum(self._norm_sizes)
        latent = torch.empty(spec.weight_bits)
        self.latent = nn.Parameter(
            latent.uniform_(-LATENT_INITIAL, LATENT_INITIAL, generator=generator)
        )
        self.gamma = nn.Parameter(torch.ones(channels))
        self.beta = nn.Parameter(torch.zeros(channels))
        self.log_scale = nn.Parameter(torch.tensor(float(scale_initial)).log())
        self.register_buffer("mean", torch.zeros(channels, dtype=torch.float64))
        self.register_buffer("var", torch.cat([_variance(layer) for layer in spec.layers[:-1]]))

    def forward(self, pixels: Tensor, group: Group = SINGLE_PROCESS) -> Tensor:
        """P(s, .): in training with the whole minibatch's statistics, else exactly as exported."""
        if not self.training:
            return self.scale() * self.integers(pixels)[-1].flatten(1)
        weights = self.signs()
        gammas, betas = (
            torch.split(self.gamma, self._norm_sizes),
            torch.split(self.beta, self._norm_sizes),
        )
        x = pixels
        for index, (gamma, beta) in enumerate(zip(gammas, betas, strict=True)):
            o = dot_products(self.spec.layers[index], weights[index], x)
            x = sign(batch_norm(o, gamma, beta, group))
        return self.scale() * dot_products(self.spec.layers[-1], weights[-1], x).flatten(1)

    def signs(self) -> list[Tensor]:
        """Sign(w) per layer, float32[out, fan_in] as the blob has them (before `fold`'s flips)."""
        signs = torch.split(sign(self.latent), self._weight_sizes)
        return [s.view(g.weight_shape) for s, g in zip(signs, self.spec.layers, strict=True)]

    def affine(self) -> list[tuple[Tensor, Tensor]]:
        """a, b (float64[out]) of all layers but the last: the evaluated activation is Sign(a o + b)."""
        a = self.gamma.detach().double() / torch.sqrt(self.var + BATCH_NORM_EPSILON)
        b = self.beta.detach().double() - a * self.mean
        return list(
            zip(torch.split(a, self._norm_sizes), torch.split(b, self._norm_sizes), strict=True)
        )

    @torch.no_grad()
    def integers(self, pixels: Tensor) -> list[Tensor]:
        """Every layer's o of the evaluated network, float32[B, out, out_size, out_size], exact."""
        layers, weights = self.spec.layers, self.signs()
        outputs = [exact_dot_products(layers[0], weights[0], pixels)]
        for layer, signs, (a, b) in zip(layers[1:], weights[1:], self.affine(), strict=True):
            outputs.append(exact_dot_products(layer, signs, activation(a, b, outputs[-1])))
        return outputs

    def scale(self) -> Tensor:
        """The factor lambda, float32[]: learned, being difficult to set by hand (section IV-B c)."""
        return self.log_scale.exp()

    def max_preference(self) -> float:
        """The largest |P|: lambda N; of an action of D dimensions, D lambda N."""
        return float(self.scale().detach()) * self.spec.hidden_units * len(self.spec.action_dims)

    def parameter_groups(self, learning_rate: float) -> list[dict[str, Any]]:
        """Log lambda at three times the rate: one number has to follow the values' magnitude."""
        others = [p for name, p in self.named_parameters() if name != "log_scale"]
        scale = {"params": [self.log_scale], "lr": learning_rate * SCALE_RATE_FACTOR}
        return [{"params": others}, scale]

    def finish_update(self, observations: Callable[[], Iterable[Tensor]]) -> None:
        """Estimates batch norm anew over D."""
        reestimate_batch_norm(self, observations())

    def export(self, *, run: UUID = NO_RUN, attempt: int = 0, version: int = 0) -> Weights:
        """Batch norm and signs folded into integers."""
        return fold(self, run=run, attempt=attempt, version=version)

    @torch.no_grad()
    def clip_latent_weights(self) -> None:
        """Latent weights to [-1, 1], where the straight-through gradient can still move them."""
        self.latent.clamp_(-1, 1)


class FloatNetwork(PNetwork):
    """The same geometry in floating point: pixels / 255, biases, ReLU; the network of CVI, DPP and DQN.

    Attributes:
        weights: float32[weight_bits], in the weight blob's order as `BinaryNetwork.latent`.
        biases: float32[channels of all layers together].

    Args:
        spec: geometry.
        generator: draws weights and biases, uniform in +-1/sqrt(fan_in) as torch's layers do.
    """

    def __init__(self, spec: NetworkSpec, *, generator: torch.Generator) -> None:
        super().__init__(spec)
        self._weight_sizes = [layer.out_channels * layer.fan_in for layer in spec.layers]
        self._bias_sizes = [layer.out_channels for layer in spec.layers]

        def drawn(sizes: list[int]) -> nn.Parameter:
            bounds = [layer.fan_in**-0.5 for layer in spec.layers]
            parts = [
                torch.empty(size).uniform_(-bound, bound, generator=generator)
                for size, bound in zip(sizes, bounds, strict=True)
            ]
            return nn.Parameter(torch.cat(parts))

        self.weights, self.biases = drawn(self._weight_sizes), drawn(self._bias_sizes)

    def forward(self, pixels: Tensor, group: Group = SINGLE_PROCESS) -> Tensor:  # noqa: ARG002
        """P(s, .): of each image by itself, whatever the rest of its minibatch."""
        x = pixels
        for index, (weights, bias) in enumerate(self.affine()):
            x = dot_products(self.spec.layers[index], weights, x if index == 0 else x.relu(), bias)
        return x.flatten(1)

    def affine(self) -> list[tuple[Tensor, Tensor]]:
        """Weights float32[out, fan_in] and biases float32[out] per layer; the first takes 0..255."""
        weights = torch.split(self.weights, self._weight_sizes)
        biases = torch.split(self.biases, self._bias_sizes)
        # conv1 is divided by 255 in place of the pixels: there are fewer weights than pixels
        return [
            (w.view(layer.weight_shape) / layer.max_input, b)
            for layer, w, b in zip(self.spec.layers, weights, biases, strict=True)
        ]

    def export(self, *, run: UUID = NO_RUN, attempt: int = 0, version: int = 0) -> Weights:
        """An ONNX model."""
        return float_weights(self, run=run, attempt=attempt, version=version)


def make_network(
    kind: NetworkKind, spec: NetworkSpec, *, scale_initial: float, generator: torch.Generator
) -> PNetwork:
    """A network of that kind; lambda is the binarized one's alone."""
    if kind == "float":
        return FloatNetwork(spec, generator=generator)
    return BinaryNetwork(spec, scale_initial=scale_initial, generator=generator)


def _variance(layer: Layer) -> Tensor:
    """Before any data: what random signs give with inputs +-1, or pixels uniform in 0..255."""
    mean_square = layer.max_input**2 / (3 if layer.max_input == MAX_PIXEL else 1)
    return torch.full((layer.out_channels,), layer.fan_in * mean_square, dtype=torch.float64)
