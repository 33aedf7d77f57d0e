"""What `objects: cluster` sees of persons on stubble before a crop, and what it takes for one: drawn cases.

python benchmarks/objects_drawn.py [--first 1000] [--cases 60] [--empty 40] [--file FILE.jsonl]

A case draws a person of 1.75, 1.2 or 1.1 m, wheat of 0.6 or 0.85 m and 300 to 600 stems/m2 with rows any
way, a layout (crop across the way, beside it, beginning ahead, the far wall of a gap), a place (1.5 to 4 m
before the crop, or its middle 0.25 m out of it), a scanner with its mounting, and whether the machine stands
or drives; pitch and roll sway by 0.4 deg (one sigma). Scans are of `lidar: plants`. Nothing tells an edge.
In sight is the share of the silhouette that no crop hides and that lies between the scanner's lines and in
its sector. A case counts where that is at least 0.3 in the last scan, or in one of the last ten of a machine
that drives.
Seen: an object of confidence 0.5 or more within 0.7 m of the person in a third of those scans or more.
Phantom: an object of that confidence more than 1.5 m from the person, at any time.
"""

import argparse
import json
from collections import defaultdict
from dataclasses import dataclass
from math import hypot, radians, tau
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from swath.control.objects import cluster
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.crop_sheet import load_crop
from swath.field.edges.edge import GapParams, StraightEdge, make_edge
from swath.field.field import make_field
from swath.field.field_setup import FieldSetup
from swath.field.memory_layout import Organ
from swath.field.site_setup import SiteSetup
from swath.field.solid.obstacles import Path as ObstaclePath
from swath.field.solid.obstacles import SheetObstacle, things_of
from swath.field.stand import uniform
from swath.field.terrain import plane
from swath.sensing.lidar import plants
from swath.sensing.mount import Mount
from swath.sensing.radar.solid_rays import aimed, distances
from swath.signals import MachineState, Odometry
from swath.signals.setup import ControlSetup, MachineGeometry

MACHINE = MachineGeometry(3.6, 3.0, 2.8, 0.6, 7.5, 3.9, 0.0, 1.2, 1.5, (-5.0, 2.0, 1.6, 0.6, 3.9))
STEP = NS // 10
SCANNERS = {
    "vlp16 roof": ("velodyne-vlp16", 2.0, 3.8, 20.0, 0.2, (-55.0, 55.0)),
    "vlp16 coarse": ("velodyne-vlp16", 2.0, 3.6, 17.0, 0.4, (-60.0, 60.0)),
    "vlp16 low": ("velodyne-vlp16", 3.0, 2.6, 12.0, 0.2, (-55.0, 55.0)),
    "os1-64": ("ouster-os1-64", 2.0, 3.5, 17.0, 0.3515625, (-45.0, 45.0)),
}
LAYOUTS = ("across", "beside", "begins", "gap")
TARGETS = {"grown": 1.75, "child 1.2": 1.2, "child 1.1": 1.1, "nobody": None}
SURE, NEAR, FAR = 0.5, 0.7, 1.5


@dataclass(frozen=True)
class Case:
    """place: of the person before the crop [m]; ahead: crop, or the end of its gap, before the scanner at the
    start [m]; aside: of the person along the crop [m]; turn: of the edge [deg]; depth: of the gap [m]; [m/s].
    """

    seed: int
    target: str
    layout: str
    scanner: str
    height: float
    density: float
    rows: float
    place: float
    ahead: float
    aside: float
    turn: float
    depth: float
    speed: float
    scans: int

    @property
    def is_near(self) -> bool:
        return self.place == 0.25


def draw(seed: int, *, nobody: bool = False) -> Case:
    """A case of a seed."""
    rng = np.random.default_rng(seed)
    target = "nobody" if nobody else str(rng.choice(list(TARGETS)[:3]))
    drives = nobody or bool(rng.random() < 0.5)
    return Case(
        seed,
        target,
        layout=str(rng.choice(LAYOUTS)),
        scanner=str(rng.choice(list(SCANNERS))),
        height=float(rng.choice([0.6, 0.85])),
        density=float(rng.uniform(300, 600)),
        rows=float(rng.uniform(0, 180)),
        place=0.25 if rng.random() < 0.5 else float(rng.uniform(1.5, 4.0)),
        ahead=float(rng.uniform(7.0, 14.0)),
        aside=float(rng.uniform(-5.0, 5.0)),
        turn=float(rng.uniform(-15.0, 15.0)),
        depth=float(rng.uniform(1.0, 9.0)),
        speed=float(rng.uniform(1.0, 2.2)) if drives else 0.0,
        scans=(40 if nobody else 14) if drives else 4,
    )


