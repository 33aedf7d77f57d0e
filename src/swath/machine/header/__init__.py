"""Header levels: what the knife takes from the field."""

from swath.core.registry import Checked

PROFILE_STEMS = Checked("stems_per_m2", 50.0, 700.0, "tests/levels/test_ranges.py", "sibling")
FLOWS = "grain", "straw", "area", "stem_count", "header_fill", "dt", "left_grain"  # that headers send
OVER_M = 1.0  # of travel, which `header_fill` forgets over: cells of 1.6 cm, cut whole, scatter it by 1 %
