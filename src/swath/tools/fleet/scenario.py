"""The scenario of a job: its field, combines and carts with their sensors, passes and turns as planned."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swath.job.fleet import FleetFile
from swath.job.machines import Cart, Combine, Fleet
from swath.job.path import Pose
from swath.job.plan import FieldPlan, shapely_here
from swath.job.truck_ways import place_at_truck
from swath.machine.machine_sheet import open_machine
from swath.signals import F64
from swath.tools.fleet.combine_turns import axle_at
from swath.tools.fleet.order import LANDS, RUN_UP
from swath.tools.fleet.waiting import axle_ways, truck_place, waiting_places
from swath.tools.fleet.work_plan import WorkPlan, rounded

GRAIN_PER_STEM = 0.0018  # kg, wheat: 500 stems/m2 are 9 t/ha
FAR = 80.0  # m, as in the other levels: a way beyond it is no turn
RECEIVER: dict[str, Any] = {
    "gnss": {
        "level": "error", "receiver": "rtk", "antenna": {"y_m": 0.6}, "second_antenna": {"y_m": -0.6},
    },
    "pose": "ekf",
}  # fmt: skip
"""Two antennas, so that a machine that stands knows where it looks."""
LEAST_STRAY = 0.2  # m beside the plan, up to which the edge leads; else as far as passes overlap
RADIO: dict[str, Any] = {"level": "radio", "rate_hz": 10, "delay_ms": 100}
RANGE = 500.0  # m, of the radio without setting it
BEYOND = 100.0  # m that it reaches farther than the field is long
TOLD = "line_m", "cart_beside", "cart_standing", "combine", "turn"  # of a pass, to a cart
OFF_FIELD = 12.0  # m from the field, that headers and turns need beside it


def scenario_of(file: FleetFile, work: WorkPlan, fleet: Fleet, base: Path | None = None) -> dict[str, Any]:
    """The scenario as plain data. InputError for what this level cannot do."""
    carts, combines, combine = fleet.carts, fleet.combines, fleet.combines[0]
    shared, passes, team = work
    plan, by = shared.plan, shared.by
    machines = {}
    for i, own in enumerate(combines):
        made = _combine(file, own, carts, passes, plan, base)
        if len(team) > 1:
            made["start"] = _start(axle_at(plan.passes[by.index(i)].start, own, team[i].start))
            made["job"] |= team[i].job
            others = [c.name for c in combines if c is not own]
            made |= {f"peer_link_{n}": {**RADIO, "peer": c} for n, c in enumerate(others, len(carts))}
        machines[own.name] = made
    ways = [axle_ways(work.shared, i, own, team[i].run_out) for i, own in enumerate(combines)]
    truck = _truck(file, plan, ways)
    places = waiting_places(plan, ways, truck, len(carts)) if len(carts) > 1 else []
    for number, cart in enumerate(carts):
        made = _cart(file, combine, cart, passes, plan, truck, base)
        if places:
            made |= {"start": _start(_facing(plan, *places[number]))} | _links(carts, cart)
            made["job"] |= {"number": number, "wait_m": rounded(places[number])}
        for i, other in enumerate(combines[1:], len(carts)):
            made[f"peer_link_{i}"] = {**RADIO, "peer": other.name}
        machines[cart.name] = made
    _reach(machines, plan)
    ring = [rounded(point) for point in plan.boundary[::-1].tolist()]
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


def _reach(machines: dict[str, Any], plan: FieldPlan) -> None:
    """The radio of all machines reaches from one end of the field to the other."""
    needed = math.hypot(*np.ptp(plan.boundary, axis=0).tolist()) + BEYOND
    links = [v for made in machines.values() for k, v in made.items() if k.startswith("peer_link")]
    for link in links if needed > RANGE else ():
        link["range_m"] = math.ceil(needed)


def _combine(
    file: FleetFile,
    combine: Combine,
    carts: Sequence[Cart],
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
            "transport_speed_kmh": settings.transport_speed_kmh,
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
    if carts:
        made |= {
            "peer": carts[0].name,
            "unload": "auger",
            "peer_link": dict(RADIO),
            "cooperate": {"level": "unloader", "start_percent": 1.0},
            "scan_filter": "peer_body",
            "edge": {"wires": {"scan": "scan_filter.scan"}},
        }
        made |= {f"peer_link_{i}": {**RADIO, "peer": cart.name} for i, cart in enumerate(carts) if i}
    return made


def _links(carts: Sequence[Cart], own: Cart) -> dict[str, Any]:
    """Radio to the other carts, which tell their ways."""
    others = [cart.name for cart in carts if cart.name != own.name]
    return {f"peer_link_{i}": {**RADIO, "way": True, "peer": name} for i, name in enumerate(others, 1)}


def _cart(
    file: FleetFile,
    combine: Combine,
    cart: Cart,
    passes: list[dict[str, Any]],
    plan: FieldPlan,
    truck: tuple[float, float],
    base: Path | None,
) -> dict[str, Any]:
    settings, (x, y) = file.carts[cart.name], truck
    return {
        "machine": _named(settings.machine, base),
        "peer": combine.name,
        "start": _start(_facing(plan, x, y)),
        "odometry": {"level": "error"},
        "imu": "error",
        **RECEIVER,
        "heap": {"level": "height_map", "empty_l_s": settings.unload_l_s},
        "peer_link": dict(RADIO),
        "cooperate": "front_to_back",
        "job": {
            "level": "shuttle",
            "passes": [{k: v for k, v in row.items() if k in TOLD} for row in passes],
            "boundary_m": [rounded(q) for q in plan.boundary.tolist()],
            "header_m": combine.sheet.header_width,
            "beside_m": round(combine.pipe + LANDS, 3),
            "truck_m": [x, y],
            "dock_s": file.truck.dock_s,
            "speed_kmh": settings.speed_kmh,
            "leave_percent": settings.leave_percent * settings.fill_percent / 100.0,
            "fill_percent": 0.95 * settings.fill_percent,  # a place is left a little before it is full
        },
        "steer": "station_or_path",
        "speed": "job",
    }


def _truck(file: FleetFile, plan: FieldPlan, ways: Sequence[F64]) -> tuple[float, float]:
    """Where carts are emptied [m]: a place in the field or near it is moved out, as at the other levels; one
    near the ways of combines is moved off them: a cart that stands there would stop them.
    """
    x, y = file.truck.x_m, file.truck.y_m
    shapely = shapely_here()
    if shapely.Polygon(plan.boundary).distance(shapely.Point(x, y)) < OFF_FIELD:
        x, y, _ = place_at_truck(Pose(x, y, 0.0), plan.boundary, 0)
    x, y = truck_place(plan, ways, (x, y), OFF_FIELD)
    return round(x, 6), round(y, 6)


def _facing(plan: FieldPlan, x: float, y: float) -> Pose:
    """A machine at a place that looks at the field."""
    middle = np.mean(plan.boundary, axis=0)
    return Pose(x, y, math.atan2(float(middle[1]) - y, float(middle[0]) - x))


def _start(pose: Pose) -> dict[str, float]:
    degrees = math.degrees(math.remainder(pose.heading, 2.0 * math.pi))
    return {"x_m": round(pose.x, 6), "y_m": round(pose.y, 6), "heading_deg": round(degrees, 9)}


def _named(machine: str, base: Path | None) -> str:
    """A bundled sheet by its whole name, a file with its whole path."""
    path = open_machine(machine, base).path
    is_file = machine.endswith((".yaml", ".yml"))
    return str(path.resolve()) if is_file else path.stem
