"""Runs beyond what their levels were checked for are told from those within, by what they met."""

import math
from dataclasses import is_dataclass, replace
from typing import get_args, get_type_hints

import numpy as np
import pytest
from benchmarks.credibility import PLAIN, met

from swath.core.abilities import Meets
from swath.core.estimate import estimates
from swath.core.frames import Pose
from swath.core.registry import Checked
from swath.core.schedule import NS
from swath.field.light import light
from swath.field.weather import fog_extinction
from swath.judge.catalogue import load_evaluators
from swath.judge.limits import exit_code_of
from swath.report.page import _head
from swath.runtime.assembly import assemble
from swath.runtime.changes import Interventions
from swath.runtime.credibility import (
    EDGE,
    INSIDE,
    OUTSIDE,
    Credibility,
    Looks,
    Scene,
    Seen,
    _holds,
    _told,
    outside_of,
    rests_on,
    why_outside,
)
from swath.runtime.evaluation import make_evaluation
from swath.runtime.job import run_unrecorded
from swath.runtime.loop import drive
from swath.runtime.met import QUANTITIES, Where, told_by
from swath.scenario.scenario import load_scenario
from swath.scenario.slots import CATALOGUE
from swath.signals import MachineState
from swath.terminal.outcome import result_of
from swath.tools.function_test.judging.judged import UNJUDGED, beyond, verdict_of

CHEAP = "combine.lidar.level=empirical"
SLOPE = "field.terrain={{level: plane, slope_percent: {}, slope_azimuth_deg: {}}}"
PROFILE = ["combine.lidar.level=profile", "combine.header.level=profile"]
# Changes of `straight`, the slot and the quantities that they take beyond its ranges.
OUTSIDE_RUNS = [
    ([CHEAP, "field.stand.wind={speed_m_s: 3}", "field.stand.weeds={plants_per_m2: 20}",
      "field.stand.stems_per_m2=100", "field.stand.height_factor=0.5", "combine.lidar.mount.pitch_deg=4"],
     "lidar", "wind_lean_deg weeds_per_m2 stems_per_m2 crop_height_m depression_deg"),
    ([CHEAP, "field.stand.lean_deg=25", "field.stand.stems_per_m2=700", "field.stand.height_factor=1.45"],
     "lidar", "lean_deg stems_per_m2 crop_height_m"),
    ([CHEAP, "field.stand.wind={speed_m_s: 9}", "field.stand.lean_deg=50"],
     "lidar", "wind_lean_deg lean_deg"),
    ([CHEAP, "combine.lidar.mount.pitch_deg=87"], "lidar", "depression_deg"),
    # 11.9 mrad, 30 m to the crop: spots of 0.37 m
    ([CHEAP, "combine.lidar.sensor=sick-lms511-sr", "combine.lidar.mount.z_m=6",
      "combine.lidar.mount.pitch_deg=10"], "lidar", "spot_mm"),
    ([*PROFILE, "field.stand.stems_per_m2=40"], "lidar", "stems_per_m2"),
    (["field.stand.lean_deg=80", "field.stand.wind={speed_m_s: 12}"], "lidar", "lean_deg wind_lean_deg"),
    ([CHEAP, SLOPE.format(25, 90), "combine.motion.start_speed_kmh=18", "combine.speed.speed_kmh=18"],
     "motion", "slope_across_percent ground_speed_kmh"),
    ([CHEAP, SLOPE.format(25, 90), "combine.motion.level=kinematic"], "motion", "slope_across_percent"),
    ([CHEAP, SLOPE.format(20, 0)], "motion", "slope_along_percent"),
    ([CHEAP, SLOPE.format(20, 180)], "motion", "slope_along_percent"),
]  # fmt: skip


# Values just inside an end of a range or of plain values, of which nothing is said of the scanner, and just
# outside of one, where it is: all in `python -m benchmarks.credibility --ends`.
ENDS = [
    ("stems_per_m2", 124.8, False), ("stems_per_m2", 115.0, True), ("crop_height_m", 0.53, False),
    ("crop_height_m", 1.24, True), ("roughness_gd_m3", 2.4e-4, False), ("roughness_gd_m3", 2.7e-4, True),
]  # fmt: skip


