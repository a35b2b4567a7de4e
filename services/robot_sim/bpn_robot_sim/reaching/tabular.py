"""Reaching as a table: CVI and Q-learning computed in full, with errors put in where a network makes them.

An arm with ideal servos has 24 x 24 poses and 14 actions, so y(s, a) of an iteration is exact, and the only error
is the one that is added. What each kind of error does to the greedy policy is then a property of the update alone.
"""

from dataclasses import dataclass
from math import dist
from typing import Literal

import numpy as np
import numpy.typing as npt

from bpn_robot_sim import EPISODE_STEPS
from bpn_robot_sim.reaching import geometry

_TURNS = 360 // geometry.GRID_DEG
_GAMMA, _BETA, _REWARD_SCALE = 0.99, 1.0, 0.1
"""As reaching's preset has them."""

Table = npt.NDArray[np.float64]
"""[576, 14]: of every pose and action."""
Kind = Literal["fresh", "staying"]


@dataclass(frozen=True, slots=True)
class Update:
    """One way to iterate.

    Attributes:
        alpha: of CVI (equation 5 of the paper); None: Q-learning, y = r + gamma max_a Q(s', a).
        sigma: of the normal error that is added to y, in its own unit.
        kind: the error is drawn anew in each iteration, or once for all of them.
        nodes: P has N + 1 levels, as a binarized network's outputs have; 0: any value.
    """

    alpha: float | None
    sigma: float = 0.0
    kind: Kind = "fresh"
    nodes: int = 0


def greedy_returns(update: Update, iterations: int, seed: int) -> npt.NDArray[np.float64]:
    """Return (px, one episode from the start pose) of greedy play after each iteration, [iterations]."""
    random = np.random.default_rng(seed)
    after, rewards = _after(), _rewards()
    P = np.zeros(after.shape)
    error = random.standard_normal(P.shape)
    returns = np.empty(iterations)
    for iteration in range(iterations):
        P = _backup(P, after, rewards, update.alpha) + update.sigma * error
        if update.nodes:
            P = _levels(P, update.nodes)
        returns[iteration] = _played(P, after, rewards)
        if update.kind == "fresh":
            error = random.standard_normal(P.shape)
    return returns


def _backup(
    P: Table, after: npt.NDArray[np.intp], rewards: npt.NDArray[np.float64], alpha: float | None
) -> Table:
    reward: Table = _REWARD_SCALE * rewards[after]
    if alpha is None:
        best: Table = P.max(axis=1)
        return reward + _GAMMA * best[after]
    top: Table = P.max(axis=1, keepdims=True)
    mellowmax: Table = top + np.log(np.exp(_BETA * (P - top)).mean(axis=1, keepdims=True)) / _BETA
    y: Table = reward + _GAMMA * mellowmax[after, 0] + alpha * (P - mellowmax)
    return y


def _levels(P: Table, nodes: int) -> Table:
    """The nearest of lambda {-N, -N + 2, ..., N}, less the mean of P, as relative targets are."""
    relative = P - P.mean()
    scale = float(np.abs(relative).max()) / nodes
    steps: Table = 2 * np.round((relative / scale + nodes) / 2) - nodes
    return scale * steps


def _played(P: Table, after: npt.NDArray[np.intp], rewards: npt.NDArray[np.float64]) -> float:
    pose, total = _index(*geometry.START_DEG), 0.0
    for _ in range(EPISODE_STEPS["reaching"]):
        pose = after[pose, P[pose].argmax()]
        total += rewards[pose]
    return total


def _index(q1_deg: int, q2_deg: int) -> int:
    q1, q2 = (angle // geometry.GRID_DEG % _TURNS for angle in (q1_deg, q2_deg))
    return int(q1 * _TURNS + q2)


def _poses() -> list[tuple[int, int]]:
    angles = range(0, 360, geometry.GRID_DEG)
    return [(q1, q2) for q1 in angles for q2 in angles]


def _after() -> npt.NDArray[np.intp]:
    """The pose after each action in each pose, [576, 14]."""
    return np.array(
        [[_index(q1 + t1, q2 + t2) for t1, t2 in geometry.ACTIONS_DEG] for q1, q2 in _poses()]
    )


def _rewards() -> npt.NDArray[np.float64]:
    """Reward (px) of being in each pose, [576]."""
    return np.array([-dist(geometry.hand_px(*pose), geometry.TARGET_PX) for pose in _poses()])
