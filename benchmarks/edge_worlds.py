"""Drawn worlds that judge the crop-edge detector: all axes at once, told against the true edge.

    python -m benchmarks.edge_worlds building --first 0 --count 24 [--list] [--out FILE] [--set KEY=VALUE]
    python -m benchmarks.edge_worlds judging | nine | waves | rows | domain      with the same options

Detectors are built with the pool `building`; the pool `judging` is looked at once, at the end. `nine`: lean
20, 26, 32 deg straight out x height 1.0, 1.1, 1.2 in level wheat; `waves`: 0.3 and 0.6 m over 60 m at four
phases, and none; `rows`: crops in rows, both sides; `domain`: points of the bundled domain `wheat-harvest`.
`--list` prints the cases as `--set` texts for `swath run straight` and drives none. `--out` keeps what was
driven in a parquet file: what that holds with the same settings is not driven again. `--set` goes on top of
every case, such as another level of the edge.

Axes of `building` and `judging`, evenly in their range unless it is said otherwise. Directions are clockwise
from the way driven, mirrored where the crop is to the left: 90 deg is into the crop, -90 deg out of it.

| axis | range | where it comes from |
|---|---|---|
| height of the crop | 70 to 120 % of the sheet's | domain `wheat-harvest` has 60 to 120 |
| lean, size | 0 to 35 deg | domain: 0 to 45; above 35 lodged |
| lean, direction | whole circle; every fifth case 11 deg and more, 45 deg about straight out | estimated |
| waves, length | 20 to 80 m | estimated; domain: 60 |
| waves, amplitude | 0 to 0.8 m as its square root, up to a slope of 13 % | domain; the slope is estimated |
| waves, phase, direction | whole circle | |
| slope | 0 to 14 deg as its square root, whole circle | combines level themselves up to 14 deg or so |
| stubble | 5 to 45 cm, up to 0.6 of the crop's height | cutting heights of all bundled crops |
| crop | bundled sheets; soy, maize and rape are rows | more cereals than rows, estimated |
| density | in its logarithm, by crop: `CROPS` | cereals: domain, without its thinnest |
| scanner | bundled line scanners and the one of four lines | more lines cost half a minute each |
| mounting | 1.8 to 3.6 m high, looking at 6 to 11 m, left or right | header to roof of the cab, estimated |
| mount error | half of the cases; sd 0.5 deg pitch, roll, 0.3 yaw, 1 cm | a careful fitter, estimated |
| dust | none 1/2; chaff and dust before the scanner 1/4; the combine's own 1/4 | domain; plumes: EMEP/EEA |
| its own dust | 0.2 to 10 g/kg, 0.05 to 5 g/m, outlets, air of class A to F, straw of 6 to 16 % | estimated |
| edge | straight 3/4, bend of 15 to 40 m; teeth 1/3; notch 1/5, gap 1/8; tramline 1/5 | domain; estimated |
| wind | calm 1/3, else 0.5 to 8 m/s, whole circle; 6 at most where the lean is above 30 deg | domain |
| roughness | none, B, C, D | domain has B to E |
| speed | 4 to 9 km/h | domain has 2 to 10 |
| seed | of the pool: 710000 and 920000, and the number of the case | |

Left out of `building`: rye, the scanner `hokuyo-utm-30lx`, waves of 30 to 45 m.

What is printed, and how it is judged. The true edge is that of the field without its gaps, with the mean of
its teeth over some metres (`Line`). Before all else stands what the scans hold, whatever the detector: rays
beside the true edge, the shares of what they meet on both sides learned from the other metres of the run, the
log-likelihood that the best place of a metre of travel gains over none [nat], and its standard deviation.
From 8 m on, one sample per 0.1 m of way: error of the told edge; told standard deviation; confidence. A run
`holds` where it comes to its end and the header end stays within 30 cm, `stops` where it ends early and has
stayed within 50 cm, and neither where more than 0.5 % of the samples are sure (0.5) and wrong (30 cm) or more
than 5 m (10 with a gap) were driven without an edge: then it is `off`. A stop is needless where the scans
hold 100 nat and more of a stand that does not lean out, which they do not show. Right is an error up to
10 cm. Band: share of the errors within 1.96 told deviations.
"""

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from swath.judge.evaluators.edge_detection import RIGHT_M, SURE, WRONG_M
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.runtime.world import World
from swath.scenario.scenario import load_scenario
from swath.signals import F64, CropEdge, MachineState, Scan

