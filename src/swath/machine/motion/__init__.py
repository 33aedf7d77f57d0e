"""Motion levels: how the machine moves under steering and speed."""

from swath.core.registry import Checked

TESTS = "tests/levels/test_motion.py"
CHECKED = (
    Checked("ground_speed_kmh", -0.5, 14.4, TESTS),
    Checked("slope_across_percent", -20.0, 20.0, TESTS),
    Checked("slope_along_percent", -18.0, 18.0, TESTS),
    Checked("yaw_rate_deg_s", -25.9, 25.9, TESTS),
)  # of a combine, levels against each other and against closed forms
FIRM = Checked("cone_index_kpa", 1800.0, 10_000.0, "its wheels do not sink")  # as plain values of it
ON_SOIL = (*CHECKED, Checked("cone_index_kpa", 350.0, 10_000.0, "tests/machine/test_on_soil.py"))
