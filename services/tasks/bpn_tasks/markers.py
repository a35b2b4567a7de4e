"""How a task's scene marks what its reward is computed from; drawn by the simulation, found by the learner.

In every task a marked object has one flat colour, drawn without light, shadow or smoothing, so a pixel of
an object has exactly its object's colour. In the reaching task the hand is drawn above everything and is
never hidden; the target is hidden where the arm or the hand is above it, but not in an episode's first
frame. In the others nothing hides the target; the frame's border cuts it.
"""

from dataclasses import dataclass

BACKGROUND_LEVEL = 0
ARM_LEVEL = 80
TARGET_LEVEL = 160
HAND_LEVEL = 255
REACHING_TARGET_RADIUS_PX = 5.0


@dataclass(frozen=True, slots=True)
class Disc:
    """A target that the camera sees as a disc.

    Attributes:
        rgb: its colour, which nothing else in the scene has.
        radius_px: its radius in the image; where perspective varies it, the mean where the frame's
            border cuts it.
    """

    rgb: tuple[int, int, int]
    radius_px: float


TRACKING_TARGET = Disc(rgb=(255, 160, 0), radius_px=12.0)
PAN_TILT_MARKER = Disc(rgb=(0, 64, 255), radius_px=11.0)
