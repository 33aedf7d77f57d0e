"""The scenario of a job: its field, combines and carts with their sensors, passes and turns as planned."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swath.control.job.passes import RUN_OUT, Pass
from swath.control.steer.path import Segment
from swath.core.errors import InputError
from swath.core.units import KMH
from swath.job.cart_ways import place_at_truck
from swath.job.fleet import FleetFile
from swath.job.machines import Cart, Combine, Fleet
from swath.job.path import Pose
from swath.job.plan import FieldPlan, shapely_here
from swath.machine.machine_sheet import open_machine
from swath.tools.fleet import echelon, lands
from swath.tools.fleet.combine_turns import Shared, axle_at, shared
from swath.tools.fleet.order import RUN_UP, Member
from swath.tools.fleet.waiting import axle_ways, waiting_places

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
MOST = 3  # combines, carts
TOLD = "line_m", "cart_beside", "cart_standing", "combine", "turn"  # of a pass, to a cart
OFF_FIELD = 12.0  # m from the field, that headers and turns need beside it
LANDS = 0.5  # m, that the stream lands beyond the mouth of the pipe


def scenario_of(file: FleetFile, plan: FieldPlan, fleet: Fleet, base: Path | None = None) -> dict[str, Any]:
    """The scenario as plain data. InputError for what this level cannot do."""
    _check(file, plan, fleet)
    carts, combines, combine = fleet.carts, fleet.combines, fleet.combines[0]
    made_plan = shared_out(file, plan, fleet)
    plan, by, _ = made_plan
    passes = passes_of(made_plan, combines, file)
    team = _team(told_passes(passes), combines, file)
    machines = {}
    for i, own in enumerate(combines):
        made = _combine(file, own, carts, passes, plan, base)
        if len(team) > 1:
            made["start"] = _start(axle_at(plan.passes[by.index(i)].start, own, team[i].start))
            made["job"] |= team[i].job
            others = [c.name for c in combines if c is not own]
            made |= {f"peer_link_{n}": {**RADIO, "peer": c} for n, c in enumerate(others, len(carts))}
        machines[own.name] = made
    truck = _truck(file, plan)
    ways = [axle_ways(made_plan, i, own, team[i].run_out) for i, own in enumerate(combines)]
    places = waiting_places(plan, ways, truck, len(carts)) if len(carts) > 1 else []
    for number, cart in enumerate(carts):
        made = _cart(file, combine, cart, passes, plan, base)
        if places:
            made |= {"start": _start(_facing(plan, *places[number]))} | _links(carts, cart)
            made["job"] |= {"number": number, "wait_m": _rounded(places[number])}
        for i, other in enumerate(combines[1:], len(carts)):
            made[f"peer_link_{i}"] = {**RADIO, "peer": other.name}
        machines[cart.name] = made
    _reach(machines, plan)
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


def _reach(machines: dict[str, Any], plan: FieldPlan) -> None:
    """The radio of all machines reaches from one end of the field to the other."""
    needed = math.hypot(*np.ptp(plan.boundary, axis=0).tolist()) + BEYOND
    links = [v for made in machines.values() for k, v in made.items() if k.startswith("peer_link")]
    for link in links if needed > RANGE else ():
        link["range_m"] = math.ceil(needed)


def _check(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> None:
    for key, found in (("combines", fleet.combines), ("carts", fleet.carts)):
        if len(found) > MOST:
            raise InputError(key, len(found), f"expected {MOST} at most at the level with sensors")
    if plan.holes:
        raise InputError("field", None, "expected a field without holes at the level with sensors")
    if file.unload.mode != "on_the_go":
        raise InputError("unload.mode", file.unload.mode, "expected on_the_go at the level with sensors")


def shared_out(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> Shared:
    """Which combine cuts which pass, in their order."""
    if len(fleet.combines) > 1 and file.team.together != "echelon":
        return lands.shared_out(file, plan, fleet)
    return shared(plan, echelon.assigned(plan, len(fleet.combines)), fleet.combines)


def _team(passes: Sequence[Pass], combines: Sequence[Combine], file: FleetFile) -> list[Member]:
    """Start and settings of each of the combines."""
    if len(combines) == 1:
        return [Member(RUN_UP, {}, RUN_OUT)]
    if file.team.together == "echelon":
        return echelon.members(passes, combines, file)
    return lands.members(passes, combines)


def passes_of(of: Shared, combines: Sequence[Combine], file: FleetFile) -> list[dict[str, Any]]:
    """Passes with the turns behind them, to the next one of the same combine.

    Beside the last pass of a combine a cart can stand at least: it gives its last grain there.
    """
    rows = []
    plan, by, turns = of
    for i, p in enumerate(plan.passes):
        combine = combines[by[i]]
        grain = p.area * file.field.yield_t_ha / 10.0 / p.length
        row: dict[str, Any] = {
            "line_m": [_rounded(q) for q in p.line.tolist()],
            "cart_beside": bool(p.cart_beside),
            "speed_kmh": round(combine.speed_in(grain) / KMH, 4),
            "width_m": round(p.area / p.length, 3),
        }
        is_outside = p.kind == "headland" and p.round_index == 0 and file.plan.headland == "clockwise"
        if not p.cart_beside and (is_outside or i not in turns):
            row["cart_standing"] = True
        if by[i]:
            row["combine"] = by[i]
        if i in turns:
            row["turn"] = [
                {"length_m": q.length, "curvature_per_m": q.first, "to_per_m": q.last}
                for q in turns[i]
                if q.length > 1e-6
            ]
        rows.append(row)
    return rows


def told_passes(rows: list[dict[str, Any]]) -> list[Pass]:
    """The passes as a machine is told them."""
    return [
        Pass(
            tuple((x, y) for x, y in row["line_m"]), row["cart_beside"], row["speed_kmh"],
            tuple(Segment(**segment) for segment in row.get("turn", [])), row.get("combine", 0),
            row.get("cart_standing", False),
        )
        for row in rows
    ]  # fmt: skip


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
    base: Path | None,
) -> dict[str, Any]:
    settings = file.carts[cart.name]
    x, y = _truck(file, plan)
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


def _truck(file: FleetFile, plan: FieldPlan) -> tuple[float, float]:
    """Where carts are emptied [m]: a place in the field or near it is moved out, as at the other levels."""
    x, y = file.truck.x_m, file.truck.y_m
    shapely = shapely_here()
    if shapely.Polygon(plan.boundary).distance(shapely.Point(x, y)) < OFF_FIELD:
        x, y, _ = place_at_truck(Pose(x, y, 0.0), plan.boundary, 0)
    return round(x, 6), round(y, 6)


def _facing(plan: FieldPlan, x: float, y: float) -> Pose:
    """A machine at a place that looks at the field."""
    middle = np.mean(plan.boundary, axis=0)
    return Pose(x, y, math.atan2(float(middle[1]) - y, float(middle[0]) - x))


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
