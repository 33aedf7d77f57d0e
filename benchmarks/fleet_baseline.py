"""Hours of a job by simple rules, without paths and without machines that are in each other's way.

What a planner of whole fields has to be better than. Headland rounds are driven in turn, then each combine
cuts a block of adjacent strips there and back, the nearest next, and takes half of the longest block left
when its own is done. A cart comes when the tank is over its level; it drives beside where the ground on the
left is cut, the rest is poured standing. One machine at a time at the truck.
"""

import heapq
import math
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from swath.fleet.files import JobFile
from swath.fleet.ground import Ground
from swath.fleet.machines import Cart, Combine, body_of, machines_of

TURN_S, CORNER_S, ALIGN_S, HEADWAY_S = 17.0, 25.0, 10.0, 30.0  # turns as recorded, the rest estimates
DETOUR = 1.3  # of a cart's path over the straight line
STEP_S, SOON_S = 4.0, 60.0  # of cutting; a cart that would come later is not called
SIDE_M, AROUND_M, NEAR_M = 6.0, 15.0, 30.0  # least side, strip that paths may use, straight paths
LEAST_M2 = 2.0


Point = tuple[float, float]
Row = tuple[float, float, float, float]


def polygons(area: Any) -> list[Any]:
    return [p for p in shapely.get_parts(area) if p.geom_type == "Polygon" and p.area > LEAST_M2]


class _Server:
    """A cart: when and where it is free, and its load [kg]."""

    def __init__(self, spec: Cart, place: Point) -> None:
        self.spec, self.place, self.time, self.load = spec, place, 0.0, 0.0


