"""The graph of a job: poses and ways between them for each kind of machine, with the ground that each sweeps.

Passes are chains of cells of about `CELL_M`, in both directions; beside each is a chain for carts; rings
around the field, headland passes and a road to the truck are lanes; rolled turns join all. Resources are
the edges, then the poses to stand at; which of them meet, and which crop has to be cut before, is worked
out once.
"""

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from benchmarks.fleet_graph.turns import pieces_of, shortest_turns, turns_of

from swath.control.turns.dubins import Place as Pose
from swath.control.turns.dubins import shortest
from swath.core.errors import InputError
from swath.fleet.files import JobFile
from swath.fleet.ground import PARAMS as YARDS
from swath.fleet.ground import Ground, fits, run_of
from swath.fleet.machines import PARAMS as GAPS
from swath.fleet.machines import Body, Cart, Combine, Machines, Place, Rectangle, beside, body_of, machines_of
from swath.fleet.plan import HEADLAND, Pass, plan_of, strips_along, track_along
from swath.fleet.table import Path, Swept, segments, standing
from swath.fleet.ways import Track, abreast, driven, spent_along, straight
from swath.kernels import filled, launch

CELL_M = 24.0  # of passes, about
NODE_M = 26.0  # between poses of lanes
FAR_M = 62.0  # longest turn
BACK_M = (8.0, 16.0, 28.0)  # back from the end of a pass that leads against crop
AT_HOLE_M = 15.0  # from a hole, in which a pass ends before it
CORNER_M = 30.0  # between passes that meet in a corner
ON_M = (0.0, 4.0, 8.0, 12.0)  # straight before and behind a bend that is driven back
LINE_M = 7.0  # straight at the end of turns of a trailer
SWING_M, STAND_M = 0.4, 0.8  # more room on each side of a trailer in turns, and where one stands behind them
OPENS_M = 120.0  # over which a combine opens a way into standing crop
PART_M, BENT_M = 7.0, 2.5  # between hulls of what is swept, in bends of a pass
NEED_M = 0.15  # by which crop is narrower where ways are checked for it
TOP, LANES = (5, 10), (3, 5)  # nearest passes, and lanes, to turn to, from a lane and from the end of a pass
WAIT_M = 2.0  # between machines that wait
ALONE = -1


@dataclass
class Edge:
    """a, b: nodes; kind: of `Machines`; track; spent: rolling [s]; path: as segments; cell: that is cut on
    it, -1 for none; opens: whether crop of its round is cut on the way in.
    """

    a: int
    b: int
    group: int
    track: Track
    spent: float
    path: Path
    what: str
    opens: int = -1


@dataclass
class Chain:
    """A pass in one direction: nodes, edges and cells of a kind of combine; lanes: by kind of cart the edges
    beside, -1 where there is none, and nodes.
    """

    task: Pass
    number: int
    group: int
    nodes: list[int]
    edges: list[int]
    cells: list[int]
    lanes: dict[int, tuple[list[int], list[int]]] = field(default_factory=dict)
    openings: list[int] = field(default_factory=list)
    is_back: bool = False

    @property
    def is_headland(self) -> bool:
        return self.task.kind == HEADLAND


@dataclass(frozen=True)
class Group:
    """Machines that drive alike: one of them."""

    spec: Any
    is_cart: bool

    @property
    def body(self) -> Body:
        return self.spec.body


def _key(m: Any) -> tuple[Any, ...]:
    own = (m.width, m.knife, m.pipe_x, m.pipe_y) if isinstance(m, Combine) else (m.box_x,)
    return (m.body, m.drive, *own)


