"""The mover `driven`: bodies without sensors that drive the schedule, each as far as it is granted.

Each 0.1 s a machine looks how far it may go, chooses a speed from which it can stop there, steers along its
path and rolls an arc where its wheels point, a trailer behind it on the tractrix, as at the motion level
`kinematic`. Who waits, waits at the end of granted ground. A cart that is poured into keeps its station
beside the combine; grain flows while it is in reach of the stream.
"""

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.fleet.machines import PARAMS as MACHINES
from swath.fleet.machines import Cart, Combine
from swath.fleet.schedule import Poured, Schedule
from swath.fleet.table import Order, Segment, order_of
from swath.fleet.ways import Track, joined, limits_along, stops_along
from swath.fleet.worked import IDLE, Span, Worked, merged, spans_in, state_of, waiting

Array = NDArray[np.float64]
STEP = 0.1  # s
NEAR = 0.03  # m, that a machine stands before where it may go
STILL = 1e-3  # m/s, at which it stands
STUCK = 600.0  # s without anybody moving, pouring or standing for a known time; then it is said who waits


@dataclass(frozen=True)
class Params:
    """back_m: length over which a machine steers back to its path, two steps at the fastest; station_s: time
    over which a cart makes up what it is off its station; reach: of the box, how far off its middle grain
    may land. Estimates.
    """

    back_m: float = 2.0
    station_s: float = 2.0
    reach: float = 0.25


PARAMS = Params()


@dataclass
class _Held:
    """reservation: number; path: segments in order; place: of each in it; wants, granted, at: places in the
    path, -1 for none.
    """

    reservation: int
    path: list[int]
    place: dict[int, int]
    wants: int = -1
    granted: int = -1
    at: int = -1


class Grants:
    """Hands out the segments of an order; `granted` says how far a machine may go.

    Three verbs, after those of the blockade of open-rmf:

    set       a machine's path under a reservation: the segments that it will enter, in order
    ready     it wants to go as far as a segment
    reached   it has entered a segment, and with it left all before

    Every message names its reservation; one of an older reservation is ignored, and one that comes late or
    twice changes nothing, since what was reached or asked for only grows. A machine that hears nothing stands
    at the end of what it was granted. A segment is granted when all that the order puts before it are left,
    so nothing overlaps whoever is late, and since the order has no circle, some machine can always go on.
    """

    def __init__(self, order: Order) -> None:
        self.order = order
        self._entered: set[int] = set()
        self._held: dict[str, _Held] = {}
        self._group = {number: group for group in order.groups for number in group}
        self._asked: set[int] = set()

    def set(self, machine: str, reservation: int, path: list[int]) -> None:
        """A machine's segments from here on. Ignored for a reservation that is not newer than its last."""
        held = self._held.get(machine)
        if held is None or reservation > held.reservation:
            self._held[machine] = _Held(reservation, list(path), {n: i for i, n in enumerate(path)})

    def ready(self, machine: str, reservation: int, segment: int) -> None:
        """A machine wants to go as far as a segment of its path."""
        held = self._of(machine, reservation)
        if held is not None and held.place.get(segment, -1) > held.wants:
            self._asked.update(held.path[held.at + 1 : held.place[segment] + 1])
            held.wants = held.place[segment]

    def reached(self, machine: str, reservation: int, segment: int) -> None:
        """A machine has entered a segment; ignored for one that it was not granted."""
        held = self._of(machine, reservation)
        if held is not None and held.at < held.place.get(segment, -1) <= held.granted:
            self._entered.update(held.path[held.at + 1 : held.place[segment] + 1])
            held.at = held.place[segment]

    def granted(self, machine: str) -> int | None:
        """The segment that a machine may go as far as, None before its first."""
        held = self._held.get(machine)
        if held is None:
            return None
        while held.granted < held.wants and self.waits_for(held.path[held.granted + 1]) is None:
            held.granted += 1
        return held.path[held.granted] if held.granted >= 0 else None

    def _of(self, machine: str, reservation: int) -> _Held | None:
        held = self._held.get(machine)
        return held if held is not None and held.reservation == reservation else None

    def waits_for(self, segment: int) -> tuple[int, int] | None:
        """What a segment is not granted for: the one that is entered at that moment, itself or a partner's,
        and what has to be entered, or asked for, before; None where nothing has.
        """
        for member in self._group[segment]:
            if member != segment and member not in self._asked:
                return member, member
            for other, waits in self.order.before[member]:
                if other not in self._entered and not (waits and member == segment):
                    return member, other
        return None