def test_a_line_that_moves_by_more_than_its_limit_is_not_told_without_a_word():
    plain = met(PLAIN, math.nan, CHEAP, distance=14, seeds=[1])
    assert plain.limit == 0.03
    for name, value, is_said in ENDS:
        found = met(name, value, CHEAP, distance=3 if is_said else 14, seeds=[1])
        assert bool({"lidar", "(lidar)"} & {*found.said}) == is_said, (name, value)
        assert is_said or abs(found.line - plain.line) <= plain.limit, (name, value)


def run(*sets, distance=5):
    return run_unrecorded(load_scenario("straight", sets=[f"run.distance_m={distance}", *sets]))


# What is judged itself: told, and its limits count.
OUTSIDE_CONTROL = [
    (["field.stand.lean_deg=40"], "edge", "lean_deg"),
    ([SLOPE.format(15, 90)], "steer", "slope_across_percent"),
]


@pytest.mark.parametrize(("sets", "slot", "quantity"), OUTSIDE_CONTROL, ids=lambda value: str(value)[:50])
def test_control_outside_its_range_is_told_and_judged(sets, slot, quantity):
    summary = run(*sets, distance=3)
    assert summary["credibility"]["slots"][f"combine.{slot}"]["state"] == OUTSIDE
    assert any(f"combine.{slot}: outside the range" in n and quantity in n for n in summary["notes"])
    assert not any("rests_outside" in entry for entry in summary["expect"])


@pytest.mark.parametrize(("sets", "slot", "quantities"), OUTSIDE_RUNS, ids=lambda value: str(value)[:60])
def test_outside(sets, slot, quantities):
    summary = run(*sets, distance=3)
    told = summary["credibility"]["slots"][f"combine.{slot}"]
    assert told["state"] == OUTSIDE
    rows = {row["quantity"]: row for row in told["quantities"]}
    (note,) = [note for note in summary["notes"] if f"combine.{slot}: outside the range" in note]
    for quantity in quantities.split():
        assert rows[quantity]["state"] == OUTSIDE, quantity
        assert quantity in note
    rests = {entry["name"]: entry.get("rests_outside", []) for entry in summary["expect"]}
    assert f"combine.{slot}" in rests["lateral_rms_m"]


def test_what_ended_the_run_is_judged_outside_a_range_too():
    summary = run("field.soil={cone_index_kpa: 100}", CHEAP)
    assert summary["ended"]["reason"] == "stuck"
    assert summary["credibility"]["slots"]["combine.motion"]["state"] == OUTSIDE
    entries = {entry["name"]: entry for entry in summary["expect"]}
    assert (entries["stuck_count"]["result"], entries["stuck_count"].get("rests_outside")) == ("fail", None)
    assert "combine.motion" in entries["rollover_count"]["rests_outside"]


LITTLE = [name for name, quantity in QUANTITIES.items() if quantity.little > 0.0]


@pytest.mark.parametrize("name", LITTLE)
@pytest.mark.parametrize("high", [0.0, 20.0])
def test_what_is_too_little_to_change_anything_is_no_doubt(name, high):
    checked = Checked(name, 0.0, high, "")
    for part, state in ((1e-3, INSIDE), (0.9, INSIDE), (1.1, OUTSIDE), (50.0, OUTSIDE)):
        seen = Seen()
        for _ in range(3):
            seen.add(Looks([high + part * QUANTITIES[name].little]), checked)
        assert seen.state == state, part


def test_a_trace_of_weather_needs_no_word():
    trace = ["rain_mm_h=5.6e-5", "fog_mor_m=90000", "dust_per_m=1e-6"]
    for share in (1.0, 1e5):
        sets = [f"field.weather.{key}={float(value) * share if key != 'fog_mor_m' else value}"
                for key, _, value in (text.partition("=") for text in trace)]  # fmt: skip
        notes = run(CHEAP, *sets, distance=3).get("notes", [])
        assert any("not checked for" in note for note in notes) == (share > 1.0)


@pytest.mark.parametrize(("value", "state"), [(0.18 - 1e-9, INSIDE), (0.17998, OUTSIDE), (12.601, OUTSIDE)])
def test_what_is_told_says_on_which_side_of_a_bound_it_is(value, state):
    checked, seen = Checked("ground_speed_kmh", 0.18, 12.6, ""), Seen()
    for _ in range(3):
        seen.add(Looks([value]), checked)
    assert seen.state == state
    assert (0.18 <= _told(value, checked) <= 12.6) == (state == INSIDE)


