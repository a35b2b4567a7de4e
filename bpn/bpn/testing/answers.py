"""A robot whose every answer is looked at: what a single call shows of it."""

import math
from typing import Any

import numpy as np

from bpn_robot.frame import Frame
from bpn_robot.robot import Robot, RobotFault
from bpn_shared.errors import one_line
from bpn_shared.spec.tasks import TaskSpec


class CheckedRobot:
    """Passes calls on, and raises `AssertionError` where an answer is not what `Robot` says.

    Args:
        robot: which.
        repeatable: whether frames repeat bit by bit, as simulated ones have to.

    Attributes:
        who: the robot, at the beginning of each message.
        task: its.
    """

    def __init__(self, robot: Robot, repeatable: bool = True) -> None:
        self._robot = robot
        self.repeatable = repeatable
        self._given: tuple[Frame, bytes] | None = None
        task = getattr(robot, "task", None)
        assert isinstance(task, TaskSpec), (
            f"{type(robot).__name__}: task is {task!r}, not the TaskSpec that it was made for"
        )
        self.task = task
        self.who = f"robot {task.robot!r}"

    @property
    def ended(self) -> tuple[bool, bool]:
        """Whether the episode is terminated, and whether it is truncated."""
        terminated, truncated = self._tell("terminated"), self._tell("truncated")
        for name, told in (("terminated", terminated), ("truncated", truncated)):
            assert isinstance(told, bool), f"{self.who}: {name} is {told!r}, not True or False"
        return terminated, truncated

    @property
    def success(self) -> bool | None:
        told = self._tell("success")
        assert told is None or isinstance(told, bool), (
            f"{self.who}: success is {told!r}, not True, False or None"
        )
        return told

    def reset(self, seed: int) -> Frame:
        """An episode's first frame, which `frame()` shows too."""
        first = self._looked_at(f"reset({seed})", self._ask("reset", seed))
        assert not any(self.ended), f"{self.who}: it has ended right after reset({seed})"
        assert self.alike(first, self.frame()), (
            f"{self.who}: frame() right after reset({seed}) is not the frame that reset returned"
        )
        return first

    def command(self, action: int) -> None:
        self._nothing("command", action)

    def settle(self) -> None:
        self._nothing("settle")

    def advance(self, seconds: float) -> None:
        self._nothing("advance", seconds)

    def stop(self) -> None:
        self._nothing("stop")

    def close(self) -> None:
        self._nothing("close")

    def frame(self) -> Frame:
        return self._looked_at("frame()", self._ask("frame"))

    def alike(self, frame: Frame, other: Frame) -> bool:
        """Whether two frames are equal that have to be, as far as they can be."""
        return not self.repeatable or np.array_equal(frame, other)

    def reward(self) -> float:
        """Finite, if the task's rewards are those that the robot tells."""
        told = self._ask("reward")
        assert isinstance(told, float | int), f"{self.who}: reward() is {told!r}, not a float"
        assert math.isfinite(told) or not self.task.told_rewards, (
            f"{self.who}: reward() is {told}, not finite"
        )
        return float(told)

    def info(self) -> None:
        """Asks for it alone: what is in it is for people."""
        told = self._ask("info")
        assert isinstance(told, dict), f"{self.who}: info() is {told!r}, not a dict"
        for name, value in told.items():
            assert len(np.shape(value)) == 1, (
                f"{self.who}: info()[{name!r}] is {value!r}, not a tuple of numbers"
            )

    def refuse(self, action: int) -> None:
        """An action that the task does not have, which has to be refused."""
        how = f"command({action}) of the actions 0..{self.task.joint_actions - 1}"
        try:
            self._robot.command(action)
        except ValueError:
            return
        except Exception as error:
            raise AssertionError(
                f"{self.who}: {how} raises {one_line(error)}, not ValueError"
            ) from error
        raise AssertionError(f"{self.who}: {how} is accepted, it has to raise ValueError")

    def _nothing(self, method: str, *args: Any) -> None:
        returned = self._ask(method, *args)
        assert returned is None, f"{self.who}: {method}() returns {returned!r}, not None"

    def _tell(self, name: str) -> Any:
        try:
            return getattr(self._robot, name)
        except Exception as error:
            raise AssertionError(f"{self.who}: {name} raises {one_line(error)}") from error

    def _ask(self, method: str, *args: Any) -> Any:
        what = f"{method}({', '.join(map(str, args))})"
        try:
            return getattr(self._robot, method)(*args)
        except RobotFault as fault:
            raise AssertionError(f"{self.who}: {what} has a fault: {fault}") from fault
        except Exception as error:
            raise AssertionError(
                f"{self.who}: {what} raises {one_line(error)}; a robot that cannot go on raises RobotFault"
            ) from error

    def _looked_at(self, what: str, frame: Any) -> Frame:
        shape = self.task.frame_shape
        assert isinstance(frame, np.ndarray), (
            f"{self.who}: {what} is {type(frame).__name__}, no array"
        )
        assert (frame.dtype, frame.shape) == (np.uint8, shape), (
            f"{self.who}: {what} is {frame.dtype}{list(frame.shape)}, not uint8{list(shape)}"
        )
        assert frame.flags.c_contiguous, (
            f"{self.who}: {what} is not contiguous; np.ascontiguousarray makes it so"
        )
        if self._given is not None:
            given, pixels = self._given
            assert given.tobytes() == pixels, (
                f"{self.who}: {what} overwrites the frame before it; each has to be a new array"
            )
        self._given = frame, frame.tobytes()
        return frame
