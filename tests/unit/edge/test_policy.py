import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bpn_edge.policy import (
    epsilon_greedy_action,
    softmax,
    softmax_action,
    softmax_weights,
)
from bpn_shared.messages.control import Assignment
from bpn_shared.spec.config import RunConfig

outputs = hnp.arrays(np.int32, st.integers(2, 64), elements=st.integers(-1024, 1024))
uniforms = st.floats(0, 1, exclude_max=True)
scales = st.floats(1e-3, 10)
betas = st.floats(1e-2, 1e4)


@example(np.array([0, 200], np.int32), 0.001, 3694.0)  # exp(-738.8) is subnormal
@given(outputs, scales, betas)
def test_weights_are_the_papers_equation(o: np.ndarray, scale: float, beta: float) -> None:
    weights = np.array(softmax_weights(o, scale, beta))
    assert weights.max() == 1
    expected = beta * scale * (o.astype(float) - float(o.max()))
    # Eq. 9 as ratios to the best action; below the smallest normal float a weight has few digits or none
    normal = weights >= np.finfo(float).tiny
    np.testing.assert_allclose(np.log(weights[normal]), expected[normal], rtol=1e-6, atol=1e-6)
    assert (expected[~normal] < -708).all()


@given(outputs, scales, betas, uniforms)
def test_the_drawn_action_is_where_the_cdf_passes_the_number(
    o: np.ndarray, scale: float, beta: float, uniform: float
) -> None:
    action = softmax_action(o, scale, beta, uniform)
    weights = softmax_weights(o, scale, beta)
    cdf = np.cumsum(weights) / np.sum(weights)
    assert 0 <= action < len(o)
    assert action == 0 or cdf[action - 1] <= uniform + 1e-12
    assert uniform - 1e-12 < cdf[action] or action == len(o) - 1


@example(np.array([1, 5, 3, 1, 0], np.int32))  # whose weights are not used up by the number
@given(outputs)
def test_a_number_next_to_one_gives_the_last_action_that_is_drawn_at_all(o: np.ndarray) -> None:
    action = softmax_action(o, 0.1, 1.0, np.nextafter(1, 0))
    cdf = np.cumsum(softmax_weights(o, 0.1, 1.0))
    assert action == len(o) - 1 or cdf[action] >= cdf[-1] * (1 - 1e-15 * len(o))


@given(outputs, scales, uniforms, st.integers(0, 9))
def test_an_episode_is_played_at_the_beta_of_its_weights_version(
    o: np.ndarray, scale: float, uniform: float, version: int
) -> None:
    """Whatever its iteration is called: an evaluation's is none of the run's."""
    config = RunConfig.bare("reaching", iterations=9, beta=0.5, beta_run_final_factor=5)
    assignment = Assignment(status="play", iteration=2**31 + version, weights_version=version)
    expected = softmax_action(o, scale, 0.5 + 2 * min(version, 8) / 8, uniform)
    assert softmax(config, assignment, scale)(o, uniform) == expected


@given(outputs, st.floats(0, 1), uniforms)
def test_epsilon_greedy(o: np.ndarray, epsilon: float, uniform: float) -> None:
    action = epsilon_greedy_action(o, epsilon, uniform)
    assert 0 <= action < len(o)
    if uniform >= epsilon:
        assert action == list(o).index(max(o))


def test_epsilon_one_reaches_every_action_equally() -> None:
    o = np.zeros(4, np.int32)
    drawn = [epsilon_greedy_action(o, 0.5, u) for u in np.linspace(0, 0.4999, 400)]
    assert np.bincount(drawn).tolist() == [100, 100, 100, 100]
