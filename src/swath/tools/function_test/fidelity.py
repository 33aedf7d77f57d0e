"""Which level of the scanner a run is judged at: the cheap one only where it can carry the limits.

The bias of detection at `empirical` is 2 to 3 cm from that at `plants` (wheat and rye, ten detectors on the
same stands), while its scatter is the same: so no mean or largest error is judged there to 5 cm or less.
"""

from math import atan, degrees
from typing import Any

from swath.core.number_text import num
from swath.field.wind import make_sway
from swath.runtime.credibility import holds
from swath.scenario.scenario import Scenario
from swath.sensing.lidar.empirical import BIAS, BIASED, CHECKED, compared_stems, table_name
from swath.sensing.tables import load_table, table_names

CHEAP, DEAR = "empirical", "plants"
BIAS_M = 0.05  # limits on errors of detection and line up to this are beyond the cheap level
LEVEL_BIAS_M, *_ = BIAS  # by which the bias of two detectors may move apart between the levels


def scanners(scenario: Scenario, level: str) -> list[str]:
    """Full names of the scanners at a level."""
    return [name for name, own in levels_of(scenario, "lidar").items() if own == level]


def why_not_cheap(scenario: Scenario) -> str:
    """Why runs of a scenario cannot be judged at the cheap level, "" where they can."""
    return _why_not_in(scenario) or _why_not_for(scenario)


def _why_not_in(scenario: Scenario) -> str:
    """What of the stand is outside the range in which the level was checked."""
    if scenario.field.stand is None:
        return "the stand comes from a field folder"
    stand = scenario.field.stand.params
    if unseen := [name for name in ("patches", "lodging") if getattr(stand, name, None)]:
        return f"the stand has {' and '.join(unseen)}"
    crop = getattr(stand, "crop", "a stand of your own")
    name = table_name(crop, "percentile")
    if name not in table_names():
        return f"there is no table of {crop}"
    asked, compared = _set_by(stand), compared_stems(load_table(name))
    if compared is None:
        return f"the table of {crop} was not compared"
    for checked in (*CHECKED, compared):
        for value in asked[checked.quantity]:
            if not holds(checked, value):
                return f"the level was checked for {checked.quantity} {checked.span} only"
    return ""


def _set_by(stand: Any) -> dict[str, list[float]]:
    """Quantities of a run (`runtime/met.py`) that the keys of a stand set."""
    wind, weeds = getattr(stand, "wind", None), getattr(stand, "weeds", None)
    sway = make_sway(wind, 0.0)
    densities = [getattr(part, "stems_per_m2", None) for part in (stand, *getattr(stand, "bands", ()))]
    return {
        "wind_lean_deg": [] if sway is None else [degrees(atan(sway.slope_max))],
        "weeds_per_m2": [] if weeds is None else [weeds.plants_per_m2],
        "lean_deg": [abs(getattr(stand, "lean_deg", 0.0))],
        "stems_per_m2": [density for density in densities if density is not None],
    }


def _why_not_for(scenario: Scenario) -> str:
    """Say which limit is too narrow for the level; "" where none is."""
    for expected in scenario.expect:
        bounds = [abs(b) for b in (expected.limit.min, expected.limit.max) if b is not None]
        if expected.name in BIASED and bounds and min(bounds) <= BIAS_M:
            return f"{expected.name} is asked to {num(min(bounds))} m, its bias is that large"
    return ""


def chosen_level(scenario: Scenario, wanted: str) -> tuple[list[str], str]:
    """Changes that bring a scenario's scanners to the level at which it is judged, and why that is the dear
    one though the cheap one is wanted, by `wanted` or by the scenario itself ("" where it is not).
    """
    cheap, dear = scanners(scenario, CHEAP), scanners(scenario, DEAR)
    if wanted == DEAR:
        return [f"{name}.level={DEAR}" for name in cheap], ""
    if not cheap and not (wanted == CHEAP and dear):
        return [], ""
    why = why_not_cheap(scenario)
    if why:
        return [f"{name}.level={DEAR}" for name in cheap], why
    return [f"{name}.level={CHEAP}" for name in dear if wanted == CHEAP], ""


def levels_of(scenario: Scenario, kind: str = "edge") -> dict[str, str]:
    """Levels of the slots of a kind by full name."""
    return {
        f"{machine.name}.{slot}": choice.level
        for machine in scenario.machines.values()
        for slot, choice in machine.slots.items()
        if choice.kind.name == kind
    }
