"""The data D of an update, and the targets y that its minibatches are fitted to, in float32."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bpn.verify import draws
from bpn.verify.play import Policy, inverse_temperature, observations
from bpn_shared.camera.disturbed import EpisodeCamera
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.disturbances import parse

COMPUTED = ("cvi", "dqn")
"""The targets that are computed here; of others, which are somebody's own, only what they leave is looked at."""


@dataclass(frozen=True, eq=False)
class Played:
    """An episode as data.

    Attributes:
        seen: s_0..s_T, uint8[T+1, C, h, w].
        actions: int64[T, D], the choice in each dimension.
        rewards: float64[T], unscaled.
        terminal: the last observation is the task's end, not a time limit.
        misses: control periods without an action in time.
    """

    seen: Tensor
    actions: Tensor
    rewards: Tensor
    terminal: bool
    misses: int = 0


@dataclass(frozen=True, eq=False)
class Targets:
    """What one update fits.

    Attributes:
        seen: s of every transition of D in order, uint8[n, h, w, C]; behind them, where the run asks
            for it, the same with pictures that were disturbed for the update.
        taken: the outputs that each action takes, one of each dimension, int64[n, D].
        y: float32[n].
        offset: c, what all preferences lack that are fitted to y (relative targets).
        max_preference: largest |P-(s, .)|.
    """

    seen: Tensor
    taken: Tensor
    y: Tensor
    offset: float
    max_preference: float


def factor_on_rewards(config: RunConfig, D: Sequence[Played], before: float) -> float:
    """The run's `reward_scale`; where that is 0, what makes the first returns over n steps that differ span 10.

    Args:
        before: what it was in the update before; 0: returns did not differ yet, as what this gives then.
    """
    if config.reward_scale or before:
        return config.reward_scale or before
    returns = [
        sum(config.gamma**k * reward for k, reward in enumerate(rewards[t : t + config.n_step]))
        for rewards in (episode.rewards.tolist() for episode in D)
        for t in range(len(rewards))
    ]
    spread = max(returns) - min(returns)
    return 10 / spread if spread else 0.0


def targets(
    config: RunConfig,
    iteration: int,
    D: Sequence[Played],
    policy: Policy,
    *,
    offset: float,
    reward_scale: float,
) -> Targets:
    """Of all of D under the policy that the update begins with.

    CVI: y = r + gamma m(s') + alpha (P(s, a) - m(s)) with mellowmax m; DQN: y = r + gamma max_a P(s', a).
    Where actions have several dimensions, P, m and max are sums over them.
    Without `bootstrap_terminals` what follows a terminal state is worth 0: -c beside preferences that lack c.

    Args:
        offset: c of the policy's preferences.
        reward_scale: factor on rewards.
    """
    P_of = [policy.preferences(episode.seen) for episode in D]
    P, P_next = torch.cat([p[:-1] for p in P_of]), torch.cat([p[1:] for p in P_of])
    dims = config.task_spec.action_dims or (config.task_spec.actions,)
    starts = torch.tensor([sum(dims[:d]) for d in range(len(dims))])
    taken = torch.cat([episode.actions for episode in D]) + starts
    reward = torch.cat([(reward_scale * episode.rewards).float() for episode in D])
    ends = torch.cat([_ends(episode) for episode in D])
    is_cvi = config.algorithm_spec.targets == "cvi"
    beta = inverse_temperature(config, iteration)

    following = value_of(P_next, beta if is_cvi else None, dims)
    if not config.bootstrap_terminals:
        following = torch.where(ends, torch.tensor(-offset, dtype=torch.float32), following)
    gap = P.gather(1, taken).sum(dim=1) - value_of(P, beta, dims)
    increased = config.alpha * (gap.clamp_min(-config.gap_floor) if config.gap_floor else gap)
    if config.n_step == 1:
        y = reward + config.gamma * following
    else:
        value = offset
        if config.relative_targets and config.bootstrap_terminals:
            value = float(reward.mean()) / (1 - config.gamma)
        lengths = [len(episode.actions) for episode in D]
        later = reward - (gap - increased) if is_cvi else reward
        y = _over_steps(config, reward, later, following, lengths=lengths, value=value)
    if is_cvi:
        y = y + increased
    next_offset = 0.0
    if config.relative_targets:
        next_offset = config.gamma * offset + float(y.mean())
        y = y - y.mean()
    shown = [episode.seen for episode in D]
    if config.augment:
        shown += [_seen_again(config, iteration, k, episode) for k, episode in enumerate(D)]
        taken, y = taken.repeat(2, 1), y.repeat(2)
    seen = torch.cat([of_episode[:-1] for of_episode in shown]).permute(0, 2, 3, 1).contiguous()
    return Targets(seen, taken, y, next_offset, float(P.abs().max()))


def _seen_again(config: RunConfig, iteration: int, index: int, episode: Played) -> Tensor:
    """An episode's observations, made of frames that the update disturbed."""
    seed = draws.camera_seed(config.seed, iteration, index)
    camera = EpisodeCamera(parse(config.augment), seed)
    newest = episode.seen[:, -config.task_spec.frame_channels :].numpy()
    frames = np.stack([camera.picture(frame, step) for step, frame in enumerate(newest)])
    stacked = config.task_spec.frames_stacked
    return observations(torch.from_numpy(frames), stacked, difference=config.difference)


def _over_steps(
    config: RunConfig,
    first: Tensor,
    later: Tensor,
    following: Tensor,
    *,
    lengths: Sequence[int],
    value: float,
) -> Tensor:
    """Of every step the next n of its episode summed up, or those that are left, and what follows the last.

    Args:
        first: what a step's sum begins with, float32[n].
        later: what a step is worth in sums that began before, float32[n].
        following: what follows each step, less `value`, float32[n].
        lengths: of the episodes.
    """
    sums, begin = [], 0
    for length in lengths:
        for t in range(begin, begin + length):
            end = min(t + config.n_step, begin + length)
            total = first[t]
            for k in range(1, end - t):
                total = total + config.gamma**k * later[t + k]
            discount = torch.tensor(config.gamma ** (end - t))
            total = total + (discount - config.gamma) * value
            sums.append(total + discount * following[end - 1])
        begin += length
    return torch.stack(sums)


def value_of(P: Tensor, beta: float | None, dims: Sequence[int]) -> Tensor:
    """The mellowmax of P [n, sum of dims] in each dimension, or without beta the maximum, summed up."""
    parts = torch.split(P, list(dims), dim=1)
    values = [part.amax(dim=1) if beta is None else mellowmax(part, beta) for part in parts]
    return sum(values[1:], start=values[0])


def mellowmax(P: Tensor, beta: float) -> Tensor:
    """1/beta log mean_a exp(beta P(., a)), from the largest P on, so that nothing overflows."""
    largest = P.amax(dim=1)
    shares = torch.expm1(beta * (P - largest[:, None])).mean(dim=1)
    return largest + torch.log1p(shares) / beta


def _ends(episode: Played) -> Tensor:
    """bool[T]: whether s' of a step is terminal."""
    ends = torch.zeros(len(episode.actions), dtype=torch.bool)
    ends[-1] = episode.terminal
    return ends
