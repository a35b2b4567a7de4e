"""What it costs that preferences of joint actions are sums over the joints: reaching with both at once, exactly.

An arm with ideal servos has 24 x 24 poses and 49 joint actions, so every iteration of CVI or Q-learning is
computed in full: y(s,a) of all poses and actions, then P(s,.) as the weighted least-squares fit of y(s,.), which
is y itself where P has 49 outputs, and the nearest sum P_1(a_1) + P_2(a_2) where it has 14.
`python -m bpn_robot_sim.reaching.additivity` prints the table of docs/factored-actions.md.
"""

import argparse
from dataclasses import dataclass
from math import dist
from typing import Literal

import numpy as np
import numpy.typing as npt

from bpn_robot_sim import EPISODE_STEPS
from bpn_robot_sim.reaching import geometry

_POSES = 360 // geometry.GRID_DEG
_STEPS = EPISODE_STEPS["reaching_both"]
_TURNS = [turn // geometry.GRID_DEG for turn in geometry.ROTATIONS_DEG]
_GAMMA, _BETA, _REWARD_SCALE = 0.99, 1.0, 0.1
_EPSILONS = 1.0, 0.05
"""Of Q-learning's exploration, falling over the first half of the iterations, as a run's defaults have it."""
ITERATIONS, LAST = 50, 10
SIGMA = 0.5
SEEDS = 5

Table = npt.NDArray[np.float64]
"""[24, 24, ...]: of every pose."""
Weights = Literal["own", "softmax", "uniform"]


@dataclass(frozen=True, slots=True)
class Setting:
    """One way to iterate.

    Attributes:
        alpha: of CVI; None: Q-learning, y = r + gamma max_a Q(s',a).
        outputs: 49, of every joint action, or 14, of each joint's turns.
        weights: of the fit: the policy's own probabilities, as of data that it collected itself; the softmax's,
            which is CVI's own, for Q-learning too; or all alike.
        sigma: of normal noise that every output gets anew in every iteration, in the unit of y.
    """

    alpha: float | None
    outputs: Literal[14, 49]
    weights: Weights
    sigma: float = 0.0


def greedy_returns(setting: Setting, seed: int = 0) -> Table:
    """Return (px, 20 steps from the start pose) of the greedy policy after each of 50 iterations."""
    random = np.random.default_rng(seed)
    after, rewards = _after(), _rewards()
    P = np.zeros((_POSES, _POSES, 7, 7))
    returns = np.empty(ITERATIONS)
    for iteration in range(ITERATIONS):
        value = _value(P, setting)
        y = _REWARD_SCALE * rewards[after] + _GAMMA * value[after]
        if setting.alpha is not None:
            y += setting.alpha * (P - value[..., None, None])
        P = _fitted(y, _policy(P, setting, iteration), setting, random)
        returns[iteration] = _played(P, rewards, after)
    return returns


def optimum() -> float:
    """The largest sum of rewards (px) over the episode with both joints turned in every step."""
    after, rewards = _after(), _rewards()
    values = np.zeros((_POSES, _POSES))
    for _ in range(_STEPS):
        values = (rewards[after] + values[after]).max(axis=(2, 3))
    return float(values[_start()])


def _value(P: Table, setting: Setting) -> Table:
    """m_beta P, or max P, of every pose."""
    top: Table = P.max(axis=(2, 3))
    if setting.alpha is None:
        return top
    excess: Table = np.exp(_BETA * (P - top[..., None, None])).mean(axis=(2, 3))
    return top + np.log(excess) / _BETA


def _policy(P: Table, setting: Setting, iteration: int) -> Table:
    """The weights of the fit, [24, 24, 7, 7]; of several outputs together a product over the joints."""
    if setting.weights == "uniform":
        return np.full(P.shape, 1 / 49)
    if setting.alpha is not None or setting.weights == "softmax":
        weights: Table = np.exp(_BETA * (P - P.max(axis=(2, 3), keepdims=True)))
        weights /= weights.sum(axis=(2, 3), keepdims=True)
        return weights
    first, last = _EPSILONS
    epsilon = first + min(1.0, 2 * iteration / ITERATIONS) * (last - first)
    each = 1 - (1 - epsilon) ** 0.5  # as epsilon-greedy explores in each dimension
    greedy = [
        np.eye(7)[P.max(axis=other).argmax(axis=2)] * (1 - each) + each / 7 for other in (3, 2)
    ]
    product: Table = np.einsum("pqi,pqj->pqij", *greedy)
    return product


def _fitted(y: Table, weights: Table, setting: Setting, random: np.random.Generator) -> Table:
    """P(s,.) nearest to y(s,.); of weights that are a product over the joints, the nearest sum is one of means."""
    if setting.outputs == 49:
        return y + setting.sigma * random.standard_normal(y.shape)
    of_first, of_second = weights.sum(axis=3), weights.sum(axis=2)
    first = np.einsum("pqij,pqj->pqi", y, of_second)
    second = np.einsum("pqij,pqi->pqj", y, of_first)
    mean = np.einsum("pqi,pqi->pq", first, of_first)
    first, second = first - mean[..., None] / 2, second - mean[..., None] / 2
    first = first + setting.sigma * random.standard_normal(first.shape)
    second = second + setting.sigma * random.standard_normal(second.shape)
    fitted: Table = first[..., :, None] + second[..., None, :]
    return fitted


def _played(P: Table, rewards: Table, after: tuple[npt.NDArray[np.intp], ...]) -> float:
    pose, total = _start(), 0.0
    for _ in range(_STEPS):
        pose = _best(P[pose], pose, after)
        total += float(rewards[pose])
    return total


def _best(
    values: Table, pose: tuple[int, int], after: tuple[npt.NDArray[np.intp], ...]
) -> tuple[int, int]:
    first, second = np.unravel_index(int(values.argmax()), values.shape)
    return int(after[0][(*pose, first, second)]), int(after[1][(*pose, first, second)])


def _after() -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """The pose after each action in each pose, two indices [24, 24, 7, 7]."""
    p, q, i, j = np.indices((_POSES, _POSES, 7, 7))
    turns = np.array(_TURNS)
    return (p + turns[i]) % _POSES, (q + turns[j]) % _POSES


def _rewards() -> Table:
    """Reward (px) of being in each pose, [24, 24]."""
    angles = range(0, 360, geometry.GRID_DEG)
    return np.array(
        [[-dist(geometry.hand_px(q1, q2), geometry.TARGET_PX) for q2 in angles] for q1 in angles]
    )


def _start() -> tuple[int, int]:
    first, second = (angle // geometry.GRID_DEG % _POSES for angle in geometry.START_DEG)
    return first, second


def _shown(setting: Setting) -> str:
    """Mean of the last ten iterations, and beside noise its spread over the seeds."""
    seeds = range(SEEDS if setting.sigma else 1)
    means = np.array([greedy_returns(setting, seed)[-LAST:].mean() for seed in seeds])
    spread = f" ± {means.std(ddof=1):.0f}" if len(means) > 1 else ""
    return f"{means.mean():.1f}{spread}"


def main() -> None:
    """Prints the table."""
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    print(f"optimum {optimum():.1f} px\n")
    alphas = (None, 0.0, 0.8, 0.95)
    titles = ["Q" if alpha is None else f"CVI, α = {alpha:g}" for alpha in alphas]
    print("| outputs | fitted by | noise | " + " | ".join(titles) + " |")
    print("|---|---|---|" + "---|" * len(alphas))
    said: dict[Weights, str] = {
        "own": "the policy's own actions", "softmax": "the softmax's actions", "uniform": "all alike",
    }  # fmt: skip
    for sigma in (0.0, SIGMA):
        for outputs, weights in ((49, "own"), *((14, way) for way in said)):
            cells = [_shown(Setting(alpha, outputs, weights, sigma)) for alpha in alphas]  # type: ignore[arg-type]
            by = "" if outputs == 49 else said[weights]
            print(f"| {outputs} | {by} | {sigma:g} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
