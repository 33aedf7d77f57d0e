"""Whether a refused job cannot be done, looked at without any code that refused it.

Each condition that a refusal states is looked at by geometry alone, of the job's file and its machines'
bodies: how far the pipe throws, where the truck stands, whether all can stand on ground without crop and a
disc as wide as a machine still gets from the gate to each and to the truck, whether such a disc gets to all
of the field.
"""

import math

import numpy as np

from swath.fleet.files import JobFile
from swath.fleet.ground import PARAMS as GROUND
from swath.fleet.ground import shapely_here
from swath.fleet.machines import PARAMS, Machines, machines_of
from swath.fleet.machines import PARAMS as GAPS

SPOTS = 4.0  # m between places that are looked at
TURNS = 8  # directions
TRIES = 400
GAP = 0.5  # m around a machine that stands or drives


def confirmed(job: JobFile, key: str, expected: str) -> tuple[bool, str]:
    """Whether what a refusal says holds, and what was seen. key, expected: of its InputError"""
    if "header" in key or "header" in expected:
        return _reach(job)
    machines = machines_of(job)
    if key == "truck":
        far = _field(job).distance(shapely_here().Point(job.truck.x_m, job.truck.y_m))
        return far < 4.0, f"the truck is {far:.1f} m off the field"
    if "room for" in expected:
        return _room(job, machines)
    if "find a way" in expected or "a way from" in expected:
        return _connected(job, machines)
    return False, "nothing is known of this condition"


def _field(job: JobFile):
    shapely = shapely_here()
    parts = shapely.union_all([shapely.Polygon(r) for r in (job.field.boundary_m, *job.field.parts_m)])
    return shapely.difference(parts, shapely.union_all([shapely.Polygon(h) for h in job.field.holes_m]))


def open_ground(job: JobFile):
    """Field, strip around it, yards at truck and gate, the road between; no holes. And the gate."""
    shapely = shapely_here()
    field, truck = _field(job), shapely.Point(job.truck.x_m, job.truck.y_m)
    gate = shapely.Point(shapely.shortest_line(field, truck).coords[0])
    outer = shapely.union_all([shapely.Polygon(r) for r in (job.field.boundary_m, *job.field.parts_m)])
    road = shapely.LineString([gate, truck]).buffer(GROUND.road_m)
    around = outer.buffer(job.field.around_m, join_style="mitre", mitre_limit=2.0)
    yards = [p.buffer(GROUND.yard_m) for p in (gate, truck)]
    holes = shapely.union_all([shapely.Polygon(h) for h in job.field.holes_m])
    return shapely.difference(shapely.union_all([around, road, *yards]), holes), gate, truck


def _reach(job: JobFile) -> tuple[bool, str]:
    """The stream of each combine against the nearest that a cart's box can be beside its header."""
    from swath.machine.machine_sheet import load_machine

    lacks = []
    for name, c in job.combines.items():
        sheet = load_machine(c.machine, header_width_m=c.header_width_m)
        pipe = sheet.pipe
        y, out, fall = 0.0, pipe.exit_speed * math.cos(pipe.fall), pipe.exit_speed * math.sin(pipe.fall)
        height = 1.0
        while height > 0.0:  # thrown, step by step
            y, height, fall = y + 1e-4 * out, height - 1e-4 * fall, fall + 1e-4 * 9.81
        lands = pipe.y + pipe.length + y
        for cart in job.carts.values():
            tractor = load_machine(cart.machine)
            half = max(0.5 * tractor.trailer.width, 0.5 * tractor.box.width, *(r[3] for r in tractor.outline))
            lacks.append((0.5 * sheet.header_width + half - lands, name))
    worst, name = max(lacks)
    off = worst + GAPS.beside_m
    return off > PARAMS.off_m, f"{name}: beside its header grain lands {off:.2f} m off the middle of the box"


def _room(job: JobFile, machines: Machines) -> tuple[bool, str]:
    """Places for all, one after the other, the largest first, as far from gate and truck as there are."""
    shapely = shapely_here()
    ground, gate, truck = open_ground(job)
    bare = shapely.difference(ground, shapely.union_all([_field(job), truck.buffer(10.0)]))
    sizes = sorted(
        ((m.body.length_behind + max(r.front for r in m.body.own), 2.0 * m.body.half_width, m)
         for m in (*machines.combines, *machines.carts)), key=lambda s: -s[0] * s[1],
    )  # fmt: skip
    half = max(_chassis(m) for _, _, m in sizes)
    west, south, east, north = bare.bounds
    x, y = (a.ravel() for a in np.meshgrid(np.arange(west, east, SPOTS), np.arange(south, north, SPOTS)))
    far = np.minimum(np.hypot(x - gate.x, y - gate.y), np.hypot(x - truck.x, y - truck.y))
    order = np.argsort(-far, kind="stable")
    stand: list = []
    for length, width, m in sizes:
        place = _place(bare, stand, half, (gate, truck), x[order], y[order], length, width)
        if place is None:
            return True, f"no place for {m.name}, {length:.1f} x {width:.1f} m, beside {len(stand)} others"
        stand.append(place)
    return False, f"{len(stand)} machines have places outside of the crop"


def _chassis(m) -> float:
    """Half width [m] of what drives over bare ground: a header passes above what others leave free."""
    return max(max(abs(r.left), abs(r.right)) for i, r in enumerate(m.body.own) if i != m.body.raised)


def _place(bare, stand, half, goals, x, y, length, width):
    """A rectangle clear of others from which a disc gets to all goals and to those that stand."""
    shapely = shapely_here()
    free = shapely.difference(bare, shapely.union_all([s.buffer(GAP) for s in stand])) if stand else bare
    shapely.prepare(free)
    tried = 0
    for px, py in zip(x.tolist(), y.tolist(), strict=True):
        if not shapely.contains_xy(free, px, py):
            continue
        for turn in range(TURNS):
            box = _turned(px, py, length, width, math.pi * turn / TURNS)
            if not shapely.contains(free, box):
                continue
            tried += 1
            lanes = shapely.difference(bare, shapely.union_all([*stand, box])).buffer(-half)
            if _reaches(lanes, half, [*goals, *stand, box]):
                return box
            if tried >= TRIES:
                return None
    return None


def _turned(x, y, length, width, a):
    c, s = math.cos(a), math.sin(a)
    half = 0.5 * length + GAP, 0.5 * width + GAP
    corners = [(i * half[0], j * half[1]) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return shapely_here().Polygon([(x + u * c - v * s, y + u * s + v * c) for u, v in corners])


def _reaches(lanes, half, goals) -> bool:
    """Whether one connected piece of ground for a disc's middle comes near to all goals."""
    shapely = shapely_here()
    parts = [part for part in shapely.get_parts(lanes) if not part.is_empty]
    return any(all(part.distance(g) < half + 11.0 for g in goals) for part in parts)


def _connected(job: JobFile, machines: Machines) -> tuple[bool, str]:
    """Whether a disc as wide as the narrowest combine gets to all of the field, had others cut it."""
    shapely = shapely_here()
    ground, _, truck = open_ground(job)
    half = min(_chassis(c) for c in machines.combines)
    lanes = ground.buffer(-half)
    for part in shapely.get_parts(lanes):
        if part.distance(truck) < half + 11.0:
            left = shapely.difference(_field(job), part.buffer(half + 0.5 * machines.combines[0].width))
            cut_off = left.area / _field(job).area
            return cut_off > 0.005, f"{100.0 * cut_off:.2f} % of the field are cut off from the truck"
    return True, "no ground leads to the truck"
