"""The machine: motion, steering, header, process; what the data sheet says about it."""

from dataclasses import replace

from swath.core.registry import OWN_LAW, Checked

TESTS = "tests/levels/test_ranges.py"  # at both ends
SPEED = Checked("ground_speed_kmh", -0.5, 14.4, TESTS, "closed form")  # masses over the way
DRIVEN = replace(SPEED, witness=OWN_LAW)  # of what a flow or a power does
SLOPES = (
    Checked("slope_across_percent", -20.0, 20.0, TESTS, OWN_LAW),
    Checked("slope_along_percent", -18.0, 18.0, TESTS, OWN_LAW),
)