def test_inside_and_how_far_off_the_level_may_be():
    summary = run(CHEAP)
    assert summary["ended"] == {"reason": "distance", "text": ""}
    slots = summary["credibility"]["slots"]
    judged = ("motion", "header", "lidar", "odometry", "imu", "edge", "steer")
    assert {name: slot["state"] for name, slot in slots.items()} == {f"combine.{s}": INSIDE for s in judged}
    assert "combine.process" in summary["credibility"]["undeclared"]
    entries = {entry["name"]: entry for entry in summary["expect"]}
    error = {"size": 0.03, "slot": "combine.lidar", "against": "plants"}
    assert entries["lateral_rms_m"]["level_error"] == error
    assert "level_error" not in entries["contact_count"]
    assert not any("rests_outside" in entry for entry in summary["expect"])


THIN = ["field.stand={level: uniform, crop: rye, stems_per_m2: 150}"]
POST = "field.obstacles=[{{kind: post, x_m: {}, y_m: 6}}]"


def open_limits(*sets, distance=14):
    summary = run(CHEAP, *sets, distance=distance)
    assert summary["credibility"]["slots"]["combine.lidar"]["state"] == OUTSIDE
    whole = (e for e in summary["expect"] if "hold" not in e["limit"])  # the others stay open
    return {e["name"] for e in whole if "rests_outside" in e}, summary


def test_a_limit_is_open_only_where_what_was_left_moves_it_so_far():
    """In rye of 150 stems per m2 by 4.9 cm of the line at most, as drawn runs say; beyond these by more."""
    every = {"edge_rmse_m", "lateral_rms_m", "contact_count", "rollover_count"}
    found, summary = open_limits(*THIN, POST.format(-3))
    assert found == {"edge_rmse_m", "lateral_rms_m"}
    assert summary["least_clearance_m"] > 1.0
    wide = ["expect.lateral_rms_m.max=0.3", "expect.edge_rmse_m.max=0.3"]
    found, summary = open_limits(*THIN, *wide)
    assert found == set()
    sizes = {e["name"]: e.get("level_error", {}).get("size") for e in summary["expect"]}
    moved = {c.quantity: c.beyond.moved for c in compared_of(summary)}["stems_per_m2"]
    assert sizes["lateral_rms_m"] == moved["lateral_rms_m"]
    far = ["field.stand={level: uniform, crop: rye, stems_per_m2: 80}"]
    assert open_limits(*far, *wide)[0] == every
    assert open_limits(*THIN, *wide, "combine.edge=otsu")[0] == every  # nobody measured what that makes of it


def compared_of(summary):
    world = assemble(load_scenario("straight", sets=[CHEAP, *THIN]))
    return [c for c in Scene(world).ranges["combine"]["lidar"] if c.beyond is not None]


@pytest.mark.parametrize(("value", "bounds", "moved", "margin", "holds"), [
    (0.03, {"max": 0.1}, 0.05, {}, True), (0.06, {"max": 0.1}, 0.05, {}, False),
    (0.16, {"max": 0.1}, 0.05, {}, True), (0.14, {"max": 0.1}, 0.05, {}, False),
    (0.94, {"min": 0.9}, 0.05, {}, False), (0.96, {"min": 0.9}, 0.05, {}, True),
    (0.03, {"max": 0.1}, None, {}, False), (None, {"max": 0.1}, 0.05, {}, False),
    (0.03, {"max": 0.1, "hold": "always"}, 0.05, {}, False),
    (0.0, {"max": 0.0}, 0.05, {"near_m": 0.06}, True), (0.0, {"max": 0.0}, 0.05, {"near_m": 0.04}, False),
    (1.0, {"max": 0.0}, 0.05, {"near_m": -0.1}, False), (0.0, {"max": 0.0}, 0.05, {"other": 1}, True),
])  # fmt: skip
def test_what_a_limit_comes_to_with_its_metric_moved(value, bounds, moved, margin, holds):
    result = "fail" if value is not None and not value <= bounds.get("max", math.inf) else "pass"
    entry = {"limit": bounds, "value": value, "result": result}
    assert _holds(entry, moved, "near_m" if margin else "", margin) == holds


