"""How a task's scene marks what its reward is computed from; drawn by the simulation, found by the learner.

In the reaching task every object has one flat gray level, drawn without light, shadow or smoothing, so
a pixel of an object has exactly its object's level. The hand is drawn above everything and is never
hidden; the target is hidden where the arm or the hand is above it, but not in an episode's first frame.
"""

BACKGROUND_LEVEL = 0
ARM_LEVEL = 80
TARGET_LEVEL = 160
HAND_LEVEL = 255
