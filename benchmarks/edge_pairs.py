"""Edge detectors on drawn cases: single difficulties and pairs; other scanners, mountings, headers, crops.

    python benchmarks/edge_pairs.py record --pool fitting --number 60 --into scans/
             scans of the drawn cases, driven along the true line; of `plants` unless --lidar empirical, and
             then, too, where that has no table of the crop (a line on stderr says so)
    python benchmarks/edge_pairs.py detect --from scans/ --levels likelihood_ratio otsu --out told.jsonl
    python benchmarks/edge_pairs.py drive --pool final --number 60 --out driven.jsonl        closed loop
             a level may be of your own: mine.py:Mine
    python benchmarks/edge_pairs.py table told.jsonl ... [--each | --beside]     --beside: level beside level

A case depends on its pool and number alone. Pools `building` (looked at) and `judging` (not) draw over all
axes: stubble of 5 to 45 cm, every crop, scanner, mounting of 1.8 to 3.6 m, side; singles and pairs half and
half, of twenty cases three and more with a bend. In the others stubble goes with the crop, and what is left
out while fitting and choosing: two scanners, one crop, the edge on the left, mountings above 2.7 m; `final`
and `seen` (looked at, to choose by) have all, `left_out` only cases with one of them.

The line that a detector shall tell is the one to be steered along: the edge without its gaps, with the mean
of its teeth over some metres. Errors count from 8 m on. Sure is a confidence >= 0.5, wrong an error > 30 cm,
hazardous one of more than 3 deviations, too, each over more than 1 m.
A run holds where the header end stays within 30 cm (open loop: where the line is told for 90 % of the way and
within 30 cm), and stops safely where it stands within 50 cm (open loop: where no wrong line is told with a
confidence of 0.3).
"""

import argparse
import json
import pickle
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from edge_hard import BEGIN, DUST, EDGE, STAND
from edge_worlds import Line

from swath.core.component import Port
from swath.core.errors import SwathError
from swath.core.foreign_code import allow_code
from swath.core.random import Stream
from swath.judge.evaluators.edge_detection import DEVIATIONS, SURE
from swath.judge.evaluators.edge_detection import RIGHT_M as TOLERANCE
from swath.judge.evaluators.edge_detection import WRONG_M as WRONG
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.runtime.world import World
from swath.scenario.scenario import load_scenario
from swath.scenario.slots import CATALOGUE
from swath.signals import CropEdge, Inertial, MachineState, Odometry, Scan
from swath.signals.setup import ControlSetup

Sets = dict[str, Any]
DISTANCE = 46.0  # m, of a run
POOLS = {
    "fitting": 81, "choosing": 4021, "seen": 770077, "final": 6271128, "left_out": 5150,
    "building": 71001, "judging": 71929377,
}  # fmt: skip
WIDE, BENDS = ("building", "judging"), (3, 9, 14)  # of twenty cases, with a bend
SCANNERS = ("sick-lms511-hr", "sick-lms511-sr", "sick-lms111", "sick-lms291", "hokuyo-utm-30lx")
CROPS = {  # stems per m2, stubble height
    "wheat": (250, 550, 0.15),
    "barley": (300, 600, 0.15),
    "rape": (40, 90, 0.4),
    "soy": (30, 45, 0.08),
    "rye": (250, 450, 0.25),
    "maize": (7, 11, 0.3),
}
ODDS = [0.4, 0.2, 0.15, 0.1, 0.15, 0.0]
WIDE_ODDS = [0.3, 0.16, 0.14, 0.1, 0.16, 0.14]
STUBBLE, TALLEST_STUBBLE = (0.05, 0.45), 0.6  # m; of the crop's height
HEIGHTS = {"wheat": 0.85, "barley": 0.8, "rape": 1.4, "soy": 0.85, "rye": 1.4, "maize": 2.4}  # m, usual
UNSEEN_SCANNERS, UNSEEN_CROP, UNSEEN_HEIGHT = ("sick-lms291", "hokuyo-utm-30lx"), "rye", 2.7


# ---- What makes an edge hard: (rng, side: +1 crop on the right) -> settings
def bend(rng: np.random.Generator, side: float) -> Sets:
    radius, angle = rng.uniform(11, 25), float(rng.choice([-1.0, 1.0])) * rng.uniform(50, 80)
    return {
        f"{EDGE}.shape": "curve",
        f"{EDGE}.run_in_m": 14,
        f"{EDGE}.radius_m": radius,
        f"{EDGE}.angle_deg": angle,
    }


