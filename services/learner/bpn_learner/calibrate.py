"""Batch norm statistics of the network as it is now, over all of D.

After a policy update the weights have flipped and every statistic from training belongs to another
network. Estimating them anew, layer by layer, makes the exported thresholds belong to these weights.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from bpn_learner.layers import activation, exact_dot_products

if TYPE_CHECKING:
    from bpn_learner.networks import BinaryNetwork


@torch.no_grad()
def reestimate_batch_norm(network: "BinaryNetwork", observations: Iterable[Tensor]) -> None:
    """Sets `network.mean` and `network.var`, layer l's with layers below l evaluated with theirs.

    The integers' sums are exact (int64 of a batch, then Python's), so the result depends neither on how
    observations are batched nor on their order.

    Args:
        observations: uint8[n, C, rows, columns] each, n in one forward pass; looked at once.

    Raises:
        ValueError: there is no observation.
    """
    layers, weights = network.spec.layers, network.signs()
    inputs: Iterable[Tensor] = (part for part in observations if len(part))
    first = 0
    for index, layer in enumerate(layers[:-1]):
        outputs = [exact_dot_products(layer, weights[index], x.float()) for x in inputs]
        if not outputs:
            raise ValueError("batch norm needs at least 1 observation to estimate from, got 0")
        mean, var = _moments(outputs)
        channels = slice(first, first + layer.out_channels)
        network.mean[channels], network.var[channels] = mean, var
        first += layer.out_channels
        a, b = network.affine()[index]
        inputs = [activation(a, b, o) for o in outputs]


def _moments(outputs: list[Tensor]) -> tuple[Tensor, Tensor]:
    """Mean and (biased) variance per channel of integers [B, out, h, w]; float64[out] each."""
    count = sum(o.numel() // o.shape[1] for o in outputs)
    totals, squares = ([0] * outputs[0].shape[1] for _ in range(2))
    for o in outputs:
        integers = o.long()
        for sums, part in ((totals, integers), (squares, integers.square())):
            for channel, value in enumerate(part.sum(dim=(0, 2, 3)).tolist()):
                sums[channel] += value
    pairs = list(zip(totals, squares, strict=True))
    mean = [total / count for total, _ in pairs]
    var = [(count * square - total * total) / (count * count) for total, square in pairs]
    return torch.tensor(mean, dtype=torch.float64), torch.tensor(var, dtype=torch.float64)
