"""The paper's reaching task: a 2-DOF arm in the plane, seen from above (section V-A-1)."""
