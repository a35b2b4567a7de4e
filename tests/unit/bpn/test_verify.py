"""The second writing of rewards, random numbers, observations and choices beside the first, over random input."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from paper import rewards

from bpn.verify import draws, pixels
from bpn.verify.play import greedy_choice, observations, softmax_choice
from bpn.verify.trainee import smallest_on
from bpn.verify.training import minibatches
from bpn_edge.policy import epsilon_greedy_action, softmax_action
from bpn_learner.fold import smallest_positive
from bpn_learner.transitions import EpisodeData, Transitions
from bpn_learner.update import minibatches_per_epoch
from bpn_shared.spec import seeds
from bpn_shared.spec.observation import stack
from bpn_tasks.markers import HAND_LEVEL, PAN_TILT_MARKER, TARGET_LEVEL, TRACKING_TARGET

DISCS = {"tracking": TRACKING_TARGET, "pan_tilt": PAN_TILT_MARKER}
points = st.tuples(st.floats(-15, 98), st.floats(-15, 98))
inside = st.tuples(st.floats(3, 80), st.floats(3, 80))
runs = st.integers(0, 2**63 - 1)


def with_disc(
    frame: np.ndarray, centre: tuple[float, float], radius: float, rgb: tuple[int, ...]
) -> None:
    """Draws a disc into uint8[c, 84, 84]."""
    y, x = np.mgrid[:84, :84]
    frame[:, (x - centre[0]) ** 2 + (y - centre[1]) ** 2 <= radius**2] = np.array(rgb)[:, None]


@pytest.mark.parametrize("task", DISCS)
@given(start=inside, path=st.lists(points, min_size=1, max_size=4), scale=st.floats(0.8, 1.2))
def test_a_disc_is_found_where_the_learner_finds_it(task, start, path, scale) -> None:
    """Whole, cut by the border, and gone."""
    disc = DISCS[task]
    frames = np.full((len(path) + 1, 3, 84, 84), 30, np.uint8)
    for frame, centre in zip(frames, (start, *path), strict=True):
        with_disc(frame, centre, disc.radius_px * scale, disc.rgb)
    np.testing.assert_allclose(pixels.rewards_px(task, frames), rewards(task, frames), atol=1e-6)


@given(target=inside, hands=st.lists(inside, min_size=2, max_size=4))
def test_a_hand_is_found_where_the_learner_finds_it(target, hands) -> None:
    frames = np.zeros((len(hands), 1, 84, 84), np.uint8)
    for t, (frame, hand) in enumerate(zip(frames, hands, strict=True)):
        with_disc(frame, hand, 3, (HAND_LEVEL,))
        if t == 0:
            with_disc(frame, target, 3, (TARGET_LEVEL,))
    if (frames[0] == HAND_LEVEL).any():
        np.testing.assert_allclose(
            pixels.rewards_px("reaching", frames), rewards("reaching", frames), atol=1e-9
        )


def test_a_frame_without_a_marker_is_said() -> None:
    with pytest.raises(pixels.PixelError, match="frame 0"):
        pixels.rewards_px("reaching", np.zeros((2, 1, 84, 84), np.uint8))
    with pytest.raises(pixels.PixelError, match="frame 0"):
        pixels.rewards_px("tracking", np.zeros((2, 3, 84, 84), np.uint8))


@given(runs, st.integers(0, 99_999), st.integers(0, 9_999))
def test_random_numbers_are_those_of_the_services(run: int, iteration: int, episode: int) -> None:
    seed = draws.episode_seed(run, iteration, episode)
    assert seed == seeds.episode_seed(run, iteration, episode)
    assert draws.step_uniforms(seed, 5) == [[u] for u in seeds.action_uniforms(seed, 5).tolist()]
    for dims in (2, 4, 5, 9):
        assert draws.step_uniforms(seed, 3, dims) == seeds.choice_uniforms(seed, 3, dims).tolist()
    assert draws.initial_seed(run) == seeds.initial_weights_seed(run)
    order = seeds.shuffle_generator(run, iteration).permutation(30)
    assert np.array_equal(draws.shuffles(run, iteration).permutation(30), order)


@given(
    st.integers(1, 6),
    st.integers(1, 3),
    st.integers(1, 5),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
@settings(deadline=None)
def test_robots_side_learner_and_verification_make_the_same_observations(
    steps, channels, stacked, difference, seed
) -> None:
    frames = np.random.default_rng(seed).integers(0, 256, (steps + 1, channels, 84, 84), np.uint8)
    found = observations(torch.from_numpy(frames), stacked, difference=difference).numpy()
    seen = [stack(list(frames), t, stacked, difference=difference) for t in range(steps + 1)]
    assert np.array_equal(found, seen)
    none = np.zeros(steps, np.float32)
    episode = EpisodeData(frames, none.astype(np.uint8), none, terminated=False)
    D = Transitions.from_episodes([episode] * 2, frames_stacked=stacked, difference=difference)
    assert np.array_equal(D.gather(D.observations).numpy(), seen[:-1] * 2)
    assert np.array_equal(D.gather(D.next_observations).numpy(), seen[1:] * 2)


@given(st.integers(0, 255), st.integers(0, 255))
def test_a_difference_is_twice_the_change_around_the_middle(earlier: int, newest: int) -> None:
    frames = [np.full((1, 84, 84), level, np.uint8) for level in (earlier, newest)]
    then, now = stack(frames, 1, 2, difference=True)[:, 0, 0].tolist()
    assert (then, now) == (min(max(128 + 2 * (newest - earlier), 0), 255), newest)


@given(
    st.lists(st.integers(-200, 200), min_size=2, max_size=20),
    st.floats(0.01, 2),
    st.floats(0.1, 10),
    st.floats(0, 1, exclude_max=True),
    st.floats(0, 1),
)
def test_choices_hold_the_edges_action(outputs, scale, beta, uniform, epsilon) -> None:
    o = np.array(outputs, np.int32)
    softmax = softmax_choice(o.astype(float) * scale, beta, uniform)
    assert softmax_action(o, scale, beta, uniform) in softmax
    greedy = greedy_choice(o.astype(float) * scale, epsilon, uniform)
    assert epsilon_greedy_action(o, epsilon, uniform) in greedy
    assert len(greedy) <= 2
    weights = np.exp(beta * scale * (o - o.max()))
    assert len(softmax) <= 2 or np.sort(weights / weights.sum())[: len(softmax) - 2].max() < 1e-8


@given(
    st.lists(st.tuples(st.floats(0, 5), st.floats(-300, 300)), min_size=1, max_size=5),
    st.integers(1, 100),
)
def test_thresholds_are_those_of_folding(affine, limit: int) -> None:
    a, b = (np.array(values) for values in zip(*affine, strict=True))
    found = smallest_on(torch.from_numpy(a), torch.from_numpy(b), limit)
    assert np.array_equal(found.numpy(), smallest_positive(a, b, limit))


@given(st.integers(2, 5000), st.integers(2, 4096))
def test_an_epoch_has_as_many_minibatches(size: int, batch: int) -> None:
    assert minibatches(size, batch) == minibatches_per_epoch(size, batch)
