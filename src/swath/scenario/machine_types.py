"""Types of machines: which slots one has unless the scenario says otherwise, and at which level.

A data sheet names the type of its machine (`type: combine`) and may add to or take from its slots
(`slots: {gnss: error, odometry: off}`). Any other slot is there when the scenario names it.
"""

from collections.abc import Mapping

_HARVESTER = {
    "motion": "single_track",
    "header": "fixed_height",
    "process": "constant",
    "lidar": "plants",
    "odometry": "error",
    "imu": "error",
    "edge": "likelihood_ratio",
    "steer": "preview",
    "speed": "constant",
    "steering": "actuator",
}
_VEHICLE = {"motion": "single_track", "steer": "constant", "speed": "constant", "steering": "actuator"}

MACHINE_TYPES: Mapping[str, Mapping[str, str]] = {
    "combine": _HARVESTER,
    "forage_harvester": _HARVESTER,
    "tractor": _VEHICLE,
    "tractor_with_trailer": {**_VEHICLE, "motion": "articulated"},
    "truck": _VEHICLE,
}

BY_SECTION: Mapping[str, Mapping[str, str]] = {"box": {"heap": "height_map"}}  # of the data sheet
ORGANS = ("feeder", "threshing", "separation", "cleaning", "returns")
BY_LEVEL: Mapping[tuple[str, str], tuple[str, ...]] = {("process", "organs"): ORGANS}
"""Slot and level -> slots that a machine has with it alone, at the level of its sheet or the default one."""


def slots_of(machine_type: Mapping[str, str], own: Mapping[str, str]) -> dict[str, str]:
    """Slot -> level of a machine of a type. own: what its data sheet adds, or takes away with `off`."""
    slots = {**machine_type, **own}
    return {slot: level for slot, level in slots.items() if level != "off"}