def test_an_identity_rests_on_no_level():
    """Walks all metrics: of those that rest on nothing each is a balance, or a count of the program's own."""
    world = assemble(load_scenario("straight", sets=[CHEAP]))
    catalogue = load_evaluators()
    free = {n for n in catalogue.metrics if not rests_on(world, catalogue, "combine", n)}
    assert free >= {n for n, m in catalogue.metrics.items() if m.is_identity}
    assert {n for n, m in catalogue.metrics.items() if m.is_identity} == {
        "mass_balance_error", "real_time_factor", "ray_count"
    }  # fmt: skip
    assert {m.margin for m in catalogue.metrics.values()} <= {"", *catalogue.metrics}


def test_what_only_the_own_law_checked_and_what_an_estimate_decides_is_said():
    fog = "field.weather={fog_mor_m: 200, sun_elevation_deg: 30, sun_azimuth_deg: 180}"
    foggy, clear = (run(CHEAP, *sets, distance=2) for sets in ([fog], []))
    assert not any("own law" in n or "estimate" in n for n in clear.get("notes", []))
    (own,) = [n for n in foggy["notes"] if "own law" in n]
    assert own == "combine: levels were checked by their own law alone for dust_per_m 0.01498 (lidar)"
    (said,) = [n for n in foggy["notes"] if "estimate" in n]
    assert "combine.lidar.weather.overlap_m 1 (our estimate, 0.3 to 2)" in said
    row = next(
        r
        for r in foggy["credibility"]["slots"]["combine.lidar"]["quantities"]
        if r["quantity"] == "dust_per_m"
    )
    assert row["witness"] == "own law"


# What a level with bands needs beside it; `field.weather` for all.
BESIDE = {
    **{kind: ["combine.process=organs"] for kind in ("threshing", "separation", "cleaning", "crop_flow")},
    "lidar": ["combine.lidar.window={}", "combine.lidar.weather.near_returns=1"],
}
WEATHER = "field.weather={fog_mor_m: 100, sun_elevation_deg: 30, sun_azimuth_deg: 180}"


def every_band():
    for kind in CATALOGUE.registry.packages:
        for name in CATALOGUE.registry.names(kind):
            yield from ((kind, name, key) for key in bands_in(CATALOGUE.registry.get(kind, name).params))


def bands_in(params, above=""):
    """Keys with a band of a class of parameters, and of those that may be within."""
    yield from (above + key for key in estimates(params))
    for key, hint in (get_type_hints(params) if is_dataclass(params) else {}).items():
        for inner in {kind for kind in (hint, *get_args(hint)) if is_dataclass(kind)}:
            yield from bands_in(inner, f"{above}{key}.")


def test_every_key_with_a_band_is_told_by_a_run_that_uses_it():
    """Each level that has one is put into a machine, and has met fog."""
    by_level = {}
    for kind, level, key in every_band():
        by_level.setdefault((kind, level), []).append(key)
    assert sum(map(len, by_level.values())) >= 150
    assert len(by_level) >= 17
    for (kind, level), keys in by_level.items():
        if kind == "camera" or level == "profile":  # refuse puffs, and weather
            continue
        owner = "field" if kind == "stand" else "combine"
        sets = [f"{owner}.{kind}.level={level}", *BESIDE.get(kind, ())]
        if kind == "stand":
            sets = [f"field.stand={{level: {level}, crop: wheat, straw_moisture_percent: weather}}"]
        watch = Credibility(Scene(assemble(load_scenario("straight", sets=[*sets, WEATHER]))))
        watch._seen["combine.lidar", "dust_per_m"] = Seen(0.03, 0.03, 1)
        told = watch.entries()["estimates"][f"{owner}.{kind}"]
        assert [line.partition(" ")[0] for line in told] == keys, (kind, level)