class Lanes:
    """The graph of a job."""

    def __init__(self, job: JobFile, machines: Machines | None = None) -> None:
        self.job = job
        self.machines = machines or machines_of(job)
        self.ground = Ground(job, body_of(self.machines.truck))
        self.plan = plan_of(self.ground, self.machines.combines, job.plan, job.drawn)
        self.groups: list[Group] = []
        keys: list[Any] = []
        self.group_of: dict[str, int] = {}
        for m in (*self.machines.combines, *self.machines.carts):
            if _key(m) not in keys:
                keys.append(_key(m))
                self.groups.append(Group(m, isinstance(m, Cart)))
            self.group_of[m.name] = keys.index(_key(m))
        self.nodes: list[tuple[int, Place]] = []
        self.known: dict[Any, int] = {}
        self.edges: list[Edge] = []
        self.turned: dict[tuple[int, int], Any] = {}  # rolled turns that were looked at
        self.chains: list[Chain] = []
        self.crop: list[Any] = []
        self.areas: list[float] = []
        self.mass: list[float] = []
        self.round: list[int] = []  # of the headland, of a cell; -1 in lands
        self.backed: dict[int, int] = {}
        self.outside: set[int] = set()
        self.ends: dict[int, list[int]] = {g: [] for g in range(len(self.groups))}  # a turn leads from here
        self.starts: dict[int, list[int]] = {g: [] for g in range(len(self.groups))}  # and to here
        self.flows: dict[int, list[list[int]]] = {g: [] for g in range(len(self.groups))}  # lanes: both
        self.rough = self.ground.rough
        self.standing = self.ground.field.buffer(-NEED_M)
        shapely.prepare(self.standing)
        self._cells()
        for g, group in enumerate(self.groups):
            if not group.is_cart:
                self._passes(g)
        for g in range(len(self.groups)):
            self._rings(g)
        self._yard()
        for g in range(len(self.groups)):
            self._turns(g)
        self._index()

    # parts of the graph
    def node(self, g: int, place: Place) -> int:
        """A pose, the same node for one that is there."""
        h = math.remainder(place.heading, 2.0 * math.pi)
        key = g, round(place.x, 2), round(place.y, 2), round(h % (2.0 * math.pi), 3)
        if key not in self.known:
            self.known[key] = len(self.nodes)
            self.nodes.append((g, Place(place.x, place.y, h, h)))
        return self.known[key]

    def edge(self, a: int, b: int, g: int, track: Track, what: str, opens: int = -1) -> int:
        """An edge; -1 where there is no room for it."""
        group = self.groups[g]
        part = BENT_M if what == "cut" and track.bends.any() else PART_M
        count = math.ceil(track.length / part)
        marks = np.linspace(0.0, track.length, count + 1)
        body = _rough(group.body, SWING_M if what == "way" else 0.0)
        path = segments(track, track.distance, body, what, marks)
        if not shapely.contains(self.rough, path.swept[:]).all():
            return -1
        last = len(track.places) - 1
        spent = float(spent_along(track, group.spec.drive, 0, last))
        self.edges.append(Edge(a, b, g, track, spent, path, what, opens))
        return len(self.edges) - 1

    def rolls(self, pairs: list[tuple[int, int]], what: str = "way", most: float = math.inf) -> list[int]:
        """Rolled turns from nodes to others of one kind of machine, -1 where there is none."""
        pairs = [(a, b) for a, b in pairs if a != b]
        if not pairs:
            return []
        g = self.nodes[pairs[0][0]][0]
        spec, out = self.groups[g].spec, []
        line = [(0.0, LINE_M)] if self.groups[g].is_cart else []
        for (a, b), far in zip(pairs, self._far(g, pairs).tolist(), strict=True):
            if far > most:
                out.append(-1)
                continue
            pieces = pieces_of(self.turned[a, b], spec.drive) + line
            out.append(self.edge(a, b, g, driven(self.nodes[a][1], pieces, spec.body, 1.0), what))
        return out

    def _cells(self) -> None:
        """What is cut, in cells of passes: shapes, areas and grain."""
        ground, rest = self.ground, self.ground.field
        narrow = min(self.machines.combines, key=lambda c: c.width)
        self.cells_of: list[list[int]] = []
        for p in self.plan.passes:
            track = track_along(p, narrow)
            count = max(1, math.ceil(track.length / CELL_M - 1e-9))
            fine = 3
            marks = np.linspace(0.0, track.length, fine * count + 1)
            strips = strips_along(track, p.width, narrow.knife, marks)
            density = ground.density(strips).reshape(count, fine).mean(axis=1)
            own = []
            for i in range(count):
                shape = shapely.union_all(strips[fine * i : fine * i + fine])
                crop = shapely.intersection(rest, shape)
                rest = shapely.difference(rest, shape)
                own.append(len(self.crop))
                self.crop.append(crop.buffer(-NEED_M, join_style="mitre"))
                self.areas.append(float(crop.area))
                self.mass.append(float(crop.area * density[i]))
                self.round.append(p.land if p.kind == HEADLAND else -1)
            self.cells_of.append(own)
        self.left = float(rest.area)

    def _passes(self, g: int) -> None:
        """Chains of all passes that a header takes, in both directions, with lanes beside."""
        c: Combine = self.groups[g].spec
        for number, p in enumerate(self.plan.passes):
            if p.width > c.width + 1e-6:
                continue
            for task, cells in ((p, self.cells_of[number]), (p.reversed(), self.cells_of[number][::-1])):
                track = track_along(task, c)
                marks = np.linspace(0.0, track.length, len(cells) + 1)
                at = np.searchsorted(track.distance, marks - 1e-6)
                at[-1] = len(track.places) - 1
                parts = [_part(track, i, j) for i, j in pairwise(at.tolist())]
                nodes = [self.node(g, part.start) for part in parts]
                nodes.append(self.node(g, track.end))
                edges = [
                    self.edge(a, b, g, t, "cut") for a, b, t in zip(nodes[:-1], nodes[1:], parts, strict=True)
                ]
                if min(edges) < 0:
                    continue
                chain = Chain(task, number, g, nodes, edges, cells, is_back=task is not p)
                self.chains.append(chain)
                self.ends[g].append(nodes[-1])
                if chain.is_headland:
                    self.flows[g].append(nodes)
                else:
                    self.starts[g].append(nodes[0])
                if chain.is_headland:
                    self._backed(g, c, chain, track)
                self._opening(g, c, chain, track)
                for k, other in enumerate(self.groups):
                    if other.is_cart:
                        self._beside(c, k, chain, track, at.tolist())

    def _backed(self, g: int, c: Combine, chain: Chain, track: Track) -> None:
        """Back to the start of a pass from where the body is close to crop, under the raised header."""
        far = c.knife - max(r.front for r in c.body.own[:-1]) - 2.0 * GAPS.gap_m
        if far < 0.5 or c.drive.backwards <= 0.0:
            return
        start = track.start.ahead(far)
        back = driven(start, [(0.0, -far)], c.body)
        e = self.edge(self.node(g, start), chain.nodes[0], g, back, "way")
        if e >= 0:
            self.edges[e].spent += 2.0 * c.drive.shift
            self.backed[chain.nodes[0]] = self.edges[e].a

    def _opening(self, g: int, c: Combine, chain: Chain, track: Track) -> None:
        """A straight way in to the start of a pass, over crop of its own round if there is any."""
        body = c.body
        for far in np.arange(4.0, OPENS_M, 8.0).tolist():
            start = track.start.ahead(-far)
            shape = run_of(body, start, 0.0, 0.0)
            if not shapely.contains(self.rough, shape):
                return
            if self.ground.field.intersection(shape).area < 0.01 or not chain.is_headland:
                a = self.node(g, start)
                into = straight(start, far, body)
                e = self.edge(a, chain.nodes[0], g, into, "way", chain.task.land if chain.is_headland else -1)
                if e >= 0:
                    self.starts[g].append(a)
                    chain.openings.append(e)
                return

    def _beside(self, c: Combine, k: int, chain: Chain, track: Track, at: list[int]) -> None:
        """Edges of carts of a kind beside a pass."""
        spec: Cart = self.groups[k].spec
        ahead, left = beside(c, spec)
        lane = abreast(track, ahead, left, spec.body, 0, len(track.places) - 1)
        sharp = np.abs(lane.bends) * spec.drive.radius > 1.0
        nodes = [-1] * len(chain.nodes)
        edges = [-1] * len(chain.edges)
        for i, (m, n) in enumerate(pairwise(at)):
            if sharp[m:n].any():
                continue
            part = _part(lane, m, n)
            for j, place in ((i, part.start), (i + 1, part.end)):
                if nodes[j] < 0:
                    nodes[j] = self.node(k, place)
            edges[i] = self.edge(nodes[i], nodes[i + 1], k, part, "beside")
        if max(edges) < 0:
            return
        chain.lanes[k] = edges, nodes
        used = {n for i, e in enumerate(edges) if e >= 0 for n in nodes[i : i + 2]}
        run = [n for n in nodes if n in used]
        if chain.is_headland:
            self.flows[k].append(run)
        else:
            self.starts[k].append(run[0])
            self.ends[k].append(run[-1])

    def _rings(self, g: int) -> None:
        """Lanes outside of the field, both ways; for carts along headland passes, too."""
        around, group = self.job.field.around_m, self.groups[g]
        half = group.body.half_width
        offs = [0.6 * around] if not group.is_cart else [0.3 * around, 0.75 * around]
        outer = shapely.union_all([shapely.Polygon(p.exterior) for p in shapely.get_parts(self.ground.field)])
        for off in offs:
            if off < half + 0.5 or off + half + 0.5 > around:
                continue
            for part in shapely.get_parts(outer.buffer(off)):
                ring = shapely.orient_polygons(part.simplify(0.5)).exterior
                self._lane(g, _spread(ring, self.ground.gate), True)

    def _lane(self, g: int, places: list[Place], is_ring: bool) -> None:
        """Poses that follow each other, both ways."""
        for turn in (0.0, math.pi):
            row = [Place(p.x, p.y, p.heading + turn, p.heading + turn) for p in places]
            row = row[::-1] if turn else row
            nodes = [self.node(g, p) for p in row]
            self.rolls([*pairwise(nodes + nodes[:1] if is_ring else nodes)])
            self.flows[g].append(nodes)
            self.outside.update(nodes)

    def _yard(self) -> None:
        """Road, places at the truck, and a place to wait for each machine."""
        ground, job = self.ground, self.job
        out = ground.dock.heading + 0.5 * math.pi  # from the gate to the truck
        gate = Place(*ground.gate, out, out)
        far = ground.truck_m
        self.docks: dict[int, int] = {}
        self.homes: dict[str, int] = {}
        self.taken: list[Any] = []  # bodies that wait, and the ways to them
        self.kept: list[Any] = []
        carts = bool(self.machines.carts)
        box = self.machines.truck.box
        self.joins: dict[int, list[int]] = {}
        for g, group in enumerate(self.groups):
            if group.is_cart:
                dock = ground.dock.ahead(-group.spec.box_x)
            elif not carts:
                dock = ground.truck_place.ahead(box.x - group.spec.pipe_x, -group.spec.pipe_y)
            else:
                dock = None
            side = 4.5 if group.is_cart else 3.0
            near = job.field.around_m + 12.0
            if far > near + 60.0:
                count = max(1, round((far - near - 28.0) / 45.0))
                along = np.linspace(near, far - 28.0, count + 1).tolist()
                there = [self.node(g, gate.ahead(d, -side)) for d in along]
                back = [
                    self.node(g, Place(p.x, p.y, p.heading + math.pi, p.heading + math.pi))
                    for p in (gate.ahead(d, side) for d in reversed(along))
                ]
                for lane in (there, back):
                    self.rolls([*pairwise(lane)])
                    self.flows[g].append(lane)
            hubs = []
            for at, u in ((gate, (10.0,)), (gate.ahead(far), (-22.0,))):
                for d in u:
                    for turn in range(4):
                        p = at.ahead(d)
                        h = out + 0.5 * math.pi * turn
                        hubs.append(self.node(g, Place(p.x, p.y, h, h)))
            self.flows[g] += [[h] for h in hubs]
            if dock is not None:
                self.docks[g] = self.node(g, dock)
                self.flows[g].append([self.docks[g]])
        self._homes()

    def _homes(self) -> None:
        """Places to wait, off all lanes, as near to the gate as there are."""
        ground = self.ground
        ring = ground.field.buffer(self.job.field.around_m, join_style="mitre", mitre_limit=2.0)
        docks = [*self.docks.items()]
        used = [
            run_of(self.groups[g].body, self.nodes[n][1], d, 3.0) for g, n in docks for d in (30.0, -30.0)
        ]
        road = shapely.LineString([ground.gate, ground.dock[:2]]).buffer(7.5)
        machines = [*self.machines.carts, *self.machines.combines]
        yards = [shapely.Point(p).buffer(YARDS.yard_m) for p in (ground.gate, ground.dock[:2])]
        for yard in yards:
            for off in (shapely.union_all([ring, road]), ring, ground.field):
                bare = shapely.difference(ground.open & yard, shapely.union_all([off, *used]))
                for m in machines:
                    if m.name in self.homes:
                        continue
                    for place in self._spots(bare, m.body):
                        n = self._joined(self.group_of[m.name], place)
                        if n >= 0:
                            self.homes[m.name] = n
                            used.append(run_of(m.body, place, 0.0, WAIT_M))
                            bare = shapely.difference(bare, used[-1])
                            break
        carts = tuple(k for k in self.machines.carts if k.name in self.homes)
        missing = [m.name for m in self.machines.combines if m.name not in self.homes]
        if missing or bool(carts) != bool(self.machines.carts):
            names = ", ".join(missing) or "a cart"
            raise InputError("field.around_m", None, f"expected room for {names} to wait")
        self.machines = replace(self.machines, carts=carts)

    def _spots(self, bare: Any, body: Body) -> list[Place]:
        """Places where a body has room, the nearest to the gate first."""
        x0, y0 = self.ground.gate
        spots = []
        for x0, y0 in (self.ground.gate, self.ground.dock[:2]):
            for r in np.arange(8.0, YARDS.yard_m, 4.0).tolist():
                for i in range(24):
                    angle = self.ground.dock.heading + 2.0 * math.pi * i / 24
                    x, y = x0 + r * math.cos(angle), y0 + r * math.sin(angle)
                    for turn in range(4):
                        h = self.ground.dock.heading + 0.5 * math.pi * turn
                        spots.append(
                            (round(math.dist((x, y), self.ground.gate), 2), len(spots), Place(x, y, h, h))
                        )
        shapely.prepare(bare)
        middle = shapely.points([s[2][:2] for s in spots])
        inside = shapely.contains(bare, middle)
        near = [s for s, ok in zip(spots, inside, strict=True) if ok]
        return [p for _, _, p in sorted(near) if fits(bare, body, p)][:160:2]

    def _joined(self, g: int, place: Place) -> int:
        """A node with turns to and from lanes; -1 where there are none."""
        marks = len(self.nodes), len(self.edges)
        n = self.node(g, place)
        if n < marks[0]:
            return -1
        flows = [m for lane in self.flows[g] for m in lane]
        body = self.groups[g].body
        shape = run_of(body, place, 0.0, WAIT_M)
        ways: list[Any] = []
        both = self.groups[g].is_cart or not self.machines.carts  # others leave for good, the last one first
        if both and self.kept and shapely.intersects(shape, self.kept).any():
            return self._forgotten(*marks)
        for is_out in (True, False) if both else (True,):
            rows = sorted((self._turn_m(*((n, m) if is_out else (m, n))), m) for m in flows)
            some = [m for far, m in rows[:20] if far < FAR_M]
            first, kept = len(self.edges), []
            self.rolls([(n, m) if is_out else (m, n) for m in some])
            own = [i for i in range(len(body.own) + len(_rough(body).towed)) if i != body.raised]
            for e in sorted(self.edges[first:], key=lambda e: e.spent):
                parts = e.path.swept[:]
                if len(kept) == 2 or shapely.intersects(self.standing, parts[:, own]).any():
                    continue
                if not (self.taken and shapely.intersects(parts.ravel()[:, None], [*self.taken]).any()):
                    kept.append(e)
            self.edges[first:] = kept
            ways += [q for e in kept for q in e.path.swept[:].ravel().tolist()]
            if not kept:
                return self._forgotten(*marks)
        self.taken.append(shape)
        self.kept += ways if both else []
        return n

    def _forgotten(self, nodes: int, edges: int) -> int:
        """Nodes and edges from some on are taken back."""
        self.known = {key: n for key, n in self.known.items() if n < nodes}
        self.turned = {key: row for key, row in self.turned.items() if max(key) < nodes}
        del self.nodes[nodes:], self.edges[edges:]
        return -1

    def _turn_m(self, a: int, b: int) -> float:
        """Length of a turn between nodes [m]."""
        (g, p), (_, q) = self.nodes[a], self.nodes[b]
        if math.dist(p[:2], q[:2]) > FAR_M:
            return math.inf
        return sum(d for _, d in shortest(Pose(*p[:3]), Pose(*q[:3]), self.groups[g].spec.drive.radius))

    def _far(self, g: int, pairs: list[tuple[int, int]]) -> Any:
        """Lengths of turns between nodes [m]."""
        new = [p for p in dict.fromkeys(pairs) if p not in self.turned]
        line = LINE_M * self.groups[g].is_cart
        if new:
            starts, goals = (np.array([self.nodes[pair[i]][1][:3] for pair in new]) for i in (0, 1))
            goals[:, :2] -= line * np.column_stack([np.cos(goals[:, 2]), np.sin(goals[:, 2])])
            self.turned.update(zip(new, turns_of(starts, goals, self.groups[g].spec.drive), strict=True))
        return np.round([self.turned[p][0] + line for p in pairs], 1)

    def _turns(self, g: int) -> None:
        """Turns from ends of passes and poses of lanes to starts and lanes."""
        known = {(e.a, e.b) for e in self.edges}
        places = np.array([p[:2] for _, p in self.nodes])
        lanes = self.flows[g]
        ends = set(self.ends[g]) | {lane[-1] for lane in lanes if lane[0] not in self.outside}
        outs = list(dict.fromkeys([*self.ends[g], *(n for lane in lanes for n in lane)]))
        at: dict[int, list[int]] = {}  # lanes of poses
        for k, lane in enumerate(lanes):
            for n in lane:
                at.setdefault(n, []).append(k)
        starts = list(dict.fromkeys(self.starts[g]))
        pairs = []
        for a in outs:
            near = np.hypot(*(places - places[a]).T)
            pairs += [(a, b) for b in [*starts, *at] if near[b] < 0.8 * FAR_M and a != b]
        far = self._far(g, pairs)
        rows: dict[int, list[tuple[float, int]]] = {}
        for (a, b), d in zip(pairs, far.tolist(), strict=True):
            if d < FAR_M:
                rows.setdefault(a, []).append((d, b))
        is_start = set(starts)
        for a, own in rows.items():
            own.sort()
            more = a in ends
            made: dict[int, int] = {}
            for d, b in own:
                to = [-1] if b in is_start else [k for k in at[b] if a not in lanes[k] or d > 1.5 * NODE_M]
                to = [k for k in to if made.get(k, 0) < (1 if k >= 0 else TOP[more])]
                if not to or (to != [-1] and sum(k >= 0 for k in made) >= LANES[more]):
                    continue
                if (a, b) not in known:
                    if self.rolls([(a, b)])[0] < 0:
                        continue
                    known.add((a, b))
                for k in to:
                    made[k] = made.get(k, 0) + 1
        if g in self.docks:  # a yard is wider than a headland
            dock, pairs = self.docks[g], []
            for lane in lanes:
                near_dock = sorted((round(math.dist(places[dock], places[n])), n) for n in lane if n != dock)
                for d, n in near_dock[:3]:
                    pairs += [p for p in ((dock, n), (n, dock)) if d < 2.0 * FAR_M and p not in known]
            known.update(pairs)
            self.rolls(pairs, most=3.0 * FAR_M)
        self._ways_in(g, outs, known)
        if not self.groups[g].is_cart:
            self._corners(g)
            self._dead_ends(g)

    def _dead_ends(self, g: int) -> None:
        """From ends of passes before a hole: back along them, to turn into a pass beside that is cut or, with
        the whole of it behind, back in a bend onto a lane.
        """
        spec, holes = self.groups[g].spec, self.ground.holes
        if holes.is_empty or spec.drive.backwards <= 0.0:
            return
        own = [c for c in self.chains if c.group == g and not c.is_headland]
        lanes = [n for lane in self.flows[g] for n in lane]
        flipped = np.array([0.0, 0.0, math.pi])
        for c in own:
            end = self.nodes[c.nodes[-1]][1]
            if holes.distance(shapely.Point(end[:2])) > AT_HOLE_M:
                continue
            beside = [
                n for o in own if o.number != c.number for n in o.nodes
                if math.dist(self.nodes[n][1][:2], end[:2]) < FAR_M
                and math.cos(self.nodes[n][1].heading - end.heading) < 0.0
            ]  # fmt: skip
            for far in BACK_M:
                if far < c.task.length - 2.0:
                    n = self._back(g, c.nodes[-1], far)
                    pairs = [(n, b) for b in (*beside, *lanes)] if n >= 0 else []
                    rows = sorted(zip(self._far(g, pairs).tolist(), pairs, strict=True))
                    self.rolls([p for d, p in rows[:8] if d < FAR_M])
            n = self._back(g, c.nodes[-1], c.task.length)
            if n < 0:
                continue
            start = self.nodes[n][1]
            near = [b for b in lanes if math.dist(self.nodes[b][1][:2], start[:2]) < FAR_M]
            goals = np.array([self.nodes[b][1][:3] for b in near]).reshape(-1, 3) + flipped
            turns = shortest_turns(
                np.array([start[:3]] * len(near)).reshape(-1, 3) + flipped, goals, spec.drive
            )
            rows = sorted((math.fsum(d for _, d in t), b, t) for b, t in zip(near, turns, strict=True) if t)
            for far, b, pieces in rows[:8]:
                if far < FAR_M:
                    e = self.edge(n, b, g, driven(start, [(-k, -d) for k, d in pieces], spec.body), "way")
                    self.edges[e].spent += 2.0 * spec.drive.shift * (e >= 0)

    def _back(self, g: int, a: int, far: float) -> int:
        """Straight back from a node [m]; the node there, -1 where there is no room."""
        drive, body = self.groups[g].spec.drive, self.groups[g].body
        back = driven(self.nodes[a][1], [(0.0, -far)], body)
        n = self.node(g, back.end)
        e = self.edge(a, n, g, back, "way")
        if e < 0:
            return -1
        self.edges[e].spent += 2.0 * drive.shift
        return n

    def _ways_in(self, g: int, outs: list[int], known: set[tuple[int, int]]) -> None:
        """Turns to where a round is begun, past standing crop."""
        crop = self.standing
        heads = [c for c in self.chains if c.group == g and c.is_headland]
        starts = dict.fromkeys(
            n
            for c in heads
            for n in (c.nodes[0], self.backed.get(c.nodes[0], -1), *(self.edges[e].a for e in c.openings))
            if n >= 0
        )
        for b in starts:
            rows = sorted((self._turn_m(a, b), a) for a in outs if a != b)
            pairs = [(a, b) for far, a in rows[:14] if far < FAR_M and (a, b) not in known]
            self._roll_clear(g, pairs, crop, 3)
        outside = [n for n in sorted(self.outside) if self.nodes[n][0] == g]
        for c in heads:
            flows = outside + [n for o in heads if o.task.land < c.task.land for n in o.nodes]
            cut = [*c.cells, *(i for i, r in enumerate(self.round) if 0 <= r < c.task.land)]
            rest = shapely.difference(
                crop, shapely.union_all([self.crop[i] for i in cut]).buffer(2.0 * NEED_M)
            )
            shapely.prepare(rest)
            for far in BACK_M:
                if far > c.task.length - 2.0:
                    continue
                n = self._back(g, c.nodes[-1], far)
                if n < 0:
                    continue
                rows = sorted((self._turn_m(n, b), b) for b in flows if b != n)
                self._roll_clear(g, [(n, b) for d, b in rows[:14] if d < FAR_M], rest, 2)

    def _corners(self, g: int) -> None:
        """From the end of a headland pass to where one begins about a corner: on, back in a bend, and on."""
        spec = self.groups[g].spec
        if spec.drive.backwards <= 0.0:
            return
        heads = [c for c in self.chains if c.group == g and c.is_headland]
        pairs: dict[tuple[int, int], list[tuple[float, float]]] = {}
        for a in heads:
            end = self.nodes[a.nodes[-1]][1]
            for b in heads:
                start = self.nodes[b.nodes[0]][1]
                turned = abs(math.remainder(start.heading - end.heading, 2.0 * math.pi))
                if a.number != b.number and math.dist(end[:2], start[:2]) < CORNER_M and 0.5 < turned < 2.7:
                    pairs[a.nodes[-1], b.nodes[0]] = [(f, h) for f in ON_M for h in ON_M]
        rows = [(a, b, f, h) for (a, b), each in pairs.items() for f, h in each]
        if not rows:
            return
        begins = np.array([self.nodes[a][1].ahead(f)[:3] for a, _, f, _ in rows])
        goals = np.array([self.nodes[b][1].ahead(-h)[:3] for _, b, _, h in rows])
        for is_back in (True, False):
            found: dict[tuple[int, int], list[tuple[float, list[tuple[float, float]]]]] = {}
            way, flipped = (-1, math.pi) if is_back else (1, 0.0)
            turned = np.array([0.0, 0.0, flipped])
            turns = shortest_turns(begins + turned, goals + turned, spec.drive)
            for (a, b, f, h), pieces in zip(rows, turns, strict=True):
                bend = math.fsum(abs(k * d) for k, d in pieces)
                if pieces and (not is_back or bend < 3.2):
                    far = math.fsum(d for _, d in pieces)
                    whole = [(0.0, f), *((way * k, way * d) for k, d in pieces), (0.0, h)]
                    speed = spec.drive.backwards if is_back else spec.drive.turning
                    time = (f + h) / spec.drive.turning + far / speed
                    found.setdefault((a, b), []).append((time, [p for p in whole if abs(p[1]) > 1e-9]))
            for (a, b), ways in found.items():
                made = 0
                for _, pieces in sorted(ways)[:6]:
                    e = self.edge(a, b, g, driven(self.nodes[a][1], pieces, spec.body), "way")
                    if e >= 0:
                        self.edges[e].spent += 4.0 * spec.drive.shift * is_back
                        made += 1
                    if made == 3:
                        break

    def _roll_clear(self, g: int, pairs: list[tuple[int, int]], crop: Any, most: int) -> None:
        """The fastest turns that keep off crop."""
        body = self.groups[g].body
        kept, first = [], len(self.edges)
        self.rolls(pairs, most=1.5 * FAR_M)
        for e in sorted(self.edges[first:], key=lambda e: e.spent):
            parts = e.path.swept[:]
            own = [i for i in range(parts.shape[1]) if i != body.raised]
            if len(kept) < most and not shapely.intersects(crop, parts[:, own]).any():
                kept.append(e)
        self.edges[first:] = kept

    # what meets
    def _index(self) -> None:
        """Arrays of the graph, conflicts of all resources, and the crop that each needs cut."""
        paths = [e.path for e in self.edges]
        self.stands = [standing(p, _rough(self.groups[g].body), 0.0, "stands") for g, p in self.nodes]
        every = [*paths, *self.stands]
        count = len(every)
        pairs = self._pairs(every)
        self.conflicts = _rows(pairs, count)
        tree = shapely.STRtree(self.crop)
        shapes, of = [], []
        for r, path in enumerate(every):
            g = self.edges[r].group if r < len(paths) else self.nodes[r - len(paths)][0]
            body = self.groups[g].body
            parts = path.swept[:]
            keep = [i for i in range(parts.shape[1]) if i != body.raised]
            shapes += parts[:, keep].ravel().tolist()
            of += [r] * (len(keep) * len(parts))
        s, c = tree.query(shapes, predicate="intersects")
        need = np.unique(np.column_stack([np.array(of)[s], c]), axis=0)
        self.needs = _rows(need, count)

    def _pairs(self, every: list[Path]) -> Any:
        """Resources that meet; a trailer that stands, or comes beside, is not yet in line, but for who cuts
        there.
        """
        wide, cuts = [p.swept for p in every], np.zeros(len(every), bool)
        for r, e in enumerate(self.edges):
            body = self.groups[e.group].body
            cuts[r] = e.what == "cut"
            if e.what == "beside":
                wide[r] = segments(e.track, e.track.distance, _rough(body, STAND_M), "").swept
        for n, (g, p) in enumerate(self.nodes):
            wide[len(self.edges) + n] = standing(p, _rough(self.groups[g].body, STAND_M), 0.0, "").swept
        for chain in self.chains:
            cuts[[len(self.edges) + n for n in chain.nodes]] = True
        pairs, strict = _met(wide), _met([p.swept for p in every])
        far = pairs[~cuts[pairs].any(axis=1)]
        keys = np.sort(np.concatenate([strict, far]) @ np.array([len(every), 1]))
        keys = keys[np.diff(keys, prepend=-1) > 0]
        return np.column_stack([keys // len(every), keys % len(every)])


def _rough(body: Body, more: float = 0.0) -> Body:
    """A body whose trailer is one rectangle, wider by so much [m], as it is not in line in turns."""
    if not body.towed:
        return body
    rear, front, right, left = zip(*body.towed, strict=True)
    return replace(body, towed=(Rectangle(min(rear), max(front), min(right) - more, max(left) + more),))


def _met(each: list[Swept]) -> Any:
    """All pairs of what sweeps the same ground, each with itself, in order, (n, 2)."""
    from benchmarks.fleet_graph import kernel

    low = np.array([s.boxes[:, :2].min(axis=0) for s in each])
    high = np.array([s.boxes[:, 2:].max(axis=0) for s in each])
    order = np.argsort(low[:, 0], kind="stable")
    own = [each[i] for i in order.tolist()]
    points = np.concatenate([s.points[: s.starts[-1]] for s in own])
    shift = np.cumsum([0, *(s.starts[-1] for s in own)])
    starts = np.concatenate([*(s.starts[:-1] + n for s, n in zip(own, shift[:-1], strict=True)), shift[-1:]])
    ends = np.minimum.reduceat(points, starts[:-1]), np.maximum.reduceat(points, starts[:-1])
    first = np.cumsum([0, *(len(s.starts) - 1 for s in own)])
    most = 1 << 21
    while True:
        found = np.zeros(2 * most + 1, np.int32)
        its = filled(
            kernel.Met, numbers=np.array([len(own), most], float), points=points.ravel(),
            starts=starts.astype(np.int32), first=first.astype(np.int32),
            boxes=np.hstack([low, high])[order].ravel(), parts=np.hstack(ends).ravel(), found=found,
        )  # fmt: skip
        launch(kernel.meet, its)
        if found[0] <= most:
            break
        most = int(found[0]) + 1
    one, two = order[found[1 : 1 + 2 * found[0]].reshape(-1, 2).T.astype(np.int64)]
    same, count = np.arange(len(own)), len(own)
    keys = np.sort(np.concatenate([one * count + two, two * count + one, same * (count + 1)]))
    return np.column_stack([keys // count, keys % count])


def _rows(pairs: Any, count: int) -> tuple[Any, Any]:
    """Pairs in order of the first as begins (count + 1,) and the others."""
    begins = np.searchsorted(pairs[:, 0], np.arange(count + 1)).astype(np.int32)
    return begins, np.ascontiguousarray(pairs[:, 1], np.int32)


def _part(track: Track, first: int, last: int) -> Track:
    distance = track.distance[first : last + 1] - track.distance[first]
    return Track(track.places[first : last + 1], distance, track.ways[first:last], track.bends[first:last])


def _spread(ring: Any, gate: tuple[float, float]) -> list[Place]:
    """Poses along a ring, about `NODE_M` apart, from the place nearest to the gate on."""
    first = ring.project(shapely.Point(gate))
    count = max(4, round(ring.length / NODE_M))
    out = []
    for i in range(count):
        at = (first + ring.length * i / count) % ring.length
        before, here, ahead = (ring.interpolate((at + d) % ring.length).coords[0] for d in (-6.0, 0.0, 6.0))
        h = math.atan2(ahead[1] - before[1], ahead[0] - before[0])
        out.append(Place(*here, h, h))
    return out