def hole(start: float, end: float, depth: float) -> Sets:
    return {f"{EDGE}.gaps": [{"start_m": start, "end_m": end, "depth_m": depth, "stubble_height_m": 0.15}]}


def notch(rng: np.random.Generator, side: float) -> Sets:
    start = rng.uniform(18, 24)
    return hole(start, start + rng.uniform(1.5, 6.0), rng.uniform(0.35, 1.6))


def gap(rng: np.random.Generator, side: float) -> Sets:
    start = rng.uniform(18, 24)
    return hole(start, start + rng.uniform(3.0, 8.0), 5.0)


def teeth(rng: np.random.Generator, side: float) -> Sets:
    kind = str(rng.choice(["random", "sawtooth"]))
    of = {"amplitude_m": rng.uniform(0.15, 0.5), "wavelength_m": rng.uniform(2, 6), "kind": kind}
    return {f"{EDGE}.teeth": of}


def thin(rng: np.random.Generator, side: float) -> Sets:
    return {"thin": rng.uniform(0.12, 0.3)}


def lean(rng: np.random.Generator, side: float) -> Sets:
    return {f"{STAND}.lean_deg": rng.uniform(20, 40), f"{STAND}.lean_azimuth_deg": rng.uniform(-180, 180)}


def lodged(rng: np.random.Generator, side: float) -> Sets:
    patch = {
        "x_m": side * rng.uniform(-0.5, 2.0),
        "y_m": rng.uniform(23, 28),
        "radius_m": rng.uniform(2.0, 4.5),
        "lean_deg": rng.uniform(40, 65),
        "azimuth_deg": rng.uniform(-180, 180),
    }
    return {f"{STAND}.level": "maps", f"{STAND}.patches": [patch]}


def patchy(rng: np.random.Generator, side: float) -> Sets:
    return {
        f"{STAND}.level": "maps",
        f"{STAND}.density_variation": {"sd_percent": rng.uniform(10, 30), "length_m": 8},
        f"{STAND}.height_variation": {"sd_percent": rng.uniform(5, 12), "length_m": 8},
    }


def tramline(rng: np.random.Generator, side: float) -> Sets:
    lines = {
        "spacing_m": 24,
        "track_m": 2,
        "width_m": rng.uniform(0.3, 0.5),
        "offset_m": -side * rng.uniform(2.0, 4.0),
    }
    return {f"{STAND}.level": "maps", f"{STAND}.tramlines": lines}


def low(rng: np.random.Generator, side: float) -> Sets:
    return {f"{STAND}.height_factor": rng.uniform(0.5, 0.7), "tall_stubble": rng.uniform(0.35, 0.5)}


def dust(rng: np.random.Generator, side: float) -> Sets:
    return {
        DUST: {
            "near_returns": rng.uniform(0.1, 0.6),
            "near_reach_m": rng.uniform(1.0, 2.5),
            "extinction_per_m": rng.uniform(0.1, 0.4),
        }
    }


def slope(rng: np.random.Generator, side: float) -> Sets:
    return {"field.terrain.slope_percent": float(rng.choice([-1.0, 1.0])) * rng.uniform(5, 12)}


def rough(rng: np.random.Generator, side: float) -> Sets:
    wave = {
        "amplitude_m": rng.uniform(0.1, 0.4),
        "wavelength_m": rng.uniform(25, 50),
        "azimuth_deg": rng.uniform(0, 90),
    }
    return {"field.terrain.waves": [wave], "field.terrain.roughness_class": str(rng.choice(["B", "C", "D"]))}


def wind(rng: np.random.Generator, side: float) -> Sets:
    return {f"{STAND}.wind": {"speed_m_s": rng.uniform(4, 8), "azimuth_deg": rng.uniform(-180, 180)}}


def weeds(rng: np.random.Generator, side: float) -> Sets:
    return {f"{STAND}.weeds": {"plants_per_m2": rng.uniform(10, 40), "height_m": rng.uniform(0.2, 0.5)}}


