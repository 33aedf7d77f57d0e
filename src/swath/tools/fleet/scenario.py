"""The scenario of a job: its field, a combine and a cart with their sensors, passes and turns as planned."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.units import KMH
from swath.job.combine_ways import axle_pose
from swath.job.fleet import FleetFile
from swath.job.machines import Cart, Combine, Fleet
from swath.job.path import Piece, Pose
from swath.job.plan import FieldPlan, PlannedPass
from swath.job.turns import TurnLimits, clothoid
from swath.machine.machine_sheet import open_machine

GRAIN_PER_STEM = 0.0018  # kg, wheat: 500 stems/m2 are 9 t/ha
FAR = 80.0  # m, as in the other levels: a way beyond it is no turn
RUN_UP = 4.0  # m before the first pass, where the combine starts
RECEIVER: dict[str, Any] = {
    "gnss": {
        "level": "error", "receiver": "rtk", "antenna": {"y_m": 0.6}, "second_antenna": {"y_m": -0.6},
    },
    "pose": "ekf",
}  # fmt: skip
"""Two antennas, so that a machine that stands knows where it looks."""
GENTLE = 0.6  # of the steering's rate in a turn, the rest is for coming back to the path
STRAIGHT = 3.0  # m on the line of the next pass before its begin
LEAST_STRAY = 0.2  # m beside the plan, up to which the edge leads; else as far as passes overlap
LANDS = 0.5  # m, that the stream lands beyond the mouth of the pipe


def scenario_of(file: FleetFile, plan: FieldPlan, fleet: Fleet, base: Path | None = None) -> dict[str, Any]:
    """The scenario as plain data. InputError for what this level cannot do."""
    _check(file, plan, fleet)
    (combine,), carts = fleet.combines, fleet.carts
    passes = passes_of(plan, combine, file)
    machines = {combine.name: _combine(file, combine, carts[0] if carts else None, passes, plan, base)}
    if carts:
        machines[carts[0].name] = _cart(file, combine, carts[0], passes, plan, base)
    ring = [_rounded(point) for point in plan.boundary[::-1].tolist()]
    way = math.fsum(p.length for p in plan.passes) + FAR * len(plan.passes)
    return {
        "format": "swath scenario 2",
        "name": file.name,
        "summary": file.summary or "a whole field with sensors",
        "seed": 1,
        "run": {
            "distance_m": round(1.5 * way), "max_duration_s": round(2.0 * way + 4000.0),
            "on_contact": "note", "record": "none",
        },
        "field": {
            "terrain": {"level": "plane"},
            "stand": {
                "level": "uniform", "crop": "wheat",
                "stems_per_m2": round(file.field.yield_t_ha / 10.0 / GRAIN_PER_STEM, 3),
            },
            "edge": {
                "shape": "polyline", "points_m": [*ring, ring[0]], "crop_side": "right", "crop_begins_m": None
            },
        },
        "machines": machines,
    }  # fmt: skip


def _check(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> None:
    for key, found in (("combines", fleet.combines), ("carts", fleet.carts)):
        if len(found) > 1:
            raise InputError(key, len(found), "expected one at most at the level with sensors")
    if plan.holes:
        raise InputError("field", None, "expected a field without holes at the level with sensors")
    if file.unload.mode != "on_the_go":
        raise InputError("unload.mode", file.unload.mode, "expected on_the_go at the level with sensors")


def passes_of(plan: FieldPlan, combine: Combine, file: FleetFile) -> list[dict[str, Any]]:
    """Passes with the turns behind them."""
    rows = []
    for i, p in enumerate(plan.passes):
        grain = p.area * file.field.yield_t_ha / 10.0 / p.length
        row: dict[str, Any] = {
            "line_m": [_rounded(q) for q in p.line.tolist()],
            "cart_beside": bool(p.cart_beside),
            "speed_kmh": round(combine.speed_in(grain) / KMH, 4),
        }
        if i + 1 < len(plan.passes):
            row["turn"] = [
                {"length_m": q.length, "curvature_per_m": q.first, "to_per_m": q.last}
                for q in turn_between(p, plan.passes[i + 1], combine)
                if q.length > 1e-6
            ]
        rows.append(row)
    return rows


def turn_between(p: PlannedPass, then: PlannedPass, combine: Combine) -> list[Piece]:
    """Pieces of the fixed axle's way from the end of a pass to the start of the next.

    Round a corner of an opening round it is a loop to the outside.
    """
    here, there = axle_at(p.end, combine), axle_at(then.start, combine, STRAIGHT)
    limits = replace(combine.limits, sharpness=GENTLE * combine.limits.sharpness)
    angle = math.remainder(there.heading - here.heading, 2.0 * math.pi)
    if then.is_corner and math.radians(20.0) < abs(angle) < math.radians(150.0):
        return loop(here, there, angle, limits)
    return [*clothoid.plan(here, there, limits), Piece(0.0, 0.0, STRAIGHT)]


def axle_at(knife: Pose, combine: Combine, back: float = 0.0) -> Pose:
    """Where the fixed axle is when the middle of the knife is at a pose, and so far back on its way [m]."""
    x, y, heading = axle_pose(knife, combine.sheet.knife_x + back)
    aside = combine.sheet.header_y
    return Pose(x + aside * math.sin(heading), y - aside * math.cos(heading), heading)


def loop(here: Pose, there: Pose, angle: float, limits: TurnLimits) -> list[Piece]:
    """Straight on, round to the other side through a full turn less the angle [rad], straight to the goal and
    STRAIGHT beyond.
    """
    side = -1 if angle > 0.0 else 1
    around = 2.0 * math.pi - abs(angle)
    end = clothoid.bend_end(around, side, limits)
    c, s = math.cos(here.heading), math.sin(here.heading)
    dx, dy = there.x - here.x, there.y - here.y
    gap = complex(c * dx + s * dy, c * dy - s * dx) - end
    # gap = first + last * exp(i angle)
    last = gap.imag / math.sin(angle)
    first = gap.real - last * math.cos(angle)
    if first < 0.0 or last < 0.0:
        return [*clothoid.plan(here, there, limits), Piece(0.0, 0.0, STRAIGHT)]
    straight = [Piece(0.0, 0.0, way) for way in (first, last + STRAIGHT)]
    return [straight[0], *clothoid.bend(around, side, limits), straight[1]]


def _combine(
    file: FleetFile,
    combine: Combine,
    cart: Cart | None,
    passes: list[dict[str, Any]],
    plan: FieldPlan,
    base: Path | None,
) -> dict[str, Any]:
    settings = file.combines[combine.name]
    start = axle_at(plan.passes[0].start, combine, RUN_UP)
    overlap = combine.sheet.header_width - plan.width
    made: dict[str, Any] = {
        "machine": _named(settings.machine, base),
        "edge_side": "left" if file.plan.headland == "clockwise" else "right",
        "start": _start(start),
        "lidar": {"level": "empirical", "sensor": "sick-lms511-hr", "rate_hz": 25, "sector_deg": [-60, 60]},
        **RECEIVER,
        "process": {"level": "threshing", "tank_start_percent": settings.tank_start_percent},
        "powertrain": "hydrostat",
        "job": {
            "level": "harvest",
            "turn_speed_kmh": settings.turn_speed_kmh,
            "turn_radius_m": settings.turn_radius_m,
            "call_percent": settings.call_percent,
            "finish_s": file.unload.finish_s,
            "passes": passes,
        },
        "steer": {
            "level": "edge_or_path",
            "edge": {"overlap_m": round(overlap, 6)},
            "path": {"distance_m": 6.0},
            "stray_m": round(max(overlap, LEAST_STRAY), 6),
        },
        "speed": "job",
    }
    if cart is not None:
        made |= {
            "peer": cart.name,
            "unload": "auger",
            "peer_link": {"level": "radio", "rate_hz": 10, "delay_ms": 100},
            "cooperate": {"level": "unloader", "start_percent": 1.0},
            "scan_filter": "peer_body",
            "edge": {"wires": {"scan": "scan_filter.scan"}},
        }
    return made


def _cart(
    file: FleetFile,
    combine: Combine,
    cart: Cart,
    passes: list[dict[str, Any]],
    plan: FieldPlan,
    base: Path | None,
) -> dict[str, Any]:
    settings = file.carts[cart.name]
    middle = np.mean(plan.boundary, axis=0)
    x, y = file.truck.x_m, file.truck.y_m
    heading = math.atan2(float(middle[1]) - y, float(middle[0]) - x)
    return {
        "machine": _named(settings.machine, base),
        "peer": combine.name,
        "start": _start(Pose(x, y, heading)),
        "odometry": {"level": "error"},
        "imu": "error",
        **RECEIVER,
        "heap": {"level": "height_map", "empty_l_s": settings.unload_l_s},
        "peer_link": {"level": "radio", "rate_hz": 10, "delay_ms": 100},
        "cooperate": "front_to_back",
        "job": {
            "level": "shuttle",
            "passes": [{k: row[k] for k in ("line_m", "cart_beside")} for row in passes],
            "boundary_m": [_rounded(q) for q in plan.boundary.tolist()],
            "header_m": combine.sheet.header_width,
            "beside_m": round(combine.pipe + LANDS, 3),
            "truck_m": [x, y],
            "dock_s": file.truck.dock_s,
            "speed_kmh": settings.speed_kmh,
            "leave_percent": settings.leave_percent * settings.fill_percent / 100.0,
        },
        "steer": "station_or_path",
        "speed": "job",
    }


def _start(pose: Pose) -> dict[str, float]:
    degrees = math.degrees(math.remainder(pose.heading, 2.0 * math.pi))
    return {"x_m": round(pose.x, 6), "y_m": round(pose.y, 6), "heading_deg": round(degrees, 9)}


def _rounded(point: Any) -> list[float]:
    return [round(float(v), 6) for v in point]


def _named(machine: str, base: Path | None) -> str:
    """A bundled sheet by its whole name, a file with its whole path."""
    path = open_machine(machine, base).path
    is_file = machine.endswith((".yaml", ".yml"))
    return str(path.resolve()) if is_file else path.stem
