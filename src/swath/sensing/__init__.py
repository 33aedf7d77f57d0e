"""Sensors: a folder per slot, a file per level; beam and echo models."""

from swath.core.registry import Checked

SPEED = Checked("ground_speed_kmh", -0.5, 14.4, "tests/levels/test_ranges.py")
TURN = Checked("yaw_rate_deg_s", -25.9, 25.9, "tests/levels/test_ranges.py")
RADAR = (
    SPEED,
    Checked("stems_per_m2", 200.0, 600.0, "tests/sensing/test_radar.py"),
    Checked("lean_deg", 0.0, 20.0, "tests/sensing/test_radar.py"),
)  # loss in the crop, against rays
CHECKED = SPEED, TURN  # of sensors of motion, against closed forms, in the ranges of motion levels
