"""Trajectories from pixels and actions, against the simulation's truth."""

import numpy as np
import pytest

from bpn.evaluation import plot, trajectories
from bpn_robot.robot import Robot
from bpn_robot_sim.robots import make_robot
from bpn_shared.errors import InputError
from bpn_shared.messages.episode import Episode, EpisodeMeta
from bpn_shared.spec.config import RunConfig
from bpn_shared.spec.tasks import task_named

STEPS = 12

Played = list[tuple[Episode, list[dict[str, tuple[float, float]]]]]


def episode_of(
    frames: list[np.ndarray], actions: list[int], task: str, *, terminated: bool = False
) -> Episode:
    steps, spec = len(actions), task_named(task)
    meta = EpisodeMeta(
        iteration=0, episode=0, seed=0, slot=0, worker="edge", weights_attempt=1, weights_version=0,
        terminated=terminated, deadline_misses=0, duration_ns=0,
    )  # fmt: skip
    return Episode(
        meta=meta,
        frames=np.stack(frames),
        actions=np.array(actions, np.uint8),
        outputs=np.tile(np.arange(spec.actions, dtype=np.int32), (steps, 1)),
        rewards=np.full(steps, np.nan),
        inference_ns=np.ones(steps, np.uint32),
        camera_to_action_ns=np.ones(steps, np.uint32),
    )  # fmt: skip


def played(robot: Robot, seed: int) -> tuple[Episode, list[dict[str, tuple[float, float]]]]:
    """Random play in lockstep, and the truth in every frame."""
    random = np.random.default_rng(seed)
    frames, actions = [robot.reset(seed)], []
    truth = [robot.info()]
    while len(actions) < STEPS and not robot.terminated:
        actions.append(int(random.integers(robot.task.actions)))
        robot.command(actions[-1])
        robot.settle()
        frames.append(robot.frame())
        truth.append(robot.info())
    return episode_of(frames, actions, robot.task.name, terminated=robot.terminated), truth


@pytest.fixture(scope="module")
def pan_tilt() -> Played:
    robot = make_robot("pan_tilt")
    episodes = [played(robot, seed) for seed in range(4)]
    robot.close()
    return episodes


def test_the_gaze_is_where_the_camera_points(pan_tilt: Played) -> None:
    for episode, truth in pan_tilt:
        expected = np.array([info["agent_deg"] for info in truth])
        np.testing.assert_allclose(trajectories.gaze_deg(episode), expected, atol=0.1)


def test_gaze_and_pixels_give_the_direction_in_which_the_marker_is(pan_tilt: Played) -> None:
    figure = trajectories.figure_deg(4000)
    for episode, truth in pan_tilt:
        gaze = trajectories.gaze_deg(episode)
        offsets = np.array([info["target_px"] for info in truth]) - 41.5
        seen = trajectories.seen_direction_deg(gaze, offsets)
        # the marker is on its figure-8, whatever the camera did meanwhile
        distances = np.linalg.norm(seen[:, None] - figure[None], axis=2).min(axis=1)
        assert distances.max() < 0.4
        in_middle = trajectories.seen_direction_deg(gaze, np.zeros_like(offsets))
        np.testing.assert_allclose(in_middle, gaze, atol=1e-6)


def test_offsets_come_from_the_pixels(pan_tilt: Played) -> None:
    for episode, truth in pan_tilt:
        expected = np.array([info["target_px"] for info in truth]) - 41.5
        kept = slice(None, -1) if episode.meta.terminated else slice(None)
        found = trajectories.target_offsets_px("pan_tilt", episode)
        np.testing.assert_allclose(found[kept], expected[kept], atol=1.5)


@pytest.mark.parametrize("task", ["reaching", "tracking", "pan_tilt"])
def test_every_task_of_the_paper_has_a_figure(task: str, pan_tilt: Played) -> None:
    if task == "pan_tilt":
        episodes = [episode for episode, _ in pan_tilt]
    else:
        robot = make_robot(task)
        episodes = [played(robot, seed)[0] for seed in range(2)]
        robot.close()
    (axes,) = plot.draw(task, episodes).axes
    assert len(axes.lines) >= len(episodes)
    if task != "reaching":
        assert f"{sum(one.meta.terminated for one in episodes)} lost" in axes.get_title()


def test_a_task_without_trajectories_is_refused() -> None:
    with pytest.raises(InputError, match="no trajectories are known of task 'gym:"):
        plot.draw("gym:CartPole-v1", [])


def test_the_gaze_stops_at_the_limits() -> None:
    frames = [np.zeros((3, 84, 84), np.uint8)] * 41
    up_and_left = episode_of(frames, [16] * 40, "pan_tilt")
    assert trajectories.gaze_deg(up_and_left)[-1].tolist() == [40.0, 30.0]
    assert RunConfig.for_task("pan_tilt").task_spec.hold_action == 2
    assert trajectories.gaze_deg(episode_of(frames, [2] * 40, "pan_tilt")).any() == np.False_