class _Baseline:
    def __init__(self, job: JobFile) -> None:
        self.job, self.machines = job, machines_of(job)
        self.ground = Ground(job, body_of(self.machines.truck))
        self.field = self.ground.field
        self.grain = 0.1 * job.field.yield_t_ha
        self.inside = self.field.buffer(AROUND_M)
        shapely.prepare(self.inside)
        self.rings = [p.exterior for p in polygons(self.field)]
        self.combines: list[Combine] = list(self.machines.combines)
        self.width = min(c.width for c in self.combines) - job.plan.overlap_m
        self.dock = tuple(self.ground.dock[:2])
        self.carts = [_Server(k, self.dock) for k in self.machines.carts]
        self.time = {c.name: 0.0 for c in self.combines}
        self.tank = {c.name: c.start for c in self.combines}
        self.place = {c.name: tuple(self.ground.gate) for c in self.combines}
        volume = job.truck.volume_m3
        self.trucks_kg = volume * self.machines.density if volume else math.inf
        self.truck_time, self.truck_room, self.ends = 0.0, self.trucks_kg, 0.0

    def way(self, a: Point, b: Point) -> float:
        """Length of a path [m], along the outline where the straight line leaves the field and its strip."""
        d = math.dist(a, b)
        if d < NEAR_M or self.inside.contains(shapely.LineString([a, b])):
            return d
        ring = min(self.rings, key=lambda r: r.distance(shapely.Point(a)))
        arc = abs(ring.project(shapely.Point(a)) - ring.project(shapely.Point(b)))
        return max(d, min(arc, ring.length - arc))

    def empty(self, time: float, load: float, rate: float) -> float:
        """When a load is in trucks and its machine is gone [s]."""
        dock_s = self.job.truck.dock_s
        time = max(time, self.truck_time) + 0.5 * dock_s
        while load > 1e-6:
            if self.truck_room <= 1e-6:
                time += 60.0 * self.job.truck.away_min
                self.truck_room = self.trucks_kg
            amount = min(load, self.truck_room)
            self.truck_room -= amount
            load -= amount
            time += amount / rate
        self.ends = max(self.ends, time)
        self.truck_time = time + 0.5 * dock_s
        return self.truck_time

    def comes(self, k: _Server, place: Point) -> float:
        return k.time + DETOUR * self.way(k.place, place) / k.spec.drive.straight + ALIGN_S

    def to_truck(self, k: _Server) -> None:
        there = k.time + DETOUR * self.way(k.place, self.dock) / k.spec.drive.straight
        k.time, k.place, k.load = self.empty(there, k.load, k.spec.out), self.dock, 0.0

    def loaded(self, k: _Server, place: Point, time: float, load: float) -> None:
        k.load, k.time, k.place = k.load + load, time, place
        if k.load >= k.spec.leave:
            self.to_truck(k)

    def unload(self, c: Combine, place: Point) -> None:
        """All of a tank, standing."""
        while self.tank[c.name] > 1e-6:
            now = self.time[c.name]
            if not self.carts:
                there = self.way(place, self.dock) / c.drive.straight + TURN_S
                self.time[c.name] = self.empty(now + there, self.tank[c.name], c.auger) + there
                self.tank[c.name] = 0.0
                continue
            k = min(self.carts, key=lambda k: self.comes(k, place))
            amount = min(self.tank[c.name], k.spec.load - k.load)
            if amount < 1.0:
                self.to_truck(k)
                continue
            self.time[c.name] = max(now, self.comes(k, place)) + amount / c.auger
            self.tank[c.name] -= amount
            self.loaded(k, place, self.time[c.name], amount)

    def cut(self, c: Combine, a: Point, b: Point, area: float, beside: bool) -> None:
        """A pass from a to b; beside: a cart may drive beside it."""
        mass, beside = area * self.grain, beside and bool(self.carts)
        length = max(math.dist(a, b), area / c.width)
        tank = self.tank[c.name]
        if tank + mass > c.tank and not beside and (tank > 0.5 * c.tank or mass <= c.tank):
            self.unload(c, a)
        spent = length / c.speed_in(self.grain * c.width)
        steps = max(1, round(spent / STEP_S))
        cart, start, given = None, 0.0, 0.0
        for i in range(steps):
            place = tuple(np.array(a) + (np.array(b) - np.array(a)) * i / steps)
            if self.tank[c.name] + mass / steps > c.tank:
                self.unload(c, place)
            self.time[c.name] += spent / steps
            self.tank[c.name] += mass / steps
            now = self.time[c.name]
            if beside and cart is None and self.tank[c.name] >= c.call:
                k = min(self.carts, key=lambda k: self.comes(k, place))
                if self.comes(k, place) <= now + SOON_S and k.spec.load - k.load >= 0.1 * c.tank:
                    cart, start, given = k, max(self.comes(k, place), now + c.swing), 0.0
            if cart is not None and now >= start:
                most = c.auger * spent / steps
                amount = min(most, self.tank[c.name], cart.spec.load - cart.load - given)
                self.tank[c.name] -= amount
                given += amount
                if amount < most - 1e-6 or i == steps - 1:
                    self.loaded(cart, place, now, given)
                    cart = None
        self.place[c.name] = b
        if cart is not None and given > 0.0:
            self.loaded(cart, b, self.time[c.name], given)

    def rounds(self) -> Any:
        """Headland rounds; what is left of the field."""
        rest = self.field
        for number in range(self.job.plan.headland_rounds):
            inner = self.field.buffer(-(number + 1) * self.width, join_style="mitre")
            for ring in polygons(rest.difference(inner)):
                points = np.array(ring.exterior.coords)[::-1]
                sides = [(tuple(a), tuple(b)) for a, b in pairwise(points) if math.dist(a, b) > SIDE_M]
                total = math.fsum(math.dist(a, b) for a, b in sides)
                for a, b in sides:
                    gaps = {c.name: self.way(self.place[c.name], a) / c.drive.straight for c in self.combines}
                    c = min(self.combines, key=lambda c, gaps=gaps: self.time[c.name] + gaps[c.name])
                    self.time[c.name] += CORNER_S + gaps[c.name]
                    self.cut(c, a, b, ring.area * math.dist(a, b) / total, number > 0)
            rest = inner
            for i, c in enumerate(self.combines):
                self.time[c.name] += HEADWAY_S * i / len(self.combines)
        return rest

    def strips(self, rest: Any) -> list[Row]:
        """y, from, to, area of strips, the northernmost first."""
        if rest.is_empty:
            return []
        west, south, east, north = rest.bounds
        count = max(1, math.ceil((north - south) / self.width - 1e-6))
        pitch, rows = (north - south) / count, []
        for i in range(count):
            box = shapely.box(west - 1.0, south + i * pitch, east + 1.0, south + (i + 1) * pitch)
            rows += [
                (south + (i + 0.5) * pitch, *p.bounds[::2], p.area) for p in polygons(rest.intersection(box))
            ]
        return sorted(rows, reverse=True)

    def blocks(self, rows: list[Row]) -> dict[str, list[Row]]:
        power = np.array([c.width * c.speed for c in self.combines])
        done = np.cumsum([r[3] for r in rows]) / max(math.fsum(r[3] for r in rows), 1e-9)
        edges = [0.0, *np.cumsum(power / power.sum()).tolist()]
        return {
            c.name: [r for r, s in zip(rows, done, strict=True) if edges[i] < s - 1e-9 <= edges[i + 1] + 1e-9]
            for i, c in enumerate(self.combines)
        }

    def run(self) -> float:
        """Hours until the last grain is at the truck."""
        todo = self.blocks(self.strips(self.rounds()))
        queue = [(self.time[c.name], i) for i, c in enumerate(self.combines)]
        heapq.heapify(queue)
        while queue:
            _, i = heapq.heappop(queue)
            c = self.combines[i]
            own = todo[c.name]
            if not own:
                other = max(todo.values(), key=len)
                if len(other) < 2:
                    continue
                own.extend(other[len(other) // 2 :])
                del other[len(other) // 2 :]
            here = self.place[c.name]
            far = {r: [self.way(here, (x, r[0])) for x in r[1:3]] for r in own}
            y, west, east, area = row = min(own, key=lambda r: min(far[r]))
            own.remove(row)
            a, b = ((west, y), (east, y)) if far[row][0] <= far[row][1] else ((east, y), (west, y))
            self.time[c.name] += TURN_S + max(0.0, min(far[row]) - self.width) / c.drive.straight
            above, below = all(r[0] < y for r in own), all(r[0] > y for r in own)
            self.cut(c, a, b, area, (above and b[0] > a[0]) or (below and b[0] < a[0]))
            heapq.heappush(queue, (self.time[c.name], i))
        for c in self.combines:
            self.unload(c, self.place[c.name])
        for k in self.carts:
            if k.load > 1e-6:
                self.to_truck(k)
        return self.ends / 3600.0


def baseline_hours(job: JobFile) -> float:
    """Hours of a job by simple rules."""
    return _Baseline(job).run()
