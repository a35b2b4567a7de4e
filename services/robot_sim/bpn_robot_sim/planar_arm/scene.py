"""A planar arm's MJCF: links one behind the other, the hand at the last one's end, a target disc."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from string import Template

from bpn_shared.spec.network import IMAGE_SIZE_PX
from bpn_tasks import markers

PX_PER_M = 100.0
"""Of the camera's image: one pixel is one centimetre."""
BASE_PX = ((IMAGE_SIZE_PX - 1) / 2, (IMAGE_SIZE_PX - 1) / 2)
"""The arm's base, which is the world's origin; pixels are OpenCV's: x to the right, y down."""

ARMATURE_KGM2 = 0.05
"""Of a geared servo, reflected to the joint; far above the links' own inertia, so the joints hardly
disturb each other."""
NATURAL_FREQUENCY_PER_S = 80.0
"""A 90 degree rotation then settles within the control period of 0.145 s."""
DAMPING_RATIO = 1.1
"""Above 1 at the armature alone, so that the outstretched arm does not overshoot either."""

_HAND_KG = 0.01


@dataclass(frozen=True, slots=True)
class Link:
    """One link of the arm."""

    length_px: float
    mass_kg: float


def mjcf(
    name: str,
    links: Sequence[Link],
    *,
    width_px: float,
    hand_radius_px: float,
    target_radius_px: float,
    target_px: tuple[float, float],
) -> str:
    """The scene as MJCF text.

    Args:
        name: the model's.
        links: from the base on; joint k turns link k, and servo k joint k.
        target_px: where the target lies, under the arm.
    """
    stiffness = ARMATURE_KGM2 * NATURAL_FREQUENCY_PER_S**2
    damping = 2 * DAMPING_RATIO * ARMATURE_KGM2 * NATURAL_FREQUENCY_PER_S
    template = (resources.files(__package__) / "arm.xml").read_text(encoding="utf-8")
    target_x_m, target_y_m = to_world(*target_px)
    numbers = range(1, len(links) + 1)
    return Template(template).substitute(
        name=name,
        arm_gray=_gray(markers.ARM_LEVEL),
        target_gray=_gray(markers.TARGET_LEVEL),
        hand_gray=_gray(markers.HAND_LEVEL),
        armature=ARMATURE_KGM2,
        stiffness=stiffness,
        damping=damping,
        image_m=_metres(IMAGE_SIZE_PX),
        target_m=f"{target_x_m} {target_y_m}",
        target_radius_m=_metres(target_radius_px),
        links=_nested(links, _metres(width_px / 2), _metres(hand_radius_px)),
        servos="\n    ".join(f'<position name="servo{k}" joint="joint{k}"/>' for k in numbers),
    )


def to_px(x_m: float, y_m: float) -> tuple[float, float]:
    """Where a point of the world is in the image; the world's y points up."""
    return BASE_PX[0] + PX_PER_M * x_m, BASE_PX[1] - PX_PER_M * y_m


def to_world(x_px: float, y_px: float) -> tuple[float, float]:
    """The inverse of `to_px`, in metres."""
    return (x_px - BASE_PX[0]) / PX_PER_M, (BASE_PX[1] - y_px) / PX_PER_M


def _nested(links: Sequence[Link], half_width_m: float, hand_radius_m: float) -> str:
    end_m = _metres(links[-1].length_px)
    inner = (
        f'<body name="hand" pos="{end_m} 0 0"><geom type="cylinder" size="{hand_radius_m} 0.005" '
        f'pos="0 0 0.05" mass="{_HAND_KG}" material="hand"/></body>'
    )
    for k in reversed(range(len(links))):
        link, middle_m = links[k], _metres(links[k].length_px) / 2
        begin = f' pos="{_metres(links[k - 1].length_px)} 0 0"' if k else ""
        half_m = middle_m + half_width_m  # beyond both joints: no gap at a bent elbow
        inner = (
            f'<body name="link{k + 1}"{begin}><joint name="joint{k + 1}"/>'
            f'<geom type="box" pos="{middle_m} 0 0" size="{half_m} {half_width_m} 0.01" '
            f'mass="{link.mass_kg}" material="arm"/>{inner}</body>'
        )
    return inner


def _metres(length_px: float) -> float:
    return length_px / PX_PER_M


def _gray(level: int) -> str:
    return " ".join([repr(level / 255)] * 3)
