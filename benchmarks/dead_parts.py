"""Every level stands where a limit depends on it: a dead part in its place breaks the limit.

python -m benchmarks.dead_parts [LEVEL ...]    such as camera.rays; without one all of them, about 4 minutes

A dead part sends its first sample and then nothing; of a command the first one says nothing. In the place of
terrain and stand comes another: a slope or a plane, and a stand of one stem per square metre. Left out are
levels that need a file of the user, those that are another one with other parameters, and dust.plume: as much
dust as has been published moves no limit of a detector (benchmarks/dust.py).
"""

import sys
from dataclasses import replace
from importlib.util import find_spec
from math import nan
from typing import Any

from swath.core.component import Inputs, Outputs, State
from swath.core.random import Stream
from swath.runtime.job import run_unrecorded
from swath.scenario.overrides import layered
from swath.scenario.scenario import Scenario, load_scenario
from swath.scenario.slots import CATALOGUE as SLOTS
from swath.signals import (
    CropStream,
    OrganLoads,
    OrganSettings,
    OrganWork,
    SpeedCommand,
    SteerCommand,
    UnloadCommand,
)
from swath.signals.flat import build, flat_fields
from swath.tools.function_test.case import CATALOGUE, read_case

LEFT_OUT = {"terrain.dem", "lidar.replay", "field_map.file", "edge.onnx", "objects.onnx", "dust.plume"}
WHERE = {
    "forage-maize": "motion.kinematic header.fixed_height process.constant powertrain.ideal lidar.plants "
    "edge.otsu steer.stanley steering.actuator stand.uniform",
    "rolling-slope": "motion.multibody header.height_control odometry.error ground_speed.radar gnss.error "
    "imu.error pose.raw steer.path speed.constant steering.ideal terrain.formula",
    "record-run": "process.threshing powertrain.hydrostat",
    "fill-seen": "motion.articulated unload.auger heap.cones lidar.empirical peer_link.radio box.rim "
    "cooperate.by_profile cooperate.unloader steer.station speed.station",
    "camera-cab": "motion.single_track camera.error edge.truth objects.joined",
    "fawn-at-dawn": "camera.thermal",
    "feed-rate": "stand.bands crop_flow.delayed speed.feed_rate",
    "look-ahead": "ahead.penetration speed.look_ahead",
    "two-scanners": "edge.joined",
    "straight": "edge.likelihood_ratio steer.preview",
    "lodged-in": "stand.maps",
    "person-seen seen_by=scanner": "camera.rays objects.cluster",
    "person-seen seen_by=radar": "camera.depth objects.radar radar.error",
    "person-seen seen_by=radar_rays": "radar.rays",
    "person-seen seen_by=radar_ideal": "radar.ideal",
    "person-seen seen_by=error": "objects.error",
    "person-seen seen_by=truth": "objects.truth",
    "hillside by=filter": "gnss.sky pose.ekf",
    "hillside by=law": "steer.edge_or_path",
    "hillside by=ground": "ground_speed.ideal",
    "cheap-parts stems_per_m2=400": "terrain.plane header.profile lidar.profile steer.pure_pursuit",
    "fill-ways by=true_box": "box.truth",
    "fill-ways by=front_to_back": "cooperate.front_to_back heap.height_map",
    "fill-ways by=one_spot": "cooperate.one_spot",
    "map-ahead map=true": "field_map.ideal",
    "map-ahead map=drawn": "field_map.error",
    "beside-cart stems_per_m2=400": "scan_filter.peer_body",
    "organs by=sieves": "cleaning.model settings.fixed",
    "organs by=walkers": "separation.walkers",
    "settings-climb by=climb": "settings.climb",
    "organs-dense patch_per_m2=650": "threshing.model separation.model",
    "organs-hours at=8 h": "feeder.model",
    "organs-slope slope_percent=10": "cleaning.model",
    "organs-weeds plants_per_m2=10": "feeder.model cleaning.model",
    "organs-concave clearance=close": "settings.fixed",
    "organs by=plain": "process.organs feeder.model threshing.model separation.model "
    "cleaning.overload returns.model",
    "turn-circle speed_kmh=7": "steer.constant",
}
"""Scenario, or case and point -> the levels on which its limits depend."""
COMMANDS = OrganSettings, SpeedCommand, SteerCommand, UnloadCommand
HELD = "settings.climb"  # what it starts from is a command, too
ORGANS = CropStream, OrganLoads, OrganWork
SHORT = {"straight": 16, "two-scanners": 16, "record-run": 40}  # m that show it


