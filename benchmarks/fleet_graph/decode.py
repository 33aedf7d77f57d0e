"""From a plan, a few choices, to what each machine does when: the machine that is free first is next.

Each way is the earliest one through free intervals, and is reserved; who is done stands where it is until it
sets out again. Where a machine finds no way another one goes first, then one that stands makes room, then the
plan has no end.
"""

import heapq
import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from benchmarks.fleet_graph.lanes import Chain, Lanes
from benchmarks.fleet_graph.reserved import INF, Reserved, Way

ALIGN_S = 10.0  # until a cart beside is in line
INNER_S = 150.0  # cost of a pass inside while a round is left
LEAST = 0.12  # of a tank, less than which nobody comes beside for


class NoEnd(Exception):
    """A plan in which machines are in each other's way for good."""


@dataclass(frozen=True)
class Choices:
    """A plan. combines, carts: how many are used, the strongest first; call, full: levels of a tank from
    which a cart comes beside, or it is emptied standing, shares; leave: load from which a cart drives to
    the truck, share; lane: cost of a tank that is cut where no cart can drive beside, other: of a pass in
    another's band [s]; bias: combine, pass, more cost [s]; cart: counts of calls at which another one than
    the first comes; late: by which a combine comes later in the order [s].
    """

    combines: int
    carts: int
    call: float = 0.4
    full: float = 0.6
    leave: float = 0.6
    lane: float = 150.0
    other: float = 120.0
    bias: frozenset[tuple[int, int, float]] = frozenset()
    cart: frozenset[int] = frozenset()
    late: tuple[float, ...] = ()


@dataclass
class Step:
    """A move along an edge, or a stay at a node where edge is -1; what: as segments are called; cell: that is
    cut; mass: grain of it [kg]; key: of what is done together.
    """

    edge: int
    node: int
    begins: float
    ends: float
    what: str
    cell: int = -1
    mass: float = 0.0
    key: int = -1


@dataclass
class Mover:
    """A machine: number, group, its place and where it is from when on, grain in it, steps; back: its state
    before a way home that may be taken back, and the grant of that.
    """

    number: int
    spec: Any
    group: int
    home: int
    node: int
    time: float = 0.0
    since: float = -1.0
    grain: float = 0.0
    steps: list[Step] = field(default_factory=list)
    back: tuple[Any, ...] | None = None


@dataclass
class Poured:
    """key: of the steps in which it is; at truck: times within the stay."""

    source: int
    target: int
    amount: float
    begins: float
    ends: float
    key: int


