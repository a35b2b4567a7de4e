"""What is found out for a run that leaves units open: the factor on rewards, and lambda of the first policy."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from bpn_learner.checkpoint import CheckpointError
from bpn_learner.factory import initial_policy
from bpn_learner.history import History
from bpn_learner.policy_metrics import entropy
from bpn_learner.reward_scale import RewardScale
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import preferences
from bpn_shared.runs.folder import RunFolder
from bpn_shared.spec.config import RunConfig

rewards = st.lists(st.integers(-50, 50).map(float), min_size=1, max_size=9)
episodes = st.lists(rewards, min_size=1, max_size=5)
steps = st.integers(1, 6)


def data(of: Sequence[Sequence[float]]) -> list[EpisodeData]:
    return [
        EpisodeData(
            np.zeros((len(r) + 1, 1, 84, 84), np.uint8),
            np.zeros(len(r), np.uint8),
            np.array(r),
            terminated=False,
        )
        for r in of
    ]


def config(n: int = 1, *, scale: float = 0.0) -> RunConfig:
    return RunConfig.bare("reaching", n_step=n, gamma=0.9, reward_scale=scale)


def returns(of: Sequence[Sequence[float]], n: int) -> list[float]:
    return [sum(0.9**k * r for k, r in enumerate(e[t : t + n])) for e in of for t in range(len(e))]


@given(episodes, steps)
def test_returns_over_n_steps_span_ten(of: list[list[float]], n: int) -> None:
    found = returns(of, n)
    spread = max(found) - min(found)
    scale = RewardScale(config(n))
    if spread > 1e-6:
        assert scale.of(data(of)) * spread == pytest.approx(10)
        assert scale.found == scale.of(data(of))


@given(episodes, steps, st.sampled_from([1e-3, 0.25, 3.0, 1e4]))
def test_the_unit_of_rewards_does_not_matter(of: list[list[float]], n: int, unit: float) -> None:
    other = [[unit * r for r in e] for e in of]
    mine, theirs = RewardScale(config(n)), RewardScale(config(n))
    learned, same = mine.of(data(of)), theirs.of(data(other))
    if mine.found:
        assert same * unit == pytest.approx(learned)


def test_it_is_found_in_the_first_data_that_have_any_and_stays() -> None:
    scale = RewardScale(config())
    assert (scale.of(data([[1.0, 1.0]])), scale.found) == (1.0, 0.0)
    assert (scale.of(data([[1.0, 3.0]])), scale.found) == (5.0, 5.0)
    assert scale.of(data([[1.0, 1001.0]])) == 5.0
    assert RewardScale(config(), 5.0).of(data([[0.0, 1.0]])) == 5.0


@given(st.floats(1e-3, 10), episodes)
def test_what_a_run_asks_for_it_gets(given_scale: float, of: list[list[float]]) -> None:
    scale = RewardScale(config(scale=given_scale))
    assert scale.of(data(of)) == scale.found == given_scale
    D = Transitions.from_episodes(data(of), frames_stacked=1, reward_scale=given_scale)
    flat = np.array([r for e in of for r in e])
    assert torch.equal(D.rewards, torch.from_numpy((flat * given_scale).astype(np.float32)))


def test_what_is_found_out_may_be_called_by_its_name() -> None:
    asked = RunConfig.bare("reaching", reward_scale="auto", scale_initial="auto")
    assert (asked.reward_scale, asked.scale_initial) == (0, 0)


def test_a_run_whose_factor_is_lost_is_not_gone_on_with(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "01900000-0000-7000-8000-000000000000")
    folder.path.mkdir()
    assert History(config(), folder).reward_scale(0) == 0
    assert History(config(scale=0.5), folder).reward_scale(3) == 0
    with pytest.raises(CheckpointError, match="has lost iteration 2, which told"):
        History(config(), folder).reward_scale(3)


@pytest.mark.parametrize("beta", [0.01, 1.0, 30.0])
@pytest.mark.parametrize("hidden_units", [16, 256])
def test_the_first_policy_is_nearly_uniform_whatever_beta_and_n_are(
    beta: float, hidden_units: int
) -> None:
    asked = RunConfig.bare("reaching", beta=beta, hidden_units=hidden_units, scale_initial=0)
    network, _ = initial_policy(asked)
    frames = np.random.default_rng(0).integers(0, 256, (40, 1, 84, 84), np.uint8)
    P = preferences(network, [torch.from_numpy(frames)])
    assert 0.9 * math.log(14) < entropy(P, beta) < math.log(14)
    shares = torch.softmax(beta * P, dim=1)
    assert float(shares.max()) < 0.25