Sets = dict[str, Any]
Drawn = dict[str, Any]
Row = dict[str, Any]
STAND, EDGE, TERRAIN, LIDAR = "field.stand", "field.edge", "field.terrain", "combine.lidar"
FIRST_SEED = {"building": 710_000, "judging": 920_000}
METRES = 30.0  # of a drawn run: 22 are judged
CROPS = {  # share of the cases; stems per m2; height of the sheet [m]; spacings of its rows [m]
    "wheat": (0.30, (100, 700), 0.85, ()),
    "barley": (0.16, (150, 775), 0.80, ()),
    "rye": (0.14, (120, 500), 1.40, ()),
    "rape": (0.12, (25, 90), 1.45, (0.25,)),
    "soy": (0.14, (20, 45), 0.90, (0.38, 0.75)),
    "maize": (0.14, (6, 11), 2.50, (0.75,)),
}
SCANNERS = (
    "sick-lms511-hr", "sick-lms511-sr", "sick-lms111", "sick-lms200", "sick-lms291", "sick-tim561",
    "sick-ld-mrs", "hokuyo-utm-30lx",
)  # fmt: skip
UNSEEN_CROP, UNSEEN_SCANNER, UNSEEN_WAVES = "rye", "hokuyo-utm-30lx", (30.0, 45.0)  # not in `building`
OUT_EVERY, LEANS, ASIDE = (
    5,
    11.0,
    45.0,
)  # cases; deg: half of the working time leans by more; deg off straight out
STEEPEST = 0.13  # slope of waves: 1.5 times that of the domain's worst, estimated
TALLEST = 0.6  # stubble over the crop's height
STRONG, LAID = 6.0, 30.0  # m/s, deg: stands that lean by more are taken to be lodged by a stronger wind
BEGIN, STEP = 8.0, 0.1  # m: from where on errors count, and how often
HOLDS, STANDS, BLIND = (
    0.30,
    0.50,
    (5.0, 10.0),
)  # m of a run that holds, that stops; blind without and with a gap
SURE_WRONG = 0.005  # share of the samples that makes a run off
NEEDLESS = 100.0  # nat: of a metre of travel, with which the edge is known to 5 cm
GROUP = 15  # runs
BINS = (0.0, 0.3, 0.5, 0.7, 0.9, 1.01)  # of the confidence
TEETH_OVER = 2.0  # m: standard deviation of the weights with which teeth are averaged to a line


@dataclass(frozen=True)
class Case:
    """One run of `straight`. tags: kinds that it belongs to; facts: in words."""

    name: str
    sets: tuple[str, ...]
    tags: tuple[str, ...] = ()
    facts: str = ""


def texts(sets: Mapping[str, Any]) -> tuple[str, ...]:
    """Settings as `--set` texts, numbers to four digits."""

    def short(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: short(one) for key, one in value.items()}
        if isinstance(value, list):
            return [short(one) for one in value]
        return float(f"{value:.4g}") if isinstance(value, float) else value

    return tuple(f"{key}={json.dumps(short(value))}" for key, value in sets.items())


# ---- Cases
def pool(name: str) -> Callable[[int], Case]:
    """The drawn cases of a pool by their number."""

    def case(number: int) -> Case:
        d = drawn(name, number)
        return Case(f"{name} {number}", texts(sets_of(d)), _tags(d), facts_of(d))

    return case


def drawn(name: str, number: int) -> Drawn:
    """What the axes of the docstring are in a case of a pool, in their units."""
    seed = FIRST_SEED[name] + number
    rng = np.random.default_rng(seed)
    while True:
        d = _one(rng, must_lean_out=number % OUT_EVERY == 0)
        if name == "judging" or not is_left_out(d):
            return {"seed": seed, **d}


def is_left_out(d: Drawn) -> bool:
    """Of what no building case has."""
    low, high = UNSEEN_WAVES
    return d["crop"] == UNSEEN_CROP or d["scanner"] == UNSEEN_SCANNER or low <= d["length"] <= high


