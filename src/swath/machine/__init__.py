"""The machine: motion, steering, header, process; what the data sheet says about it."""

from swath.core.registry import Checked

TESTS = "tests/levels/test_ranges.py"  # against closed forms, at both ends
SPEED = Checked("ground_speed_kmh", -0.5, 14.4, TESTS)
SLOPES = (
    Checked("slope_across_percent", -20.0, 20.0, TESTS),
    Checked("slope_along_percent", -18.0, 18.0, TESTS),
)