# Changes of `straight`, and quantities for which levels were not checked, each with its slot.
NOT_CHECKED_RUNS = [
    (["combine.motion.friction=0.2", "field.terrain={level: formula, roughness_class: E}",
      "combine.header.cutting_height_m=0.6", "combine.lidar.weather.rain_mm_h=3"],
     {"friction": "motion", "roughness_gd_m3": "motion", "cutting_height_m": "header", "rain_mm_h": "edge"}),
    (["field.soil.cone_index_kpa=900", "field.stand.wind={speed_m_s: 6}"],
     {"cone_index_kpa": "steer", "wind_lean_deg": "edge"}),
    (["field.stand={level: uniform, crop: rye, stems_per_m2: 280}"], {"other_crop": "lidar"}),
]  # fmt: skip


@pytest.mark.parametrize(("sets", "lacking"), NOT_CHECKED_RUNS, ids=lambda value: str(value)[:50])
def test_what_no_level_was_checked_for_is_said(sets, lacking):
    summary = run(CHEAP, *sets, distance=3)
    told = summary["credibility"]
    (note,) = [note for note in summary["notes"] if "not checked for" in note]
    for quantity, slot in lacking.items():
        assert quantity in told["not_checked"][f"combine.{slot}"]
        assert quantity in told["met"]["combine"]
        assert quantity in note
        assert slot in note.rpartition(quantity)[2]


def test_a_plain_run_needs_no_word_and_lists_what_was_not_checked():
    summary = run(CHEAP, distance=3)
    assert not any("not checked" in note for note in summary.get("notes", []))
    declared = {name: {r["quantity"] for r in slot["quantities"]}
                for name, slot in summary["credibility"]["slots"].items()}  # fmt: skip
    for slot, names in summary["credibility"]["not_checked"].items():
        assert not declared.get(slot, set()) & set(names)
    assert {"combine.process", "combine.edge", "combine.steer"} <= summary["credibility"][
        "not_checked"
    ].keys()


def test_lean_is_looked_up_where_beams_meet_the_crop():
    """A lodged patch to the side, that beams reach and the machine does not."""
    patch = "{x_m: 9, y_m: 7, radius_m: 4, lean_deg: 60}"
    stand = f"field.stand={{level: maps, crop: wheat, stems_per_m2: 400, patches: [{patch}]}}"
    told = run(CHEAP, stand, distance=3)["credibility"]
    (row,) = [r for r in told["slots"]["combine.lidar"]["quantities"] if r["quantity"] == "lean_deg"]
    assert row["met"][1] > 50.0
    assert row["state"] == OUTSIDE
    assert told["met"]["combine"]["lean_deg"][1] < 20.0  # beside the machine


def test_what_nothing_rests_on_leaves_the_verdict():
    """On the true edge nobody listens to the scanner."""
    summary = run(
        CHEAP, "field.stand.weeds={plants_per_m2: 20}", "combine.edge=truth", "combine.speed.guard={}"
    )
    assert summary["credibility"]["slots"]["combine.lidar"]["state"] == OUTSIDE
    assert not any("rests_outside" in entry for entry in summary["expect"])


def test_strays_are_at_the_edge():
    checked, seen = Checked("spot_mm", 0.0, 1.0, "made"), Seen()
    for _ in range(50):
        seen.add(Looks([[0.5] * 99 + [1.5]]), checked)
        seen.add(Looks([[0.5] * 9 + [1.5]]), checked)  # one echo, of however few
    assert (seen.state, seen.looks, seen.high) == (EDGE, 100, 1.5)
    for _ in range(3):
        seen.add(Looks([[0.5] * 8 + [1.5] * 2]), checked)
    assert seen.state == OUTSIDE


def test_a_limit_that_rests_on_nothing_outside_still_fails():
    kept = {"subject": "combine", "name": "a", "result": "pass", "rests_outside": ["combine.lidar"]}
    broken = {"subject": "combine", "name": "b", "result": "fail", "reason": "2 is more than 1"}
    told = {
        "level": "empirical",
        "quantities": [{"quantity": "lean_deg", "met": [50, 50], "checked": [0, 20]}],
    }
    why = "outside the range in which level empirical was checked: lean_deg 50, checked 0 to 20"
    outside = {"combine.lidar": told}
    assert verdict_of([kept], outside) == (UNJUDGED, f"not judged: combine.lidar {why}")
    assert verdict_of([kept, broken], outside)[0] == "fail"
    assert verdict_of([{**broken, "rests_outside": ["combine.lidar"]}], outside)[0] == UNJUDGED
    result = {"expect": [kept], "credibility": outside}
    assert beyond(result) == [("combine.lidar", "lean_deg", [50, 50])]


