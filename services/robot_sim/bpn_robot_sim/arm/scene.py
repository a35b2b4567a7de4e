"""The arm task's MJCF, filled in from its geometry."""

from bpn_robot_sim.arm import geometry
from bpn_robot_sim.planar_arm import scene

_LINK_KG = 0.03


def mjcf() -> str:
    """The scene as MJCF text."""
    return scene.mjcf(
        "arm",
        [scene.Link(length_px, _LINK_KG) for length_px in geometry.LINK_LENGTHS_PX],
        width_px=geometry.LINK_WIDTH_PX,
        hand_radius_px=geometry.HAND_RADIUS_PX,
        target_radius_px=geometry.TARGET_RADIUS_PX,
        target_px=geometry.TARGET_PX,
    )
