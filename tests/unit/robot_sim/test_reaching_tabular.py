"""Reaching as a table against the exact optimum, and errors that do what theory says."""

import numpy as np
import pytest
from scipy.special import logsumexp

from bpn_robot_sim.reaching import tabular
from bpn_robot_sim.reaching.optimum import optimal_return
from bpn_robot_sim.reaching.tabular import Update, greedy_returns


def test_without_an_error_q_learning_finds_the_optimum() -> None:
    assert greedy_returns(Update(None), 50, seed=0)[-10:] == pytest.approx(optimal_return())


@pytest.mark.parametrize("alpha", [0.0, 0.5, 0.95])
def test_an_update_is_equation_5(alpha: float) -> None:
    P = np.random.default_rng(1).normal(size=(576, 14)) * 3
    after, rewards = tabular._after(), tabular._rewards()
    m = logsumexp(P, axis=1) - np.log(14)
    expected = 0.1 * rewards[after] + 0.99 * m[after] + alpha * (P - m[:, None])
    np.testing.assert_allclose(tabular._backup(P, after, rewards, alpha), expected, atol=1e-12)


def test_cvi_averages_errors_that_change_and_not_those_that_stay() -> None:
    def lost(alpha: float | None, kind: tabular.Kind) -> float:
        seeds = range(4)
        update = Update(alpha, 1.0, kind)
        ends = [greedy_returns(update, 40, seed)[-10:].mean() for seed in seeds]
        return optimal_return() - float(np.mean(ends))

    assert lost(0.95, "fresh") < 0.5 * lost(None, "fresh")
    assert lost(0.95, "staying") > 0.7 * lost(None, "staying")


@pytest.mark.parametrize("nodes", [16, 32, 101])
def test_levels_are_a_binarized_outputs(nodes: int) -> None:
    P = np.random.default_rng(2).normal(size=(576, 14))
    levels = np.unique(tabular._levels(P, nodes))
    assert len(levels) <= nodes + 1
    scale = np.abs(levels).max() / nodes
    steps = levels / scale
    np.testing.assert_allclose((steps - nodes) / 2, np.round((steps - nodes) / 2), atol=1e-9)
    assert np.abs(tabular._levels(P, nodes) - (P - P.mean())).max() <= scale * (1 + 1e-9)


def test_the_seed_decides_the_errors_alone() -> None:
    update = Update(0.8, 0.5)
    np.testing.assert_array_equal(greedy_returns(update, 10, 3), greedy_returns(update, 10, 3))
    assert (greedy_returns(update, 10, 3) != greedy_returns(update, 10, 4)).any()