def levels() -> set[str]:
    """Every level that is no preset of another and not left out, as `slot.level`."""
    packages = {kind: (f"swath.field.{kind}",) for kind in SLOTS.field_levels}
    packages |= {slot.name: slot.packages for slot in SLOTS.slots}
    found = {
        f"{kind}.{name}"
        for kind, rooms in packages.items()
        for name in SLOTS.registry.names(kind)
        if any(find_spec(f"{room}.{name}") for room in rooms)
    }
    return found - LEFT_OUT


def scenario_of(where: str, sets: tuple[str, ...] = ()) -> Scenario:
    """The scenario of an entry of WHERE."""
    name, _, point = where.partition(" ")
    if (CATALOGUE / f"{name}.yaml").is_file() and (point or not _is_bundled(name)):
        case = read_case(CATALOGUE / f"{name}.yaml")
        key, _, value = point.partition("=")
        at = next((p for p in case.grid() if str(p.get(key)) == value), case.grid_point(0))
        return load_scenario(case.scenario, sets=layered([*case.sets(at), "seed=1"], list(sets)))
    short = [f"run.distance_m={SHORT[name]}"] if name in SHORT else []
    return load_scenario(name, sets=[*short, *sets])


def _is_bundled(name: str) -> bool:
    return (CATALOGUE.parent / "scenarios" / f"{name}.yaml").is_file()


class Dead:
    """In the place of a part, whose first sample it sends."""

    steps_any_length = True

    def __init__(self, part: Any, is_held: bool) -> None:
        self._part, self._is_held, self.inputs, self.outputs = part, is_held, part.inputs, part.outputs
        for name in ("mounting", "optical", "pinhole"):
            if hasattr(part, name):
                setattr(self, name, getattr(part, name))

    def reset(self, stream: Stream) -> Outputs:
        """What the part sends first."""
        first = self._part.reset(stream)
        return first if self._is_held else {name: _zero(sample) for name, sample in first.items()}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Nothing; of a stream of crop, which has to come in every step, nothing in it."""
        return {p.name: build(p.signal, t + dt, _zeros(p.signal)) for p in self.outputs if p.signal in ORGANS}

    def save(self) -> State:
        """Nothing."""
        return {}

    def load(self, state: State) -> None:
        """Nothing."""


def _zero(sample: Any) -> Any:
    kind = type(sample)
    return build(kind, sample.t, _zeros(kind)) if kind in COMMANDS else sample


def _zeros(kind: Any) -> dict[str, float]:
    return dict.fromkeys(flat_fields(kind), nan if kind is OrganSettings else 0)


def holds(scenario: Scenario) -> bool:
    """Whether every limit of a scenario passes."""
    return all(limit["result"] == "pass" for limit in run_unrecorded(scenario)["expect"])


def without(where: str, level: str) -> Scenario:
    """The scenario of an entry with a dead part for a level. LookupError where it has none of it."""
    kind, _, name = level.partition(".")
    if kind == "terrain":
        other = "plane" if name == "formula" else "{level: formula, slope_percent: 15}"
        return scenario_of(where, (f"field.terrain={other}",))
    if kind == "stand":
        thin = (
            "field.stand={level: uniform, stems_per_m2: 1}"
            if name == "bands"
            else "field.stand.stems_per_m2=1"
        )
        return scenario_of(where, (thin,))
    scenario = scenario_of(where)
    found = 0
    for machine in scenario.machines.values():
        for slot, choice in machine.slots.items():
            if (choice.kind.name, choice.level) == (kind, name):
                make, found = choice.found.component, found + 1
                dead = replace(
                    choice.found, component=lambda p, s, make=make: Dead(make(p, s), level in HELD)
                )
                machine.slots[slot] = replace(choice, found=dead)
    if not found:
        raise LookupError(f"no {level} in {where}")
    return scenario


def main(asked: list[str]) -> int:
    """Print each level, where it stands, and whether a dead part shows."""
    missed = levels() - {level for of in WHERE.values() for level in of.split()}
    for where, of in WHERE.items():
        chosen = [level for level in of.split() if not asked or level in asked]
        whole = holds(scenario_of(where)) if chosen else True
        for level in chosen:
            shows = whole and not holds(without(where, level))
            said = "shows" if shows else "does not show" if whole else "limits broken as it is"
            print(f"{level:26} {where:34} {said}", flush=True)
            missed |= set() if shows else {level}
    print(f"{len(levels())} levels, not shown: {', '.join(sorted(missed)) or 'none'}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
