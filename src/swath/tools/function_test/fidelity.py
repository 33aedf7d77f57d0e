"""Which level of the scanner a run is judged at: the cheap one only where it can carry the limits.

The bias of detection at `empirical` is 2 to 3 cm from that at `plants` (wheat and rye, ten detectors on the
same stands), while its scatter is the same: so no mean or largest error is judged there to 5 cm or less.
"""

from collections.abc import Mapping

from swath.scenario.scenario import Scenario
from swath.sensing.lidar.empirical import table_name
from swath.sensing.tables import load_table, table_names, valid_range

CHEAP, DEAR = "empirical", "plants"
BIAS_M = 0.05  # limits on errors of detection and line up to this are beyond the cheap level
LEVEL_BIAS_M = 0.03  # by which the bias of two detectors may move apart between the levels
ERRORS = ("edge_rmse_m", "edge_bias_m", "lateral_rms_m", "lateral_p95_m", "lateral_bias_m")
LODGED_DEG = 20.0  # lean from which on the table knows the crop no more


def scanners(scenario: Scenario, level: str) -> list[str]:
    """Full names of the scanners at a level."""
    return [
        f"{machine.name}.{slot}"
        for machine in scenario.machines.values()
        for slot, choice in machine.slots.items()
        if choice.kind.name == "lidar" and choice.level == level
    ]


def why_not_cheap(scenario: Scenario) -> str:
    """Why runs of a scenario cannot be judged at the cheap level, "" where they can."""
    return _why_not_in(scenario) or _why_not_for(scenario)


def _why_not_in(scenario: Scenario) -> str:
    """What of the stand the level does not see."""
    if scenario.field.stand is None:
        return "the stand comes from a field folder"
    stand = scenario.field.stand.params
    has = {name: getattr(stand, name, None) for name in ("wind", "weeds", "patches", "lodging")}
    if unseen := [name for name, value in has.items() if value]:
        return f"the stand has {' and '.join(unseen)}"
    if abs(getattr(stand, "lean_deg", 0.0)) > 0.5 * LODGED_DEG:
        return f"the stand leans by {stand.lean_deg:g} deg"
    crop = getattr(stand, "crop", "a stand of your own")
    name = table_name(crop, "percentile")
    if name not in table_names():
        return f"there is no table of {crop}"
    low, high = valid_range(load_table(name).standing)["density_per_m2"]
    densities = [stand.stems_per_m2, *(band.stems_per_m2 for band in getattr(stand, "bands", ()))]
    for density in densities:
        if density is not None and not low < density <= high:
            return f"{density:g} stems per m2 are at or beyond the end of its table ({low:g} to {high:g})"
    return ""


def _why_not_for(scenario: Scenario) -> str:
    """Which limit is too narrow."""
    for expected in scenario.expect:
        bounds = [abs(b) for b in (expected.limit.min, expected.limit.max) if b is not None]
        if expected.name in ERRORS and bounds and min(bounds) <= BIAS_M:
            return f"{expected.name} is asked to {min(bounds):g} m, its bias is that large"
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


def detectors(scenario: Scenario) -> dict[str, str]:
    """Levels of the edge detectors by full name."""
    return {
        f"{machine.name}.{slot}": choice.level
        for machine in scenario.machines.values()
        for slot, choice in machine.slots.items()
        if choice.kind.name == "edge"
    }


def told(reasons: Mapping[tuple[str, str], int]) -> list[str]:
    """A line for each case that is judged at the dear level, with how many of its runs."""
    return [f"{case}: {count} runs at {DEAR}: {why}" for (case, why), count in reasons.items()]