@dataclass
class Look:
    """What a part is given, and what is true: person (x, y) in the machine's frame, share of it in sight."""

    t: int
    scan: Any
    odometry: Odometry
    person: tuple[float, float] | None
    in_sight: float


def _edge(case: Case, sensor_x: float) -> tuple[StraightEdge, tuple[float, float]]:
    """The edge in the world, where the machine starts at 0, 0 towards +x, and where the person stands."""
    x, out = sensor_x + case.ahead, case.place
    stubble = {"stubble_height_m": 0.15}
    if case.layout == "across":
        # along the edge is (-sin, cos) of turn, crop to its right
        c, s = np.cos(radians(case.turn)), np.sin(radians(case.turn))
        start = x + 200.0 * s, -200.0 * c
        line = StraightEdge(
            x_m=start[0],
            y_m=start[1],
            heading_deg=90.0 + case.turn,
            length_m=400.0,
            crop_begins_m=None,
            **stubble,
        )
        return line, (x - case.aside * s - out * c, case.aside * c - out * s)
    left = 3.75
    if case.layout == "beside":
        line = StraightEdge(
            x_m=-100.0, y_m=left, heading_deg=0.0, length_m=400.0, crop_begins_m=None, **stubble
        )
        return line, (x, left + out)
    if case.layout == "begins":
        line = StraightEdge(x_m=0.0, y_m=left, heading_deg=0.0, length_m=400.0, crop_begins_m=x, **stubble)
        return line, (x - out, left - 0.5 - abs(case.aside))
    gap = GapParams(start_m=100.0 + x - 5.0, end_m=100.0 + x, depth_m=case.depth, **stubble)
    line = StraightEdge(
        x_m=-100.0, y_m=left, heading_deg=0.0, length_m=400.0, crop_begins_m=None, gaps=(gap,), **stubble
    )
    return line, (x - out, left - min(0.5 + abs(case.aside), 0.5 * case.depth))


def looks(case: Case) -> tuple[list[Look], ControlSetup]:
    """The scans of a case."""
    sensor, sx, sz, pitch, step, sector = SCANNERS[case.scanner]
    line, place = _edge(case, sx)
    stream = Stream(case.seed, "objects")
    crop, setup = load_crop("wheat"), FieldSetup()
    stand = uniform.Params(
        crop="wheat",
        stems_per_m2=case.density,
        row_spacing_m=crop.stand.row_spacing,
        row_azimuth_deg=case.rows,
        height_factor=case.height / crop.stand.height,
    )
    ground = plane.Plane(plane.Params(), setup)
    field = make_field(
        ground, uniform.Uniform(stand, setup), make_edge(line, setup), crop=crop, stream=stream.child("stand")
    )
    site = SiteSetup(field, MACHINE, Pose.identity(), "left", 0.1, "combine", base=Path())
    params = plants.Params(
        sensor=sensor,
        mount=Mount(at="axle", x_m=sx, z_m=sz, pitch_deg=pitch),
        sector_deg=sector,
        step_deg=step,
        sub_rays=7,
    )
    lidar = plants.PlantsLidar(params, site)
    lidar.reset(stream.child("lidar"))
    rng = np.random.default_rng(case.seed + 10**6)
    height = TARGETS[case.target]
    body = None
    if height is not None:
        thing = SheetObstacle(
            kind="person",
            name="person",
            x_m=place[0],
            y_m=place[1],
            height_m=height,
            heading_deg=float(rng.uniform(-180, 180)),
            path=ObstaclePath(to=((place[0] - 1.0, place[1]),)),
        )
        site.bodies.set_things(things_of([thing], field))
        body = next(b for b in site.bodies.around("combine") if b.name == "person")
    phase = rng.uniform(0, tau, 2)
    found = []

    def state(t: int) -> MachineState:
        s = t / NS
        tilt = radians(0.4 * 2**0.5) * np.sin(tau * np.array([0.9, 0.6]) * s + phase)
        pose = Pose.from_euler([case.speed * s, 0.0, 0.0], roll=float(tilt[0]), pitch=float(tilt[1]))
        return MachineState(t, pose, case.speed, 0.0, 0.0, 0.0, 0.0)

    for k in range(1, case.scans + 1):
        t = k * STEP
        field.ensure(case.speed * t / NS, 0.0, 60.0)
        scan = lidar.step(t - STEP, STEP, {"state": (state(t - STEP), state(t))})["scan"]
        at, share = None, 0.0
        if body is not None:
            pose = state(t).pose
            at = place[0] - case.speed * t / NS, place[1]
            share = _in_sight(lidar, body, pose @ lidar.mounting, radians(sector[1]))
        found.append(Look(t, scan, Odometry(t, case.speed, 0.0, 0.0), at, share))
    return found, ControlSetup(MACHINE, {"scan": lidar.mounting}, "left", 0.1)


