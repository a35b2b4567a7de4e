"""The robot's end of the protocol, spoken to as an edge would."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from loop_parts import Running
from robot_edge import EdgeSide

from bpn_robot import service
from bpn_robot_sim import worker as robot_sim
from bpn_robot_sim.robots import make_robot
from bpn_shared.bus.session import Bus
from bpn_shared.messages.frame import NO_ACTION, FrameHeader, FrameKind
from bpn_shared.spec.config import RunConfig

LOCKSTEP = RunConfig.for_task("reaching", hidden_units=16, steps=3)
REALTIME = RunConfig.for_task("tracking", hidden_units=16, steps=4, pacing="realtime")


@pytest.fixture
def edge(open_bus: Callable[[], Bus]) -> Callable[[RunConfig], EdgeSide]:
    return lambda config: EdgeSide(open_bus(), config)


def test_in_lockstep_each_frame_is_what_the_action_made_of_the_world(
    edge: Callable[[RunConfig], EdgeSide], running: Callable[..., Running]
) -> None:
    running("robot_sim", robot_sim.serve, LOCKSTEP)
    side, twin = edge(LOCKSTEP), make_robot("reaching")
    side.reset(5)
    expected, applied = twin.reset(3), NO_ACTION
    for step, action in enumerate([6, 13, 0, None]):
        header, pixels = side.frame(step, 5)
        np.testing.assert_array_equal(pixels, expected)
        kind = {0: FrameKind.FIRST, 3: FrameKind.LAST}.get(step, FrameKind.MID)
        assert header._replace(t_capture_ns=0, camera_to_action_ns=0, reward=0.0) == FrameHeader(
            kind, 2, 1, step, 5, 0, applied, reward=0.0
        )
        assert np.isnan(header.reward)  # this task's is in its pixels
        assert (header.camera_to_action_ns > 0) == (step > 0)
        assert header.success is None
        if action is not None:
            side.act(action, step, 5)
            twin.command(action)
            twin.settle()
            expected, applied = twin.frame(), action
    twin.close()


def test_in_lockstep_the_frame_is_sent_again_and_the_world_waits(
    edge: Callable[[RunConfig], EdgeSide],
    running: Callable[..., Running],
    wait_for: Callable[..., None],
) -> None:
    robot, side = running("robot_sim", robot_sim.serve, LOCKSTEP), edge(LOCKSTEP)
    side.reset(5)
    side.frame(0, 5)
    for counter, strange in (
        ("actions_for_other_frames", (6, 0, 4)),  # of another episode
        ("actions_for_other_frames", (6, 1, 5)),  # of another step
        ("actions_refused", (14, 0, 5)),  # none of the task's
    ):
        before = robot.counters.get(counter, 0)
        side.act(*strange)
        wait_for(lambda: robot.counters.get(counter, 0) == before + 1, counter)  # noqa: B023
    side.frame(0, 5, count=3)
    assert robot.counters["frames_sent_again"] >= 1
    before = len(side.frames)
    side.reset(5)  # asked again, it sends the frame again and does not begin anew
    side.frame(0, 5, count=before + 1)
    side.act(6, 0, 5)
    assert side.frame(1, 5)[0].applied_action == 6
    side.reset(6, episode=4)  # another one begins at once
    header, _ = side.frame(0, 6)
    assert (header.episode, header.kind) == (4, FrameKind.FIRST)


def test_in_realtime_a_robot_without_an_action_holds_and_counts(
    edge: Callable[[RunConfig], EdgeSide], running: Callable[..., Running]
) -> None:
    running("robot_sim", robot_sim.serve, REALTIME)
    side, hold = edge(REALTIME), REALTIME.task_spec.hold_action
    side.reset(5)
    last, _ = side.frame(REALTIME.steps, 5)
    headers = [side.frame(step, 5)[0] for step in range(REALTIME.steps + 1)]
    assert [header.applied_action for header in headers] == [NO_ACTION, *[hold] * 4]
    assert [header.deadline_misses for header in headers] == [0, 1, 2, 3, 4]
    assert {header.camera_to_action_ns for header in headers} == {0}
    assert last.kind == FrameKind.LAST
    period_ns = REALTIME.task_spec.control_period_s * 1e9
    times_ns = np.array([header.t_capture_ns for header in headers], float)
    assert (np.diff(times_ns) >= 0.99 * period_ns).all()


def test_in_realtime_an_action_that_is_in_time_is_applied(
    edge: Callable[[RunConfig], EdgeSide], running: Callable[..., Running]
) -> None:
    """On a busy machine one may be late: another episode is tried."""
    running("robot_sim", robot_sim.serve, REALTIME)
    side, action = edge(REALTIME), (REALTIME.task_spec.hold_action or 0) + 1
    applied: list[FrameHeader] = []
    for reset_id in range(5, 15):
        side.reset(reset_id)
        for step in range(REALTIME.steps):
            side.frame(step, reset_id)
            side.act(action, step, reset_id)
        side.frame(REALTIME.steps, reset_id)
        headers = [side.frame(step, reset_id)[0] for step in range(REALTIME.steps + 1)]
        applied = [header for header in headers if header.applied_action == action]
        if applied:
            break
    assert applied
    assert all(header.camera_to_action_ns > 0 for header in applied)


def test_what_it_waits_for_is_told_while_it_waits(
    edge: Callable[[RunConfig], EdgeSide],
    running: Callable[..., Running],
    wait_for: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot, side = running("robot_sim", robot_sim.serve, LOCKSTEP), edge(LOCKSTEP)

    def waits_for() -> str | None:
        return robot.worker.waiting.snapshot()[0]

    wait_for(lambda: waits_for() == "an edge to begin an episode", "it to be idle")
    side.reset(5)
    wait_for(lambda: waits_for() == "an action from the edge", "it to miss an action")
    with monkeypatch.context() as patient:
        patient.setattr(service, "_RESEND_S", 60.0)
        side.act(6, 0, 5)
        side.frame(1, 5)
        assert waits_for() is None
    side.reset(6)  # which ends the long wait


def test_what_an_edge_says_ends_every_wait(
    edge: Callable[[RunConfig], EdgeSide],
    running: Callable[..., Running],
    wait_for: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with monkeypatch.context() as patient:
        patient.setattr(service, "_RESEND_S", 60.0)
        robot, side = running("robot_sim", robot_sim.serve, LOCKSTEP), edge(LOCKSTEP)
        wait_for(lambda: robot.worker.waiting.snapshot()[0], "it to be idle")
        side.reset(5)
        side.frame(0, 5)
        side.reset(5)
        side.frame(0, 5, count=2)
        for step in range(LOCKSTEP.steps):
            side.act(6, step, 5)
            side.frame(step + 1, 5)
        side.reset(5)
        side.frame(LOCKSTEP.steps, 5, count=2)
        side.reset(6)
        side.frame(0, 6)
        side.reset(7)
        side.frame(0, 7)
        assert "frames_sent_again" not in robot.counters
    side.reset(8)


def test_the_last_frame_is_sent_until_another_episode_begins(
    edge: Callable[[RunConfig], EdgeSide], running: Callable[..., Running]
) -> None:
    running("robot_sim", robot_sim.serve, LOCKSTEP)
    side = edge(LOCKSTEP)
    side.reset(5)
    for step in range(3):
        side.frame(step, 5)
        side.act(3, step, 5)
    first, _ = side.frame(3, 5)
    again, _ = side.frame(3, 5, count=3)
    assert first.encode() == again.encode()
    side.reset(6)
    side.frame(0, 6)
    assert [f[0].reset_id for f in side.frames] == sorted(f[0].reset_id for f in side.frames)


def test_a_camera_that_shows_nothing_is_refused_at_the_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from bpn_robot.robots import make_robot
    from bpn_robot_sim.reaching.robot import ReachingRobot
    from bpn_robot_sim.rendering import RenderingError

    make_robot(LOCKSTEP.task_spec).close()
    black: Any = np.zeros((1, 84, 84), np.uint8)
    monkeypatch.setattr(ReachingRobot, "frame", lambda _: black)
    with pytest.raises(RenderingError, match="its pictures have one colour only"):
        make_robot(LOCKSTEP.task_spec)
