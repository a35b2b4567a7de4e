"""A network in training: latent weights, the straight-through gradient, Adam; and its folded form."""

from typing import Any, Self

import torch
from torch import Tensor
from torch.nn import functional

from bpn.verify.play import Policy, as_kernels, sizes
from bpn_shared.spec.config import RunConfig

INITIAL_LATENT = 0.1
SCALE_RATE = 3.0
NORM_EPSILON = 1e-5
LARGEST_PIXEL = 255


class _StraightThrough(torch.autograd.Function):
    """+1 where x >= 0, else -1; the gradient passes where |x| <= 1."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        ctx.save_for_backward(x)
        return (x >= 0).to(x.dtype) * 2 - 1

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> Tensor:
        (x,) = ctx.saved_tensors
        passed: Tensor = gradients[0] * (x.abs() <= 1)
        return passed


def binarized(x: Tensor) -> Tensor:
    """Sign with its straight-through gradient."""
    signs: Tensor = _StraightThrough.apply(x)  # type: ignore[no-untyped-call]
    return signs


class Trainee:
    """The parameters of one kind of network. Vectors run over the layers, weights in the weight blob's order.

    Attributes:
        weights: float32[all weights]; of a binarized network the latent ones, in [-1, 1].
        gamma, beta: of batch norm, float32[channels of all layers but the last] (binarized; else empty).
        biases: float32[channels of all layers] (float; else empty).
        log_scale: log lambda, float32[] (binarized).

    Args:
        seed: of the initial weights.
    """

    def __init__(self, config: RunConfig, seed: int) -> None:
        self.spec = config.network
        self.binary = config.algorithm_spec.network == "binary"
        layers = self.spec.layers
        self.sizes = [layer.out_channels * layer.fan_in for layer in layers]
        self.channels = [layer.out_channels for layer in layers]
        self.shape = sizes(self.spec)
        generator = torch.Generator().manual_seed(seed)

        def uniform(sizes: list[int]) -> Tensor:
            parts = zip(sizes, layers, strict=True)
            drawn = [
                torch.empty(n).uniform_(-(g.fan_in**-0.5), g.fan_in**-0.5, generator=generator)
                for n, g in parts
            ]
            return torch.cat(drawn)

        norms = sum(self.channels[:-1]) if self.binary else 0
        if self.binary:
            latent = torch.empty(sum(self.sizes))
            self.weights = latent.uniform_(-INITIAL_LATENT, INITIAL_LATENT, generator=generator)
            self.biases = torch.empty(0)
        else:
            self.weights, self.biases = uniform(self.sizes), uniform(self.channels)
        self.gamma, self.beta = torch.ones(norms), torch.zeros(norms)
        self.log_scale = torch.tensor(_first_scale(config) if self.binary else 1.0).log()
        used = [self.weights, self.gamma, self.beta] if self.binary else [self.weights, self.biases]
        groups: list[dict[str, Any]] = [{"params": used}]
        if self.binary:
            groups.append({"params": [self.log_scale]})
        self.parameters = [p.requires_grad_() for group in groups for p in group["params"]]
        self.clips = True
        self.rates = [config.learning_rate, config.learning_rate * SCALE_RATE][: len(groups)]
        self.adam = torch.optim.Adam(groups, lr=config.learning_rate, fused=True)

    @property
    def scale(self) -> float:
        """Lambda; 1 of a float network."""
        return float(self.log_scale.detach().exp())

    def rows(self) -> list[Tensor]:
        """Weights per layer [out, fan_in] as the network multiplies with them."""
        parts = torch.split(binarized(self.weights) if self.binary else self.weights, self.sizes)
        shaped = [w.view(g.weight_shape) for w, g in zip(parts, self.spec.layers, strict=True)]
        return shaped if self.binary else [shaped[0] / LARGEST_PIXEL, *shaped[1:]]

    def forward(self, seen: Tensor) -> Tensor:
        """P of a minibatch uint8[B, h, w, C] with its own batch statistics: [B, |A|]."""
        x = seen.to(self.weights.dtype).permute(0, 3, 1, 2)
        if not self.binary:
            for layer, (rows, bias) in enumerate(
                zip(self.rows(), torch.split(self.biases, self.channels), strict=True)
            ):
                x = self.summed(rows, layer, x if layer == 0 else x.relu(), bias)
            return x.flatten(1)
        *hidden, last = self.rows()
        norms = zip(
            *(torch.split(v, self.channels[:-1]) for v in (self.gamma, self.beta)), strict=True
        )
        for layer, (rows, (gamma, beta)) in enumerate(zip(hidden, norms, strict=True)):
            x = binarized(normalized(self.summed(rows, layer, x), gamma, beta))
        return self.log_scale.exp() * self.summed(last, len(hidden), x).flatten(1)

    def summed(self, rows: Tensor, layer: int, x: Tensor, bias: Tensor | None = None) -> Tensor:
        """A layer's weighted sums of [B, in, h, w]."""
        kernel, stride = (of[layer] for of in self.shape)
        if kernel == x.shape[-1]:  # it covers all of its input
            flat = x.permute(0, 2, 3, 1).flatten(1)
            return functional.linear(flat, rows, bias)[:, :, None, None]
        return functional.conv2d(x, as_kernels(rows, kernel), bias, stride=stride)

    def double(self) -> Self:
        """Turns the parameters into float64, for gradients to compare with; it trains no more."""
        for name in ("weights", "gamma", "beta", "biases", "log_scale"):
            setattr(self, name, getattr(self, name).detach().double().requires_grad_())
        used = (self.weights, self.gamma, self.beta) if self.binary else (self.weights, self.biases)
        self.parameters = [*used, self.log_scale] if self.binary else list(used)
        return self

    def step(self, factor: float) -> None:
        """One step of Adam at that factor of the learning rates; then latent weights are clipped."""
        for group, rate in zip(self.adam.param_groups, self.rates, strict=True):
            group["lr"] = factor * rate
        self.adam.step()
        if self.binary and self.clips:
            with torch.no_grad():
                self.weights.clamp_(-1, 1)