KINDS: dict[str, Callable[[np.random.Generator, float], Sets]] = {
    k.__name__: k
    for k in (
        bend,
        notch,
        gap,
        teeth,
        thin,
        lean,
        lodged,
        patchy,
        tramline,
        low,
        dust,
        slope,
        rough,
        wind,
        weeds,
    )
}
ALIKE = (  # of these no two go together: they set the same keys
    {"notch", "gap"},
    {"thin", "patchy", "tramline", "lodged", "low"},
    {"slope", "rough"},
    {"lean", "wind", "lodged"},
    {"bend", "lodged"},
    {"bend", "tramline"},
    {"weeds", "lodged", "patchy", "tramline"},
)


def case(pool: str, number: int) -> dict[str, Any]:
    """Kinds, facts and settings of one case. Every fifth is plain, two of five are pairs."""
    rng = np.random.default_rng([POOLS[pool], number])
    while True:
        drawn = _drawn(rng, number, is_wide=pool in WIDE)
        if pool in ("seen", "final", *WIDE) or is_left_out(drawn) == (pool == "left_out"):
            return drawn


def is_left_out(drawn: Mapping[str, Any]) -> bool:
    """Of what no number was fitted to."""
    return (
        drawn["scanner"] in UNSEEN_SCANNERS
        or drawn["crop"] == UNSEEN_CROP
        or drawn["side"] == "left"
        or drawn["mount"] > UNSEEN_HEIGHT
    )


def _drawn(rng: np.random.Generator, number: int, *, is_wide: bool) -> dict[str, Any]:
    scanner, crop = str(rng.choice(SCANNERS)), str(rng.choice(list(CROPS), p=WIDE_ODDS if is_wide else ODDS))
    on = str(rng.choice(["left", "right"]))
    height, pitch = rng.uniform(1.9, 3.1), rng.uniform(12, 22)
    if is_wide:
        height = rng.uniform(1.8, 3.6)
        pitch = float(np.degrees(np.arctan2(height, rng.uniform(6.0, 11.0))))
    machine, width = (
        str(rng.choice(["lexion-700-class", "combine-5m"])),
        float(rng.choice([5.4, 6.6, 7.5, 9.0])),
    )
    speed, count = rng.uniform(3, 12), 1 + number % 2 if is_wide else (0, 1, 1, 2, 2)[number % 5]
    side = 1.0 if on == "left" else -1.0
    while True:
        kinds = sorted(str(k) for k in rng.choice(list(KINDS), count, replace=False))
        if (
            not any(len(group & set(kinds)) > 1 for group in ALIKE)
            and not (crop in ("soy", "rape", "maize") and "low" in kinds)
            and (not is_wide or number % 20 not in BENDS or "bend" in kinds)
        ):
            break
    few, many, stubble = CROPS[crop]
    if is_wide:
        stubble = rng.uniform(STUBBLE[0], min(STUBBLE[1], TALLEST_STUBBLE * HEIGHTS[crop]))
    sets: Sets = {
        "run.distance_m": DISTANCE,
        "run.max_duration_s": 90,
        "seed": int(rng.integers(1000, 10**6)),
        "combine.machine": machine,
        "combine.header_width_m": width,
        "combine.edge_side": on,
        f"{EDGE}.crop_side": "right" if on == "left" else "left",
        "combine.speed.speed_kmh": speed,
        "combine.lidar.sensor": scanner,
        "combine.lidar.mount.z_m": height,
        "combine.lidar.mount.pitch_deg": pitch,
        "combine.imu.level": "error",
        "combine.edge.wires": {"inertial": "imu.inertial"},
        f"{STAND}.crop": crop,
        f"{STAND}.stems_per_m2": rng.uniform(few, many),
        f"{EDGE}.stubble_height_m": stubble,
    }
    for kind in kinds:
        sets.update(KINDS[kind](rng, side))
    if "thin" in sets:
        sets[f"{STAND}.stems_per_m2"] *= sets.pop("thin") * (1.0 if few > 100 else 2.0)
    if "tall_stubble" in sets:
        tall = HEIGHTS[crop] * sets[f"{STAND}.height_factor"]
        sets[f"{EDGE}.stubble_height_m"] = sets.pop("tall_stubble") * tall
    return {
        "number": number,
        "kinds": kinds,
        "scanner": scanner,
        "crop": crop,
        "side": on,
        "mount": height,
        "pitch": pitch,
        "speed": speed,
        "stubble": sets[f"{EDGE}.stubble_height_m"],
        "sets": sets,
    }


def found(level: str) -> Any:
    """A level of the edge by its name, or as `mine.py:Mine`."""
    return CATALOGUE.registry.get("edge", level, base=Path.cwd())


