"""The paper's tasks: what every service must know of each, and the values that their runs begin with.

The presets are Table I; what it leaves open (optimizer, scales) was found by experiment, see docs/algorithms.
"""

from bpn_shared.spec.tasks import TaskSpec
from bpn_tasks.markers import REACHING_TARGET_RADIUS_PX

CONTROL_PERIOD_S = 0.145
"""The paper's Table II."""


def reaching() -> TaskSpec:
    """A 2-DOF arm seen from above brings its hand to a target (section V-A-1)."""
    return TaskSpec(
        name="reaching",
        title="Reaching",
        robot="reaching",
        rewards="reaching",
        reward_unit="px",
        plot="reaching",
        frame_channels=1,
        frames_stacked=1,
        action_names=tuple(
            f"joint {joint} by {turn}°"
            for joint in (1, 2)
            for turn in (-90, -45, -30, 0, 30, 45, 90)
        ),
        hold_action=3,  # joint 1 by 0 degrees
        control_period_s=CONTROL_PERIOD_S,
        success="last_reward",  # the hand ends on the target
        success_reward=-REACHING_TARGET_RADIUS_PX,
        preset={
            "steps": 20,
            "hidden_units": 256,
            "reward_scale": 0.1,
            "relative_targets": True,
            "lr_run_final_factor": 0.05,
        },
    )


def tracking() -> TaskSpec:
    """A window that slides over a wide image keeps a moving target in it (section V-A-2)."""
    return TaskSpec(
        name="tracking",
        title="Tracking",
        robot="tracking",
        rewards="tracking",
        reward_unit="px",
        plot="tracking",
        frame_channels=3,
        frames_stacked=2,  # "to estimate the target's velocity", section V-A-2
        action_names=tuple(f"window by {move} px" for move in (-8, -4, -2, 0, 2, 4, 8)),
        hold_action=3,  # the window by 0 px
        control_period_s=CONTROL_PERIOD_S,
        success="not_terminated",
        preset={
            "steps": 40,
            "hidden_units": 256,
            "reward_scale": 0.2,
            "relative_targets": True,
            "lr_run_final_factor": 0.05,
        },
    )


def pan_tilt() -> TaskSpec:
    """A camera on two servos keeps a marker in view that another such unit moves (section VI-B)."""
    return TaskSpec(
        name="pan_tilt",
        title="Pan tilt",
        robot="pan_tilt",
        rewards="pan_tilt",
        reward_unit="px",
        plot="pan_tilt",
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
        success="not_terminated",
        preset={
            "hidden_units": 100,
            "alpha": 0.95,
            "beta": 3.0,
            "iterations": 150,
            "steps": 80,
            "reward_scale": 0.1,
            "relative_targets": True,
            "lr_run_final_factor": 0.05,
        },
    )
