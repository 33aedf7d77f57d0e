"""How large things are in masks of a camera, against rays four times finer: drawn cases.

python -m benchmarks.pixels [--first 1000] [--cases 60] [--samples 16] [--file FILE.jsonl]

A case draws what lies or stands there (person, lying person, hare, fawn), crop, its density, height, lean and
rows, how far inside the crop it is (-1.2 to 1.2 m), its heading, the distance (5 to 12 m) and side that the
camera looks from, its height (2 to 4.5 m) and field of view (45 to 75 deg over 640 px), and where its pixels
lie. The area is the sum of the shares of a camera with so many samples per pixel; the finer rays are 16 times
as many. Cases of which less than half a pixel is in sight are left out of the table. Right: within 10 %.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import asin, atan2, cos, hypot, isqrt, radians, sin, tan
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.objects_drawn import MACHINE

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.edges.edge import StraightEdge, make_edge
from swath.field.field import make_field
from swath.field.field_setup import FieldSetup
from swath.field.memory_layout import Organ
from swath.field.site_setup import SiteSetup
from swath.field.solid.obstacles import SheetObstacle, things_of
from swath.field.stand import uniform
from swath.field.terrain import plane
from swath.sensing.camera import rays
from swath.sensing.camera.pinhole import OPTICAL, Pinhole
from swath.sensing.mount import Mount

REACH = {"standing": 1.9, "lying": 1.1, "hare": 0.35, "fawn": 0.55}  # of a window around it [m]
WIDTH, RIGHT, LEAST = 640, 0.1, 0.5
SIZES = 0.5, 3.0, 10.0, 50.0, 1e9


@dataclass(frozen=True)
class Case:
    """Lengths [m], angles [deg]; jitter: of the pixels."""

    seed: int
    target: str
    crop: str
    density: float
    height_factor: float
    lean: float
    rows: float
    inside: float
    heading: float
    distance: float
    bearing: float
    height: float
    fov: float
    jitter: tuple[float, float]


def draw(seed: int) -> Case:
    """A case of a seed."""
    rng = np.random.default_rng(seed)
    real = lambda low, high: float(rng.uniform(low, high))  # noqa: E731
    return Case(
        seed,
        target=str(rng.choice(list(REACH))),
        crop=str(rng.choice(["wheat", "barley", "rye"])),
        density=real(250.0, 600.0),
        height_factor=real(0.7, 1.15),
        lean=real(0.0, 20.0),
        rows=real(0.0, 180.0),
        inside=real(-1.2, 1.2),
        heading=real(-180.0, 180.0),
        distance=real(5.0, 12.0),
        bearing=real(-180.0, 180.0),
        height=real(2.0, 4.5),
        fov=real(45.0, 75.0),
        jitter=(real(-0.5, 0.5), real(-0.5, 0.5)),
    )


def scene(case: Case) -> tuple[SiteSetup, Pose]:
    """The field with the thing at 0, 0, and pose_world_optical of the camera."""
    stream, setup, crop = Stream(case.seed, "pixels"), FieldSetup(), load_crop(case.crop)
    stand = uniform.Params(
        crop=case.crop,
        stems_per_m2=case.density,
        height_factor=case.height_factor,
        row_azimuth_deg=case.rows,
        lean_deg=case.lean,
    )
    line = StraightEdge(  # crop to its right
        x_m=-case.inside, y_m=-100.0, length_m=200.0, crop_begins_m=None, stubble_height_m=0.15
    )
    field = make_field(
        plane.Plane(plane.Params(), setup),
        uniform.Uniform(stand, setup),
        make_edge(line, setup),
        crop=crop,
        stream=stream.child("stand"),
    )
    site = SiteSetup(field, MACHINE, Pose.identity(), "left", 0.1, "combine", base=Path())
    kind = "person" if case.target in ("standing", "lying") else "animal"
    posture: Any = None if case.target == "standing" else case.target
    thing = SheetObstacle(kind=kind, posture=posture, x_m=0.0, y_m=0.0, heading_deg=case.heading)
    site.bodies.set_things(things_of([thing], field))
    side = radians(case.bearing)
    eye = np.array([-case.distance * cos(side), -case.distance * sin(side), case.height])
    ahead = np.array([0.0, 0.0, 0.9 if case.target == "standing" else 0.2]) - eye
    pitch = -asin(ahead[2] / hypot(*ahead))
    return site, Pose.from_euler(eye, yaw=atan2(ahead[1], ahead[0]), pitch=pitch) @ OPTICAL


def areas(case: Case, samples: Sequence[int]) -> list[tuple[float, float]]:
    """Pixels of the thing with so many samples per pixel: by shares, and of the hard mask."""
    site, pose = scene(case)
    focal = 0.5 * WIDTH / tan(0.5 * radians(case.fov))
    side = 2 * int(REACH[case.target] * focal / case.distance) + 8
    params = rays.Params(mount=Mount(at="axle", z_m=case.height), channels=("label",), reach_m=60.0)
    camera = rays.RaysCamera(params, site)
    middle = 0.5 * (side - 1)
    camera.pinhole = Pinhole(side, side, focal, middle + case.jitter[0], middle + case.jitter[1])
    found = []
    for count in samples:
        camera.per_side = isqrt(count)
        camera._rays = camera.pinhole.rays(camera.per_side)
        out: Any = camera.picture_from(0, pose)
        hard = np.count_nonzero(out["image"].label == Organ.SOLID)
        found.append((float(out["boxes"].area.sum()), float(hard)))
    return found


def tell(rows: list[dict[str, Any]]) -> None:
    """The tables."""
    seen = [r for r in rows if r["finer"] >= LEAST]
    off = lambda r: abs(r["shares"] / r["finer"] - 1.0)  # noqa: E731
    for key in ("target", "crop"):
        for value in sorted({r[key] for r in seen}):
            own = [r for r in seen if r[key] == value]
            print(f"{value:9} {sum(off(r) <= RIGHT for r in own):3d} of {len(own):3d} within 10 %")
    for low, high in pairwise(SIZES):
        own = [r for r in seen if low <= r["finer"] < high]
        if own:
            each = sorted(map(off, own))
            print(
                f"{low:4.3g} to {high:5.3g} px: {sum(e <= RIGHT for e in each)} of {len(own)} within 10 %, "
                f"median {each[len(each) // 2]:.1%}, worst {each[-1]:.1%}"
            )
    total = [sum(r[name] for r in seen) for name in ("shares", "hard", "finer")]
    print(f"all {len(seen)}: shares {total[0] / total[2]:.3f}, hard masks {total[1] / total[2]:.3f} of finer")
    small = [r for r in seen if r["finer"] < SIZES[3]]
    parts = [sum(r[name] for r in small) / sum(r["finer"] for r in small) for name in ("shares", "hard")]
    print(f"the {len(small)} under 50 px: shares {parts[0]:.3f}, hard masks {parts[1]:.3f} of finer")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--samples", type=int, default=16, choices=(1, 4, 9, 16))
    parser.add_argument("--file", type=Path)
    args = parser.parse_args()
    rows = []
    for seed in range(args.first, args.first + args.cases):
        case = draw(seed)
        (shares, hard), (finer, _) = areas(case, (args.samples, 16 * args.samples))
        rows.append({**asdict(case), "shares": shares, "hard": hard, "finer": finer})
        if finer >= LEAST:
            print(
                f"{seed} {case.target:8} {case.crop:6} {case.distance:4.1f} m, {case.inside:+.1f} m inside: "
                f"{shares:.2f} px, finer {finer:.2f}, {shares / finer - 1.0:+.1%}; hard {hard:.0f}",
                flush=True,
            )
    if args.file:
        args.file.parent.mkdir(parents=True, exist_ok=True)
        args.file.write_text("".join(json.dumps(r) + "\n" for r in rows), encoding="utf-8")
    tell(rows)


if __name__ == "__main__":
    main()
