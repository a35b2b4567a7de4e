"""A robot beside what `Robot` promises to whoever plays it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from bpn.testing.answers import CheckedRobot
from bpn_robot.frame import Frame, is_flat
from bpn_robot.robot import Robot
from bpn_shared.spec.joint_actions import joined

PERIODS_TO_REST = 5
"""Control periods within which a robot that was stopped has to be at rest."""

Move = Callable[[CheckedRobot, int], None]
"""How an action is given and time passes, up to the next frame."""


@dataclass(frozen=True, slots=True)
class Played:
    """An episode as the robot played it: T+1 frames, T rewards, which are only those that it tells."""

    seed: int
    frames: list[Frame]
    rewards: list[float]
    terminated: bool
    success: bool | None


def check_robot(robot: Robot, *, steps: int = 30, seed: int = 0, repeatable: bool = True) -> None:
    """Holds a robot to `bpn_robot.robot.Robot`; it is closed afterwards.

    Every action and others at random, twice with equal seeds: in lockstep, and, where the task has a clock,
    with time that passes before and after the command. Then whether it comes to rest when it is stopped: before
    its first reset, at rest, and in motion. A real robot has to be where it may move freely.

    Args:
        robot: new, or of any state that `reset` ends.
        steps: of each way to play; every action is among them, or every choice of each dimension.
        seed: of the actions, and of the first episode.
        repeatable: False for a real robot, whose camera never sees the same twice: frames are not compared.

    Raises:
        AssertionError: it does not do what it should; the message is one sentence.
    """
    checked = CheckedRobot(robot, repeatable)
    try:
        examine(checked, steps, seed)
    finally:
        checked.close()


def examine(robot: CheckedRobot, steps: int, seed: int) -> list[Played]:
    """All that `check_robot` looks at, but for the closing.

    Returns:
        The episodes that were played in lockstep.
    """
    actions = _some_actions(robot.task.dims, steps, seed)
    robot.stop()
    robot.reset(seed)
    for wrong in (-1, robot.task.joint_actions):
        robot.refuse(wrong)
    in_lockstep = _play_twice(robot, seed, actions, lockstep, "settle()")
    _check_stop_at_rest(robot, seed, actions, in_lockstep)
    if robot.task.realtime:
        period_s = robot.task.control_period_s
        for share in (0, 0.5):
            move = partial(realtime, before_s=share * period_s)
            _play_twice(robot, seed, actions, move, f"advance({period_s - share * period_s:g})")
        _check_hold(robot, seed)
        _check_stop_in_motion(robot, seed)
    return in_lockstep


def lockstep(robot: CheckedRobot, action: int) -> None:
    """The robot waits for the action, and moves until it has done what that says."""
    _command(robot, action)
    robot.settle()


def realtime(robot: CheckedRobot, action: int, before_s: float) -> None:
    """The action comes `before_s` after the frame, within the control period."""
    robot.advance(before_s)
    _command(robot, action)
    robot.advance(robot.task.control_period_s - before_s)


def _command(robot: CheckedRobot, action: int) -> None:
    before = robot.frame()
    robot.command(action)
    assert robot.alike(before, robot.frame()), (
        f"{robot.who}: command({action}) or frame() lets time pass; only settle() and advance() do"
    )


def _some_actions(dims: Sequence[int], steps: int, seed: int) -> list[int]:
    """Each choice of each dimension in one of them at least, then others at random."""
    rng = np.random.default_rng(seed)
    most, count = max(dims), math.prod(dims)
    others = rng.integers(count, size=max(0, steps - most))
    orders = [np.resize(rng.permutation(n), most).tolist() for n in dims]
    each = [joined(choices, dims) for choices in zip(*orders, strict=True)]
    return [*each, *others.tolist()]


def _play_twice(
    robot: CheckedRobot, seed: int, actions: Sequence[int], move: Move, passes: str
) -> list[Played]:
    first = _play(robot, seed, actions, move)
    _check_pictures(robot, first, passes)
    robot.reset(seed)
    robot.command(actions[0])  # of which nothing may be left after the next reset
    again = _play(robot, seed, actions, move)
    for one, other in zip(first, again, strict=False):
        for step, (frame, repeated) in enumerate(zip(one.frames, other.frames, strict=False)):
            assert robot.alike(frame, repeated), (
                f"{robot.who}: seed {one.seed} and the same actions give another frame at step {step}"
            )
        assert _told(one) == _told(other) or not robot.repeatable, (
            f"{robot.who}: seed {one.seed} and the same actions give other rewards, or another end"
        )
    return first


def _check_pictures(robot: CheckedRobot, episodes: Sequence[Played], passes: str) -> None:
    frames = [frame for episode in episodes for frame in episode.frames]
    assert not all(map(is_flat, frames)), (
        f"{robot.who}: each of {len(frames)} frames has one colour only; the camera shows nothing"
    )
    assert any(not np.array_equal(e.frames[0], frame) for e in episodes for frame in e.frames), (
        f"{robot.who}: no action and {passes} ever changes its frame"
    )


def _check_stop_at_rest(
    robot: CheckedRobot, seed: int, actions: Sequence[int], played: Sequence[Played]
) -> None:
    """In lockstep a robot that waits for long is stopped, and then goes on as if nothing had been."""

    def stopped(robot: CheckedRobot, action: int) -> None:
        robot.stop()
        lockstep(robot, action)

    for one, other in zip(played, _play(robot, seed, actions, stopped), strict=False):
        assert all(map(robot.alike, one.frames, other.frames)), (
            f"{robot.who}: stop() between two steps in lockstep, where it is at rest, changes the frames after it"
        )


def _check_stop_in_motion(robot: CheckedRobot, seed: int) -> None:
    """Where nothing but the robot moves, its picture stands still soon after it was stopped."""
    period_s = robot.task.control_period_s

    def later() -> Frame | None:
        """The frame after one period; None: the episode has ended."""
        robot.advance(period_s)
        return None if any(robot.ended) else robot.frame()

    for action in _some_actions(robot.task.dims, 0, seed):
        robot.reset(seed)
        still, next_ = later(), later()
        if still is None or next_ is None or not robot.alike(still, next_):
            return  # something else moves
        robot.command(action)
        robot.advance(period_s / 4)
        robot.stop()
        for _ in range(PERIODS_TO_REST):
            later()
        still, next_ = later(), later()
        assert still is None or next_ is None or robot.alike(still, next_), (
            f"{robot.who}: {PERIODS_TO_REST} control periods after stop() in motion it still moves "
            f"(action {action}, {robot.task.action_name(action)!r})"
        )


def _told(episode: Played) -> tuple[object, ...]:
    return len(episode.frames), episode.rewards, episode.terminated, episode.success


def _play(robot: CheckedRobot, seed: int, actions: Sequence[int], move: Move) -> list[Played]:
    """As many episodes as the actions take, with one seed after the other."""
    episodes: list[Played] = []
    left = list(actions)
    while left:
        frames, rewards = [robot.reset(seed + len(episodes))], []
        while left:
            move(robot, left.pop(0))
            ended = robot.ended
            frames.append(robot.frame())
            rewards.append(robot.reward())
            robot.info()
            assert robot.ended == ended, (
                f"{robot.who}: terminated or truncated changes while no time passes"
            )
            if any(ended):
                break
        told = rewards if robot.task.told_rewards else []
        episodes.append(Played(seed + len(episodes), frames, told, robot.ended[0], robot.success))
    return episodes


def _check_hold(robot: CheckedRobot, seed: int) -> None:
    """A robot that is given nothing is recorded as one that holds, so it has to do the same."""
    hold = robot.task.hold_action
    other = (hold + 1) % robot.task.joint_actions
    seen = []
    for commanded in (True, False):
        robot.reset(seed)
        lockstep(robot, other)
        if any(robot.ended):
            return
        if commanded:
            robot.command(hold)
        robot.advance(robot.task.control_period_s)
        seen.append(robot.frame())
    assert robot.alike(seen[0], seen[1]), (
        f"{robot.who}: hold_action = {hold} ({robot.task.action_name(hold)!r}) does something else than no "
        "command at all"
    )
