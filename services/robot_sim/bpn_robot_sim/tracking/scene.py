"""The tracking task's MJCF, filled in from its geometry, its colour and its servo."""

from importlib import resources
from string import Template

from bpn_robot_sim.tracking import geometry
from bpn_shared.spec import markers
from bpn_shared.spec.network import IMAGE_SIZE_PX

MASS_KG = 1.0
NATURAL_FREQUENCY_PER_S = 80.0
"""A move of 8 px is then done within the control period of 0.145 s."""
DAMPING_RATIO = 1.0


def mjcf() -> str:
    """The scene as MJCF text."""
    template = (resources.files(__package__) / "window.xml").read_text(encoding="utf-8")
    return Template(template).substitute(
        target_rgb=" ".join(repr(level / 255) for level in markers.TRACKING_TARGET.rgb),
        target_radius_m=geometry.TARGET_RADIUS_PX / geometry.PX_PER_M,
        window_y_m=geometry.to_world_m((0.0, geometry.WINDOW_Y_PX))[1],
        image_m=IMAGE_SIZE_PX / geometry.PX_PER_M,
        mass=MASS_KG,
        stiffness=MASS_KG * NATURAL_FREQUENCY_PER_S**2,
        damping=2 * DAMPING_RATIO * MASS_KG * NATURAL_FREQUENCY_PER_S,
    )