class Decoder:
    """What comes of a plan."""

    def __init__(self, lanes: Lanes, reserved: Reserved, choices: Choices, limit: float = INF) -> None:
        self.lanes, self.res, self.p, self.limit = lanes, reserved, choices, limit
        machines, job = lanes.machines, lanes.job
        used = [*machines.combines[: choices.combines], *machines.carts[: choices.carts]]
        self.movers = [
            Mover(
                i,
                m,
                lanes.group_of[m.name],
                lanes.homes[m.name],
                lanes.homes[m.name],
                grain=getattr(m, "start", 0.0),
            )
            for i, m in enumerate(used)
        ]
        self.combines, self.carts = self.movers[: choices.combines], self.movers[choices.combines :]
        reserved.clear(len(used))
        for m in self.movers:
            self.park(m, m.home, -1.0)
        self.left = {c.number for c in lanes.chains}
        self.rest: dict[int, tuple[Chain, int]] = {}
        self.done: set[int] = set()
        self.calls = 0
        self.keys = 0
        self.inner = 0.0
        self.outside = {
            g: np.array([n for n in sorted(lanes.outside) if lanes.nodes[n][0] == g], int)
            for g in range(len(lanes.groups))
        }
        self.poured: list[Poured] = []
        self.ends = 0.0
        self.truck_free = 0.0
        volume = job.truck.volume_m3
        self.truck_room = math.inf if volume is None else volume * machines.density
        self.by_number: dict[int, list[Chain]] = {}
        for c in lanes.chains:
            self.by_number.setdefault(c.number, []).append(c)

    # what is reserved
    def park(self, m: Mover, node: int, since: float) -> None:
        m.node, m.since = node, since
        self.res.parked[2 * m.number : 2 * m.number + 2] = node, since

    def take(self, m: Mover, rows: Any, what: str, stays: float = 0.0, name: str = "stands") -> int:
        """Reserve a way, and a stay at its end; returns the grant."""
        res, n = self.res, self.res.edges
        first = float(rows[0][1]) if len(rows) else m.time
        grant = -1
        if len(rows):
            taken = [(n + m.node, m.since, first)]
            if first > m.time + 1e-6:
                m.steps.append(Step(-1, m.node, m.time, first, "waits"))
            for i, (e, a, b) in enumerate(rows):
                edge = self.lanes.edges[int(e)]
                taken.append((int(e), a, b))
                m.steps.append(Step(int(e), edge.b, a, b, what))
                if i + 1 < len(rows) and rows[i + 1][1] > b + 1e-3:
                    taken.append((n + edge.b, b, rows[i + 1][1]))
                    m.steps.append(Step(-1, edge.b, b, rows[i + 1][1], "waits"))
            grant = res.reserve(m.number, taken)
            self.park(m, edge.b, float(rows[-1][2]))
            m.time = float(rows[-1][2])
        if stays > 0.0:
            m.steps.append(Step(-1, m.node, m.time, m.time + stays, name))
            m.time += stays
        return grant

    def state(self, m: Mover) -> tuple[Any, ...]:
        return m.node, m.since, m.time, len(m.steps)

    def restore(self, m: Mover, state: tuple[Any, ...], *grants: int) -> None:
        """Take back what was granted since a state."""
        for g in grants:
            if g >= 0:
                self.res.dead[g] = 1
        node, since, m.time, count = state
        self.park(m, node, since)
        del m.steps[count:]

    # the job
    def run(self) -> float:
        """Hours."""
        late = self.p.late or (0.0,) * len(self.combines)
        queue = [(late[c.number], c.number) for c in self.combines]
        heapq.heapify(queue)
        stuck = 0
        while queue:
            time, i = heapq.heappop(queue)
            if time > self.limit:
                raise NoEnd("later than the best")
            c = self.combines[i]
            if self.turn(c):
                stuck = 0
            else:
                stuck += 1
                if stuck > 3 * len(queue) + 4:
                    raise NoEnd(f"nobody finds a way at {time:.0f} s")
                if stuck > len(queue) + 1:
                    self.makes_room(stuck)
                others = [t for t, _ in queue]
                heapq.heappush(queue, (max([c.time, *others, time]) + 1.0, i))
                continue
            if i not in self.done:
                heapq.heappush(queue, (c.time + late[i], i))
        stuck = 0
        while full := sorted((k for k in self.carts if k.grain > 1e-6), key=lambda k: (k.time, k.number)):
            if any(self.to_truck(k) for k in full):
                stuck = 0
                continue
            stuck += 1
            if stuck > 2 * len(self.movers):
                raise NoEnd("no way to the truck at the end")
            self.makes_room(stuck)
        return self.ends / 3600.0

    def turn(self, c: Mover) -> bool:
        """The next thing of a combine; False where it finds no way."""
        if c.number in self.rest:
            chain, k = self.rest[c.number]
            more = math.fsum(self.lanes.mass[cell] for cell in chain.cells[k:])
            if c.grain + more > c.spec.tank and self.unload(c, here=True):
                return True
            return self.cuts(c, chain, [], k)
        chains = self.candidates(c)
        if not chains:
            if c.grain > 1e-6:
                return self.unload(c)
            if not self.left:
                self.done.add(c.number)
                return True
            return False
        self.inner = INNER_S * any(chain.is_headland for chain in chains)
        far = self.res.far(c.number, c.node, c.time)
        rows = []
        for chain in chains:
            extra = self.extra(c, chain)
            for number, (node, into) in enumerate(self.entries(chain)):
                if far[node] < INF:
                    rows.append((round(far[node] + extra, 1), chain.number, number, node, into, chain, extra))
        rows.sort(key=lambda r: (r[0], r[1], r[2], r[3]))
        if not rows:
            return False
        rows = rows[:8]
        is_full = c.grain > self.p.full * c.spec.tank and not self.has_lane(rows[0][5])
        if is_full and self.unload(c):
            return True
        for _ in range(4):
            if not rows:
                return False
            goals = [(r[3], 0.0, 0.0, INF, r[6]) for r in rows]
            way = self.res.way(c.number, c.node, goals, c.time)
            if way is None:
                return False
            *_, into, chain, _ = rows[way.goal]
            if self.cuts(c, chain, into, 0, way):
                return True
            rows = [r for r in rows if r[5] is not chain]
        return False

    def candidates(self, c: Mover) -> list[Chain]:
        """Passes that may be cut next: rounds outside in, then the rest."""
        own = [chain for n in self.left for chain in self.by_number[n] if chain.group == c.group]
        rounds = {chain.task.land for chain in own if chain.is_headland}
        if rounds:
            first = [chain for chain in own if chain.is_headland and chain.task.land == min(rounds)]
            if len({chain.number for chain in first}) >= len(self.combines):
                return first
        return [chain for chain in own if chain.task.kind != "clean"] or own

    def entries(self, chain: Chain) -> list[tuple[int, list[int]]]:
        """Nodes from which a pass is begun, and edges up to it."""
        return [(chain.nodes[0], []), *((self.lanes.edges[e].a, [e]) for e in chain.openings)]

    def extra(self, c: Mover, chain: Chain) -> float:
        """Cost of a pass beside that of the way [s]."""
        p, cost = self.p, 45.0 * (chain.is_back and chain.is_headland)
        cost += 0.0 if chain.is_headland else self.inner
        if self.carts and not self.has_lane(chain):
            mass = math.fsum(self.lanes.mass[cell] for cell in chain.cells)
            cost += p.lane * mass / c.spec.tank
        cost += sum(seconds for i, number, seconds in p.bias if (i, number) == (c.number, chain.number))
        if chain.task.combine >= 0 and chain.task.combine != c.number:
            cost += p.other
        return cost

    def has_lane(self, chain: Chain) -> bool:
        """Whether a cart can drive beside most of a pass."""
        if not self.carts:
            return False
        edges, _ = chain.lanes.get(self.carts[0].group, ([], []))
        return sum(e >= 0 and self.is_cut(e) for e in edges) > 0.6 * len(chain.edges)

    def is_cut(self, resource: int) -> bool:
        x = self.res.arrays
        need = x["need"][x["need_at"][resource] : x["need_at"][resource + 1]]
        return not len(need) or float(self.res.cut[need].max()) < INF

    def cuts(self, c: Mover, chain: Chain, into: list[int], k: int, way: Way | None = None) -> bool:
        """A pass from a cell on, with the way to it; False where it cannot be driven."""
        lanes, res, spec = self.lanes, self.res, c.spec
        masses = np.array([lanes.mass[cell] for cell in chain.cells[k:]])
        rows = []
        for e, mass in zip(chain.edges[k:], masses.tolist(), strict=True):
            length = lanes.edges[e].track.length
            rows.append((e, max(lanes.edges[e].spent, length / spec.speed_in(mass / length))))
        levels = c.grain + np.concatenate([[0.0], np.cumsum(masses)])
        fits = int(np.searchsorted(levels, spec.tank + 1e-6, side="right")) - 1  # cells that the tank takes
        if fits < 1 and not self.carts:
            return self.unload(c) if c.grain > 1e-6 else False
        state, grants = self.state(c), []
        steps_before = len(c.steps)
        if way is not None and len(way.rows):
            grants.append(self.take(c, way.rows, "way"))
        own = [*chain.cells]
        if into:
            own += [i for i, r in enumerate(lanes.round) if r == chain.task.land]
        res.exempt[own] = 1
        opened = [(e, lanes.edges[e].track.length / spec.speed) for e in into]
        begin = c.time
        whole = res.along(c.number, c.node, opened + rows, begin)
        res.exempt[own] = 0
        if whole is None or len(whole.rows) <= len(opened):
            self.restore(c, state, *grants)
            return False
        n = len(whole.rows) - len(opened)
        driven = whole.rows[len(opened) :]
        cells = chain.cells[k : k + n]
        res.cut[cells] = driven[:, 2]
        if not self.gets_out(c.number, lanes.edges[int(driven[-1][0])].b, c.group, float(driven[-1][2])):
            res.cut[cells] = INF
            self.restore(c, state, *grants)
            return False
        served = self.beside(c, chain, k, driven, levels) if self.carts else None
        if served is None and fits < n:
            if fits >= 1 and ((self.carts and self.can_stand(chain, k + fits)) or not self.carts):
                res.exempt[own] = 1
                whole = res.along(c.number, c.node, opened + rows[:fits], begin, True)
                res.exempt[own] = 0
                n = len(whole.rows) - len(opened) if whole is not None else 0
            else:
                n = 0
            res.cut[cells] = INF
            if n < 1:
                self.restore(c, state, *grants)
                return self.unload(c) if c.grain > LEAST * spec.tank else False
            assert whole is not None
            driven = whole.rows[len(opened) :]
        self.keys += 1
        key = self.keys
        self.take(c, whole.rows, "cut")
        cut = [s for s in c.steps[steps_before:] if s.what == "cut"]
        for s in cut[: len(opened)]:
            s.what = "way"
        for i, s in enumerate(cut[len(opened) :]):
            s.cell, s.mass, s.key = chain.cells[k + i], float(masses[i]), 1000 * key + i
            res.cut[s.cell] = s.ends
        c.grain += float(masses[:n].sum())
        self.left.discard(chain.number)
        self.rest.pop(c.number, None)
        if n < len(rows):
            self.rest[c.number] = chain, k + n
        if served is not None:
            self.follows(c, served, driven, key)
        return True

    def gets_out(self, number: int, node: int, group: int, time: float) -> bool:
        """Whether cut ground leads from a node out of the field."""
        far = self.res.far(number, node, time)
        return bool((far[self.outside[group]] < INF).any())

    def can_stand(self, chain: Chain, i: int) -> bool:
        """Whether a cart can come beside a node of a pass."""
        _, nodes = chain.lanes.get(self.carts[0].group, ([], []))
        return bool(nodes) and nodes[i] >= 0 and self.is_cut(self.res.edges + nodes[i])

    # carts
    def order(self) -> list[Mover]:
        """Carts, those that are free first."""
        self.calls += 1
        row = sorted(self.carts, key=lambda k: (round(k.back[0][2] if k.back else k.time), k.number))
        if self.calls in self.p.cart and len(row) > 1:
            row = row[1:] + row[:1]
        return row

    def sets_out(self, k: Mover, goal: int, until: float, late: float) -> Way | None:
        """A cart's way to a node, in time; from where it took its last load, else from where it is."""
        for taken_back in (True, False) if k.back is not None else (False,):
            now = self.state(k)
            gone = k.steps[:]
            back = k.back
            if taken_back:
                state, grant = back
                self.restore(k, state, grant)
            far = self.res.far(k.number, k.node, k.time)[goal]
            way = None
            if far < INF and k.time + far <= late:
                begin = max(k.time, min(until, late) - 1.3 * far - 40.0)
                if taken_back and not self.res.is_free(k.number, self.res.edges + k.node, k.time, begin):
                    begin = k.time  # others pass where it would wait
                way = self.res.way(k.number, k.node, [(goal, until, 0.0, late, 0.0)], begin, 8000)
            if way is not None:
                if taken_back:
                    k.back = None
                return way
            if taken_back:
                self.res.dead[grant] = 0
                node, since, k.time, _ = now
                self.park(k, node, since)
                k.steps[:] = gone
        return None

    def beside(self, c: Mover, chain: Chain, k: int, driven: Any, levels: Any) -> Any:
        """A cart that follows beside from some cell on: its way, and what it takes in which cells."""
        spec, lanes, res = c.spec, self.lanes, self.res
        n = len(driven)
        if levels[n] < self.p.call * spec.tank:
            return None
        first = int(np.searchsorted(levels, self.p.call * spec.tank))
        fits = int(np.searchsorted(levels, spec.tank + 1e-6, side="right")) - 1
        first = max(min(first, fits, n - 1) - 1, 0)
        for cart in self.order()[:3]:
            edges, nodes = chain.lanes.get(cart.group, ([], []))
            room = cart.spec.load - cart.grain
            if not edges or room < LEAST * spec.tank:
                continue
            tries = 0
            join = first
            while join < min(n, fits + 1) and tries < 3:
                if edges[k + join] < 0 or not self.is_cut(edges[k + join]):
                    join += 1
                    continue
                starts = float(driven[join][1])
                if cart.time - (0.0 if cart.back is None else 120.0) > starts:
                    join += 1
                    continue
                rows, amounts, level = [], [], float(levels[join])
                given = 0.0
                for i in range(join, n):
                    e, (_, a, b) = edges[k + i], driven[i]
                    if e < 0 or not res.is_free(cart.number, e, a, b):
                        break
                    mass = float(levels[i + 1] - levels[i])
                    x = min(
                        spec.auger * max(b - a - (spec.swing if i == join else 0.0), 0.0),
                        level + mass,
                        room - given,
                    )
                    if level + mass - x > spec.tank + 1e-6:
                        break
                    level += mass - x
                    given += x
                    rows.append((e, a, b))
                    amounts.append(x)
                    if room - given < 1.0 or level < 0.01 * spec.tank:
                        break
                while rows and not res.is_free(
                    cart.number, res.edges + lanes.edges[rows[-1][0]].b, rows[-1][2], INF
                ):
                    rows.pop()
                    given -= amounts.pop()
                over = float((levels[join + len(rows) : n + 1] - given).max()) if rows else INF
                if given < LEAST * spec.tank or over > spec.tank + 1e-6:
                    join += 1
                    tries += 0 if rows else 1
                    continue
                tries += 1
                way = self.sets_out(cart, nodes[k + join], starts, starts - ALIGN_S)
                if way is None:
                    join += max(1, n // 4)
                    continue
                return cart, way, join, rows, amounts
        return None

    def follows(self, c: Mover, served: Any, driven: Any, key: int) -> None:
        """A cart beside, as found, and away."""
        cart, way, join, rows, amounts = served
        self.take(cart, way.rows, "to combine")
        if rows[0][1] > cart.time:
            cart.steps.append(Step(-1, cart.node, cart.time, rows[0][1], "beside"))
            cart.time = rows[0][1]
        count = len(cart.steps)
        self.take(cart, rows, "beside, pouring")
        for i, s in enumerate(s for s in cart.steps[count:] if s.edge >= 0):
            s.key = 1000 * key + join + i
        given = math.fsum(amounts)
        self.poured.append(Poured(c.number, cart.number, given, rows[0][1], rows[-1][2], 1000 * key + join))
        c.grain -= given
        cart.grain += given
        self.away(cart)

    def away(self, k: Mover) -> None:
        """To the truck if the load is worth it, else to its place, which may be taken back."""
        if k.grain >= self.p.leave * k.spec.load and self.to_truck(k):
            return
        state = self.state(k)
        way = self.res.way(k.number, k.node, [(k.home, 0.0, INF, INF, 0.0)], k.time)
        if way is not None and len(way.rows):
            grant = self.take(k, way.rows, "to its place")
            k.back = state, grant
        else:
            k.back = None

    def to_truck(self, m: Mover) -> bool:
        """To the truck, empty there, and to its place."""
        job = self.lanes.job
        rate = m.spec.auger if m in self.combines else m.spec.out
        pour, left, room, waits = m.grain / rate, m.grain, self.truck_room, 0
        while left > room + 1e-6:
            left -= room
            room = job.truck.volume_m3 * self.lanes.machines.density
            waits += 1
        stay = job.truck.dock_s + pour + 60.0 * job.truck.away_min * waits + getattr(m.spec, "swing", 0.0)
        dock = self.lanes.docks[m.group]
        starts = (True, False) if m.back is not None else (False,)
        for taken_back in starts:
            now, gone = self.state(m), m.steps[:]
            if taken_back:
                state, grant = m.back
                self.restore(m, state, grant)
            way = self.res.way(m.number, m.node, [(dock, 0.0, stay + 30.0, INF, 0.0)], m.time)
            if way is not None:
                break
            if taken_back:
                self.res.dead[grant] = 0
                self.park(m, now[0], now[1])
                m.time, m.steps[:] = now[2], gone
        if way is None:
            return False
        before = self.state(m)
        grant = self.take(m, way.rows, "to truck")
        begins = max(m.time, self.truck_free if math.isfinite(self.truck_room) else 0.0)
        arrived = m.time
        m.steps.append(Step(-1, m.node, arrived, begins + stay, "at truck", key=-2 - len(self.poured)))
        m.time = begins + stay
        home = self.res.way(m.number, m.node, [(m.home, 0.0, INF, INF, 0.0)], m.time)
        if home is None and m not in self.combines:
            self.restore(m, before, grant)
            return False
        self.truck_free = m.time
        self.truck_room = room - left
        over = m.time - 0.5 * job.truck.dock_s
        self.poured.append(Poured(m.number, -1, m.grain, over - pour, over, m.steps[-1].key))
        self.ends = max(self.ends, over)
        m.grain = 0.0
        if home is not None and m not in self.combines:
            self.take(m, home.rows, "to its place")
        m.back = None
        return True

    def unload(self, c: Mover, here: bool = False) -> bool:
        """A tank is emptied standing, at the best of places where a cart can come beside, or at the truck."""
        if not self.carts:
            return self.to_truck(c)
        res = self.res
        mine = res.far(c.number, c.node, c.time)
        group = self.carts[0].group
        own = self.pairs(group)
        rows = []
        for cart in self.order()[:2]:
            if cart.spec.load - cart.grain < min(LEAST * c.spec.tank, c.grain) and not self.to_truck(cart):
                continue
            start = cart.back[0] if cart.back else (cart.node, 0.0, cart.time, 0)
            its = res.far(cart.number, start[0], start[2])
            for a, b in own:
                if here and a != c.node:
                    continue
                if mine[a] < INF and its[b] < INF:
                    own_s = float(mine[a])
                    rows.append((round(max(own_s, start[2] + float(its[b]) - c.time) + own_s, 1), a, b, cart))
        rows.sort(key=lambda r: (r[0], r[1], r[2]))
        for _, a, b, cart in rows[: 2 if here else 8]:
            state = self.state(c)
            grant = -1
            if a != c.node:
                way = res.way(c.number, c.node, [(a, 0.0, INF, INF, 0.0)], c.time, 8000)
                if way is None:
                    continue
                grant = self.take(c, way.rows, "way to unload")
            before = cart.grain
            arrives = c.time
            path = self.sets_out(cart, b, arrives, INF)
            if path is None or path.close < INF:
                self.restore(c, state, grant)
                if path is not None:
                    self.away(cart)
                continue
            self.take(cart, path.rows, "to combine")
            amount = min(c.grain, cart.spec.load - before)
            begins = max(c.time, cart.time + ALIGN_S)
            pour = amount / c.spec.auger
            self.keys += 1
            key = 1000 * self.keys
            if begins > c.time:
                c.steps.append(Step(-1, c.node, c.time, begins, "waits for cart"))
            cart.steps.append(Step(-1, cart.node, cart.time, begins, "beside"))
            c.steps.append(Step(-1, c.node, begins, begins + pour, "pours standing", key=key))
            cart.steps.append(Step(-1, cart.node, begins, begins + pour, "beside, pouring", key=key))
            c.time = cart.time = begins + pour
            self.poured.append(Poured(c.number, cart.number, amount, begins, begins + pour, key))
            c.grain -= amount
            cart.grain += amount
            self.away(cart)
            return True
        return False

    def pairs(self, group: int) -> list[tuple[int, int]]:
        """Poses of a combine and of a cart beside it, on cut ground."""
        found = {}
        for chain in self.lanes.chains:
            _, nodes = chain.lanes.get(group, ([], []))
            for i, b in enumerate(nodes):
                if b >= 0 and (chain.is_headland or i in (0, len(nodes) - 1) or True):
                    found[chain.nodes[i], b] = None
        return [p for p in found if self.is_cut(self.res.edges + p[0]) and self.is_cut(self.res.edges + p[1])]

    def makes_room(self, turn: int) -> None:
        """A machine that stands in the field drives to its place, a combine onto cut ground."""
        there = [m for m in self.movers if m.node != m.home and m.number not in self.rest]
        for m in there[turn % max(len(there), 1) :] + there[: turn % max(len(there), 1)]:
            places = [m.home] if m in self.carts else self.refuges(m)
            way = self.res.way(
                m.number,
                m.node,
                [(n, 0.0, INF, INF, 90.0 * (n in self.lanes.outside)) for n in places],
                m.time,
            )
            if way is not None and len(way.rows):
                self.take(m, way.rows, "to its place")
                m.back = None
                return

    def refuges(self, c: Mover) -> list[int]:
        """Poses on passes that are cut, off where it stands."""
        x, y = self.lanes.nodes[c.node][1][:2]
        chains = (h for h in self.lanes.chains if h.group == c.group and h.number not in self.left)
        nodes = dict.fromkeys(n for h in chains for n in h.nodes)
        nodes |= dict.fromkeys(n for n in self.lanes.outside if self.lanes.nodes[n][0] == c.group)
        far = (n for n in nodes if math.dist(self.lanes.nodes[n][1][:2], (x, y)) > 30.0)
        return [n for n in far if self.is_cut(self.res.edges + n)]


__all__ = ["Choices", "Decoder", "NoEnd", "replace"]
