"""Motion levels: how the machine moves under steering and speed."""

from swath.core.registry import OWN_LAW, Checked

TESTS = "tests/levels/test_motion.py"
CHECKED = (
    Checked("ground_speed_kmh", -0.5, 14.4, TESTS, "sibling"),
    Checked("slope_across_percent", -20.0, 20.0, TESTS, "closed form"),
    Checked("slope_along_percent", -18.0, 18.0, TESTS, "closed form"),
    Checked("yaw_rate_deg_s", -25.9, 25.9, TESTS, "sibling"),
)  # of a combine, levels against each other and against closed forms
FIRM = Checked(
    "cone_index_kpa", 1800.0, 10_000.0, "its wheels do not sink", "left out"
)  # as plain values of it
SINKING = Checked("cone_index_kpa", 350.0, 10_000.0, "tests/machine/test_on_soil.py", OWN_LAW)
ON_SOIL = (*CHECKED, SINKING)