def world_of(sets: Sets, level: str, lidar: str) -> World:
    """The scenario `straight` with these settings."""
    given = {**sets, "combine.edge.level": level, "combine.lidar.level": lidar}
    try:
        with allow_code(None):
            if "inertial" not in {port.name for port in found(level).component.inputs}:
                given.pop("combine.edge.wires", None)
            return assemble(
                load_scenario("straight", sets=[f"{k}={json.dumps(v)}" for k, v in given.items()])
            )
    except SwathError as error:  # no table of this crop
        if lidar == "plants":
            raise
        print(f"lidar plants instead of {lidar}: {error}", file=sys.stderr)
        return world_of(sets, level, "plants")


# ---- Errors
class Recorder:
    """Stands in for an edge detector: keeps what it is given, and tells the true line (`line`, once set)."""

    @dataclass(frozen=True)
    class Params:
        """None."""

    inputs = (
        Port("scan", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry),
        Port("inertial", Inertial, history=True, optional=True),
    )
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params: Any, setup: Any) -> None:
        knife, self._y = setup.machine.header_end(setup.edge_side)
        self._x, self.setup = knife + 1.5, setup
        self.kept: list[Any] = []
        self.line: Any = None
        self.pose: Any = None

    def reset(self, stream: Any) -> dict[str, Any]:
        return {"edge": self._edge(0)}

    def step(self, t: int, dt: int, inputs: Any) -> dict[str, Any]:
        self.kept.append((t, dt, dict(inputs)))
        return {"edge": self._edge(t + dt)}

    def _edge(self, t: int) -> CropEdge:
        if self.line is None or self.pose is None:
            return CropEdge(t, self._y, 0.0, 0.0, self._x, 1.0, float("nan"), float("nan"))
        y0, y1, y2 = (self.line.ahead(self.pose, self._x + d, self._y) for d in (-0.5, 0.0, 0.5))
        slope = y2 - y0
        return CropEdge(
            t, y1, float(np.arctan(slope)), 4 * (y0 + y2 - 2 * y1), self._x, 1.0, float("nan"), float("nan")
        )

    def save(self) -> Any:
        return None

    def load(self, state: Any) -> None:
        pass


class Poses:
    """Observer: true poses and distances by time, and what was told."""

    def __init__(self, part: Any = None) -> None:
        self.at: dict[int, tuple[Any, float]] = {}
        self.told: list[CropEdge] = []
        self._part = part

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Any]) -> None:
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                if t % 20_000_000 == 0:
                    self.at[t] = signal.pose, signal.distance
                if self._part is not None:
                    self._part.pose = signal.pose
            elif isinstance(signal, CropEdge):
                self.told.append(signal)


def errors(line: Line, poses: Mapping[int, Any], told: list[CropEdge]) -> list[list[float]]:
    """Of every edge from 8 m on: way [m], error [m] (nan: none was told), deviation, confidence."""
    rows = [(e, *poses[e.t]) for e in told if e.t in poses and poses[e.t][1] > BEGIN]
    found = [r for r in rows if r[0].is_found]
    inside = line.inside([p.apply([e.reference_x, e.offset, 0.0]) for e, p, _ in found]) if found else []
    by_time = {e.t: float(v) for (e, *_), v in zip(found, inside, strict=True)}
    return [
        [at, by_time.get(e.t, float("nan")), e.offset_sd if e.is_found else float("nan"), e.confidence]
        for e, _, at in rows
    ]


# ---- Commands
def record(options: argparse.Namespace) -> None:
    options.into.mkdir(parents=True, exist_ok=True)
    for number in range(options.first, options.first + options.number):
        file = options.into / f"{options.pool}-{number:03d}.pkl"
        if file.exists():
            continue
        drawn, began = case(options.pool, number), time.process_time()
        world = world_of(drawn["sets"], f"{Path(__file__).resolve()}:Recorder", options.lidar)
        part = world.leader.parts["edge"]
        part.line, watch = Line.of(world), Poses(part)
        drive(world, [watch])
        setup = part.setup
        stored = {
            **drawn,
            "setup": (setup.machine, dict(setup.mountings), setup.edge_side, setup.period),
            "known": {"crop_height": setup.crop_height, "row_spacing": setup.row_spacing},
            "edge": part.line.edge,
            "teeth": part.line.teeth,
            "kept": part.kept,
            "poses": watch.at,
        }
        file.write_bytes(pickle.dumps(stored, protocol=5))
        print(file.name, drawn["kinds"], drawn["crop"], f"{time.process_time() - began:.1f} s", flush=True)


