"""The paper's real-robot task, simulated: a pan-tilt camera follows a marker on another unit (section VI-B)."""