@dataclass
class _Pour:
    """What is poured between two machines. left: to pour [kg]; flows: when it began, and last did [s]."""

    plan: Poured
    left: float
    begins: float = math.nan
    ends: float = math.nan


class _Mover:
    """A machine on its path.

    at: how far it has come [m]; speed [m/s]
    k: number of its segment among its own
    since: when it entered it [s]
    """

    def __init__(self, machine: Combine | Cart, segments: list[Segment]) -> None:
        self.machine, self.segments = machine, segments
        tracks: list[Track] = []
        ends, base = [], 0.0
        for _, same in groupby(segments, key=lambda s: id(s.path)):
            part = list(same)
            t = part[0].path.until(part[-1].index + 1).track
            ends += [base + float(t.distance[s.path.last[s.index]]) for s in part]
            base += t.length
            tracks.append(t)
        self.ends = ends  # of each segment [m]
        self.begins = [0.0, *ends[:-1]]
        moving = [t for t in tracks if t.length > 1e-6]
        track = joined(moving) if moving else tracks[0]
        # samples at one place are left out
        keep = np.concatenate([[True], np.diff(track.distance) > 1e-6])
        steps = keep[1:]
        track = Track(track.places[keep], track.distance[keep], track.ways[steps], track.bends[steps])
        self.xs, self.ys, self.headings = (array("d", column) for column in track.places.T[:3])
        self.distance, self.ways, self.bends = (
            array("d", values) for values in (track.distance, track.ways, track.bends)
        )
        self.stops = stops = stops_along(track, machine.drive) if len(track.distance) > 2 else {}
        self.turns = [self.distance[i] for i in stops]
        self.shifts = [machine.drive.shift * (self.ways[i] != self.ways[i - 1]) for i in stops]
        self.limits = self._limits(track)
        self.x, self.y, self.heading, self.trailer = track.places[0].tolist()
        self.at = self.speed = self.off = 0.0
        self.k, self.i, self.since, self.shift = 0, 0, 0.0, 0.0
        self.turn = 0
        self.bend = self.bends[0] if self.bends else 0.0
        self.steering = machine.drive.steering / MACHINES.steered
        body = machine.body
        self.pin = self.x + body.hitch * math.cos(self.heading), self.y + body.hitch * math.sin(self.heading)
        self.spans: list[Span] = []

    def _limits(self, track: Track) -> Sequence[float]:
        """Squares of the highest speeds at samples, from which it can slow down for all that come."""
        if len(track.distance) < 2:
            return [0.0]
        drive = self.machine.drive
        limit = limits_along(track, drive)
        for s, begin, end in zip(self.segments, self.begins, self.ends, strict=True):
            if s.kind == "cut" and s.spent > 0.0:
                first, last = np.searchsorted(track.distance, [begin + 1e-6, end - 1e-6]).tolist()
                here = slice(max(first - 1, 0), last + 1)
                limit[here] = np.minimum(limit[here], (end - begin) / s.spent)
        square = array("d", limit**2)
        gain = array("d", 2.0 * drive.accel * np.diff(track.distance))
        for i in range(len(square) - 2, -1, -1):
            square[i] = min(square[i], square[i + 1] + gain[i])
        return square

    @property
    def segment(self) -> Segment:
        """Segment that the machine is on."""
        return self.segments[self.k]

    def drive(self, goal: float, most: float) -> None:
        """Drive for a step, so that it can stop at a goal [m], no faster than a speed [m/s]."""
        drive = self.machine.drive
        if self.turn < len(self.turns):
            goal = min(goal, self.turns[self.turn])
        left = goal - self.at
        if self.speed < STILL and left < NEAR:
            self.speed = 0.0
            self._turns_round()
            return
        a = drive.accel
        ahead = self._limit(self.at + self.speed * STEP)
        stop = (
            0.8 * a * (math.sqrt(0.25 * STEP**2 + 2.0 * max(left - 0.5 * NEAR, 0.0) / (0.8 * a)) - 0.5 * STEP)
        )
        wanted = min(ahead, stop, most)
        self.speed = min(max(wanted, self.speed - 2.0 * a * STEP, 0.0), self.speed + a * STEP)
        if self.speed > 0.0:
            self._roll(self.speed * STEP)

    def _turns_round(self) -> None:
        """Between forwards and backwards, or two bends, it stands until it is shifted and steered."""
        if self.turn >= len(self.turns) or self.turns[self.turn] - self.at > NEAR:
            return
        self.shift += STEP
        i = self._sample(self.turns[self.turn] + 1e-3)
        change = self.bends[i] - self.bend
        most = self.steering * STEP
        self.bend += max(-most, min(most, change))
        if self.shift >= self.shifts[self.turn] and abs(change) < 1e-6:
            self.at = self.turns[self.turn] + 1e-6
            self.turn, self.shift = self.turn + 1, 0.0

    def _sample(self, at: float) -> int:
        """Number of the step of the path at a distance [m]."""
        i, d, last = self.i, self.distance, len(self.distance) - 2
        while i < last and d[i + 1] <= at:
            i += 1
        return i

    def _limit(self, at: float) -> float:
        i = self._sample(at)
        a, b = self.limits[i], self.limits[i + 1]
        share = min(max((at - self.distance[i]) / (self.distance[i + 1] - self.distance[i]), 0.0), 1.0)
        return max(math.sqrt(a + share * (b - a)), 0.1)

    def _roll(self, way: float) -> None:
        """An arc along its path, as steered."""
        i = self.i = self._sample(self.at)
        j = i + 1
        span = self.distance[i + 1] - self.distance[i]
        share = min(max((self.at - self.distance[i]) / span, 0.0), 1.0)
        x, y, first, forwards = self.xs[i], self.ys[i], self.headings[i], self.ways[i]
        heading = first + share * (self.headings[j] - first)
        chord = share * math.hypot(self.xs[j] - x, self.ys[j] - y) * forwards
        middle = 0.5 * (first + heading)  # on the arc of the step
        x, y = x + chord * math.cos(middle), y + chord * math.sin(middle)
        c, s = math.cos(heading), math.sin(heading)
        along = (self.x - x) * c + (self.y - y) * s
        aside = (self.y - y) * c - (self.x - x) * s
        turned = math.remainder(self.heading - heading, 2.0 * math.pi)
        ahead = self._bend(self.at + way)
        over = PARAMS.back_m
        wanted = ahead - aside / over**2 - 2.0 * forwards * turned / over
        most = self.steering * STEP
        change = max(-most, min(most, wanted - self.bend))
        bend = self.bend + 0.5 * change
        self.bend += change
        turn = bend * way * forwards
        half = self.heading + 0.5 * turn
        arc = way * forwards * (math.sin(0.5 * turn) / (0.5 * turn) if abs(turn) > 1e-9 else 1.0)
        self.x += arc * math.cos(half)
        self.y += arc * math.sin(half)
        self.heading += turn
        self.at += way * math.cos(turned) / max(1.0 - aside * ahead, 0.5) + forwards * along
        self.off = max(self.off, abs(aside))
        self._tow()

    def _bend(self, at: float) -> float:
        """Curvature of the path at a distance, between the middles of its steps [1/m]."""
        i = self._sample(at)
        d = self.distance
        middle = 0.5 * (d[i] + d[i + 1])
        j = i - 1 if at < middle else i + 1
        if j < 0 or j > len(self.bends) - 1 or max(i, j) in self.stops:
            return self.bends[i]
        share = (at - middle) / (0.5 * (d[j] + d[j + 1]) - middle)
        return self.bends[i] + min(max(share, 0.0), 1.0) * (self.bends[j] - self.bends[i])

    def _tow(self) -> None:
        """The trailer behind the pin, which went a straight piece (see machine/towing.py)."""
        body = self.machine.body
        if not body.has_trailer:
            self.trailer = self.heading
            return
        px, py = self.x + body.hitch * math.cos(self.heading), self.y + body.hitch * math.sin(self.heading)
        dx, dy = px - self.pin[0], py - self.pin[1]
        self.pin = px, py
        way = math.hypot(dx, dy)
        if way > 0.0:
            towards = math.atan2(dy, dx)
            angle = math.remainder(self.trailer - towards, 2.0 * math.pi)
            self.trailer += 2.0 * math.atan(math.tan(0.5 * angle) * math.exp(-way / body.drawbar)) - angle