def detect(options: argparse.Namespace) -> None:
    files = [f for f in sorted(options.scans.glob("*.pkl")) if f.name.startswith(options.pool)]
    for file in files[:: options.every]:
        stored = pickle.loads(file.read_bytes())
        for level in options.levels:
            run = detected(stored, level)
            with options.out.open("a") as out:
                print(json.dumps({"file": file.name, "level": level, **run}), file=out, flush=True)


def detected(stored: dict[str, Any], level: str) -> dict[str, Any]:
    """What a level tells of stored scans, without a world."""
    with allow_code(None):
        entry = found(level)
    names = {port.name for port in entry.component.inputs}
    part = entry.component(entry.params(), ControlSetup(*stored["setup"], **stored["known"]))
    told = [part.reset(Stream(1, "edge"))["edge"]]
    began = time.process_time()
    for t, dt, inputs in stored["kept"]:
        told.append(part.step(t, dt, {k: v for k, v in inputs.items() if k in names})["edge"])
    seconds = (time.process_time() - began) / max(len(stored["kept"]), 1)
    rows = errors(Line(stored["edge"], stored["teeth"]), stored["poses"], told)
    facts = {k: stored[k] for k in ("number", "kinds", "scanner", "crop", "side", "mount", "pitch", "speed")}
    return {**facts, "loop": "open", "cost_us": seconds * 1e6, "rows": rows}


def closed(options: argparse.Namespace) -> None:
    done = {(r["number"], r["level"]) for r in read([options.out])} if options.out.exists() else set()
    for number in range(options.first, options.first + options.number):
        drawn = case(options.pool, number)
        for level in options.levels:
            if (number, level) in done:
                continue
            world = world_of(drawn["sets"], level, options.lidar)
            watch, line, machine = Poses(), Line.of(world), world.leader
            drive(world, [watch])
            end = (*machine.sheet.header_end(machine.edge_side), 0.0)
            ends = [(at, p.apply(end)) for p, at in watch.at.values()]
            lateral = line.inside([p for _, p in ends]) + machine.overlap
            late = np.array([at for at, _ in ends]) > BEGIN
            driven = ends[-1][0]
            facts = {k: v for k, v in drawn.items() if k != "sets"}
            run = {
                **facts,
                "level": level,
                "loop": "closed",
                "driven": driven,
                "is_stopped": driven < DISTANCE - 1.0,
                "worst": float(np.abs(lateral[late]).max()) if late.any() else float("nan"),
                "rms": float(np.sqrt(np.mean(lateral[late] ** 2))) if late.any() else float("nan"),
                "mean_speed": 3.6 * (driven - BEGIN) / max(0.02 * np.count_nonzero(late), 0.02),
                "rows": errors(line, watch.at, watch.told),
            }
            with options.out.open("a") as out:
                print(json.dumps(run), file=out, flush=True)


def read(files: list[Path]) -> list[dict[str, Any]]:
    return [json.loads(line) for file in files for line in file.read_text().splitlines()]


def numbers(run: Mapping[str, Any]) -> dict[str, Any]:
    """Of a run: found [share], rms and worst error [m], wrong = longest way sure and wrong [m], verdict."""
    at, error, sd, sure = np.array(run["rows"], dtype=float).reshape(-1, 4).T
    found = np.isfinite(error)
    is_wrong = found & (sure >= SURE) & (np.abs(error) > WRONG)
    hazard = is_wrong & ~(np.abs(error) <= DEVIATIONS * sd)
    share = float(np.mean(found)) if len(found) else 0.0
    if run["loop"] == "closed":
        stands = not run["is_stopped"]
        holds = stands and run["worst"] <= WRONG
        safe = not stands and (not run["worst"] > 0.5)
        worst = run["worst"]
    else:
        stands = sure >= SURE if len(at) else np.zeros(0, bool)
        worst = float(np.nanmax(np.abs(error))) if found.any() else float("nan")
        holds = share >= 0.9 and worst <= WRONG
        safe = not holds and not (found & (sure >= 0.3) & (np.abs(error) > WRONG)).any()
    return {
        "found": share,
        "edge": float(np.sqrt(np.nanmean(error**2))) if found.any() else float("nan"),
        "bias": float(np.nanmean(error)) if found.any() else float("nan"),
        "worst": worst,
        "wrong": _longest(at, is_wrong),
        "hazard": _longest(at, hazard),
        "holds": bool(holds),
        "safe": bool(safe),
        "sure": float(np.mean(sure >= SURE)) if len(sure) else 0.0,
    }