def test_page_screen_and_function_test_say_the_same():
    """A limit that fails on a level outside its range is not judged, wherever it is shown."""
    broken = {"subject": "combine", "name": "lateral_rms_m", "limit": {"max": 0.1}, "value": 0.2}
    broken |= {"result": "fail", "reason": "0.2 is more than 0.1"}
    assert result_of(broken) == "fail"
    assert _head([broken])[0] == "fail"
    doubtful = {**broken, "rests_outside": ["combine.lidar"]}
    assert result_of(doubtful) == UNJUDGED
    assert _head([doubtful])[:2] == ("none", "1 of 1 limits not judged")
    assert _head([doubtful, broken])[:2] == ("fail", "✗ 1 of 2 limits fail")
    assert exit_code_of([doubtful]) == 3  # of `swath run`, as of `swath test`


def test_what_changes_while_a_run_goes_is_watched():
    """Rain from 2 s on, another knife, and a level whose ranges are others."""
    sets = ["combine.lidar.level=plants", "field.stand.lean_deg=40", "run.distance_m=9"]
    world = assemble(load_scenario("straight", sets=[*sets, "combine.motion.start_speed_kmh=6"]))
    changes, watch = Interventions(world), Credibility(Scene(world))
    script = [(3, "combine.lidar.weather.rain_mm_h", 3), (3, "combine.header.cutting_height_m", 0.6),
              (4, "combine.lidar.level", "empirical")]  # fmt: skip
    due = [(second * NS, key, value) for second, key, value in script]

    def change(t):
        while due and due[0][0] <= t:
            changes.set(t, *due.pop(0)[1:])

    world.graph.before_tick.append(change)
    assert not list(watch.untold())
    drive(world, [watch.see])
    assert not due
    (note,) = watch.untold()
    assert "rain_mm_h" in note
    assert "cutting_height_m 0.15 to 0.6 (" in note
    told = watch.entries()
    assert told["slots"]["combine.lidar"]["level"] == "empirical"
    assert told["slots"]["combine.lidar"]["state"] == OUTSIDE  # stands that lean by 40 deg


FULL = [
    "combine.process.level=threshing", "combine.powertrain=hydrostat", "combine.gnss=sky",
    "combine.radar=error", "combine.camera={width_px: 16, height_px: 12}", "combine.crop_flow=delayed",
    "combine.lidar.level=plants",
]  # fmt: skip


def test_every_slot_says_of_every_attribute_inside_outside_or_not_checked(monkeypatch):
    """Values at random within and beyond each range, and beyond plain ones where none is declared."""
    world = assemble(load_scenario("straight", sets=FULL))
    world.graph.reset()
    rng, machine, pairs = np.random.default_rng(11), world.leader, 0
    given = {}
    for name, quantity in QUANTITIES.items():
        monkeypatch.setitem(QUANTITIES, name, replace(quantity, at=lambda where, name=name: given[name]))
    for part in machine.parts.values():
        if isinstance(part, Meets):
            own = part.meets(MachineState(0, Pose.identity(), 0.0, 0.0, 0.0, 0.0, 0.0))
            part.meets = lambda state, own=own: {name: given[name] for name in own}

    def told_of(values):
        given.update({name: 0.5 * sum(np.clip(q.plain, -10.0, 2000.0)) for name, q in QUANTITIES.items()})
        given.update(values)
        watch = Credibility(Scene(world))
        for k in range(1, 5):
            at = Pose.from_euler((0.0, 2.0 * k, 0.0))
            watch.see(
                "combine.motion", k * NS, {"state": MachineState(k * NS, at, 2.0, 0.0, 0.0, 0.0, 2.0 * k)}
            )
        return watch.entries(), list(watch.untold())

    for name, quantity in QUANTITIES.items():
        for slot in (s for s, choice in machine.slots.items() if choice.kind.name in quantity.touches):
            pairs += 1
            of = {c.quantity: c for c in machine.slots[slot].found.checked}
            if name in of:
                low, high = max(of[name].low, -1e3), min(of[name].high, 1e6)
                for value, state in (
                    (rng.uniform(low, high), INSIDE),
                    (low - quantity.little - rng.uniform(0.01, 9.0), OUTSIDE),
                    (high + quantity.little + rng.uniform(0.01, 9.0), OUTSIDE),
                ):
                    told, _ = told_of({name: float(value)})
                    rows = {r["quantity"]: r["state"] for r in told["slots"][f"combine.{slot}"]["quantities"]}
                    assert rows[name] == state, (slot, name, value)
                    why = outside_of({"credibility": told}).get(f"combine.{slot}")
                    assert (state == OUTSIDE) == (why is not None and name in why_outside(why))
            else:
                ends = [e for e in quantity.plain if math.isfinite(e)]
                value = (
                    ends[-1] + quantity.little + rng.uniform(0.01, 9.0)
                    if quantity.plain[1] < math.inf
                    else 0.5 * ends[0]
                )
                told, notes = told_of({name: float(value)})
                assert name in told["not_checked"][f"combine.{slot}"]
                assert any(name in note and slot in note.rpartition(name)[2] for note in notes), (slot, name)
                assert not told_of({})[1]
    assert pairs >= 85


