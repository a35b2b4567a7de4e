"""An arm with four joints in the plane, all turned at once, that brings its hand to a target (docs/tasks/arm.md)."""