def _longest(at: Any, is_so: Any) -> float:
    longest, begin = 0.0, float("nan")
    for place, so in zip(at, is_so, strict=True):
        begin = place if so and np.isnan(begin) else begin if so else float("nan")
        longest = max(longest, place - begin) if so else longest
    return longest


def samples(run: Mapping[str, Any]) -> Any:
    """(error, deviation, confidence), one per metre of the way, (n, 3)."""
    rows = np.array(run["rows"], dtype=float).reshape(-1, 4)
    rows = rows[np.isfinite(rows[:, 1])]
    metres = rows[:, 0].astype(int)
    first = np.concatenate([[True], np.diff(metres) > 0]) if len(rows) else np.zeros(0, bool)
    return rows[first][:, 1:]


def interval(runs: list[Any], share: Callable[[Any], Any]) -> tuple[float, float, float]:
    """(share pooled, 2.5 and 97.5 percentile of it) by bootstrap over runs; share: samples -> booleans."""
    per = [share(s) for s in runs if len(s)]
    per = [p for p in per if len(p)]
    if not per:
        return (float("nan"),) * 3
    sums, counts = np.array([p.sum() for p in per], float), np.array([len(p) for p in per], float)
    pick = np.random.default_rng(1).integers(0, len(per), (2000, len(per)))
    draws = sums[pick].sum(1) / counts[pick].sum(1)
    return float(sums.sum() / counts.sum()), *(float(v) for v in np.percentile(draws, [2.5, 97.5]))


def groups_of(runs: list[dict[str, Any]]) -> dict[str, list[int]]:
    """Which of the runs are of a kind, side, scanner, crop, mounting."""
    groups: dict[str, list[int]] = {"all": list(range(len(runs)))}
    for i, r in enumerate(runs):
        names = r["kinds"] or ["plain"]
        more = ["pairs"] if len(names) > 1 else []
        above = [f"mounted above {UNSEEN_HEIGHT} m"] if r["mount"] > UNSEEN_HEIGHT else []
        for name in [*names, *more, f"{r['side']} edge", r["scanner"], r["crop"], *above]:
            groups.setdefault(name, []).append(i)
    return groups


def beside(runs: list[dict[str, Any]]) -> None:
    """Levels side by side on the draws that all of them drove, by groups of 5 runs and more."""
    levels = sorted({r["level"] for r in runs})
    drawn = [{r["number"]: r for r in runs if r["level"] == level} for level in levels]
    common = sorted(set.intersection(*(set(d) for d in drawn)))
    told = [[(numbers(d[n]), samples(d[n])) for n in common] for d in drawn]
    groups = groups_of([drawn[0][n] for n in common])
    print(f"Each cell: {', '.join(levels)}.\n")
    print("| group | runs | hold | stop | sure, wrong | hazardous | sure | in 95 % band (95 % interval) |")
    print("|---|---|---|---|---|---|---|---|")
    for name in sorted((g for g in groups if len(groups[g]) >= 5), key=lambda g: (-len(groups[g]), g)):
        cells = []
        for mine in ([of[i] for i in groups[name]] for of in told):
            n = [v for v, _ in mine]
            cover = interval([s for _, s in mine], lambda v: np.abs(v[:, 0]) < 1.96 * v[:, 1])
            cells.append(
                (
                    *(str(sum(bool(v[k]) for v in n)) for k in ("holds", "safe")),
                    *(str(sum(v[k] > 1.0 for v in n)) for k in ("wrong", "hazard")),
                    f"{np.mean([v['sure'] for v in n]):.2f}",
                    f"{cover[0]:.3f} ({cover[1]:.2f} to {cover[2]:.2f})",
                )
            )
        row = " | ".join(", ".join(c) for c in zip(*cells, strict=True))
        print(f"| {name} | {len(groups[name])} | {row} |")


