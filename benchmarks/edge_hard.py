"""Hard edges, closed loop: edge detectors beside each other, on cases that neither was tuned on.

    python benchmarks/edge_hard.py [--levels otsu likelihood_ratio] [--cases NAME ...]

Prints a Markdown table, one line per case and level, as soon as a run is over. Lateral error of the header
end against the edge before any bites, from 8 m on [cm]; `edge`: share of the edge samples with an edge, RMS
of their error [cm]; `sure and wrong`: longest way with a confidence of 0.5 or more and an error above 0.3 m
[m]; `in 95 %`: share of the errors within 1.96 of the standard deviations told, "-" where none is.
"""

import argparse
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.field.edges.track import EdgeShape
from swath.judge.evaluators.edge_detection import SURE, WRONG_M
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.runtime.world import World
from swath.scenario.scenario import load_scenario
from swath.signals import CropEdge, MachineState

STAND, EDGE, DUST = "field.stand", "field.edge", "combine.lidar.weather"
BEGIN = 8.0  # m, from where on errors count


def bend(radius: float, angle: float) -> dict[str, Any]:
    return {EDGE: {"shape": "curve", "run_in_m": 14, "radius_m": radius, "angle_deg": angle}}


def gap(start: float, end: float, depth: float) -> dict[str, Any]:
    hole = {"start_m": start, "end_m": end, "depth_m": depth, "stubble_height_m": 0.15}
    return {f"{EDGE}.gaps": [hole]}


def teeth(amplitude: float, wavelength: float, kind: str) -> dict[str, Any]:
    return {f"{EDGE}.teeth": {"amplitude_m": amplitude, "wavelength_m": wavelength, "kind": kind}}


def patch(x: float, y: float, radius: float, lean: float, azimuth: float) -> dict[str, Any]:
    lodged = {"x_m": x, "y_m": y, "radius_m": radius, "lean_deg": lean, "azimuth_deg": azimuth}
    return {STAND: {"level": "maps", "crop": "wheat", "patches": [lodged]}}


def lean(degrees: float, azimuth: float) -> dict[str, Any]:
    return {f"{STAND}.lean_deg": degrees, f"{STAND}.lean_azimuth_deg": azimuth}


def wind(speed: float, azimuth: float) -> dict[str, Any]:
    return {f"{STAND}.wind": {"speed_m_s": speed, "azimuth_deg": azimuth}}


def crop(name: str, stems: float, stubble: float) -> dict[str, Any]:
    return {f"{STAND}.crop": name, f"{STAND}.stems_per_m2": stems, f"{EDGE}.stubble_height_m": stubble}


def waves(amplitude: float, wavelength: float, azimuth: float) -> dict[str, Any]:
    wave = {"amplitude_m": amplitude, "wavelength_m": wavelength, "azimuth_deg": azimuth}
    return {"field.terrain.waves": [wave]}


SLOPE, DENSITY = "field.terrain.slope_percent", f"{STAND}.stems_per_m2"
CASES: dict[str, dict[str, Any]] = {
    "wheat, 450 /m2": {DENSITY: 450, "seed": 7},
    "wheat, 70 /m2": {DENSITY: 70, "seed": 8},
    "wheat, 50 /m2": {DENSITY: 50, "seed": 9},
    "R = 12 m, right": {**bend(12, -80), "seed": 11},
    "R = 12 m, left": {**bend(12, 80), "seed": 12},
    "R = 19 m, right": {**bend(19, -70), "seed": 13},
    "notch, 1.2 m deep, 3.5 m long": {**gap(24, 27.5, 1.2), "seed": 14},
    "gap of 5 m": {**gap(24, 29, 5), "seed": 15},
    "100 /m2, gap of 5 m": {DENSITY: 100, **gap(24, 29, 4), "seed": 16},
    "teeth, 0.3 m every 3 m": {**teeth(0.3, 3, "random"), "seed": 17},
    "saw, 0.6 m every 5 m": {**teeth(0.6, 5, "sawtooth"), "seed": 18},
    "lodged patch, 55 deg out": {**patch(0.5, 27, 3.5, 55, -80), "seed": 19},
    "lodged patch, 65 deg in": {**patch(1.5, 27, 4.5, 65, 80), "seed": 20},
    "stand leans 40 deg in": {**lean(40, 90), "seed": 21},
    "stand leans 40 deg out": {**lean(40, -90), "seed": 22},
    "0.42 m over 0.25 m": {f"{STAND}.height_factor": 0.49, f"{EDGE}.stubble_height_m": 0.25, "seed": 23},
    "dust": {DUST: {"near_returns": 0.3, "near_reach_m": 2.0, "extinction_per_m": 0.2}, "seed": 24},
    "side slope 13 %": {SLOPE: 13, "seed": 25},
    "side slope -9 %": {SLOPE: -9, "seed": 26},
    "waves, 0.5 m over 40 m": {**waves(0.5, 40, 15), "seed": 27},
    "wind, 7 m/s out": {**wind(7, -80), "seed": 28},
    "wind, 7 m/s in": {**wind(7, 80), "seed": 29},
    "rye, 400 /m2": {**crop("rye", 400, 0.25), "seed": 30},
    "rape, 55 /m2": {**crop("rape", 55, 0.3), "seed": 31},
    "no crop": {f"{EDGE}.crop_begins_m": 300, "run.distance_m": 20, "seed": 32},
}
HEAD = ("case", "level", "RMS", "95 %", "worst", "edge", "sure and wrong", "in 95 %", "driven")


