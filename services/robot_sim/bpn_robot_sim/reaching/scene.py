"""The reaching task's MJCF, filled in from its geometry, its gray levels and its servos."""

from importlib import resources
from string import Template

from bpn_robot_sim.reaching import geometry
from bpn_shared.spec import markers
from bpn_shared.spec.network import IMAGE_SIZE_PX

ARMATURE_KGM2 = 0.05
"""Of a geared servo, reflected to the joint; far above the links' own inertia, so the joints hardly
disturb each other."""
NATURAL_FREQUENCY_PER_S = 80.0
"""A 90 degree rotation then settles within the control period of 0.145 s."""
DAMPING_RATIO = 1.1
"""Above 1 at the armature alone, so that the outstretched arm does not overshoot either."""


def mjcf() -> str:
    """The scene as MJCF text."""
    stiffness = ARMATURE_KGM2 * NATURAL_FREQUENCY_PER_S**2
    damping = 2 * DAMPING_RATIO * ARMATURE_KGM2 * NATURAL_FREQUENCY_PER_S
    length1_m, length2_m = (_metres(length_px) for length_px in geometry.LINK_LENGTHS_PX)
    half_width_m = _metres(geometry.LINK_WIDTH_PX / 2)
    target_x_m, target_y_m = geometry.to_world(*geometry.TARGET_PX)
    template = (resources.files(__package__) / "arm.xml").read_text(encoding="utf-8")
    return Template(template).substitute(
        arm_gray=_gray(markers.ARM_LEVEL),
        target_gray=_gray(markers.TARGET_LEVEL),
        hand_gray=_gray(markers.HAND_LEVEL),
        armature=ARMATURE_KGM2,
        stiffness=stiffness,
        damping=damping,
        image_m=_metres(IMAGE_SIZE_PX),
        target_m=f"{target_x_m} {target_y_m}",
        target_radius_m=_metres(geometry.TARGET_RADIUS_PX),
        hand_radius_m=_metres(geometry.HAND_RADIUS_PX),
        link1_m=length1_m,
        link2_m=length2_m,
        middle1_m=length1_m / 2,
        middle2_m=length2_m / 2,
        half_link1_m=length1_m / 2 + half_width_m,  # beyond both joints: no gap at a bent elbow
        half_link2_m=length2_m / 2 + half_width_m,
        half_width_m=half_width_m,
    )


def _metres(length_px: float) -> float:
    return length_px / geometry.PX_PER_M


def _gray(level: int) -> str:
    return " ".join([repr(level / 255)] * 3)
