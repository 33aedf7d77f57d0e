"""What a schedule did, looked at without any code that made it: bodies, ground, grain."""

import math
from dataclasses import dataclass, field

import numpy as np

from swath.fleet.ground import shapely_here
from swath.fleet.machines import Body
from swath.fleet.schedule import Schedule

STEP = 0.1  # s


@dataclass
class Found:
    """contact: seconds in which two bodies are over each other; hole, outside: s in which a body is in a
    hole, off open ground; trampled: standing crop under wheels [m2 s]; left: crop, share of the field;
    mass: grain lost, share; hasty: segments that are left before their time
    """

    contact: dict[tuple[str, str], float] = field(default_factory=dict)
    hole: float = 0.0
    outside: float = 0.0
    trampled: float = 0.0
    left: float = 0.0
    mass: float = 0.0
    hasty: int = 0


def looked_at(schedule: Schedule, worked=None) -> Found:
    """All of it. worked: as driven, by default as planned"""
    found = Found()
    machines = {m.name: m for m in (*schedule.machines.combines, *schedule.machines.carts)}
    if worked is None:
        into = np.array([s.into for s in schedule.table.segments])
        clock = np.arange(0.0, float(into.max()) + 60.0, STEP)
        where = {name: places(schedule, name, into, clock) for name in machines}
        segments = schedule.table.segments
        found.hasty = sum(s.next >= 0 and into[s.next] < s.into + s.spent - 1e-6 for s in segments)
    else:
        into, clock, where = worked.into, worked.clock, worked.places
    names = list(machines)
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            touched = over_each_other(machines[a].body, where[a], machines[b].body, where[b])
            if touched:
                found.contact[a, b] = touched * STEP
    _ground(schedule, machines, where, clock, into, found)
    cut, poured = math.fsum(kg for _, kg, _ in schedule.cut), (worked or schedule).poured
    cut += math.fsum(c.start for c in schedule.machines.combines)
    at = math.fsum(p.amount for p in poured if p.target == "truck")
    found.mass = abs(cut - at) / max(cut, 1.0)
    return found


def places(schedule: Schedule, name: str, into, clock):
    """x, y, heading, heading of the trailer of a machine at times, (n, 4)."""
    rows, at = [], []
    for s in schedule.table.segments:
        if s.machine != name:
            continue
        a, b = int(s.path.first[s.index]), int(s.path.last[s.index])
        d = s.path.track.distance[a : b + 1]
        span = d[-1] - d[0]
        share = (d - d[0]) / span if span > 1e-9 else np.linspace(0.0, 1.0, len(d))
        at.append(into[s.number] + share * max(s.spent, 1e-6))
        rows.append(s.path.track.places[a : b + 1])
    t, p = np.concatenate(at), np.concatenate(rows)
    p = p.copy()
    p[:, 2:] = np.unwrap(p[:, 2:], axis=0)
    return np.column_stack([np.interp(clock, t, p[:, k]) for k in range(4)])


def rectangles(body: Body, where):
    """Middle, direction and half sizes of all rectangles, (n, r, 6)."""
    out = []
    for parts, towed in ((body.own, False), (body.towed, True)):
        heading = where[:, 3] if towed else where[:, 2]
        x, y = where[:, 0], where[:, 1]
        if towed:
            x = x + body.hitch * np.cos(where[:, 2]) - body.drawbar * np.cos(heading)
            y = y + body.hitch * np.sin(where[:, 2]) - body.drawbar * np.sin(heading)
        c, s = np.cos(heading), np.sin(heading)
        for r in parts:
            u, v = 0.5 * (r.rear + r.front), 0.5 * (r.right + r.left)
            half = np.broadcast_to([0.5 * (r.front - r.rear), 0.5 * (r.left - r.right)], (len(x), 2))
            out.append(np.column_stack([x + u * c - v * s, y + u * s + v * c, c, s, half]))
    return np.stack(out, axis=1)


def over_each_other(one: Body, where_one, two: Body, where_two) -> int:
    """Times at which any rectangles of two bodies overlap (separating axes)."""
    near = np.hypot(*(where_one[:, :2] - where_two[:, :2]).T) < 30.0
    if not near.any():
        return 0
    a, b = rectangles(one, where_one[near])[:, :, None], rectangles(two, where_two[near])[:, None]
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    along = np.abs(a[..., 2] * b[..., 2] + a[..., 3] * b[..., 3])
    across = np.abs(a[..., 2] * b[..., 3] - a[..., 3] * b[..., 2])
    meet = np.ones(np.broadcast_shapes(dx.shape), bool)
    for p, q in ((a, b), (b, a)):
        meet &= np.abs(dx * p[..., 2] + dy * p[..., 3]) < p[..., 4] + q[..., 4] * along + q[..., 5] * across
        meet &= np.abs(dy * p[..., 2] - dx * p[..., 3]) < p[..., 5] + q[..., 4] * across + q[..., 5] * along
    return int(meet.any(axis=(1, 2)).sum())


def _ground(schedule, machines, where, clock, into, found) -> None:
    """Holes, open ground and standing crop, each second."""
    shapely = shapely_here()
    ground = schedule.ground
    strips, when = [], []
    combines = {c.name: c for c in schedule.machines.combines}
    for s in schedule.table.segments:
        if s.kind != "cut":
            continue
        c = combines[s.machine]
        a, b = s.path.track.places[s.path.first[s.index]], s.path.track.places[s.path.last[s.index]]
        u = np.array([math.cos(a[2]), math.sin(a[2])])
        v = 0.5 * c.width * np.array([-u[1], u[0]])
        p, q = a[:2] + c.knife * u, b[:2] + c.knife * u
        strips.append(shapely.Polygon([p - v, q - v, q + v, p + v]))
        when.append(into[s.number])
    strips, when = np.array(strips), np.array(when)
    found.left = shapely.difference(ground.field, shapely.union_all(strips)).area / ground.field.area
    order = np.argsort(when)
    shapely.prepare(ground.open)
    every = int(2.0 / STEP)
    standing, done = ground.field, 0
    for i in range(0, len(clock), every):
        fresh = order[done : np.searchsorted(when[order], clock[i], side="right")]
        done += len(fresh)
        if len(fresh):
            standing = shapely.difference(standing, shapely.union_all(strips[fresh]))
        for name, m in machines.items():
            w = where[name][i : i + 1]
            if i and np.allclose(w, where[name][i - every : i - every + 1]):
                continue
            bodies = [_corners(r) for r in rectangles(m.body, w)[0]]
            if not shapely.contains(ground.open, bodies).all():
                inside = shapely.area(shapely.difference(bodies, ground.open)).max()
                found.outside += 2.0 if inside > 0.5 else 0.0
                found.hole += (
                    2.0 if shapely.area(shapely.intersection(bodies, ground.holes)).max() > 0.1 else 0.0
                )
            wheels = [b for k, b in enumerate(bodies) if k != m.body.raised]
            area = shapely.area(shapely.intersection(wheels, standing)).max()
            found.trampled += 2.0 * area if area > 1.0 else 0.0


def _corners(r):
    x, y, c, s, u, v = r
    return shapely_here().Polygon(
        [
            (x + a * u * c - b * v * s, y + a * u * s + b * v * c)
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
    )