def _maybe(rng, low, high):
    return round(float(rng.uniform(low, high)), 3) if rng.random() < 0.5 else None


@pytest.mark.parametrize("seed", range(6))
def test_each_slot_meets_its_own_weather_light_and_soil_or_the_fields(seed):
    """Drawn for the field and for each part; by hand, what which slot meets."""
    rng = np.random.default_rng([76, seed])
    site = {"rain_mm_h": _maybe(rng, 0, 60), "fog_mor_m": _maybe(rng, 50, 400),
            "dust_per_m": _maybe(rng, 0, 0.6), "cloud_percent": _maybe(rng, 0, 100)}  # fmt: skip
    high, sun, cloud = round(float(rng.uniform(-20, 60)), 3), _maybe(rng, -20, 60), _maybe(rng, 0, 100)
    rain = {slot: _maybe(rng, 0, 60) for slot in ("lidar", "camera", "radar")}
    dust = {slot: _maybe(rng, 0, 0.6) for slot in ("lidar", "camera")}
    soil, own_soil, is_lit = _maybe(rng, 400, 3000), _maybe(rng, 400, 3000), rng.random() < 0.5
    straw, own_straw = round(float(rng.uniform(5, 60)), 3), _maybe(rng, 5, 60)
    keys = {
        **{f"field.weather.{key}": value for key, value in site.items()},
        "field.weather.sun_elevation_deg": high, "field.weather.sun_azimuth_deg": 180,
        "combine.lidar.weather.rain_mm_h": rain["lidar"],
        "combine.lidar.weather.extinction_per_m": dust["lidar"],
        "combine.camera.weather.rain_mm_h": rain["camera"],
        "combine.camera.weather.extinction_per_m": dust["camera"],
        "combine.camera.sun_elevation_deg": sun, "combine.camera.cloud_percent": cloud,
        "combine.radar.rain_mm_h": rain["radar"], "combine.radar.straw_moisture_percent": own_straw,
        "combine.lidar.daylight.shot_noise": 5 if is_lit else 0,
        "field.stand.straw_moisture_percent": straw, "field.soil.cone_index_kpa": soil,
        "combine.motion.cone_index_kpa": own_soil, "combine.motion.soil": own_soil and "brixius",
    }  # fmt: skip
    sets = [f"{key}={value}" for key, value in keys.items() if value is not None]
    world = assemble(load_scenario("straight", sets=[*FULL, *sets]))
    world.graph.reset()
    state = MachineState(0, Pose.identity(), 0.0, 0.0, 0.0, 0.0, 0.0)
    scene = Scene(world)
    scene.take_changes("combine")
    met_now = scene.values("combine", [scene.note("combine", state)])
    seen = {(name, c.quantity): values.values[0] for name, c, values in met_now}

    def met(slot, name):
        return seen.get((f"combine.{slot}", name), seen.get(("combine", name)))

    def first(*values):
        return next((v for v in values if v is not None), 0.0)

    wave = {"lidar": world.leader.parts["lidar"].sheet.wavelength, "camera": 550e-9}
    fog = {s: fog_extinction(site["fog_mor_m"] or math.inf, w) for s, w in wave.items()}
    air = {s: first(dust[s], site["dust_per_m"]) + fog[s] for s in wave}
    rains = {s: first(own, site["rain_mm_h"]) for s, own in rain.items()}
    over = 0.01 * first(site["cloud_percent"])
    lux = light(math.radians(high), over).lux if is_lit else 0.0
    under = light(math.radians(high if sun is None else sun), over if cloud is None else 0.01 * cloud).lux
    expected = {
        **{(s, "rain_mm_h"): v for s, v in rains.items()}, ("edge", "rain_mm_h"): rains["lidar"],
        **{(s, "dust_per_m"): v for s, v in air.items()}, ("edge", "dust_per_m"): air["lidar"],
        ("lidar", "receiver_light_lx"): lux, ("edge", "receiver_light_lx"): lux,
        ("camera", "light_lx"): under,
        ("radar", "straw_moisture_percent"): straw if own_straw is None else own_straw,
        ("lidar", "straw_moisture_percent"): straw, ("camera", "straw_moisture_percent"): straw,
        ("motion", "cone_index_kpa"): own_soil or soil or math.nan,
        ("steer", "cone_index_kpa"): own_soil or soil or math.nan,
        ("powertrain", "cone_index_kpa"): soil or math.nan,
    }  # fmt: skip
    for (slot, name), value in expected.items():
        assert met(slot, name) == pytest.approx(value, rel=1e-9, nan_ok=True), (slot, name)
    whole = Where(world.leader, world.field, [state], [told_by(world.leader, state)])
    assert whole.values("rain_mm_h") == [max(rains.values())]
    assert whole.values("dust_per_m") == [max(air.values())]


