"""What rounding alone may change, and how a training is followed where it does.

Binarized networks amplify rounding: a sum that is rounded otherwise turns a sign over sooner or later, and from
then on two trainings part. So where a run cannot be repeated bit by bit, three of our own are made that differ in
nothing but the order of their sums; the run may be as far from them as they are from each other, with a margin.
Before every update all are brought to what the run's own weights show.
"""

import copy
import itertools
import math
from collections.abc import Sequence

import torch

from bpn.verify.play import Policy
from bpn.verify.targets import Targets
from bpn.verify.trainee import LARGEST_PIXEL, Trainee, released
from bpn.verify.update import Update
from bpn.verify.weights import different_signs

MARGIN, MARGIN_OF_SIGNS = 4.0, 1.5
FLOORS = {"signs": 0.005, "flips": 0.005, "log lambda": 0.005, "loss_first": 0.05, "loss": 0.05}
"""That may always differ: shares of signs, log lambda, and losses relative to the expected one."""


def replicas(trainee: Trainee) -> list[Trainee]:
    """Three of one."""
    return [trainee, copy.deepcopy(trainee), copy.deepcopy(trainee)]


def distances(
    update: Update, trained: Sequence[Trainee], data: Targets, losses: Sequence[Sequence[float]]
) -> dict[str, tuple[float, float]]:
    """For every quantity how far the run's is from the nearest of ours, and how far it may be.

    Args:
        losses: of ours, for every epoch.
    """
    before, following = update.policy, update.following
    own = [released(trainee, data.seen) for trainee in trained]
    quantities = {
        "log lambda": ([_log(p.scale) for p in own], _log(following.scale)),
        "flips": (
            [different_signs(p, before) for p in own],
            different_signs(following, before),
        ),
        "loss_first": ([_log(of[0]) for of in losses], _log(update.record["loss_first"])),
        "loss": ([_log(of[-1]) for of in losses], _log(update.record["loss"])),
    }
    result = {
        name: (min(abs(found - o) for o in ours), FLOORS[name] + MARGIN * (max(ours) - min(ours)))
        for name, (ours, found) in quantities.items()
    }
    nearest = min(different_signs(following, p) for p in own)
    apart = max(different_signs(a, b) for a, b in itertools.combinations(own, 2))
    return result | {"signs": (nearest, FLOORS["signs"] + MARGIN_OF_SIGNS * apart)}


def _log(value: float) -> float:
    return math.log(max(value, 1e-12))


@torch.no_grad()
def follow(trainee: Trainee, shown: Policy) -> None:
    """Brings a trainee to what a version of the weights shows, the rest as near as it can be.

    Float weights are shown whole; of binarized ones the signs: a latent weight on the other side of 0 is mirrored.
    """
    if not trainee.binary:
        rows = [shown.rows[0] * LARGEST_PIXEL, *shown.rows[1:]]
        trainee.weights.copy_(torch.cat([r.flatten() for r in rows]))
        trainee.biases.copy_(torch.cat(shown.biases))
        return
    signs, turns = [], []
    for own, theirs in zip(trainee.rows(), shown.rows, strict=True):
        turned = (own != theirs).float().mean(dim=1) > 0.5
        turns.append(turned)
        signs.append(torch.where(turned[:, None], -theirs, theirs).flatten())
    trainee.weights.copy_(trainee.weights.abs() * torch.cat(signs))
    trainee.gamma.copy_(trainee.gamma.abs() * (1 - 2 * torch.cat(turns[:-1]).float()))
    trainee.log_scale.fill_(math.log(shown.scale))
