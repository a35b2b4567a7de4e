"""The pan-tilt task's MJCF, filled in from its geometry, its colours and its servos."""

from importlib import resources
from string import Template

from bpn_robot_sim.pan_tilt import backdrop, geometry
from bpn_shared.spec import markers

ARMATURE_KGM2 = 0.01
"""Of a geared servo like the paper's Dynamixel XM430-W350, reflected to the joint (its gear is 353:1)."""
NATURAL_FREQUENCY_PER_S = 60.0
"""Turns of 4 degrees are then done within the control period, and the boom hardly slows its servos."""
DAMPING_RATIO = 1.1
STALL_TORQUE_NM = 4.1
"""The XM430-W350's at 12 V."""

BACKDROP_M = 1.6
"""From the camera; behind the target unit."""
BACKDROP_HALF_SIZE_M = (3.1, 3.1)


def mjcf() -> str:
    """The scene as MJCF text; the pixels of its texture `backdrop` come from `backdrop.pixels`."""
    half_width_m, half_height_m = BACKDROP_HALF_SIZE_M
    template = (resources.files(__package__) / "units.xml").read_text(encoding="utf-8")
    return Template(template).substitute(
        texture_px=backdrop.SIZE_PX,
        marker_rgb=" ".join(repr(level / 255) for level in markers.PAN_TILT_MARKER.rgb),
        armature=ARMATURE_KGM2,
        stiffness=ARMATURE_KGM2 * NATURAL_FREQUENCY_PER_S**2,
        damping=2 * DAMPING_RATIO * ARMATURE_KGM2 * NATURAL_FREQUENCY_PER_S,
        torque=STALL_TORQUE_NM,
        backdrop_m=BACKDROP_M,
        half_width_m=half_width_m,
        half_height_m=half_height_m,
        fov=geometry.FOV_DEG,
        distance_m=geometry.DISTANCE_M,
        boom_m=geometry.BOOM_M,
        half_boom_m=geometry.BOOM_M / 2,
        marker_radius_m=geometry.MARKER_RADIUS_M,
    )