@pytest.mark.parametrize(
    "sets",
    [
        [CHEAP, "field.stand.lean_deg=25", "combine.lidar.weather.rain_mm_h=3"],
        [*PROFILE, SLOPE.format(9, 40)],
        [CHEAP, "field.soil.cone_index_kpa=900", "field.terrain={level: formula, roughness_class: D}"],
    ],
)
def test_it_does_not_matter_how_many_looks_are_judged_together(sets, monkeypatch):
    found = []
    for together in (1, 1000):
        monkeypatch.setattr("swath.runtime.credibility.TOGETHER", together)
        found.append(run(*sets, distance=6)["credibility"])
    assert found[0] == found[1]
    assert all(row["looks"] >= 5 for row in found[0]["slots"]["combine.lidar"]["quantities"])


def test_nothing_waits_to_be_judged_in_a_saved_state():
    """Where a level is changed before a run goes on from there, its notes would be taken by another part."""
    world = assemble(load_scenario("straight", sets=[CHEAP, "run.distance_m=4"]))
    evaluation = make_evaluation(world)
    drive(world, [evaluation])
    watch = evaluation.find("field", Credibility)
    assert watch._notes
    saved = evaluation.save()["evaluators"]["field"][-1]
    assert not saved["_notes"]
    assert saved["_seen"]["combine.lidar", "spot_mm"].looks >= 3


def test_what_a_part_of_a_user_meets_is_taken_as_it_is_now(monkeypatch):
    """Whole numbers count as numbers; an array that the part uses again does not change what was met."""
    world = assemble(load_scenario("straight", sets=["combine.lidar.level=plants", "run.distance_m=4"]))
    scene, lidar = Scene(world), world.leader.parts["lidar"]
    again = np.zeros(2, np.float32)
    scene.ranges["combine"]["lidar"] = (Checked("spot_mm", 0, 9, ""), Checked("stems_per_m2", 0, 900, ""))
    monkeypatch.setattr(lidar, "meets", lambda state: {"spot_mm": again, "stems_per_m2": 400}, raising=False)
    watch = Credibility(scene)
    world.graph.reset()
    for k in (1, 2):
        again[:] = k
        state = MachineState(k * NS, Pose.identity(), 1.0, 0.0, 0.0, 0.0, float(k))
        watch.look_at("combine", state)
    met = {quantity: (seen.low, seen.high, seen.looks) for (slot, quantity), seen in watch.seen.items()
           if slot == "combine.lidar"}  # fmt: skip
    assert met == {"spot_mm": (1.0, 2.0, 2), "stems_per_m2": (400.0, 400.0, 2)}
