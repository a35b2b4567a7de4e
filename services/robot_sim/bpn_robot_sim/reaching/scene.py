"""The reaching task's MJCF, filled in from its geometry."""

from bpn_robot_sim.planar_arm import scene
from bpn_robot_sim.reaching import geometry

_MASSES_KG = (0.06, 0.05)


def mjcf() -> str:
    """The scene as MJCF text."""
    lengths_px = geometry.LINK_LENGTHS_PX
    return scene.mjcf(
        "reaching",
        [scene.Link(px, kg) for px, kg in zip(lengths_px, _MASSES_KG, strict=True)],
        width_px=geometry.LINK_WIDTH_PX,
        hand_radius_px=geometry.HAND_RADIUS_PX,
        target_radius_px=geometry.TARGET_RADIUS_PX,
        target_px=geometry.TARGET_PX,
    )