def _one(rng: np.random.Generator, *, must_lean_out: bool) -> Drawn:
    def log_even(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def chance(share: float) -> bool:
        return bool(rng.uniform() < share)

    crop = str(rng.choice(list(CROPS), p=[share for share, *_ in CROPS.values()]))
    _, stems, usual, spacings = CROPS[crop]
    factor, lean = rng.uniform(0.7, 1.2), rng.uniform(0.0, 35.0)
    towards, away = rng.uniform(-180.0, 180.0), rng.uniform(-ASIDE, ASIDE)
    if must_lean_out:
        lean, towards = LEANS + lean * (35.0 - LEANS) / 35.0, -90.0 + away
    length, mount = rng.uniform(20.0, 80.0), rng.uniform(1.8, 3.6)
    wind = 0.0 if chance(1 / 3) else rng.uniform(0.5, STRONG if lean > LAID else 8.0)
    d = {
        "crop": crop,
        "rows": float(rng.choice(spacings)) if spacings else 0.0,
        "stems": log_even(*stems),
        "height": factor,
        "lean": lean,
        "towards": towards,
        "length": length,
        "wave": min(0.8, STEEPEST * length / (2.0 * np.pi)) * rng.uniform() ** 2,
        "phase": rng.uniform(0.0, 360.0),
        "runs": rng.uniform(0.0, 180.0),
        "slope": 14.0 * rng.uniform() ** 2,
        "rises": rng.uniform(-180.0, 180.0),
        "rough": str(rng.choice(["none", "B", "C", "D"])),
        "stubble": rng.uniform(0.05, min(0.45, TALLEST * usual * factor)),
        "scanner": str(rng.choice(SCANNERS)),
        "mount": mount,
        "pitch": float(np.degrees(np.arctan2(mount, rng.uniform(6.0, 11.0)))),
        "side": str(rng.choice(["left", "right"])),
        "wind": wind,
        "blows": rng.uniform(-180.0, 180.0),
        "speed": rng.uniform(4.0, 9.0),
    }
    sds = {"pitch_deg": 0.5, "roll_deg": 0.5, "yaw_deg": 0.3, "x_m": 0.01, "y_m": 0.01, "z_m": 0.01}
    d["error"] = {key: rng.normal(0.0, sd) for key, sd in sds.items()} if chance(1 / 2) else {}
    d["air"] = str(rng.choice(["clear", "chaff", "plume"], p=[0.5, 0.25, 0.25]))
    d["chaff"] = {"near_returns": rng.uniform(0.0, 1.0), "near_reach_m": rng.uniform(1.0, 2.5),
                  "extinction_per_m": log_even(0.003, 0.2)}  # fmt: skip
    d["plume"] = {"grams_per_kg": log_even(0.2, 10.0), "soil_g_per_m": log_even(0.05, 5.0)}
    more = rng.spawn(1)[0]
    d["outlet"] = str(more.choice(["all", "header", "chopper", "wheels"], p=[0.55, 0.15, 0.15, 0.15]))
    d["stability"], d["moisture"] = str(more.choice(list("ABCDEF"))), more.uniform(6.0, 16.0)
    bend = {"run_in_m": rng.uniform(6.0, 12.0), "radius_m": rng.uniform(15.0, 40.0),
            "angle_deg": float(rng.choice([-1.0, 1.0])) * rng.uniform(15.0, 60.0)}  # fmt: skip
    d["bend"] = bend if chance(1 / 4) else {}
    teeth = {"amplitude_m": rng.uniform(0.05, 0.3), "wavelength_m": rng.uniform(2.0, 6.0),
             "kind": str(rng.choice(["random", "sawtooth"]))}  # fmt: skip
    d["teeth"] = teeth if chance(1 / 3) else {}
    d["hole"] = str(rng.choice(["none", "notch", "gap"], p=[0.675, 0.2, 0.125]))
    start = rng.uniform(12.0, 18.0)
    notch = {"end_m": start + rng.uniform(1.5, 6.0), "depth_m": rng.uniform(0.3, 1.5)}
    gap = {"end_m": start + rng.uniform(2.0, 8.0), "depth_m": 5.0}
    d["gap"] = {"start_m": start, **(gap if d["hole"] == "gap" else notch), "stubble_height_m": d["stubble"]}
    away, width = rng.uniform(2.0, 8.0), rng.uniform(0.3, 0.5)
    d["tramline"] = {"spacing_m": 24.0, "track_m": 2.0, "width_m": width, "offset_m": away}
    d["has_tramline"] = chance(1 / 5)
    return d


def sets_of(d: Drawn) -> Sets:
    """The settings of a drawn case."""
    side = 1.0 if d["side"] == "left" else -1.0  # the crop is to the right of the left header end
    wave = {"amplitude_m": d["wave"], "wavelength_m": d["length"], "azimuth_deg": side * d["runs"],
            "phase_deg": d["phase"]}  # fmt: skip
    sets: Sets = {
        "seed": d["seed"],
        "run.distance_m": METRES,
        "run.max_duration_s": 90,
        "combine.edge_side": d["side"],
        "combine.speed.speed_kmh": d["speed"],
        f"{LIDAR}.sensor": d["scanner"],
        f"{LIDAR}.mount": {"z_m": d["mount"], "pitch_deg": d["pitch"]},
        TERRAIN: {"level": "formula", "slope_percent": 100.0 * float(np.tan(np.radians(d["slope"]))),
                  "slope_azimuth_deg": side * d["rises"], "roughness_class": d["rough"], "waves": [wave]},
        EDGE: {"shape": "straight", "crop_side": "right" if d["side"] == "left" else "left",
               "stubble_height_m": d["stubble"]},
        STAND: {"level": "uniform", "crop": d["crop"], "stems_per_m2": d["stems"], "lean_deg": d["lean"],
                "height_factor": d["height"], "lean_azimuth_deg": side * d["towards"]},
    }  # fmt: skip
    if d["rows"]:
        sets[STAND]["row_spacing_m"] = d["rows"]
    if d["has_tramline"]:
        left = {**d["tramline"], "offset_m": -side * d["tramline"]["offset_m"]}
        sets[STAND] |= {"level": "maps", "tramlines": left}
    if d["bend"]:
        sets[EDGE] |= {"shape": "curve", **d["bend"]}
    if d["teeth"]:
        sets[EDGE]["teeth"] = d["teeth"]
    if d["hole"] != "none":
        sets[EDGE]["gaps"] = [d["gap"]]
    if d["wind"] or d["air"] == "plume":
        sets["field.weather"] = {"wind_m_s": d["wind"], "wind_azimuth_deg": side * d["blows"]}
    if d["wind"]:
        sets[STAND]["wind"] = {}
    if d["error"]:
        sets[f"{LIDAR}.mount_error"] = d["error"]
    if d["air"] == "chaff":
        sets[f"{LIDAR}.weather"] = d["chaff"]
    if d["air"] == "plume":
        outlet, told = d["outlet"], {**d["plume"], "stability": d["stability"]}
        told["header_percent"] = {"header": 100.0, "chopper": 0.0}.get(outlet, 30.0)
        if outlet != "all":
            told |= {"grams_per_kg": 0.0} if outlet == "wheels" else {"soil_g_per_m": 0.0}
        sets["combine.dust"] = told
        sets[STAND]["straw_moisture_percent"] = d["moisture"]
    return sets


def _tags(d: Drawn) -> tuple[str, ...]:
    is_out = d["lean"] > LEANS and abs(d["towards"] + 90.0) <= ASIDE
    is_in = d["lean"] > LEANS and abs(d["towards"] - 90.0) <= ASIDE
    of = {
        "leans out": is_out,
        "leans in": is_in,
        "leans along": d["lean"] > LEANS and not (is_out or is_in),
        "upright": d["lean"] <= LEANS,
        "waves > 0.2 m": d["wave"] > 0.2,
        "slope > 5 deg": d["slope"] > 5.0,
        "rows": d["rows"] > 0.0,
        "bend": bool(d["bend"]),
        "teeth": bool(d["teeth"]),
        d["hole"]: d["hole"] != "none",
        "tramline": d["has_tramline"],
        d["air"]: d["air"] != "clear",
        "mount error": bool(d["error"]),
        "left out of building": is_left_out(d),
    }
    return tuple(name for name, is_so in of.items() if is_so)


def facts_of(d: Drawn) -> str:
    """A drawn case in words."""
    more = [d["hole"]] * (d["hole"] != "none") + [d["air"]] * (d["air"] != "clear")
    more += [name for name in ("bend", "teeth", "error") if d[name]] + ["tramline"] * d["has_tramline"]
    return (
        f"{d['crop']} {d['stems']:.0f}/m2 x{d['height']:.2f} lean {d['lean']:.0f} to {d['towards']:.0f}, "
        f"stubble {d['stubble']:.2f}, wave {d['wave']:.2f}/{d['length']:.0f} m, slope {d['slope']:.0f} to "
        f"{d['rises']:.0f}, {d['rough']}, wind {d['wind']:.0f}, {d['scanner']} {d['mount']:.1f} m "
        f"{d['side']} {' '.join(more)}"
    )


def _fixed(name: str, metres: float, sets: Sets) -> Case:
    return Case(name, texts({"seed": 11, "run.distance_m": metres, **sets}))


def nine(number: int) -> Case:
    """Wheat that leans straight out, else nothing."""
    lean, height = (20, 26, 32)[number // 3], (1.0, 1.1, 1.2)[number % 3]
    leaning = {"lean_deg": lean, "lean_azimuth_deg": -90, "height_factor": height, "stems_per_m2": 450}
    return _fixed(f"lean {lean} x {height}", 26, {f"{STAND}.{key}": value for key, value in leaning.items()})


def waves(number: int) -> Case:
    """Upright wheat on waves of 60 m along the way."""
    high, phase = ((0.3, 0.6)[(number - 1) // 4], (0, 90, 180, 270)[(number - 1) % 4]) if number else (0.0, 0)
    wave = {"amplitude_m": high, "wavelength_m": 60, "azimuth_deg": 0, "phase_deg": phase}
    ground = {"level": "formula", "slope_percent": 1.0, "roughness_class": "none", "waves": [wave]}
    return _fixed(f"{high} m at {phase}", METRES, {TERRAIN: ground, f"{LIDAR}.level": "empirical"})


ROWS = (("maize", 0.75, 9, 0.25), ("soy", 0.75, 35, 0.08), ("soy", 0.38, 35, 0.08), ("rape", 0.25, 40, 0.2))


def rows(number: int) -> Case:
    """Crops in rows on a straight edge; first those on the right of the machine; three seeds."""
    (crop, spacing, stems, stubble), side = ROWS[number % 4], ("left", "right")[number // 4 % 2]
    stand = {"level": "uniform", "crop": crop, "row_spacing_m": spacing, "stems_per_m2": stems}
    edge = {"shape": "straight", "crop_side": ("right", "left")[number // 4 % 2], "stubble_height_m": stubble}
    sets = {STAND: stand, EDGE: edge, "combine.edge_side": side, "seed": 11 + number // 8}
    return _fixed(f"{crop} {spacing} m {side}", METRES, sets)


def domain(number: int) -> Case:
    """A point of a covering array of the bundled domain."""
    from swath.tools.function_test.odd.binding import find_odd, read_odd
    from swath.tools.function_test.odd.campaign import pair_count
    from swath.tools.function_test.odd.cells import needed_each
    from swath.tools.function_test.odd.design import Design

    if not POINTS:
        odd = read_odd(find_odd("wheat-harvest"))
        design = Design(odd, needed_each(pair_count(odd), odd.file.claim), 1)
        none = np.zeros((odd.bucket_count, odd.bucket_count))
        POINTS.extend((odd, point) for point in design.next(none, 0, COUNTS["domain"]))
    odd, point = POINTS[number]
    facts = " ".join(
        f"{k.partition('.')[2]} {v if isinstance(v, str) else f'{v:.3g}'}" for k, v in point.items()
    )
    of = {
        "leans out": point["process.lean"] > LEANS and point["process.lean_direction"] == "out_of_crop",
        "waves > 0.2 m": point["terrain.undulation"] > 0.2,
    }
    tags = tuple(name for name, is_so in of.items() if is_so)
    return Case(f"domain {number}", (f"seed={number + 1}", *odd.case.sets(point, None)), tags, facts)


POINTS: list[Any] = []
POOLS: dict[str, Callable[[int], Case]] = {
    "building": pool("building"), "judging": pool("judging"), "nine": nine, "waves": waves, "rows": rows,
    "domain": domain,
}  # fmt: skip
COUNTS = {"building": 24, "judging": 120, "nine": 9, "waves": 9, "rows": 24, "domain": 32}


# ---- A run and what is kept of it
class Line:
    """The line to be steered along: the edge without gaps, with the mean of its teeth."""

    def __init__(self, edge: Any, teeth: Any) -> None:
        self.edge, self.teeth = edge, teeth

    @classmethod
    def of(cls, world: World) -> "Line":
        edge = world.leader.edge
        return cls(edge, next(e.teeth for e in world.field.edges.values() if e.shape is edge))

    def inside(self, points: Any) -> Any:
        """How far inside the line world points lie [m]."""
        x, y = np.array(points, dtype=float).reshape(-1, 3)[:, :2].T
        depth = np.asarray(self.edge.signed_distance(x, y))
        if self.teeth is None:
            return depth
        s = self.edge.project(x, y)[0]
        away = np.linspace(-3.0, 3.0, 61) * TEETH_OVER
        weight = np.exp(-0.5 * (away / TEETH_OVER) ** 2)
        near = self.teeth.depth((s[:, None] + away).ravel()).reshape(-1, len(away))
        return depth - near @ weight / weight.sum()

    def in_crop(self, x: F64, y: F64) -> F64:
        """How far inside the toothed edge places lie [m]."""
        depth = np.asarray(self.edge.signed_distance(x, y))
        return depth if self.teeth is None else depth - self.teeth.depth(self.edge.project(x, y)[0])


class Watch:
    """Observer: true poses and ways, what was told, and the scans of every ALIKE / 2 of way."""

    def __init__(self) -> None:
        self.at: dict[int, tuple[Any, float, float]] = {}  # pose, way [m], speed [m/s]
        self.told: list[CropEdge] = []
        self.scans: dict[int, Scan] = {}
        self._next = 0.0

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Any]) -> None:
        for signal in outputs.values():
            if isinstance(signal, MachineState) and t % 20_000_000 == 0:
                self.at[t] = signal.pose, signal.distance, signal.speed
            elif isinstance(signal, CropEdge):
                self.told.append(signal)
            elif isinstance(signal, Scan) and signal.t in self.at and self.at[signal.t][1] >= self._next:
                self.scans[signal.t], self._next = signal, self.at[signal.t][1] + 0.5 * ALIKE


def driven(case: Case) -> Row:
    """Drive a case; what is kept of it.

    way, lateral: of the header end against the line [m], > 0 inside; told_way, error, sd, confidence: of each
    edge [m, m, m, 1], nan and 0 where none is told; nat, edge_sd: what the scans hold, of every metre
    """
    began = time.process_time()
    world = assemble(load_scenario("straight", sets=list(case.sets)))
    try:
        watch, line, machine = Watch(), Line.of(world), world.leader
        ended = drive(world, [watch])
        end = (*machine.sheet.header_end(machine.edge_side), 0.0)
        lateral = line.inside([pose.apply(end) for pose, *_ in watch.at.values()]) + machine.overlap
        told = [e for e in watch.told if e.t in watch.at]
        places = [watch.at[e.t][0].apply([e.reference_x, e.offset if e.is_found else 0.0, 0.0]) for e in told]
        found = np.array([e.is_found for e in told])
        error = np.where(found, line.inside(places), np.nan)
        nat, sd = held(world, watch, line)
        return {
            "name": case.name,
            "sets": list(case.sets),
            "tags": list(case.tags),
            "facts": case.facts,
            "metres": float(world.scenario.run.distance_m),
            "seconds": 1e-9 * max(watch.at),
            "ended": str(getattr(ended, "reason", ended))[:200],
            "cpu_s": time.process_time() - began,
            "way": [way for _, way, _ in watch.at.values()],
            "lateral": lateral.tolist(),
            "told_way": [watch.at[e.t][1] for e in told],
            "error": error.tolist(),
            "sd": np.where(found, [e.offset_sd for e in told], np.nan).tolist(),
            "confidence": np.where(found, [e.confidence for e in told], 0.0).tolist(),
            "nat": nat.tolist(),
            "edge_sd": sd.tolist(),
        }
    finally:
        world.close()


# ---- What the scans hold of the true edge
LAYER, LOWEST, LAYERS = 0.06, -0.3, 46  # m: classes of rays are heights over the ground
ABOVE, NONE, CLASSES = LAYERS, LAYERS + 1, LAYERS + 2  # and echoes over the crop, and no echo
CELL, ASIDE_M, NEAR_LINE = (
    0.025,
    2.5,
    1.5,
)  # m: places beside the edge; those among which the best one is sought
LEAST_RANGE, FARTHEST = 1.0, 25.0  # m
ALIKE = 0.24  # m of travel over which scans see the same stems
CLIP = 2.5  # nat of a ray
LOW_END = 0.3  # of the height: down to which a ray that goes on is followed through the stand
BACK_IN, BACK_OUT, SLANT_OUT = 0.03, 0.12, 0.35  # m, m, 1: the stand that stops a ray begins before its echo


def held(world: World, watch: Watch, line: Line) -> tuple[F64, F64]:
    """Gain [nat] and standard deviation [m] of the best place of the edge in each metre of travel.

    Places are against the true edge and heights over the true ground; the shares of the classes on both sides
    are those of the run's other metres.
    """
    mounting, ground = world.leader.parts["lidar"].mounting, world.field.terrain
    from_, ways, ranges, metres = [], [], [], []
    for t, scan in watch.scans.items():
        pose, way, speed = watch.at[t]
        ce = np.cos(scan.elevation)
        beams = np.stack([ce * np.cos(scan.azimuth), ce * np.sin(scan.azimuth), np.sin(scan.elevation)], 1)
        start = pose.apply(mounting.apply([0.0, 0.0, 0.0]))
        from_.append(start + speed * np.asarray(scan.beam_t)[:, None] * pose.turn([1.0, 0.0, 0.0]))
        ways.append(pose.turn(mounting.turn(beams)))
        ranges.append(scan.ranges[:, 0])
        metres.append(np.full(len(beams), int(way)))
    if not from_:
        return np.zeros(0), np.zeros(0)
    o, d, r, at = (np.concatenate(part) for part in (from_, ways, ranges, metres))
    falls = d[:, 2] < -0.05
    o, d, r, at = o[falls], d[falls], r[falls].astype(float), at[falls]
    is_echo = (r > LEAST_RANGE) & (r < FARTHEST)

    def over(t: F64) -> F64:
        p = o + t[:, None] * d
        return p[:, 2] - ground.height(p[:, 0], p[:, 1])

    def beside(t: F64) -> F64:
        p = o + t[:, None] * d
        return line.in_crop(p[:, 0], p[:, 1])

    def down_to(z: float) -> F64:
        """Where rays come to a height over the ground, by the secant method."""
        a, b = (
            np.zeros(len(o)),
            np.clip((o[:, 2] - ground.height(o[:, 0], o[:, 1]) - z) / -d[:, 2], 0.1, 30.0),
        )
        fa, fb = over(a) - z, over(b) - z
        for _ in range(3):
            a, b, fa = (
                b,
                np.clip(b - fb * (b - a) / np.where(np.abs(fb - fa) > 1e-6, fb - fa, 1e-6), 0.1, 30.0),
                fb,
            )
            fb = over(b) - z
        return b

    h, lateral = over(np.where(is_echo, r, 0.0)), beside(np.where(is_echo, r, 0.0))
    in_crop = h[is_echo & (lateral > 0.4) & (lateral < ASIDE_M) & (h > 0.24) & (h < 3.5)]
    top = float(np.percentile(in_crop, 90.0)) if len(in_crop) > 50 else float(world.field.crop_height)
    above = is_echo & (h > 1.25 * top + 0.3)
    layer = np.clip((h - LOWEST) / LAYER, 0, LAYERS - 1).astype(int)
    kind = np.where(above, ABOVE, np.where(is_echo, layer, NONE))
    stops = is_echo & (h > LOW_END * top) & ~above
    low, high = beside(np.where(stops, r, down_to(LOW_END * top))), beside(down_to(top))
    through = low - high
    back = np.where(through > 0.0, np.minimum(through, BACK_IN), np.minimum(-SLANT_OUT * through, BACK_OUT))
    place = np.where(through > 0.0, low, high) - back
    keep = (kind != ABOVE) & (np.abs(place) < ASIDE_M)
    cells = round(2.0 * ASIDE_M / CELL)
    cell = ((place[keep] + ASIDE_M) / CELL).astype(int).clip(0, cells - 1)
    counts = np.zeros((int(at.max()) + 1, cells, CLASSES))
    np.add.at(counts, (at[keep], cell, kind[keep]), 1.0)
    scans = np.bincount([int(watch.at[t][1]) for t in watch.scans], minlength=len(counts))
    every, edges = counts.sum(0), CELL * np.arange(cells + 1) - ASIDE_M
    near, middle = np.abs(edges) < NEAR_LINE, cells // 2
    gains, sds = [], []
    for own, number in zip(counts, scans, strict=True):
        if number < 4:
            continue
        others = every - own + 0.01 * every
        crop, stubble = others[middle + 10 :].sum(0) + 0.5, others[: middle - 10].sum(0) + 0.5
        worth = np.clip(np.log(crop / crop.sum()) - np.log(stubble / stubble.sum()), -CLIP, CLIP)
        score = np.append(np.cumsum((own @ worth)[::-1])[::-1], 0.0) / max(1.0, ALIKE * number)
        p = np.exp(score[near] - score[near].max())
        p /= p.sum()
        mean = float(p @ edges[near])
        gains.append(score[near].max() - max(score[0], 0.0))
        sds.append(np.sqrt(p @ (edges[near] - mean) ** 2))
    return np.array(gains), np.array(sds)


# ---- Judging
def samples(row: Row) -> F64:
    """(way, error, deviation, confidence) of one edge per STEP of way from BEGIN on, (n, 4)."""
    told = np.array([row["told_way"], row["error"], row["sd"], row["confidence"]], dtype=float).T
    told = told[told[:, 0] > BEGIN]
    steps = (told[:, 0] / STEP).astype(int)
    return told[np.diff(steps, prepend=-1) > 0]


def numbers(row: Row) -> Row:
    """Of a run: verdict; worst lateral error and RMS of the told edge [m]; told deviation [m]; shares."""
    way, lateral = np.array(row["way"]), np.abs(row["lateral"])
    at, error, sd, sure = samples(row).T
    told_way, confidence = np.array(row["told_way"]), np.array(row["confidence"])
    seen = np.concatenate([[0.0], told_way[confidence > 0.0], [way[-1]]])
    late, found = way > BEGIN, np.isfinite(error)
    worst = float(lateral[late].max()) if late.any() else float("nan")
    wrong = float(np.mean((sure >= SURE) & (np.abs(error) > WRONG_M))) if len(at) else 0.0
    fine = wrong < SURE_WRONG and float(np.diff(seen).max()) <= BLIND["gap" in row["tags"]]
    is_stopped = way[-1] < row["metres"] - 1.0
    ends_well = not worst > (STANDS if is_stopped else HOLDS)
    verdict = "off" if not (fine and ends_well) else "stops" if is_stopped else "holds"
    nat = float(np.median(row["nat"])) if row["nat"] else 0.0
    return {
        "verdict": verdict,
        "needless": verdict == "stops" and nat >= NEEDLESS and "leans out" not in row["tags"],
        "nat": nat,
        "edge_sd": float(np.median(row["edge_sd"])) if row["edge_sd"] else float("nan"),
        "way": float(way[-1]),
        "worst": worst,
        "rms": float(np.sqrt(np.mean(error[found] ** 2))) if found.any() else float("nan"),
        "sd": float(np.median(sd[found])) if found.any() else float("nan"),
        "sure": float(np.mean(sure)) if len(at) else 0.0,
        "band": float(np.mean(np.abs(error[found]) <= 1.96 * sd[found])) if found.any() else float("nan"),
        "wrong": wrong,
        "kmh": 3.6 * float(way[-1]) / row["seconds"],
    }


HEAD = (f"{'case':13} {'nat/m':>5} {'sd':>4} | {'':5} {'way':>4} {'worst':>5} {'edge':>5} {'told':>5} "
        f"{'conf':>4} {'band':>4} {'wrong':>5} {'km/h':>4} | {'cpu s':>5}")  # fmt: skip


def line_of(row: Row) -> str:
    """A row of the table; lengths in cm but the way."""
    n = numbers(row)
    return (
        f"{row['name']:13} {n['nat']:5.0f} {100 * n['edge_sd']:4.1f} | {n['verdict']:5} {n['way']:4.1f} "
        f"{100 * n['worst']:5.1f} {100 * n['rms']:5.1f} {100 * n['sd']:5.1f} {n['sure']:4.2f} "
        f"{n['band']:4.2f} {n['wrong']:5.3f} {n['kmh']:4.1f} | {row['cpu_s']:5.1f} | {row['facts']}"
    )


def tell(done: Sequence[Row]) -> None:
    """What runs come to together."""
    told = [(row, numbers(row), samples(row)[:, 1:]) for row in done]
    groups = {"all": told}
    for row, n, s in told:
        for tag in row["tags"]:
            groups.setdefault(tag, []).append((row, n, s))
    print("\n| kind | runs | hold | stop (needless, before 8 m) | off | sure and wrong: runs | band | km/h |")
    print("|---|---|---|---|---|---|---|---|")
    for name, mine in sorted(groups.items(), key=lambda of: -len(of[1])):
        count = {v: sum(n["verdict"] == v for _, n, _ in mine) for v in ("holds", "stops", "off")}
        needless, early = sum(n["needless"] for _, n, _ in mine), sum(n["way"] < BEGIN for _, n, _ in mine)
        wrong = sum(n["wrong"] > 0.0 for _, n, _ in mine)
        print(
            f"| {name} | {len(mine)} | {count['holds']} | {count['stops']} ({needless}, {early}) | "
            f"{count['off']} | {wrong} | {_band([s for *_, s in mine])} | "
            f"{np.mean([n['kmh'] for _, n, _ in mine]):.1f} |"
        )
    every = [s for *_, s in told]
    if len(told) > GROUP:
        parts = (every[k : k + GROUP] for k in range(0, len(every), GROUP))
        print(f"band by {GROUP} runs: " + ", ".join(map(_band, parts)))
    print(f"confidence: told, share right within {100 * RIGHT_M:.0f} cm, samples")
    pooled = np.concatenate(every)
    for low, high in pairwise(BINS):
        of = pooled[np.isfinite(pooled[:, 0]) & (pooled[:, 2] >= low) & (pooled[:, 2] < high)]
        if len(of):
            right = np.mean(np.abs(of[:, 0]) <= RIGHT_M)
            print(f"  {low:.1f} to {min(high, 1.0):.1f}: {of[:, 2].mean():.2f}, {right:.2f}, {len(of)}")
    print(f"{np.mean([row['cpu_s'] for row in done]):.1f} CPU-s a case")


def _band(of: Sequence[F64]) -> str:
    s = np.concatenate(of)
    s = s[np.isfinite(s[:, 0])]
    return f"{np.mean(np.abs(s[:, 0]) <= 1.96 * s[:, 1]):.3f}" if len(s) else "-"


# ---- Storing
def stored(path: Path | None) -> dict[tuple[str, ...], Row]:
    """The runs that a file holds, by their settings."""
    if path is None or not path.exists():
        return {}
    import pyarrow.parquet as pq

    return {tuple(row["sets"]): row for row in pq.read_table(path).to_pylist()}


def store(path: Path, done: Mapping[tuple[str, ...], Row]) -> None:
    """Write all runs, whole."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    beside = path.with_name(f".{path.name}.part")
    pq.write_table(pa.Table.from_pylist(list(done.values())), beside)
    os.replace(beside, path)


def run_all(cases: Iterator[Case], out: Path | None) -> list[Row]:
    """Drive what the file has not, one after another; keep each as it ends."""
    known = stored(out)
    rows = []
    print(HEAD)
    for case in cases:
        if case.sets not in known:
            known[case.sets] = driven(case)
            if out is not None:
                store(out, known)
        rows.append({**known[case.sets], "tags": list(case.tags)})
        print(line_of(rows[-1]), flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pool", choices=list(POOLS))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, help="default: all, of `building` 24")
    parser.add_argument("--list", action="store_true", help="print the cases, drive none")
    parser.add_argument("--out", type=Path, help="parquet file that keeps the runs")
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    asked = parser.parse_args()
    most = COUNTS[asked.pool]
    last = asked.first + (most if asked.count is None else asked.count)
    if asked.pool != "building" and last > most:
        last = most
    made = (POOLS[asked.pool](number) for number in range(asked.first, last))
    cases = (Case(c.name, (*c.sets, *asked.sets), c.tags, c.facts) for c in made)
    if asked.list:
        for case in cases:
            print(f"# {case.name}: {case.facts or ', '.join(case.tags)}")
            print(" ".join(["swath run straight", *(f"--set '{text}'" for text in case.sets)]))
        return
    rows = run_all(cases, asked.out)
    if rows:
        tell(rows)


if __name__ == "__main__":
    main()
