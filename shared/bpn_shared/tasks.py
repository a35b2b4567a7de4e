"""The tasks that robots can do: what every service must know of each."""

from dataclasses import dataclass

from bpn_shared.bnn.spec import IMAGE_SIZE_PX, NetworkSpec

CONTROL_PERIOD_S = 0.145
"""The paper's Table II."""


@dataclass(frozen=True, slots=True)
class Task:
    """One task.

    Attributes:
        env_id: the Gymnasium id of its simulation.
        frame_channels: c of one camera frame uint8[c, 84, 84].
        frames_stacked: frames in one observation; C = frame_channels * frames_stacked.
        action_names: what each action does, with its unit; |A| of them.
        hold_action: the action that leaves the robot where it is; what a robot did when no action
            came in time (realtime pacing).
        control_period_s: time between two frames in realtime pacing.
    """

    name: str
    env_id: str
    frame_channels: int
    frames_stacked: int
    action_names: tuple[str, ...]
    hold_action: int
    control_period_s: float

    @property
    def actions(self) -> int:
        """|A|."""
        return len(self.action_names)

    @property
    def frame_shape(self) -> tuple[int, int, int]:
        return self.frame_channels, IMAGE_SIZE_PX, IMAGE_SIZE_PX

    def network(self, nodes: int) -> NetworkSpec:
        """The geometry of this task's policy with N = nodes."""
        return NetworkSpec(self.frame_channels * self.frames_stacked, nodes, self.actions)


TASKS = {
    "reaching": Task(
        name="reaching",
        env_id="bpn/Reaching-v0",
        frame_channels=1,
        frames_stacked=1,
        action_names=tuple(
            f"joint {joint} by {turn}°"
            for joint in (1, 2)
            for turn in (-90, -45, -30, 0, 30, 45, 90)
        ),
        hold_action=3,  # joint 1 by 0 degrees
        control_period_s=CONTROL_PERIOD_S,
    ),
    "tracking": Task(
        name="tracking",
        env_id="bpn/Tracking-v0",
        frame_channels=3,
        frames_stacked=2,  # "to estimate the target's velocity", section V-A-2
        action_names=tuple(f"window by {move} px" for move in (-8, -4, -2, 0, 2, 4, 8)),
        hold_action=3,  # the window by 0 px
        control_period_s=CONTROL_PERIOD_S,
    ),
    "pan_tilt": Task(
        name="pan_tilt",
        env_id="bpn/PanTilt-v0",
        frame_channels=3,
        frames_stacked=2,
        action_names=(
            *(f"tilt by {n}°" for n in (-4, -2, 0, 2, 4)),
            *(f"pan by {n}°" for n in (-4, -2, 2, 4)),
            *(f"pan by {-n}°, tilt by {n}°" for n in (-4, -2, 2, 4)),
            *(f"pan by {n}°, tilt by {n}°" for n in (-4, -2, 2, 4)),
        ),
        hold_action=2,  # both motors by 0 degrees
        control_period_s=CONTROL_PERIOD_S,
    ),
}


def task_named(name: str) -> Task:
    """The task of that name.

    Raises:
        ValueError: there is none; the message lists those there are.
    """
    try:
        return TASKS[name]
    except KeyError:
        raise ValueError(f"task = {name!r} is unknown; one of: {', '.join(TASKS)}") from None
