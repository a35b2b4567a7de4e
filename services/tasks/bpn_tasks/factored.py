"""Tasks that choose in several dimensions at once, a joint's turn each (docs/factored-actions.md): two of the
paper's robots with both joints turned in every step, and an arm of four joints.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any

from bpn_shared.spec.joint_actions import joined
from bpn_shared.spec.tasks import TaskSpec
from bpn_tasks import specs
from bpn_tasks.markers import REACHING_TARGET_RADIUS_PX

REACHING_TURNS_DEG = (-90, -45, -30, 0, 30, 45, 90)
PAN_TILT_TURNS_DEG = (-4, -2, 0, 2, 4)
ARM_TURNS_DEG = (-30, -15, -5, 0, 5, 15, 30)
ARM_JOINTS = 4


def reaching_both() -> TaskSpec:
    """Reaching, both joints at once: 49 actions, 14 outputs."""
    joints = ("joint 1", "joint 2")
    return _as(
        specs.reaching(),
        "reaching_both",
        "Reaching, both joints",
        **_turned(joints, REACHING_TURNS_DEG),
    )


def pan_tilt_both() -> TaskSpec:
    """Pan tilt, each servo by itself: 25 actions, 10 outputs."""
    return _as(
        specs.pan_tilt(),
        "pan_tilt_both",
        "Pan tilt, both servos",
        **_turned(("pan", "tilt"), PAN_TILT_TURNS_DEG),
    )


def arm() -> TaskSpec:
    """An arm with four joints seen from above brings its hand to a target: 2,401 actions, 28 outputs."""
    joints = [f"joint {k + 1}" for k in range(ARM_JOINTS)]
    return TaskSpec(
        name="arm",
        title="Four-joint arm",
        robot="arm",
        rewards="reaching",
        reward_unit="px",
        plot="reaching",
        frame_channels=1,
        control_period_s=specs.CONTROL_PERIOD_S,
        success="last_reward",  # the hand ends on the target
        success_reward=-REACHING_TARGET_RADIUS_PX,
        preset={
            "steps": 20,
            "iterations": 60,
            "episodes": 20,
            "max_updates": 400,
            "hidden_units": 256,
            "reward_scale": 0.3,  # reaching's, about as many times as there are joints: entropies add up
            "scale_initial": 0.1,  # outputs add up
            "relative_targets": True,
            "lr_run_final_factor": 0.05,
        },
        **_turned(joints, ARM_TURNS_DEG),
    )


def _turned(joints: Sequence[str], turns_deg: Sequence[int]) -> dict[str, Any]:
    """The actions that turn each of the joints by one of the angles; holding turns none."""
    dims = (len(turns_deg),) * len(joints)
    return {
        "action_names": tuple(f"{joint} by {turn}°" for joint, turn in product(joints, turns_deg)),
        "action_dims": dims,
        "hold_action": joined([turns_deg.index(0)] * len(joints), dims),
    }


def _as(task: TaskSpec, name: str, title: str, **changes: Any) -> TaskSpec:
    return TaskSpec.model_validate(task.model_dump() | {"name": name, "title": title} | changes)
