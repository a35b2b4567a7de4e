"""What a robot is to whoever plays it: the service, a Gymnasium environment, a benchmark."""

from typing import Protocol

from bpn_robot.frame import Frame
from bpn_shared.spec.tasks import TaskSpec

Info = dict[str, tuple[float, ...]]


class RobotFault(RuntimeError):  # noqa: N818 - what the bus calls it too
    """The robot cannot go on with this episode; the message says what happened."""


class Robot(Protocol):
    """A robot with its camera.

    In lockstep one step is `command`, `settle`, `frame`; in realtime pacing it is `command` (of the action that
    came in time, else of the hold action), `advance(control period)`, `frame`. `settle` takes as long as the
    servos need where nothing else moves; where the target moves too, exactly one control period, in which they
    are done. Nothing else lets time pass, and a robot at rest stays where it is: a period with the hold action is
    the same as one without a command.

    Whenever there is nobody to obey, `stop` is called: before the first episode, after each, when no action has
    come for long, and before the end.

    Equal seeds and calls give equal frames, whatever was before the reset. A frame is a new contiguous
    uint8[c, rows, columns] (`task.frame_shape`). Whatever cannot go on raises `RobotFault`.
    `bpn.testing.check_robot` looks whether a robot does all that.
    """

    @property
    def task(self) -> TaskSpec: ...

    @property
    def terminated(self) -> bool:
        """Whether the episode has ended by the task's own rule; time limits are not among them."""

    @property
    def truncated(self) -> bool:
        """Whether the episode has to end before its time for no reason of the task's, as a simulator may say."""

    @property
    def success(self) -> bool | None:
        """What the environment says of the episode so far; None where it does not say."""

    def reset(self, seed: int) -> Frame:
        """Starts an episode at the start that belongs to the seed, and returns its first frame."""

    def command(self, action: int) -> None:
        """Gives the servos a new goal; nothing moves yet.

        Args:
            action: its number; where the task's actions have several dimensions, `task.choices` says what is
                chosen in each.

        Raises:
            ValueError: the task has no such action.
        """

    def settle(self) -> None:
        """Lets time pass until the servos have reached their goal, at least."""

    def advance(self, seconds: float) -> None:
        """Lets that much time pass, settled or not."""

    def stop(self) -> None:
        """Brings the robot to rest until the next command or reset, whatever it does; at rest it changes nothing.

        No time passes. Called at any moment, before the first reset too; what cannot be stopped raises.
        """

    def frame(self) -> Frame:
        """What the camera sees now."""

    def reward(self) -> float:
        """The reward of the last step: the paper's in pixels from the simulation's truth, or the environment's."""

    def info(self) -> Info:
        """The simulation's truth behind the reward, by name; names carry units."""

    def close(self) -> None:
        """Frees the camera's OpenGL context."""


def check_action(task: TaskSpec, action: int) -> int:
    """The action as an int.

    Raises:
        ValueError: the task has no such action.
    """
    if not 0 <= action < task.joint_actions:
        raise ValueError(
            f"action = {action} is outside 0..{task.joint_actions - 1}, the actions of {task.name!r}"
        )
    return int(action)
