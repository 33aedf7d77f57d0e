"""The schedule of a job: what each machine does when, on ground that is granted to it alone.

The combine that is free first is next: its way to its next pass is searched on ground that is cut by then,
a dispatcher takes one of the things it could do, and its path and that of the cart it meets are granted at
the first times at which they meet nobody. All that is granted to a cart ends at its waiting place off all
ways, so that it is never in the way of what comes later. Its way there from a load is taken back when it is
needed again: it waits in the field then, and sets out in time. A combine that meets one that stands lets that
one go first; where all do, one makes room.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice, pairwise
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.fleet.dispatcher import Ahead, Dispatcher, Option, State, dispatcher_of
from swath.fleet.files import JobFile
from swath.fleet.ground import CELL, Ground, run_of, shapely_here
from swath.fleet.ground import PARAMS as GROUND
from swath.fleet.machines import PARAMS as GAPS
from swath.fleet.machines import Cart, Combine, Drive, Machines, Place, beside, body_of, machines_of
from swath.fleet.plan import CLEAN, HEADLAND, SLIVER, Pass, Plan, plan_of, strip_of, strips_along, track_along
from swath.fleet.plan import PARAMS as PLAN
from swath.fleet.table import PARAMS as TABLE
from swath.fleet.table import Path, Table, segments, standing
from swath.fleet.ways import PARAMS as WAYS
from swath.fleet.ways import Far, Finder, Track, abreast, behind, driven, spent_along, times_along
from swath.fleet.yard import PARAMS as YARD
from swath.fleet.yard import WIDE, Home, Waits, along_passes, service_places, waiting_places

Array = NDArray[np.float64]
LEFT_KG = 1e-6  # of grain, that is none


@dataclass(frozen=True)
class Params:
    """cut_m: longest segment of a pass, a third of it in bends; joins: how far off [m, rad] a pass may begin
    that is gone on to without a way; align_s: until a cart that has come beside is in line; tries: passes
    that are looked at, the nearest first; poses: of a search, more do not shorten the hours of drawn
    fields; few: of carts that can come first, and of places to come beside at; soon_s:
    within which a machine stands that a way leads around; part: of a tank, up to which a combine begins a
    pass that its tank does not take; long_s: beside cutting, from where on it may be emptied before
    instead, and more cost of a place at which nobody could be emptied; behind: share in the cost of a
    place of a cart's way to the truck, which keeps nobody waiting; saves_s: less than which is no reason
    to look at another pass; out_percent: of the field that is left where no way leads; load: of a tank,
    or all but that of the room in a box, less than which nobody comes beside for; lags: behind the best
    plan, share of its time, at which another one is given up. Estimates.
    """

    cut_m: float = 8.0
    joins: tuple[float, float] = (0.01, 0.002)
    align_s: float = 10.0
    tries: int = 4
    poses: int = 24_000
    few: int = 2
    soon_s: float = 30.0
    part: float = 0.5
    long_s: float = 90.0
    behind: float = 0.25
    saves_s: float = 20.0
    out_percent: float = 0.5
    load: float = 0.1
    lags: float = 0.04

    @property
    def places(self) -> int:
        """To pour at, that are looked at, and `tries` times as many before anybody makes room; as often
        others are granted something at most before who can do nothing looks again.
        """
        return 2 * self.tries


PARAMS = Params()


@dataclass
class CombineState:
    """A combine in the schedule.

    place, time: where and when it is free [m, s]
    tank: grain in its tank [kg]
    home: its waiting place
    todo: its own passes
    """

    spec: Combine
    place: Place
    home: Place
    todo: list[Pass]
    time: float = 0.0
    tank: float = 0.0
    is_done: bool = False


class Start(NamedTuple):
    """Where a cart sets out from, from when on [s]; behind: the segment behind which its way home is taken
    back then, -1 if it is at home.
    """

    place: Place
    time: float
    behind: int = -1


@dataclass
class CartState:
    """home: its waiting place, where it is again at a time [s]; load [kg]; loaded: at its last load, while it
    need not go home from there.
    """

    spec: Cart
    home: Place
    time: float = 0.0
    load: float = 0.0
    loaded: Start | None = None

    @property
    def starts(self) -> list[Start]:
        """Places from which it may set out, the earliest first."""
        home = Start(self.home, self.time)
        return [home] if self.loaded is None else [self.loaded, home]

    @property
    def room(self) -> float:
        """Room that is left in its box [kg]."""
        return self.spec.load - self.load

    @property
    def leaves(self) -> float:
        """Least load that is worth the way to the truck [kg]."""
        return min(self.spec.leave, (1.0 - PARAMS.load) * self.spec.load)


@dataclass
class _Trip:
    """What a cart is about to do: set out from a start to another machine, along a path; exact, after: times
    that are given for its segments, and earliest ones [s].
    """

    cart: CartState
    start: Start
    other: str
    path: Path
    exact: dict[int, float]
    after: dict[int, float]


@dataclass(frozen=True)
class Poured:
    """Grain handed over.

    source, target: machines; amount [kg]; begins, ends [s]
    during: first and last segment of the source in which it is
    """

    source: str
    target: str
    amount: float
    begins: float
    ends: float
    during: tuple[int, int] = (-1, -1)


@dataclass
class Schedule:
    """table: what was granted; poured: grain handed over; cut: machine, kg, m2 of each pass; grain: of each
    segment that is cut [kg]; dock: until who empties is beside the truck and gone; ends: when all grain is
    at the truck [s]; left: crop that no pass took [m2]; plan, machines, ground: of the job.
    """

    plan: Plan
    machines: Machines
    ground: Ground
    table: Table = field(default_factory=Table)
    poured: list[Poured] = field(default_factory=list)
    cut: list[tuple[str, float, float]] = field(default_factory=list)
    grain: dict[int, float] = field(default_factory=dict)
    dock: float = 0.0
    ends: float = 0.0
    notes: list[str] = field(default_factory=list)
    bound: float = 0.0
    compared: list[tuple[str, float]] = field(default_factory=list)
    pace: list[tuple[float, float]] = field(default_factory=list)

    def is_behind(self, best: "Schedule") -> bool:
        """Whether it cannot end before another one, or has lost more time by now than that one had then."""
        left, least = self.pace[-1]
        rows = np.array(best.pace)[::-1]
        crop, last = np.unique(rows[:, 0], return_index=True)  # its last time with so much crop
        its = float(np.interp(left, crop, rows[last, 1]))
        return least >= min(best.ends, its + PARAMS.lags * best.ends)

    def renumber(self, new: Sequence[int]) -> None:
        """Segments have other numbers."""
        self.poured = [replace(p, during=(new[p.during[0]], new[p.during[1]])) for p in self.poured]
        self.grain = {new[n]: kg for n, kg in self.grain.items()}

    @property
    def harvested(self) -> float:
        """Grain cut, and in tanks at the start [kg]."""
        return math.fsum([*(kg for _, kg, _ in self.cut), *(c.start for c in self.machines.combines)])

    @property
    def delivered(self) -> float:
        """Grain at the truck [kg]."""
        return math.fsum(p.amount for p in self.poured if p.target == "truck")


class _Run(NamedTuple):
    """A combine's path along a pass, where its segments end [m], what its header goes over in each, polygons,
    None where there is no room for it, and the grain there [kg/m2].
    """

    path: Path
    marks: Array
    strips: Any
    density: Array


@dataclass
class _Leg:
    """What a combine is about to do: a path, what it cuts of which pass, as driven and as planned, where its
    segments end, and from which on; after: earliest times of segments [s]; lost: see `Scheduler.lost`; lanes:
    of carts beside it, as far as they were looked for; least: way and what is lost, if nobody is in the way
    [s].
    """

    path: Path
    task: Pass
    planned: Pass
    marks: Array
    masses: Array
    density: Array
    strips: Any
    first: int
    after: dict[int, float] = field(default_factory=dict)
    lost: float = 0.0
    lanes: dict[str, tuple[int, int] | None] = field(default_factory=dict)
    least: float = 0.0

    @property
    def cuts(self) -> float:
        """Time of cutting alone [s]."""
        return math.fsum(self.path.spent[self.first :])


class Late(Exception):
    """A plan that falls behind another one."""


def schedule_of(job: JobFile, base: FilePath | None = None, dispatcher: Dispatcher | None = None) -> Schedule:
    """One plan of a job. InputError where the field, or a machine on it, cannot be worked, and why."""
    made = Scheduler(job, base, dispatcher)
    made.run()
    return made.schedule


class Scheduler:
    """Decides one plan of a job.

    dispatcher: by default that of the job
    like: of the same job but for `fleet`, whose passes and waiting places are taken
    """

    def __init__(
        self, job: JobFile, base: FilePath | None, dispatcher: Dispatcher | None = None,
        like: "Scheduler | None" = None,
    ) -> None:  # fmt: skip
        machines = machines_of(job, base)
        ground = Ground(job, body_of(machines.truck))
        self.kept: dict[str, Home]
        self.schedule: Schedule
        plan = like.schedule.plan if like else plan_of(ground, machines.combines, job.plan, job.drawn)
        self.job, self.ground, self.machines = job, ground, machines
        self.dispatcher = dispatcher or dispatcher_of(job.fleet.dispatcher, base, job.fleet.draw)
        self.finder = Finder(ground.grid, min(c.width for c in machines.combines))
        self.kept = like.kept if like else waiting_places(ground, self.finder, self.waits())
        out = [k.name for k in machines.carts if k.name not in self.kept]
        notes = [
            *job.notes,
            *ground.notes,
            *(f"{name} is left out: there is no room for it to wait" for name in out),
        ]
        machines = replace(machines, carts=tuple(k for k in machines.carts if k.name in self.kept))
        self.machines = machines
        self.schedule = Schedule(plan, machines, ground, dock=job.truck.dock_s, notes=notes)
        self.table = self.schedule.table
        self.rests: dict[str, int] = {}  # grants to others before a combine looks again for what it can do
        self.failed: dict[str, int] = {}  # how often in a row it could do nothing
        self.patience = 1
        self._far: dict[tuple[Drive, Place, bool, int], Far] = {}
        self.dropped = -1  # windows of crop that were cut when passes were last looked through
        volume = job.truck.volume_m3
        self.truck_free, self.truck_kg = 0.0, math.inf if volume is None else volume * machines.density
        self.truck_room = self.truck_kg
        self.trucks = [0.0] * (job.truck.trucks - 1)  # when those that do not stand there are back [s]
        self.filled = 0.0  # when the last grain came into the one that does [s]
        homes = {name: home.place for name, home in self.kept.items()}
        own = {i: [p for p in plan.passes if p.combine == i] for i in range(len(machines.combines))}
        self.combines = [
            CombineState(c, homes[c.name], homes[c.name], own[i], tank=c.start)
            for i, c in enumerate(machines.combines)
        ]
        self.carts = [CartState(k, homes[k.name]) for k in machines.carts]
        self.shared = [p for p in plan.passes if p.combine < 0 and p.kind == HEADLAND]
        self.clean = [p for p in plan.passes if p.kind == CLEAN]
        for c in self.combines:
            self.table.stand(c.spec.name, standing(c.home, c.spec.body, 0.0, "home"))
        for k in self.carts:
            self.table.stand(k.spec.name, standing(k.home, k.spec.body, 0.0, "home"))
        self.homes = {k.spec.name: run_of(k.spec.body, k.home, 0.0, WIDE) for k in self.carts}
        self.places = list(self.service_places())
        # of each combine along the passes that it may cut next, see `run_along`
        self.runs: dict[str, dict[Pass, _Run]] = {}
        self.vain: dict[Place, int] = {}  # how often in a row nobody could be emptied there
        self.inner = list(along_passes(plan)) if self.carts else []
        self.lands: Any = None  # where no tank is emptied
        if job.plan.unload == "headland":
            rounds = [strip_of(p) for p in plan.passes if p.kind == HEADLAND]
            self.lands = shapely_here().difference(ground.field, shapely_here().union_all(rounds))

    def service_places(self) -> Iterator[Place]:
        """Where a combine can stand, with a cart beside it if there are any, outside of the crop and off all
        who wait.
        """
        homes = [(w.body, self.kept[w.name].place) for w in self.waits()]
        docks = [(w.body, w.dock) for w in self.waits() if w.dock is not None]
        c = max(self.machines.combines, key=lambda c: c.width)
        if not self.carts:
            return service_places(self.ground, c.body, c.body, (0.0, 0.0), homes + docks)
        k = max(self.machines.carts, key=lambda k: k.body.half_width)
        return service_places(self.ground, c.body, k.body, beside(c, k), homes + docks)

    def waits(self) -> list[Waits]:
        """All machines that move, with their places at the truck."""
        carts = self.machines.carts
        combines = [
            Waits(c.name, c.body, c.drive, None if carts else self.combine_dock(c))
            for c in self.machines.combines
        ]
        return combines + [Waits(k.name, k.body, k.drive, self.cart_dock(k)) for k in carts]

    def cart_dock(self, cart: Cart) -> Place:
        """Where a cart empties into the truck."""
        return self.ground.dock.ahead(-cart.box_x)

    def combine_dock(self, combine: Combine) -> Place:
        """Where a combine empties into the truck, which stands under its pipe."""
        box = self.machines.truck.box
        assert box is not None
        return self.ground.truck_place.ahead(box.x - combine.pipe_x, -combine.pipe_y)

    # the job
    def run(self, best: Schedule | None = None) -> None:
        """Until all is cut and at the truck. Late where that is not before the best plan so far, or where it
        falls behind.
        """
        room = 0
        while any(not c.is_done for c in self.combines):
            self.schedule.pace.append((float(self.ground.remaining.area), self.least_end()))
            if best is not None and self.schedule.is_behind(best):
                raise Late
            for k in self.carts:  # who came home with its load, since the way to the truck was not free
                if k.load >= k.leaves:
                    self.empties(k)
            busy = sorted((c for c in self.combines if not c.is_done), key=lambda c: c.time)
            late = busy[::-1]  # where nobody can go on, who stands longest is in the way of those before
            if self.goes_on(busy) or self.goes_on(late, patience=PARAMS.tries):
                room = 0
                continue
            if self.waits_for_all(busy):
                continue
            if room > 2 * len(self.combines) or not self.makes_room(room):
                room = -1
                self.leave_out(busy)
            room += 1
        for k in sorted(self.carts, key=lambda k: k.starts[0].time):
            room = 0
            while k.load > LEFT_KG and not self.empties(k):
                if room > 2 * len(self.combines) or not self.makes_room(room):
                    raise InputError(
                        "carts", k.spec.name, "expected a way from its waiting place to the truck"
                    )
                room += 1
                k.time = max(k.time, *(c.time for c in self.combines))
        for c in self.combines:
            self.goes_home(c)
        self.schedule.ends = max((p.ends for p in self.schedule.poured if p.target == "truck"), default=0.0)
        self.schedule.renumber(self.table.clear())

    def least_end(self) -> float:
        """Before which what is left cannot be cut [s], with all combines in it from when they are free on."""
        power = [c.spec.width * c.spec.speed for c in self.combines]
        given = math.fsum(p * c.time for p, c in zip(power, self.combines, strict=True))
        return (given + float(self.ground.remaining.area) - self.schedule.plan.left) / math.fsum(power)

    def goes_on(self, busy: Sequence[CombineState], patience: int = 1) -> bool:
        """One combine does its next thing, who is free first; who could do nothing looks again when others
        have done something, less and less often. patience: how much more they look at.
        """
        self.patience = patience
        for c in sorted(busy, key=lambda c: self.rests.get(c.spec.name, 0) > 0):
            name = c.spec.name
            if self.turn(c):
                self.rests = {n: k - 1 for n, k in self.rests.items() if n != name}
                self.failed.pop(name, None)
                return True
            self.failed[name] = self.failed.get(name, 0) + 1
            self.rests[name] = min(2 ** self.failed[name], PARAMS.places) - 1
        return False

    def waits_for_all(self, busy: Sequence[CombineState]) -> bool:
        """Combines stand until all that is granted is done, and the ground of it cut; False where they do."""
        late = self.late()
        early = [c for c in busy if c.time < late]
        for c in early:
            c.time = late
        return bool(early)

    def makes_room(self, turn: int) -> bool:
        """A combine drives where it is not in the way, another one each time; False where none can."""
        there = sorted(self.combines, key=lambda c: (c.place == c.home, c.time))
        turn %= len(there)
        return any(self.goes_home(c, off=c.place == c.home) for c in there[turn:] + there[:turn])

    def leave_out(self, busy: Sequence[CombineState]) -> None:
        """Passes to which nobody finds a way stay uncut, with a note, as long as they are few."""
        passes = [p for todo in self.todo() for p in todo]
        crop = self.ground.crop_in(np.array([strip_of(p) for p in passes])).sum() if passes else math.inf
        if crop > PARAMS.out_percent / 100.0 * self.ground.field.area:
            raise self.stuck(busy)
        for todo in self.todo():
            todo.clear()
        self.schedule.notes.append(
            f"{len(passes)} passes, {num(crop)} m2, left uncut: there is no way to them"
        )

    def stuck(self, busy: Sequence[CombineState]) -> InputError:
        """What stands where, when no machine can go on."""
        where = ", ".join(
            f"{c.spec.name} at ({num(c.place.x)}, {num(c.place.y)}) in the field's frame" for c in busy
        )
        expected = f"expected ground on which machines find a way; {self.left} passes left, {where}"
        return InputError("field.around_m", self.job.field.around_m, expected)

    def turn(self, c: CombineState) -> bool:
        """The next thing of a combine; False where it has to wait for others."""
        legs = self.next_legs(c)
        if legs is None:
            if c.tank > LEFT_KG:
                return self.takes(c, list(self.emptied(c)))
            waits = any(self.fits(c, p) for p in self.clean)  # until others have cut what is before that
            if waits and (self.carts or c.place == c.home):
                return False
            is_off = bool(self.carts) or self.goes_home(c)  # it stands in the field until carts have emptied
            c.is_done = is_off and not waits
            return is_off
        options = self.first(c, legs, self.cuts)
        spent = min((o.ends - o.cuts for o, _ in options), default=math.inf) - c.time
        if c.tank > LEFT_KG and spent > PARAMS.long_s + c.tank / c.spec.auger:
            options += self.emptied(c)
        if not options:
            options = self.first(c, legs, partial(self.cuts_part, anywhere=True))
        if not options and self.last_of(c.spec.name).kind == "at truck":
            return self.goes_home(c)  # others come to the truck
        return self.takes(c, options)

    def first(
        self, c: CombineState, legs: Sequence[_Leg],
        options_on: Callable[[CombineState, _Leg], Iterator[tuple[Option, Any]]],
    ) -> list[tuple[Option, Any]]:  # fmt: skip
        """What can be done on the first leg on which anything can, and on others of its kind that may save
        time; each on ground that is cut now, and on what is cut when all have done what is granted to them.
        """
        options: list[tuple[Option, Any]] = []
        spent, kind = math.inf, ""
        moments = self.moments(c)
        for leg in legs:
            length = math.nan
            for time in moments:
                if options and (leg.task.kind != kind or leg.least + PARAMS.saves_s > spent):
                    return options
                found = self.with_way(c, leg, time)
                if found is None or abs(found.path.track.length - length) < 0.1:
                    continue
                length, kind = found.path.track.length, leg.task.kind
                options += options_on(c, found)
                spent = min((o.ends - o.cuts - c.time for o, _ in options), default=math.inf)
        return options

    def takes(self, c: CombineState, options: list[tuple[Option, Any]]) -> bool:
        """What the dispatcher decides, granted; False where there is nothing to decide."""
        if not options:
            return False
        chosen = self.dispatcher.decide(self.state(c, tuple(o for o, _ in options)))
        if chosen is None and self.may_wait(c):
            return False
        for option, grant in options:
            if option is chosen:
                grant()
                return True
        raise InputError("fleet.dispatcher", str(chosen), "expected one of the options of the state")

    def state(self, c: CombineState, options: tuple[Option, ...]) -> State:
        """What a dispatcher knows."""
        carts = {k.spec.name: (k.starts[0].time, k.room) for k in self.carts}
        others = {
            o.spec.name: Ahead(o.time, o.tank, o.spec.tank, self.fills(o))
            for o in self.combines
            if o is not c and not o.is_done
        }
        comes = {k.spec.name: self.comes(k, c) for k in self.carts}
        far = math.dist(c.place[:2], self.ground.dock[:2])
        ways = {k.spec.name: far / k.spec.drive.straight for k in self.carts}
        at_truck = {k.spec.name: self.job.truck.dock_s + k.spec.leave / k.spec.out for k in self.carts}
        boxes = {k.spec.name: (k.spec.load, k.leaves) for k in self.carts}
        places = {o.spec.name: o.place[:2] for o in self.combines}
        places |= {k.spec.name: k.starts[0].place[:2] for k in self.carts}
        return State(
            c.time, c.spec.name, c.tank, c.spec.tank, c.spec.call, carts, self.left, options, self.fills(c),
            others, comes, ways, at_truck, boxes, places, self.soonest(c), self.may_wait(c),
        )  # fmt: skip

    def may_wait(self, c: CombineState) -> bool:
        """Whether a combine may let others go first: one that did not since it was given something."""
        return not self.failed.get(c.spec.name) and any(o is not c and not o.is_done for o in self.combines)

    def fills(self, c: CombineState) -> float:
        """Grain that a combine cuts in a pass [kg/s], 0 where none is left for it."""
        passes = self.candidates(c)
        if not passes:
            return 0.0
        grain = float(self.ground.density(np.array([strip_of(passes[0])]))[0]) * c.spec.width
        return grain * c.spec.speed_in(grain)

    def soonest(self, c: CombineState) -> dict[str, float]:
        """Least time until a combine could do an option of a kind, if nobody was in the way [s]."""
        ends = [end for p in self.candidates(c) for end in (p.start, p.end)]
        cut = min((math.dist(end, c.place[:2]) for end in ends), default=0.0) / c.spec.drive.straight
        cart = min((self.comes(k, c) for k in self.likely(c)), default=c.time) - c.time
        truck = math.dist(self.ground.dock[:2], c.place[:2]) / c.spec.drive.straight
        return {"cut": cut, "beside": cart, "stand": cart, "truck": truck}

    # passes
    def todo(self) -> tuple[list[Pass], ...]:
        """Lists of all passes that are left."""
        return self.shared, self.clean, *(c.todo for c in self.combines)

    @property
    def tries(self) -> int:
        """Passes of a kind that a combine looks at."""
        return PARAMS.tries * self.patience

    @property
    def left(self) -> int:
        """Passes that are left."""
        return sum(len(passes) for passes in self.todo())

    def candidates(self, c: CombineState) -> list[Pass]:
        """Passes that a combine may cut next, the best first: headland, its own, others' lands, the rest."""
        low = min((p.land for p in self.shared), default=0)
        first = self.nearest(c, [p for p in self.shared if p.land == low]) + c.todo[: self.tries]
        if c.todo:
            return first
        others = sorted((o for o in self.combines if len(o.todo) > 1), key=lambda o: -len(o.todo))
        for other in others:
            fits = [p for p in reversed(other.todo) if self.fits(c, p)]
            if fits:
                return first + fits[: self.tries]
        if first or any(o.todo for o in self.combines):
            return first
        return self.nearest(c, [p for p in self.clean if self.fits(c, p)])

    @staticmethod
    def fits(c: CombineState, task: Pass) -> bool:
        """Whether a combine's header takes a pass."""
        return task.width <= c.spec.width + 1e-6

    def drop_empty(self) -> None:
        """Passes whose crop others have cut are no longer to be driven."""
        if self.dropped == len(self.ground.grid.changed):
            return
        self.dropped = len(self.ground.grid.changed)
        for todo in self.todo():
            todo[:] = [p for p in todo if self.ground.crop_on(p, np.array([strip_of(p)]))[0] > PLAN.least_m2]

    def nearest(self, c: CombineState, passes: list[Pass]) -> list[Pass]:
        """Passes by how far off their starts are."""
        here = c.place.x, c.place.y
        return sorted(passes, key=lambda p: (round(math.dist(here, p.start), 2), p.start))[: self.tries]

    def next_legs(self, c: CombineState) -> list[_Leg] | None:
        """Next passes without ways to them: headland first, then those first that cost the least time beside
        that of cutting; None where nothing is left for it.
        """
        self.drop_empty()
        passes = self.candidates(c)
        if not passes:
            return None
        reach = self.reach(c)
        cuts: list[tuple[bool, float, int, _Leg]] = []
        known = self.runs.get(c.spec.name, {})
        tasks = [(p, self.begun(c.spec, task)) for p in passes for task in (p, p.reversed())]
        self.runs[c.spec.name] = {task: known[task] for _, task in tasks if task in known}
        for planned, task in tasks:
            leg = self.only_cut(c, planned, task)
            if leg is not None:
                way = reach(leg.path.track.start) / c.spec.drive.straight
                leg.least = way + leg.lost
                cuts.append((task.kind != HEADLAND, round(leg.least, 0), len(cuts), leg))
        return [leg for *_, leg in sorted(cuts, key=lambda cut: cut[:3])]

    def moments(self, c: CombineState) -> list[float]:
        """When a combine may set out: now, or when all have done what is granted to them."""
        late = self.late()
        return [c.time] if late <= c.time else [c.time, late]

    def late(self) -> float:
        """When all have done what is granted to them."""
        return float(max(self.last_of(name).into for name in self.names()))

    def begun(self, c: Combine, task: Pass) -> Pass:
        """A pass that begins as much earlier as crop stands between a body and its header; behind that it
        opens the way to it straight from ground without crop, where there is some near.
        """
        back, body = c.knife - c.body.own[0].front, c.body.own[0].left - c.body.own[0].right
        start = Place(*task.start, task.heading, task.heading)
        opens = PLAN.opens_m if task.via else back
        far = np.arange(math.ceil(opens / back) + 1) * -back
        marks = [start.ahead(d)[:2] for d in far.tolist()]
        between = [Pass(b, a, body, task.kind) for a, b in pairwise(marks)]
        crop = self.ground.crop_on((c.name, between[0]), np.array([strip_of(p) for p in between]))
        if crop[0] <= SLIVER:
            return task
        clear = np.flatnonzero(crop <= SLIVER)
        return replace(task, start=marks[clear[0] if len(clear) else 1])

    def only_cut(self, c: CombineState, planned: Pass, task: Pass) -> _Leg | None:
        """A pass alone; None where a combine can do nothing on it."""
        runs = self.runs[c.spec.name]
        if task not in runs:
            runs[task] = self.run_along(c.spec, task)
        cut, marks, strips, density = runs[task]
        if strips is None:
            return None
        masses = self.ground.crop_on((c.spec.name, task), strips) * density
        length = np.diff(marks)
        speed = [c.spec.speed_in(kg) for kg in (masses / length).tolist()]
        cut = replace(cut, spent=np.maximum(cut.spent, length / np.array(speed)))
        leg = _Leg(cut, task, planned, marks, masses, density, strips, 0)
        leg.lost = self.lost(c, leg) + (task.length - planned.length) / c.spec.speed
        return leg if math.isfinite(leg.lost) else None

    def run_along(self, c: Combine, task: Pass) -> _Run:
        """A pass as a combine drives it, as fast as its bends are driven."""
        track = track_along(task, c)
        marks = _marks(track)
        cut = segments(track, track.distance, c.body, "cut", marks)
        cut.spent = spent_along(track, c.drive, cut.first, cut.last)
        is_open = shapely_here().contains(self.ground.rough, cut.swept[:]).all()
        strips = strips_along(track, c.width, c.knife, marks)
        return _Run(cut, marks, strips if is_open else None, self.ground.density(strips))

    def with_way(self, c: CombineState, cut: _Leg, time: float) -> _Leg | None:
        """A pass and the way to it, searched on ground that is cut by a time and driven as that is cut."""
        place = cut.path.track.start
        path = self.way(c.spec, c.place, place, time, "way")
        if path is None:
            return None
        after = self.cut_by(path, c.time, time)
        return replace(cut, path=path.then(cut.path), first=len(path), after=after)

    def lost(self, c: CombineState, cut: _Leg) -> float:
        """Time that is lost on a pass beside which no cart can come: until its grain is poured out standing
        [s]; infinite where the tank does not take it either.
        """
        grain = c.tank + math.fsum(cut.masses)
        if grain < c.spec.call:
            return 0.0
        lanes = (self.free_lane(c, k, cut) for k in self.likely(c))
        if self.may_pour(cut.task) and any(lane is not None for lane in lanes):
            return 0.0
        if grain <= c.spec.tank + LEFT_KG or self.is_for_part(c):
            return min(grain, c.spec.tank) / c.spec.auger
        return math.inf

    def may_pour(self, task: Pass) -> bool:
        """Whether a tank may be emptied on a pass."""
        return self.lands is None or task.kind == HEADLAND

    @staticmethod
    def is_for_part(c: CombineState) -> bool:
        """Whether a combine whose tank does not take a pass cuts a part of it."""
        return c.tank < PARAMS.part * c.spec.tank

    def way(
        self, m: Combine | Cart, start: Place, goal: Place, time: float, kind: str, beside: str = "",
        line_deg: float = WAYS.line_deg,
    ) -> Path | None:  # fmt: skip
        """A way around waiting places of others and what stands then or soon.

        beside: who may be near, as those that are near at the start; line_deg: of a trailer at the end
        """
        way = self.track(m, start, goal, time, beside, line_deg if m.body.has_trailer else 0.0)
        return None if way is None else segments(way, times_along(way, m.drive), m.body, kind)

    def track(
        self, m: Combine | Cart, start: Place, goal: Place, time: float, beside: str, line: float
    ) -> Track | None:
        """The same as a track."""
        name, body, drive, none = m.name, m.body, m.drive, driven(start, [(0.0, 1e-3)], m.body)
        turned = abs(2.0 * math.sin(0.5 * (start.heading - goal.heading)))
        if math.dist(start[:2], goal[:2]) < PARAMS.joins[0] and turned < PARAMS.joins[1]:
            return none
        shapes = [home for o, home in self.homes.items() if o != name]
        near: list[Any] = []
        own = run_of(body, start, 0.0)
        for other in self.names():
            s = self.last_of(other)
            if other != name and (other == beside or s.into < time + PARAMS.soon_s):
                wide = [p.buffer(CELL, join_style="mitre") for p in s.path.swept[s.index]]
                is_near = other == beside or shapely_here().intersects(own, wide).any()
                if is_near:
                    near += [p.buffer(GAPS.near_m, join_style="mitre") for p in s.path.swept[s.index]]
                else:
                    shapes += wide
        came = None if body.has_trailer else partial(self.table.cut_to, name, start)
        find = partial(
            self.finder.find, body, drive, start, stand=shapes, near=near, time=time, most=PARAMS.poses,
            came=came,
        )  # fmt: skip
        kept, looked = self.kept[name], False
        for way, area in zip(kept.ways, kept.areas, strict=True):
            begins, ends = (math.dist(a[:2], b[:2]) < 0.01 for a, b in ((start, way.start), (goal, way.end)))
            if not ends or shapely_here().intersects(area, [*shapes, *near]).any():
                continue
            if begins:
                return behind(none, way, body)
            is_far = math.dist(start[:2], way.places[0, :2]) > GROUND.yard_m
            if is_far and not looked:  # up to the gate, then as kept
                first, looked = find(way.start, in_line=WAYS.line_deg), True
                if first is not None:
                    return behind(first, way, body)
        return find(goal, in_line=line)

    def names(self) -> list[str]:
        """Names of all machines that move."""
        return [c.spec.name for c in self.combines] + [k.spec.name for k in self.carts]

    def last_of(self, name: str) -> Any:
        """The segment that a machine ends in, as far as is known."""
        return self.table.segments[self.table.last[name]]

    # what a combine can do
    def cuts(self, c: CombineState, leg: _Leg) -> Iterator[tuple[Option, Any]]:
        """Cut on: alone where the tank takes it, with carts beside; as much of it as the tank takes."""
        levels = _levels(c, leg)
        meets = self.table.meets(leg.path, c.spec.name)
        times = self.table.earliest(c.spec.name, leg.path, c.time, meets=meets, after=leg.after)
        if times is not None:
            if levels[-1] <= c.spec.tank + LEFT_KG:
                ends = times[-1] + float(leg.path.spent[-1])
                option = Option("cut", "", ends, ends, 0.0, float(levels[-1]), 0.0, 0.0, leg.cuts)
                yield option, lambda: self.grant_cut(c, leg, times, meets)
            if levels[-1] >= c.spec.call and self.may_pour(leg.task):
                for k in self.likely(c):
                    found = self.served(k, partial(self.comes_beside, c, k, leg, levels, meets, times))
                    if found is not None:
                        yield found
        yield from self.cuts_part(c, leg)

    def likely(self, c: CombineState) -> list[CartState]:
        """Carts with room, those that are free first."""
        room = [k for k in self.carts if k.room > PARAMS.load * k.spec.load]
        return sorted(room, key=lambda k: self.comes(k, c))[: PARAMS.few]

    @staticmethod
    def comes(k: CartState, c: CombineState) -> float:
        """When a cart could be where a combine is free, if nobody was in the way [s]."""
        start = k.starts[0]
        far = math.dist(start.place[:2], c.place[:2])
        return max(start.time + far / k.spec.drive.straight, c.time)

    def cuts_part(self, c: CombineState, leg: _Leg, anywhere: bool = False) -> Iterator[tuple[Option, Any]]:
        """As much of a pass as the tank takes, where it does not take all; what is left is a pass of its own.

        anywhere: not only up to where a cart can come beside
        """
        levels = _levels(c, leg)
        count = int(np.searchsorted(levels, c.spec.tank, side="right")) - 1
        if levels[-1] <= c.spec.tank + LEFT_KG or not self.is_for_part(c) or count < 1:
            return
        if not anywhere and self.carts:
            lanes = [self.free_lane(c, k, leg) for k in self.likely(c)]
            if self.may_pour(leg.task) and not any(
                lane is not None and lane[0] < count <= lane[1] for lane in lanes
            ):
                return
        path = leg.path.until(leg.first + count)
        rest = leg.task.behind(*Place(*path.track.places[-1].tolist()).ahead(c.spec.knife)[:2])
        if abs(math.sin(0.5 * (rest.heading - path.track.end.heading))) > PARAMS.joins[1]:
            return  # in a bend
        part = replace(
            leg, path=path, marks=leg.marks[: count + 1], masses=leg.masses[:count],
            density=leg.density[:count], strips=leg.strips[:count],
        )  # fmt: skip
        meets = self.table.meets(path, c.spec.name)
        times = self.table.earliest(c.spec.name, path, c.time, meets=meets, after=leg.after)
        if times is None:
            return
        ends = times[-1] + float(path.spent[-1])
        option = Option("cut", "", ends, ends, 0.0, float(levels[count]), 0.0, 0.0, part.cuts)
        yield option, lambda: self.grant_cut(c, part, times, meets, rest)

    def grant_cut(
        self, c: CombineState, leg: _Leg, times: list[float], meets: Any, rest: Pass | None = None
    ) -> list[int]:
        """A leg as given: its crop is cut, its grain in the tank."""
        numbers = self.table.commit(c.spec.name, leg.path, times, meets)
        into = np.array([*times[leg.first :], times[-1] + float(leg.path.spent[-1])])
        areas = self.ground.cut(leg.strips, into[1:])
        masses = areas * leg.density
        c.tank += float(masses.sum())
        self.schedule.cut.append((c.spec.name, float(masses.sum()), float(areas.sum())))
        self.schedule.grain.update(zip(numbers[leg.first :], masses.tolist(), strict=True))
        c.place, c.time = leg.path.track.end, float(into[-1])
        self._take_off(leg.planned, rest)
        return numbers

    def _take_off(self, task: Pass, rest: Pass | None) -> None:
        """A pass is no longer to be cut; what is left of it is."""
        for todo in self.todo():
            if task in todo:
                i = todo.index(task)
                todo[i : i + 1] = [] if rest is None else [rest]
                return

    @staticmethod
    def served(
        k: CartState, option_from: Callable[[Start], tuple[Option, Any] | None]
    ) -> tuple[Option, Any] | None:
        """What a combine can do with a cart that comes from its last load, or else from its place."""
        return next((found for found in map(option_from, k.starts) if found is not None), None)

    def calls_back(self, start: Start) -> None:
        """A cart's way home is no longer granted."""
        if start.behind >= 0:
            self.table.take_off(start.behind)

    def sets_out(self, k: CartState, start: Start, c: CombineState, goal: Place) -> _Trip | None:
        """A cart's way to beside a combine.

        It is searched on ground that is cut when the combine is free, and driven as soon as its ground is
        cut, so that the cart is there when it is needed.
        """
        late = max(start.time, c.time)
        path = self.way(k.spec, start.place, goal, late, "to combine", c.spec.name, WAYS.line_deg / 3.0)
        if path is None:
            return None
        exact = {}
        if start.behind >= 0:
            path = standing(path.track.start, k.spec.body, 0.0, "in the field").then(path)
            exact[0] = start.time
        return _Trip(k, start, c.spec.name, path, exact, self.cut_by(path, start.time, late))

    def cut_by(self, path: Path, start: float, time: float, first: int = 0) -> dict[int, float]:
        """From when on who starts at a time may be in segments of a path that was searched for a later one
        [s].
        """
        if start >= time:
            return {}
        cut = self.ground.cut_by(path.swept[:], time + float(path.spent.sum()))
        return {first + i: t for i, t in enumerate(cut)}

    def comes_beside(
        self, c: CombineState, k: CartState, leg: _Leg, levels: Array, meets: list[list[int]],
        times: list[float] | None, start: Start,
    ) -> tuple[Option, Any] | None:  # fmt: skip
        """A cart drives beside the combine in its pass, over cut ground, and is poured into.

        meets: who is met on the leg
        times: its first ones [s]
        """
        run = self.free_lane(c, k, leg)
        if run is None:
            return None
        first, last = run
        come, go = self.far(k, start.place, c.time)
        lane = self.lane(c, k, leg, first, last)
        if math.isinf(go(lane.track.end)):
            return None
        trip = None
        apart = max(round(YARD.outer_m * len(leg.masses) / leg.task.length), 1)
        for join in range(first, last - 1, apart):
            lane = lane if join == first else self.lane(c, k, leg, join, last)
            goal, first = lane.track.start, join
            if math.isinf(come(goal)):
                continue
            trip = self.sets_out(k, start, c, goal)
            if trip is not None or join - run[0] >= PARAMS.few * apart:
                break
        if trip is None:
            return None
        to = len(trip.path)
        after = trip.after | self.cut_by(lane, start.time, c.time, to)
        trip = replace(trip, path=trip.path.then(lane), after=after)
        begin = c.time
        full = int(np.searchsorted(levels, c.spec.tank + LEFT_KG, side="right")) - 1  # that the tank takes
        for _ in range(3):
            if times is None:
                return None
            mark = self.table.mark()
            self.table.commit(c.spec.name, leg.path, times, meets)
            self.calls_back(start)
            found, late = self.meets_there(c, leg, trip, to, (first, last), levels, times, full)
            self.table.back(mark)
            if found is not None or late <= 0.0 or full >= len(leg.masses):
                break
            begin = max(begin, times[0]) + late + 2.0 * TABLE.gap_s
            times = self.table.earliest(c.spec.name, leg.path, begin, meets=meets, after=leg.after)
        if found is None or times is None:
            return None
        granted = times
        cart_path, cart_times, exits, meet, amounts = found
        given, ends = math.fsum(amounts), times[-1] + float(leg.path.spent[-1])
        into, at, lane_at = [*times, ends], leg.first + meet, to + meet - first
        pours, tank = given / c.spec.auger, float(levels[-1]) - given
        over = into[at + len(amounts)]
        option = Option(
            "beside", k.spec.name, into[at], ends, given, tank, exits[1], pours, leg.cuts,
            *self.free_again(k, exits, over, given),
        )  # fmt: skip

        def grant() -> None:
            own = self.grant_cut(c, leg, granted, meets)
            self.calls_back(start)
            numbers = self.table.commit(k.spec.name, cart_path, cart_times)
            self.table.called(c.spec.name, numbers[len(trip.exact)])
            self.table.together += [(own[at + i], numbers[lane_at + i]) for i in range(len(amounts))]
            during = own[at], own[at + len(amounts) - 1]
            poured = Poured(c.spec.name, k.spec.name, given, into[at], into[at + len(amounts)], during)
            self.hands_over(c, k, poured)
            self.leaves(k, exits, numbers, lane_at + len(amounts) - 1)

        return option, grant

    @staticmethod
    def free_again(
        k: CartState, exits: tuple[bool, float, list[Poured]], over: float, load: float
    ) -> tuple[float, float]:
        """From when on a cart can set out to another load [s], and the room in its box then [kg].

        over: when it has taken a load [s]
        """
        empties, home, _ = exits
        return (home, k.spec.load) if empties else (over, k.room - load)

    def hands_over(self, c: CombineState, k: CartState, poured: Poured) -> None:
        """Grain from a tank into a box."""
        self.schedule.poured.append(poured)
        c.tank -= poured.amount
        k.load += poured.amount

    def leaves(
        self, k: CartState, exits: tuple[bool, float, list[Poured]], numbers: Sequence[int], at: int = 0
    ) -> None:
        """What a cart did behind its load, until it was at its place again, in segments; at: where it took
        the load.
        """
        empties, k.time, poured = exits
        loaded = self.table.segments[numbers[at]]
        end = Place(*loaded.path.track.places[loaded.path.last[loaded.index]].tolist())
        k.loaded = None if empties else Start(end, loaded.into + loaded.spent, loaded.number)
        for p in poured:
            self.schedule.poured.append(self._during(p, numbers))
            k.load -= p.amount
            self.truck_free = max(self.truck_free, p.ends)
            self.take_truck(p)

    def _during(self, poured: Poured, numbers: Sequence[int]) -> Poured:
        """Grain poured at the truck in one of some segments."""
        at = next(n for n in numbers if self.table.segments[n].kind == "at truck")
        return replace(poured, during=(at, at))

    def free_lane(self, c: CombineState, k: CartState, leg: _Leg) -> tuple[int, int] | None:
        """The longest run of segments of a pass beside which a cart may drive, from and up to."""
        if k.spec.name not in leg.lanes:
            leg.lanes[k.spec.name] = self._lane_beside(c, k, leg)
        return leg.lanes[k.spec.name]

    def _lane_beside(self, c: CombineState, k: CartState, leg: _Leg) -> tuple[int, int] | None:
        shapely, spec = shapely_here(), k.spec
        whole = self.lane(c, k, leg, 0, len(leg.masses))
        track, begin = whole.track, leg.path.first[leg.first]
        (x, y, heading, trailer), (u, v, along, _) = track.places.T, leg.path.track.places[begin:].T
        hitch, box = spec.body.hitch, spec.box_x - spec.body.hitch
        ahead, left = c.spec.pipe_x, c.spec.pipe_y  # of the stream, which the box is off
        x = (
            x
            + hitch * np.cos(heading)
            + box * np.cos(trailer)
            - u
            - ahead * np.cos(along)
            + left * np.sin(along)
        )
        y = (
            y
            + hitch * np.sin(heading)
            + box * np.sin(trailer)
            - v
            - ahead * np.sin(along)
            - left * np.cos(along)
        )
        is_off = np.hypot(x, y) > 2.0 * GAPS.off_m
        is_off[:-1] |= np.abs(track.bends) * spec.drive.radius > 1.0
        lane, cuts = whole.swept[:], leg.path.swept[leg.first :]
        is_off = np.maximum.reduceat(is_off, whole.first) | is_off[whole.last]
        is_off |= shapely.intersects(lane[:, :, None], cuts[:, None, :]).any(axis=(1, 2))
        is_free = self.ground.is_free(lane.ravel(), c.time).reshape(lane.shape).all(axis=1) & ~is_off
        ends = np.diff(np.concatenate([[0], is_free.astype(int), [0]]))
        runs = np.flatnonzero(ends).reshape(-1, 2).tolist()
        begins, over = max(runs, key=lambda run: run[1] - run[0], default=(0, 0))
        return (begins, over) if over - begins > 1 else None

    def lane(self, c: CombineState, k: CartState, leg: _Leg, first: int, last: int) -> Path:
        """The cart's path beside segments of a pass, in line at first, in a segment beside each."""
        path, body = leg.path, k.spec.body
        at = [*path.first[leg.first + first : leg.first + last], path.last[leg.first + last - 1]]
        track = abreast(path.track, *beside(c.spec, k.spec), body, int(at[0]), int(at[-1]))
        made = segments(track, track.distance, body, "beside", track.distance[np.array(at) - at[0]])
        made.spent = spent_along(track, k.spec.drive, made.first, made.last)
        return made

    def meets_there(
        self, c: CombineState, leg: _Leg, trip: _Trip, to: int, run: tuple[int, int], levels: Array,
        times: list[float], full: int,
    ) -> tuple[Any, float]:  # fmt: skip
        """The cart's path up to the combine, beside it while it is poured into, and away; the combine's own
        is granted. to: segments of the trip up to the pass. What is late, where it comes too late [s].
        """
        (first, last), k = run, trip.cart
        came = self.table.earliest(
            k.spec.name, trip.path, trip.start.time, stays=False, early=True, exact=trip.exact,
            after=trip.after,
        )  # fmt: skip
        if came is None:
            return None, 0.0
        into = [*times, times[-1] + float(leg.path.spent[-1])]
        ready = max(PARAMS.align_s, c.spec.swing)
        late = [came[to + i - first] + ready - into[leg.first + i] for i in range(first, last)]
        meet = next((first + i for i, x in enumerate(late) if x <= 0.0), None)
        if meet is None or meet > full:
            return None, late[min(full, last - 1) - first] if full >= first else 0.0
        room, level = k.room, float(levels[meet])
        amounts: list[float] = []
        for i in range(meet, last):
            spent = into[leg.first + i + 1] - into[leg.first + i]
            level += float(leg.masses[i])
            given = min(c.spec.auger * spent, level, room - math.fsum(amounts))
            amounts.append(max(given, 0.0))
            level -= amounts[-1]
            if level <= LEFT_KG or math.fsum(amounts) >= room - LEFT_KG:
                break
        if math.fsum(amounts) < min(PARAMS.load * c.spec.tank, (1.0 - PARAMS.load) * room):
            return None, 0.0
        rest = float(levels[-1]) - math.fsum(amounts)
        if rest > c.spec.tank + LEFT_KG:
            return None, late[0]
        lane_at, begin = to + meet - first, leg.first + meet
        kept, exact = trip.path.until(lane_at + len(amounts)), dict(trip.exact)
        kept.spent[lane_at - 1] += ready  # until it is in line there
        for i in range(len(amounts)):
            exact[lane_at + i] = into[begin + i]
            kept.spent[lane_at + i] = into[begin + i + 1] - into[begin + i]
            kept.kinds[lane_at + i] = "beside, pouring"
        trip = replace(trip, path=kept, exact=exact)
        found = self.away(trip, into[begin + len(amounts)], k.load + math.fsum(amounts))
        return None if found is None else (*found, meet, amounts), 0.0

    def away(
        self, trip: _Trip, time: float, load: float
    ) -> tuple[Path, list[float], tuple[bool, float, list[Poured]]] | None:
        """A trip with what follows: to the truck if the load is worth it, then to the cart's place."""
        for empties in (True, False) if load >= trip.cart.leaves else (False,):
            found = self.home_by(trip, time, load, empties)
            if found is not None:
                return found
        return None

    def home_by(
        self, trip: _Trip, time: float, load: float, empties: bool
    ) -> tuple[Path, list[float], tuple[bool, float, list[Poured]]] | None:
        """A trip with the way to the cart's place behind it, by the truck or not."""
        k, other, exact = trip.cart, trip.other, trip.exact
        here = trip.path.track.end
        name, body = k.spec.name, k.spec.body
        whole, dock_at = trip.path, -1
        if empties:
            dock = self.cart_dock(k.spec)
            way = self.way(k.spec, here, dock, time, "to truck", other)
            if way is None:
                return None
            whole, here = whole.then(way), way.track.end
            dock_at = len(whole)
            whole = whole.then(standing(here, body, 0.0, "at truck"))
        way = self.way(k.spec, here, k.home, time, "to its place", other)
        if way is None:
            return None
        whole = whole.then(way)
        whole = whole.then(standing(way.track.end, body, 0.0, "home"))
        meets = self.table.meets(whole, name)
        poured: list[Poured] = []
        times: list[float] | None = None
        for _ in range(6):
            times = self.table.earliest(
                name, whole, trip.start.time, exact=exact, meets=meets, early=empties, after=trip.after
            )
            if times is None:
                return None
            if not empties:
                break
            poured = self.at_truck(name, load, k.spec.out, times[dock_at])
            spent = poured[-1].ends + 0.5 * self.job.truck.dock_s - times[dock_at]
            if abs(spent - whole.spent[dock_at]) < 1e-6:
                exact = {**exact, dock_at: times[dock_at]}
                times = self.table.earliest(
                    name, whole, trip.start.time, exact=exact, meets=meets, after=trip.after
                )
                break
            whole.spent[dock_at] = spent
        else:
            return None
        if times is None:
            return None
        return whole, times, (empties, times[-1] + float(whole.spent[-1]), poured)

    def at_truck(self, name: str, load: float, rate: float, time: float) -> list[Poured]:
        """What is poured into trucks by who has come beside at a time [s]; a full one is waited for."""
        after = self.truck_free if math.isfinite(self.truck_room) else 0.0  # beside it is one at a time
        t = max(time, after) + 0.5 * self.job.truck.dock_s
        room, poured, trucks, filled = self.truck_room, [], self.trucks, self.filled
        while load > LEFT_KG:
            if room <= LEFT_KG:
                comes, trucks = self.next_truck(trucks, filled)
                t, room = max(t, comes), self.truck_kg
            amount = min(load, room)
            poured.append(Poured(name, "truck", amount, t, t + amount / rate))
            t, load, room = t + amount / rate, load - amount, room - amount
            filled = t
        return poured

    def next_truck(self, trucks: list[float], time: float) -> tuple[float, list[float]]:
        """When the next one is there, if one leaves at a time, and when those behind it are [s]."""
        first, *others = sorted([*trucks, time + 60.0 * self.job.truck.away_min])
        return first, others

    def take_truck(self, poured: Poured) -> None:
        """Grain goes into the truck that stands there, behind a full one into the next."""
        if self.truck_room <= LEFT_KG:
            _, self.trucks = self.next_truck(self.trucks, self.filled)
            self.truck_room = self.truck_kg
        self.truck_room -= poured.amount
        self.filled = poured.ends

    def emptied(self, c: CombineState) -> Iterator[tuple[Option, Any]]:
        """A combine has its tank emptied where it stands, at a place where a cart can stand beside, or at the
        truck.
        """
        if not self.carts:
            at_truck = self.drives_to_truck(c)
            if at_truck is not None:
                yield at_truck
            return
        found: list[tuple[Option, Any]] = []
        looked, most, likely = 0, self.patience * PARAMS.places, self.likely(c)
        for place in self.by_way(c):
            for k in likely:
                if looked < most and self.has_room(c, k, place):
                    looked += 1
                    one = self.served(k, partial(self.stands, c, k, place))
                    found += [one] if one is not None else []
                    self.vain[place] = 0 if one is not None else self.vain.get(place, 0) + 1
            if looked >= most or len(found) >= min(2, len(self.carts)):
                break
        yield from found

    def by_way(self, c: CombineState) -> list[Place]:
        """Places to be emptied at, those first to which it and a cart there and back have not far."""
        k = next(iter(self.likely(c)), self.carts[0])
        start = k.starts[0]
        come, go = self.far(k, start.place, c.time)
        ahead, left = beside(c.spec, k.spec)
        reach = self.reach(c)

        def cost(place: Place) -> tuple[float, Place]:
            at = place.ahead(ahead, left)
            own = reach(place) / c.spec.drive.straight if place != c.place else 0.0
            cart = start.time - c.time + come(at) / k.spec.drive.straight
            rest = PARAMS.behind * go(at) / k.spec.drive.straight
            return round(max(own, cart) + own + rest + PARAMS.long_s * self.vain.get(place, 0), 1), place

        places = (c.place, *self.places, *self.inner)
        if self.lands is not None:
            at = np.array([[p[:2], p.ahead(ahead, left)[:2]] for p in places])
            inside = shapely_here().contains_xy(self.lands, at[..., 0], at[..., 1]).any(axis=1)
            places = tuple(p for p, is_off in zip(places, ~inside, strict=True) if is_off)
        return sorted(places, key=cost)

    def far(self, k: CartState, place: Place, time: float) -> tuple[Far, Far]:
        """How far it is about for a cart from a place and to the truck."""
        drive, dock = k.spec.drive, self.cart_dock(k.spec)
        return self._far_from(drive, place, time, True), self._far_from(drive, dock, time, False)

    def reach(self, c: CombineState) -> Far:
        """How far it is about for a combine."""
        return self._far_from(c.spec.drive, c.place, c.time, True)

    def _far_from(self, drive: Drive, place: Place, time: float, there: bool) -> Far:
        """Kept until crop is cut."""
        changed = len(self.ground.grid.changed)
        key = drive, place, there, changed
        if key not in self._far:
            self._far = {o: far for o, far in self._far.items() if o[-1] == changed}
            self._far[key] = self.finder.far_from(drive, place, time, there=there)
        return self._far[key]

    def has_room(self, c: CombineState, k: CartState, place: Place) -> bool:
        """Whether both can stand there, on open ground that is cut and where nobody stands; a combine always
        where it is.
        """
        goal = place.ahead(*beside(c.spec, k.spec))
        stands = place == c.place or self.is_room(c.spec, place, c.time)
        return stands and self.is_room(k.spec, goal, c.time)

    def drives_to_truck(self, c: CombineState) -> tuple[Option, Any] | None:
        """A combine pours into the truck itself."""
        dock = self.combine_dock(c.spec)
        path = self.way(c.spec, c.place, dock, c.time, "to truck")
        if path is None:
            return None
        path = path.then(standing(path.track.end, c.spec.body, 0.0, "at truck"))
        times = self.table.earliest(c.spec.name, path, c.time)
        if times is None:
            return None
        poured = self.at_truck(c.spec.name, c.tank, c.spec.auger, times[-1] + c.spec.swing)
        path.spent[-1] = poured[-1].ends - times[-1]
        ends = poured[-1].ends
        option = Option("truck", "", poured[0].begins, ends, c.tank, 0.0, 0.0, c.tank / c.spec.auger)

        def grant() -> None:
            numbers = self.table.commit(c.spec.name, path, times)
            for p in poured:
                self.schedule.poured.append(self._during(p, numbers))
                self.take_truck(p)
            c.tank, c.place, c.time, self.truck_free = 0.0, path.track.end, ends, ends

        return option, grant

    def stands(self, c: CombineState, k: CartState, place: Place, start: Start) -> tuple[Option, Any] | None:
        """A combine stands at a place and is emptied into a cart beside it."""
        ahead, left = beside(c.spec, k.spec)
        goal = place.ahead(ahead, left)
        way = self.way(c.spec, c.place, place, c.time, "way to unload")
        if way is None:
            return None
        amount = min(c.tank, k.room)
        pour = amount / c.spec.auger
        path = way.then(standing(way.track.end, c.spec.body, 0.0, "waits for cart"))
        path = path.then(standing(way.track.end, c.spec.body, pour, "pours standing"))
        meets = self.table.meets(path, c.spec.name)
        times = self.table.earliest(c.spec.name, path, c.time, meets=meets)
        if times is None:
            return None
        mark = self.table.mark()
        self.table.commit(c.spec.name, path, times, meets)
        self.calls_back(start)
        found = self.joins(k, start, c, goal, times[-1], pour)
        self.table.back(mark)
        if found is None:
            return None
        cart_path, cart_times, exits, first, at = found
        begin = cart_times[at]
        path.spent[-2] = begin - times[-2]
        ends = begin + pour
        option = Option(
            "stand", k.spec.name, begin, ends, amount, c.tank - amount, exits[1], pour, 0.0,
            *self.free_again(k, exits, ends, amount),
        )  # fmt: skip

        def grant() -> None:
            own = self.table.commit(c.spec.name, path, [*times[:-1], begin], meets)
            path.spent[-2] = 0.0  # it waits for the cart alone
            self.calls_back(start)
            numbers = self.table.commit(k.spec.name, cart_path, cart_times)
            self.table.called(c.spec.name, numbers[first])
            self.table.together.append((own[-1], numbers[at]))
            during = own[-1], own[-1]
            self.hands_over(c, k, Poured(c.spec.name, k.spec.name, amount, begin, ends, during))
            c.place, c.time = path.track.end, ends
            self.leaves(k, exits, numbers, at)

        return option, grant

    def joins(
        self, k: CartState, start: Start, c: CombineState, goal: Place, time: float, pour: float
    ) -> Any:
        """A cart's path to beside a combine that stands there from a time on, poured into, and away."""
        trip = self.sets_out(k, start, c, goal)
        if trip is None:
            return None
        end, body = trip.path.track.end, k.spec.body
        path = trip.path.then(standing(end, body, PARAMS.align_s, "beside"))
        at = len(path)
        path = path.then(standing(end, body, pour, "beside, pouring"))
        after = {**trip.after, at: time}
        came = self.table.earliest(k.spec.name, path, start.time, stays=False, after=after, exact=trip.exact)
        if came is None:
            return None
        begin, first = came[at], len(trip.exact)
        trip = replace(trip, path=path, exact={**trip.exact, at: begin}, after=after)
        found = self.away(trip, begin + pour, k.load + min(c.tank, k.room))
        return None if found is None else (*found, first, at)

    def is_room(self, machine: Combine | Cart, place: Place, time: float) -> bool:
        """Whether a machine can stand at a place, on open ground that is cut, where no other one stands."""
        shapely = shapely_here()
        outlines = shapely.polygons(machine.body.outlines(np.array([place]), 0.2)[0])
        others = (self.last_of(o) for o in self.names() if o != machine.name)
        stand = np.array([p for s in others for p in s.path.swept[s.index]])
        if shapely.intersects(outlines[:, None], stand[None]).any():
            return False
        return bool(self.ground.is_free(outlines, time).all())

    def empties(self, k: CartState) -> bool:
        """A cart drives to the truck, from its last load, or else from its place."""
        for start in k.starts:
            is_out = start.behind >= 0
            path = standing(start.place, k.spec.body, 0.0, "in the field" if is_out else "home")
            trip = _Trip(k, start, "", path, {0: start.time} if is_out else {}, {})
            mark = self.table.mark()
            self.calls_back(start)
            found = self.home_by(trip, start.time, k.load, True)
            if found is not None:
                path, times, exits = found
                self.leaves(k, exits, self.table.commit(k.spec.name, path, times))
                return True
            self.table.back(mark)
        return False

    def is_off_ways(self, c: CombineState, place: Place) -> bool:
        """Whether a combine at a place is off the ways that others keep to their places and the truck."""
        areas = [area for name, home in self.kept.items() if name != c.spec.name for area in home.areas]
        return not shapely_here().intersects(run_of(c.spec.body, place, 0.0), areas).any()

    def goes_home(self, c: CombineState, off: bool = False) -> bool:
        """A combine that is done, or in the way, drives to its waiting place, or one near; off: to another
        one.
        """
        if c.place == c.home and not off:
            return True
        near = sorted(self.places, key=lambda p: round(math.dist(p[:2], c.place[:2]), 2))
        off_ways = (p for p in near if self.is_off_ways(c, p))
        places = (self.kept[c.spec.name].place, *islice(off_ways, PARAMS.places))
        for time in self.moments(c):
            for place in places:
                if place == c.place or not self.is_room(c.spec, place, time):
                    continue
                path = self.way(c.spec, c.place, place, time, "to its place")
                if path is None:
                    continue
                path = path.then(standing(path.track.end, c.spec.body, 0.0, "home"))
                times = self.table.earliest(c.spec.name, path, time)
                if times is not None:
                    self.table.commit(c.spec.name, path, times)
                    c.place, c.home, c.time = place, place, times[-1] + float(path.spent[-1])
                    return True
        return False


def _levels(c: CombineState, leg: _Leg) -> Array:
    """Of a combine's tank, before each segment of its pass and behind the last [kg]."""
    return c.tank + np.concatenate([[0.0], np.cumsum(leg.masses)])


def _marks(track: Track) -> Array:
    """Where segments of a pass end [m]: shorter ones where it bends."""
    count = max(1, math.ceil(track.length / PARAMS.cut_m - 1e-9))
    fine = np.linspace(0.0, track.length, 3 * count + 1)
    middle = 0.5 * (track.distance[1:] + track.distance[:-1])[np.abs(track.bends) > 1e-9]
    bent = np.bincount((middle / track.length * count).astype(int), minlength=count)[:count] > 0
    inner = np.repeat(bent, 3)
    inner[::3] = True
    return np.asarray(fine[np.concatenate([inner, [True]])])