def table(options: argparse.Namespace) -> None:
    runs = read(options.files)
    if options.beside:
        beside(runs)
        return
    levels = sorted({r["level"] for r in runs})
    for level in levels:
        mine = [r for r in runs if r["level"] == level]
        out = [numbers(r) for r in mine]
        if options.each:
            for r, n in zip(mine, out, strict=True):
                verdict = "H" if n["holds"] else "S" if n["safe"] else "-"
                s = samples(r)
                band = np.mean(np.abs(s[:, 0]) < 1.96 * s[:, 1]) if len(s) else float("nan")
                print(
                    f"{r['number']:4d} {verdict}{'W' if n['wrong'] > 1 else ' '}"
                    f" worst {100 * n['worst']:6.1f}"
                    f" edge {100 * n['edge']:6.1f} bias {100 * n['bias']:6.1f} found {n['found']:.2f}"
                    f" sure {n['sure']:.2f}"
                    f" wrong {n['wrong']:4.1f} band {band:.2f} {'+'.join(r['kinds']) or 'plain'} {r['crop']}"
                    f" {r['scanner']} {r['side']} z{r['mount']:.1f} {r['pitch']:.0f} v{r['speed']:.0f}"
                )
        print(f"\n### {level}: {len(mine)} runs, {mine[0]['loop']} loop")
        groups = groups_of(mine)
        print(
            "| group | runs | holds | stops safely | sure and wrong > 1 m | hazardous "
            "| edge RMSE, median [cm] | sure | in 95 % band (95 % interval) |"
        )
        print("|---|---|---|---|---|---|---|---|---|")
        for name, of in groups.items():
            n, s = [out[i] for i in of], [samples(mine[i]) for i in of]
            cover = interval(s, lambda v: np.abs(v[:, 0]) < 1.96 * v[:, 1])
            every = np.concatenate([v[:, 0] for v in s])
            rms = 100 * float(np.sqrt(np.mean(every**2))) if len(every) else float("nan")
            middle = 100 * float(np.median([v["edge"] for v in n if np.isfinite(v["edge"])] or [np.nan]))
            counts = [
                sum(bool(f(v)) for v in n)
                for f in (
                    lambda v: v["holds"],
                    lambda v: v["safe"],
                    lambda v: v["wrong"] > 1.0,
                    lambda v: v["hazard"] > 1.0,
                )
            ]
            print(
                f"| {name} | {len(of)} | " + " | ".join(map(str, counts)) + f" | {rms:.1f}, {middle:.1f} |"
                f" {np.mean([v['sure'] for v in n]):.2f} |"
                f" {cover[0]:.3f} ({cover[1]:.3f} to {cover[2]:.3f}) |"
            )
        print("\nconfidence: share within 10 cm (95 % interval), points")
        s = [samples(r) for r in mine]
        for lo, hi in ((0.0, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 1.01)):
            picked = [v[(v[:, 2] >= lo) & (v[:, 2] < hi)] for v in s]
            of = interval(picked, lambda v: np.abs(v[:, 0]) <= TOLERANCE)
            said = np.concatenate([v[:, 2] for v in picked])
            mean = float(said.mean()) if len(said) else float("nan")
            print(
                f"  {lo:.1f} to {min(hi, 1.0):.1f}: said {mean:.2f}, true {of[0]:.2f}"
                f" ({of[1]:.2f} to {of[2]:.2f}), {len(said)}"
            )
        cost = [r["cost_us"] for r in mine if "cost_us" in r]
        if cost:
            print(f"  {np.median(cost):.0f} us per step (median of runs)")


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    commands = parser.add_subparsers(required=True)
    for name, function in (("record", record), ("detect", detect), ("drive", closed)):
        p = commands.add_parser(name)
        p.set_defaults(run=function)
        p.add_argument("--pool", default="fitting", choices=list(POOLS))
        p.add_argument("--number", type=int, default=60)
        p.add_argument("--first", type=int, default=0)
        p.add_argument("--every", type=int, default=1)
        p.add_argument("--lidar", default="plants", choices=["plants", "empirical"])
        p.add_argument("--levels", nargs="+", default=["likelihood_ratio"])
        p.add_argument("--into", type=Path, default=Path("scans"))
        p.add_argument("--from", dest="scans", type=Path, default=Path("scans"))
        p.add_argument("--out", type=Path, default=Path("told.jsonl"))
    p = commands.add_parser("table")
    p.set_defaults(run=table)
    p.add_argument("files", type=Path, nargs="+")
    p.add_argument("--each", action="store_true")
    p.add_argument("--beside", action="store_true")
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    sys.exit(main())