class _Drive:
    """All machines of a schedule, step by step."""

    def __init__(self, schedule: Schedule) -> None:
        self.schedule, self.table = schedule, schedule.table
        self.grants = Grants(order_of(self.table))
        machines = schedule.machines.by_name
        self.movers = {
            name: _Mover(machines[name], [s for s in self.table.segments if s.machine == name])
            for name in self.table.last
        }
        for name, m in self.movers.items():
            numbers = [s.number for s in m.segments]
            self.grants.set(name, 1, numbers)
            self.grants.ready(name, 1, numbers[-1])
            self.grants.granted(name)
            self.grants.reached(name, 1, numbers[0])
        self.place = {s.number: k for m in self.movers.values() for k, s in enumerate(m.segments)}
        self.pair = {}
        for a, b in self.table.together:
            self.pair[a], self.pair[b] = b, a
        self.pours = [_Pour(p, p.amount) for p in schedule.poured]
        self.ends_pour = {}  # segments that are left when all is poured
        self.pour_of = {}
        for p in self.pours:
            if p.plan.target != "truck":
                last = p.plan.during[1]
                self.ends_pour[last] = self.ends_pour[self.pair[last]] = p
                for number in range(p.plan.during[0], last + 1):
                    if self.table.segments[number].machine == p.plan.source:
                        self.pour_of[number] = p
        self.time = 0.0
        self.into: Array = np.zeros(len(self.table.segments))
        self.last = 0.0  # when somebody did something
        self.free = dict.fromkeys(self.movers, 0)  # number of the segment that each may go as far as
        self.hear()

    def hear(self) -> None:
        """How far each may go."""
        for name, m in self.movers.items():
            granted = self.grants.granted(name)
            self.free[name] = self.place[granted] if granted is not None else 0
            self.free[name] = max(self.free[name], m.k)

    def run(self) -> Worked:
        """Until all are at the ends of their paths."""
        rows = {name: array("d") for name in self.movers}
        cut = 0.0
        while not all(self.is_done(m) for m in self.movers.values()):
            for name, m in self.movers.items():
                rows[name].extend((m.x, m.y, m.heading, m.trailer))
                before = m.at, m.k
                self.move(name, m)
                if (m.at, m.k) != before or 0.0 < self.stays(m) < math.inf:
                    self.last = self.time
                if (m.at, m.k) != before and m.segments[before[1]].kind == "cut":
                    cut = self.time + STEP
            self.pour()
            self.time += STEP
            if self.time - self.last > STUCK:
                raise InputError("level", "driven", f"expected machines that go on; {self.who_waits()}")
        for name, m in self.movers.items():
            rows[name].extend((m.x, m.y, m.heading, m.trailer))
        places = {name: np.frombuffer(r).reshape(-1, 4) for name, r in rows.items()}
        clock = np.linspace(0.0, self.time, len(next(iter(places.values()))))
        poured = [
            replace(p.plan, amount=p.plan.amount - p.left, begins=p.begins, ends=p.ends) for p in self.pours
        ]
        ends = max((p.ends for p in poured if p.target == "truck"), default=0.0)
        spans = {name: merged(self.movers[name].spans) for name in self.schedule.machines.by_name}
        stray = max(m.off for m in self.movers.values())
        return Worked("driven", self.schedule, spans, poured, cut, ends, self.into, clock, places, stray)

    def is_done(self, m: _Mover) -> bool:
        """Whether a machine is at the end of its path."""
        return m.k == len(m.segments) - 1 and self.stays(m) <= 0.0 and m.ends[-1] - m.at < 2.0 * NEAR

    def stays(self, m: _Mover) -> float:
        """How long a machine has to stay in its segment [s]; infinite until it has poured."""
        s = m.segment
        pour = self.ends_pour.get(s.number)
        if pour is not None and pour.left > 0.0:
            return math.inf
        if m.ends[m.k] - m.begins[m.k] < 1e-2:
            return m.since + s.spent - self.time if s.number not in self.pair else 0.0
        return 0.0

    def move(self, name: str, m: _Mover) -> None:
        """A step of one machine: into next segments as far as granted, and on."""
        while m.k < self.free[name] and m.at >= m.ends[m.k] - 2.0 * NEAR and self.stays(m) <= 0.0:
            if m.ends[m.k + 1] - m.ends[m.k] < 1e-2 and m.at < m.ends[m.k] - 1e-9 and m.speed > STILL:
                break  # it comes to stand first
            m.k += 1
            m.since = self.into[m.segment.number] = self.time
            self.grants.reached(name, 1, m.segment.number)
            self.hear()
        goal, most = self.goal(name, m), math.inf
        if isinstance(m.machine, Cart):
            goal, most = self.station(m, goal)
        before = m.at
        m.drive(goal, most)
        self.says(m, m.at > before or m.shift > 0.0)

    def goal(self, name: str, m: _Mover) -> float:
        """How far it may drive without stopping [m]."""
        for k in range(m.k, self.free[name] + 1):
            number = m.segments[k].number
            pour = self.ends_pour.get(number)
            stands = m.ends[k] - m.begins[k] < 1e-2 and (k > m.k or self.stays(m) > 0.0)
            if stands or (pour is not None and pour.left > 0.0) or k == self.free[name]:
                return m.ends[k]
            if m.ends[k] - m.at > 60.0:
                return m.ends[k]
        return m.ends[m.k]

    def station(self, m: _Mover, goal: float) -> tuple[float, float]:
        """How far a cart may drive, and how fast, so that it keeps its place beside a combine."""
        for k in range(m.k, min(m.k + 3, len(m.segments))):
            number = m.segments[k].number
            if number in self.pair and m.ends[k] - m.begins[k] > 1e-2:
                other = self.movers[self.table.segments[self.pair[number]].machine]
                j = self.place[self.pair[number]]
                gap = m.begins[k] + self.beside(m, k, other, j) - m.at
                speed = max(0.0, other.speed + gap / PARAMS.station_s)
                if m.at < m.begins[k] - NEAR:
                    a = 0.8 * m.machine.drive.accel
                    return goal, max(speed, math.sqrt(2.0 * a * (m.begins[k] - m.at)))
                return goal, speed
        return goal, math.inf

    @staticmethod
    def beside(m: _Mover, k: int, other: _Mover, j: int) -> float:
        """How far a cart is in its segment when it is beside a combine in the one that goes with it [m]."""
        longer = (m.ends[k] - m.begins[k]) / max(other.ends[j] - other.begins[j], NEAR)
        return longer * (other.at - other.begins[j])

    def pour(self) -> None:
        """A step of all grain that flows."""
        for m in self.movers.values():
            p = self.pour_of.get(m.segment.number)
            if p is not None and p.left > 0.0 and isinstance(m.machine, Combine):
                self._pour_into_cart(p, m)
        for p in self.pours:
            if p.plan.target == "truck" and p.left > 0.0:
                m = self.movers[p.plan.source]
                if m.segment.number == p.plan.during[0]:
                    since = self.time + STEP - m.since + m.segment.into
                    if since >= p.plan.begins:
                        share = min((since - p.plan.begins) / max(p.plan.ends - p.plan.begins, 1e-9), 1.0)
                        p.begins = self.time if math.isnan(p.begins) else p.begins
                        p.left = (1.0 - share) * p.plan.amount if share < 1.0 else 0.0
                        p.ends = self.last = self.time + STEP

    def _pour_into_cart(self, p: _Pour, m: _Mover) -> None:
        number = self.pair.get(m.segment.number)
        if number is None:
            return
        cart = self.movers[p.plan.target]
        k, j = self.place[number], m.k
        assert isinstance(m.machine, Combine)
        assert isinstance(cart.machine, Cart)
        off = (cart.at - cart.begins[k]) - self.beside(cart, k, m, j)
        box = cart.machine.sheet.box
        assert box is not None
        if abs(off) > PARAMS.reach * box.length or cart.k < k - 1:
            return
        flow = min(m.machine.auger * STEP, p.left)
        p.begins = self.time if math.isnan(p.begins) else p.begins
        p.left = p.left - flow if flow < p.left else 0.0
        p.ends = self.last = self.time + STEP

    def says(self, m: _Mover, moves: bool) -> None:
        """What a machine does in this step."""
        s, now, then = m.segment, self.time, self.time + STEP
        if moves or self.stays(m) > 0.0:
            span = Span(state_of(s), now, then)
            if s.kind == "at truck":
                inside = spans_in(s, m.since, self.schedule.poured, self.schedule.dock)
                span = next(
                    (Span(x.state, now, then, x.reason) for x in inside if x.begin <= now < x.end), span
                )
        elif m.k + 1 < len(m.segments):
            until = self.grants.waits_for(m.segments[m.k + 1].number) or (s.number, s.number)
            span = waiting(self.table, s, now, then, until)
        else:
            span = Span(IDLE, now, then)
        last = m.spans[-1] if m.spans else None
        if last is not None and (last.state, last.reason) == (span.state, span.reason):
            m.spans[-1] = Span(last.state, last.begin, then, last.reason)
        else:
            m.spans.append(span)

    def who_waits(self) -> str:
        """Machines that stand, and for whom they wait."""
        return ", ".join(
            f"{name} in {m.segment.kind} at ({num(m.x)}, {num(m.y)}): "
            f"{m.spans[-1].state} {m.spans[-1].reason}"
            for name, m in self.movers.items()
        )


def driven(schedule: Schedule) -> Worked:
    """A schedule carried out by bodies. InputError where they do not come to an end, with who waits."""
    return _Drive(schedule).run()
