"""An arm of four joints in the plane, all turned at once, that reaches a target (docs/tasks/arm.md)."""