def _first_scale(config: RunConfig) -> float:
    """Lambda at the start; where none is given, beta P of random signs then varies by 0.3."""
    return config.scale_initial or 0.3 / (config.beta * config.hidden_units**0.5)


def normalized(sums: Tensor, gamma: Tensor, beta: Tensor) -> Tensor:
    """Batch norm of [B, out, h, w]; in float64 so that a channel without variation is exactly its beta."""
    if sums.dtype == torch.float32:
        return functional.batch_norm(sums, None, None, gamma, beta, training=True, eps=NORM_EPSILON)
    mean = sums.mean((0, 2, 3), keepdim=True)
    var = (sums - mean).square().mean((0, 2, 3), keepdim=True)
    wide = (slice(None), None, None)
    return (sums - mean) / torch.sqrt(var + NORM_EPSILON) * gamma[wide] + beta[wide]


def released(trainee: Trainee, seen: Tensor | None) -> Policy:
    """The policy that the robots run, see `folded`."""
    return folded(trainee, seen) if trainee.binary else frozen(trainee)


def frozen(trainee: Trainee) -> Policy:
    """A float network as the robots run it."""
    biases = tuple(b.detach().clone() for b in torch.split(trainee.biases, trainee.channels))
    rows = tuple(w.detach().clone() for w in trainee.rows())
    return Policy(rows, (), biases, 1.0, *trainee.shape)


@torch.no_grad()
def folded(trainee: Trainee, seen: Tensor | None) -> Policy:
    """A binarized network as the robots run it: signs and integer thresholds.

    Batch norm's statistics are those of all observations of D, layer by layer, with the layers below as they are
    folded. A channel whose gamma is negative has its signs turned.

    Args:
        seen: uint8[n, h, w, C]; None: before any data, where every mean is 0 and so is every threshold.
    """
    rows = [w.clone() for w in trainee.rows()]
    gammas, betas = (
        torch.split(trainee.gamma, trainee.channels[:-1]),
        torch.split(trainee.beta, trainee.channels[:-1]),
    )
    thresholds: list[Tensor] = []
    inputs = [] if seen is None else list(torch.split(seen.permute(0, 3, 1, 2), 256))
    for layer in range(len(gammas)):
        if seen is None:
            thresholds.append(torch.zeros(trainee.channels[layer], dtype=torch.int32))
            continue
        sums = [trainee.summed(rows[layer], layer, x.float()).round() for x in inputs]
        mean, var = moments(sums)
        a = gammas[layer].double() / torch.sqrt(var + NORM_EPSILON)
        b = betas[layer].double() - a * mean
        inputs = [
            torch.where(a[:, None, None] * s.double() + b[:, None, None] >= 0, 1.0, -1.0)
            for s in sums
        ]
        rows[layer][a < 0] *= -1
        thresholds.append(smallest_on(a.abs(), b, trainee.spec.layers[layer].max_output))
    return Policy(tuple(rows), tuple(thresholds), (), trainee.scale, *trainee.shape)


def moments(sums: list[Tensor]) -> tuple[Tensor, Tensor]:
    """Mean and variance per channel of integers [n, out, h, w], each rounded once to float64."""
    whole = torch.cat([s.transpose(0, 1).flatten(1) for s in sums], dim=1).long()
    n = whole.shape[1]
    pairs = list(zip(whole.sum(1).tolist(), whole.square().sum(1).tolist(), strict=True))
    mean = torch.tensor([total / n for total, _ in pairs], dtype=torch.float64)
    var = [(n * squares - total**2) / n**2 for total, squares in pairs]
    return mean, torch.tensor(var, dtype=torch.float64)


def smallest_on(a: Tensor, b: Tensor, limit: int) -> Tensor:
    """Smallest integer o in [-limit, limit] with a o + b >= 0 in float64, limit + 1 if none: int32[out]."""
    candidates = torch.arange(-limit, limit + 1, dtype=torch.float64)
    on = [a_k * candidates + b_k >= 0 for a_k, b_k in zip(a, b, strict=True)]
    first = [int(o.long().argmax()) if bool(o.any()) else len(candidates) for o in on]
    return torch.tensor(first, dtype=torch.int32) - limit