def _in_sight(lidar: Any, body: Any, eye: Pose, half: float) -> float:
    ways = aimed(body, eye.position, (12, 12), (35, 35))
    ways = ways[np.isfinite(distances(body.solids, eye.position, ways))]
    own = eye.inverse().turn(ways)
    up, side = np.arcsin(own[:, 2]), np.arctan2(own[:, 1], own[:, 0])
    inside = (up > lidar.elevation.min()) & (up < lidar.elevation.max()) & (np.abs(side) < half)
    hits = lidar.caster.cast(
        np.repeat(eye.position[None], len(ways), axis=0), ways, range_max=60.0, solids=body.solids
    )
    return float(np.mean(inside & (hits.organ == Organ.SOLID)))


def judge(case: Case, given: list[Look], setup: ControlSetup, params: Any = None) -> dict[str, Any]:
    """What the part makes of it."""
    part = cluster.Cluster(params or cluster.Params(), setup)
    part.reset(Stream(1, "objects"))
    seen, phantoms, started = [], [], process_time()
    for look in given:
        inputs = {"scan": look.scan, "odometry": look.odometry, "edge": None}
        objects: Any = part.step(look.t - STEP, STEP, inputs)["objects"]
        sure = objects.confidence >= SURE
        places = list(zip(objects.x[sure].tolist(), objects.y[sure].tolist(), strict=True))
        if look.person is None:
            phantoms.append(len(places))
            continue
        away = [hypot(x - look.person[0], y - look.person[1]) for x, y in places]
        seen.append((look.in_sight, min(away, default=9.0) <= NEAR))
        phantoms.append(sum(a > FAR for a in away))
    spent = (process_time() - started) / len(given)
    last = seen[-10:] if case.speed else seen[-1:]
    counted = [hit for share, hit in last if share >= 0.3]
    return {
        "seed": case.seed,
        "target": case.target,
        "layout": case.layout,
        "scanner": case.scanner,
        "crop": case.height,
        "place": "0.25 m" if case.is_near else "open",
        "drives": case.speed > 0,
        "in_sight": max((s for s, _ in last), default=0.0),
        "counts": bool(counted),
        "seen": bool(counted) and sum(counted) * 3 >= len(counted),
        "phantom_scans": sum(n > 0 for n in phantoms),
        "ms": 1e3 * spent,
        "way": case.speed * case.scans * STEP / NS,
    }


def tell(rows: list[dict[str, Any]]) -> None:
    """The tables."""
    met = [r for r in rows if r["target"] != "nobody" and r["counts"]]
    for key in ("target", "crop", "place", "layout", "scanner", "drives"):
        groups = defaultdict(list)
        for r in met:
            groups[r[key]].append(r["seen"])
        print(f"{key:9}" + "   ".join(f"{k}: {sum(v)} of {len(v)}" for k, v in sorted(groups.items())))
    pairs = defaultdict(list)
    for r in met:
        pairs[r["target"], r["crop"], r["place"]].append(r["seen"])
    for (target, crop, place), v in sorted(pairs.items()):
        print(f"  {target:10} crop {crop:4} m  {place:7} {sum(v):3d} of {len(v):3d}")
    print(f"seen {sum(r['seen'] for r in met)} of {len(met)} with 30 % of the body in sight")
    out = [r for r in rows if r["target"] != "nobody" and not r["counts"]]
    print(f"less than 30 % in sight: {len(out)} cases")
    empty = [r for r in rows if r["target"] == "nobody"]
    bad = [r["seed"] for r in empty if r["phantom_scans"]]
    print(
        f"phantoms: {len(bad)} of {len(empty)} cases without anybody, "
        f"{sum(r['way'] for r in empty):.0f} m driven {bad}"
    )
    odd = [r["seed"] for r in rows if r["target"] != "nobody" and r["phantom_scans"]]
    print(f"phantoms beside a person: {len(odd)} cases {odd}")
    print(f"{np.median([r['ms'] for r in rows]):.2f} ms of CPU time per scan (median of cases)")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--empty", type=int, default=40)
    parser.add_argument("--file", type=Path)
    args = parser.parse_args()
    rows = []
    for k in range(args.cases + args.empty):
        case = draw(args.first + k, nobody=k >= args.cases)
        rows.append(judge(case, *looks(case)))
    if args.file:
        args.file.parent.mkdir(parents=True, exist_ok=True)
        args.file.write_text("".join(json.dumps(r) + "\n" for r in rows), encoding="utf-8")
    tell(rows)


if __name__ == "__main__":
    main()
