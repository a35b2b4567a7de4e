"""One layer's arithmetic on tensors, as networks are made of it."""

from torch import Tensor
from torch.nn import functional

from bpn_learner.binarize import sign
from bpn_shared.spec.network import Layer


def dot_products(layer: Layer, weights: Tensor, x: Tensor, bias: Tensor | None = None) -> Tensor:
    """Sums of w x, with Sign(w) the paper's o (section III-C): a convolution, or one product for all input.

    Args:
        weights: float32[out, fan_in], fan_in in the order (kernel row, kernel column, channel).
        x: float32[B, in_channels, in_size, in_size]; channels-last in memory is fastest.
        bias: float32[out].

    Returns:
        float32[B, out_channels, out_size, out_size].
    """
    if layer.is_fully_connected:
        rows = x.permute(0, 2, 3, 1).flatten(1)
        return functional.linear(rows, weights, bias)[:, :, None, None]
    return functional.conv2d(x, as_kernels(layer, weights), bias, stride=layer.stride)


def as_kernels(layer: Layer, weights: Tensor) -> Tensor:
    """Weights [out, fan_in] as torch's [out, in_channels, kernel, kernel], channels-last in memory."""
    shape = (layer.out_channels, layer.kernel, layer.kernel, layer.in_channels)
    return weights.view(shape).permute(0, 3, 1, 2)


def exact_dot_products(layer: Layer, signs: Tensor, x: Tensor) -> Tensor:
    """`dot_products`, rounded: a convolution algorithm other than the direct one (Winograd) may err."""
    return dot_products(layer, signs, x).round()


def activation(a: Tensor, b: Tensor, o: Tensor) -> Tensor:
    """Sign(a o + b), product and sum each rounded to float64: what `fold` turns into thresholds.

    Args:
        a, b: float64[out].
        o: integers [B, out, h, w].

    Returns:
        float32[B, out, h, w].
    """
    return sign(a[:, None, None] * o.double() + b[:, None, None]).float()
