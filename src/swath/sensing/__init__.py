"""Sensors: a folder per slot, a file per level; beam and echo models."""

from swath.core.registry import OWN_LAW, Checked

SPEED = Checked("ground_speed_kmh", -0.5, 14.4, "tests/levels/test_ranges.py", "closed form")
TURN = Checked("yaw_rate_deg_s", -25.9, 25.9, "tests/levels/test_ranges.py", "closed form")
RADAR = (
    SPEED,
    Checked("stems_per_m2", 200.0, 600.0, "tests/sensing/test_radar.py", "sibling"),
    Checked("lean_deg", 0.0, 20.0, "tests/sensing/test_radar.py", "sibling"),
    Checked("rain_mm_h", 0.0, 25.0, "tests/sensing/test_radar.py", OWN_LAW),
)  # loss in the crop, against rays
STEMS_SEEN = (
    Checked("lean_deg", 0.0, 75.0, "tests/rays/test_exact.py", "closed form"),
    Checked("wind_lean_deg", 0.0, 24.5, "tests/rays/test_wind.py", "closed form"),
    Checked("stems_per_m2", 0.0, 1000.0, "tests/rays/test_closed_form.py", "closed form"),
)  # by rays against every stem
CAMERA = (*STEMS_SEEN, Checked("dust_per_m", 0.0, 0.3, "tests/sensing/test_camera_error.py", OWN_LAW))
RANGES = "tests/sensing/test_plants_ranges.py"
BRIGHTEST = 120_000.0  # light of the brightest day that was checked [lx]
RECEIVED = Checked("receiver_light_lx", 0.0, BRIGHTEST, "tests/sensing/test_daylight.py", OWN_LAW)
AIR = (
    Checked("rain_mm_h", 0.0, 50.0, RANGES, OWN_LAW),
    Checked("dust_per_m", 0.0, 0.3, RANGES, OWN_LAW),
    RECEIVED,
)  # of echoes
CHECKED = SPEED, TURN  # of sensors of motion, against closed forms, in the ranges of motion levels