class Watch:
    """Observer of a run: where the header end went, and what the detector said."""

    def __init__(self, world: World) -> None:
        machine = world.leader
        self.edge: EdgeShape = machine.edge
        self.teeth = next(e.teeth for e in world.field.edges.values() if e.shape is machine.edge)
        self.end = (*machine.sheet.header_end(machine.edge_side), 0.0)
        self.overlap = machine.overlap
        self.distance = float(world.scenario.run.distance_m)
        self.poses: dict[int, tuple[Pose, float]] = {}
        self.edges: list[CropEdge] = []

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Any]) -> None:
        """Keep the true poses at the times of edges, and the edges."""
        for signal in outputs.values():
            if isinstance(signal, MachineState) and t % 40_000_000 == 0:
                self.poses[t] = signal.pose, signal.distance
            elif isinstance(signal, CropEdge):
                self.edges.append(signal)

    def inside(self, points: Any) -> Any:
        """How far inside the initial edge world points lie [m]."""
        x, y = np.array(points, dtype=float).reshape(-1, 3)[:, :2].T
        return np.asarray(self.edge.signed_distance(x, y))

    def numbers(self, back_at: float = float("nan")) -> dict[str, Any]:
        """An edge is where it stands with its teeth, but without its gaps, which are not to be followed.

        Lateral errors against the edge without either: rms, p95, worst and from `back_at` [m] on, late [cm].
        Of the edge: found [share], edge (RMS) [cm], wrong = longest way sure and wrong [m], sure = share of
        the confident samples; samples = one (error [m], standard deviation, confidence) per metre.
        speed (mean) [km/h], driven [m].
        """
        poses = [(pose.apply(self.end), at) for pose, at in self.poses.values()]
        late = np.array([at for _, at in poses]) > BEGIN
        lateral = np.abs(self.inside([p for p, _ in poses]) + self.overlap) * 100
        back = lateral[np.array([at for _, at in poses]) > max(back_at, BEGIN)]
        lateral = lateral[late] if late.any() else np.full(1, np.nan)
        told = [(e, *self.poses[e.t]) for e in self.edges if e.t in self.poses and self.poses[e.t][1] > BEGIN]
        found = [(e, at, pose.apply([e.reference_x, e.offset, 0.0])) for e, pose, at in told if e.is_found]
        error = self.inside([p for *_, p in found]) if found else np.zeros(0)
        if found and self.teeth is not None:
            x, y = np.array([p[:2] for *_, p in found], dtype=float).T
            error = error - self.teeth.depth(self.edge.project(x, y)[0])
        wrong = [e.confidence >= SURE and abs(v) > WRONG_M for (e, *_), v in zip(found, error, strict=True)]
        metres = [int(at) for _, at, _ in found]
        first = [k for k, at in enumerate(metres) if k == 0 or at > metres[k - 1]]
        driven = poses[-1][1]
        return {
            "rms": float(np.sqrt(np.mean(lateral**2))),
            "p95": float(np.percentile(lateral, 95.0)),
            "worst": float(lateral.max()),
            "late": float(back.max()) if len(back) else float("nan"),
            "found": len(found) / max(len(told), 1),
            "edge": float(np.sqrt(np.mean(error**2))) * 100 if found else float("nan"),
            "wrong": _longest([at for _, at, _ in found], wrong),
            "sure": float(np.mean([e.confidence >= SURE for e, *_ in told])) if told else 0.0,
            "speed": 3.6 * (driven - BEGIN) / max(0.04 * float(np.count_nonzero(late)), 0.04),
            "samples": [(float(error[k]), found[k][0].offset_sd, found[k][0].confidence) for k in first],
            "driven": driven,
            "is_stopped": driven < self.distance - 1.0,
        }

    def row(self) -> list[str]:
        """The numbers of the table."""
        r = self.numbers()
        within = [abs(error) < 1.96 * sd for error, sd, _ in r["samples"] if np.isfinite(sd)]
        return [
            *(f"{r[key]:.1f}" for key in ("rms", "p95", "worst")),
            f"{r['found']:.0%}, {r['edge']:.1f}",
            f"{r['wrong']:.1f}",
            f"{np.mean(within):.2f}" if within else "-",
            f"{r['driven']:.0f} m",
        ]


def _longest(at: list[float], is_wrong: list[bool]) -> float:
    """The longest way [m] without a break."""
    longest, begin = 0.0, float("nan")
    for place, wrong in zip(at, is_wrong, strict=True):
        begin = place if wrong and np.isnan(begin) else begin if wrong else float("nan")
        longest = max(longest, place - begin) if wrong else longest
    return longest


def run(name: str, level: str) -> list[str]:
    """One line of the table."""
    sets = {"run.distance_m": 46, "combine.edge": level, **CASES[name]}
    world = assemble(load_scenario("straight", sets=[f"{k}={json.dumps(v)}" for k, v in sets.items()]))
    watch = Watch(world)
    drive(world, [watch])
    return [name, level, *watch.row()]


def main() -> None:
    parser = argparse.ArgumentParser(description="Hard edges: detectors beside each other.")
    parser.add_argument("--levels", nargs="+", default=["otsu", "likelihood_ratio"])
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    options = parser.parse_args()
    print("| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|")
    for name in options.cases:
        for level in options.levels:
            print("| " + " | ".join(run(name, level)) + " |", flush=True)


if __name__ == "__main__":
    main()
