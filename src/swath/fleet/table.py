"""Granted ground: who has which place when, and in which order machines pass each shared place.

A machine's path is cut into segments: the ground that its bodies sweep there, and the time that it takes.
It holds a segment from its entry until it enters the next one, and stands at the end of one as long as it
has to wait. `Table` has the segments of all machines with their times; `earliest` gives the first times at
which a new path meets nobody, waits put where they are free (safe intervals, Phillips and Likhachev 2011,
DOI 10.1109/ICRA.2011.5980306).

Where two machines sweep the same ground, only the order is kept for execution (an action dependency graph,
Hoenig et al. 2019, DOI 10.1109/LRA.2019.2894217): who is second enters when who is first has left. All
planned times agree with that order, so it has no circle: whatever is delayed, nothing overlaps and somebody
can always go on.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.fleet.ground import shapely_here
from swath.fleet.machines import PARAMS as GAPS
from swath.fleet.machines import Body, Place
from swath.fleet.ways import Track, joined
from swath.kernels import filled, launch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Params:
    """gap_s: between who leaves a shared place and who enters it; straight_m: longest segment, a third of it
    in bends, so that waiting places are near each other and ground is not held for long. Estimates.
    """

    gap_s: float = 1.0
    straight_m: float = 9.0


PARAMS = Params()


Numbers = NDArray[np.int32]
BLOCK = 16  # segments of the table whose box is looked at first


@dataclass
class Swept:
    """Outlines of what a body sweeps over each segment of a path, one of each of its rectangles.

    points: their corners, anticlockwise [m], (n, 2)
    starts: the first of each outline, and how many there are in all, (segments * rects + 1,). An index gives
        polygons of shapely, (rects,) of a segment, (n, rects) of a slice
    """

    points: Array
    starts: Numbers
    rects: int

    def __len__(self) -> int:
        return (len(self.starts) - 1) // self.rects

    def __getitem__(self, which: int | slice) -> Any:
        begin, end, _ = (slice(which, which + 1) if isinstance(which, int) else which).indices(len(self))
        starts = self.starts[begin * self.rects : end * self.rects + 1]
        counts = np.diff(starts)
        rings = np.repeat(np.arange(len(counts)), counts + 1)
        at = np.arange(len(rings)) - rings  # each outline ends where it begins
        at[np.cumsum(counts + 1) - 1] = starts[:-1] - starts[0]
        shapely = shapely_here()
        points = self.points[starts[0] + at]
        out = shapely.polygons(shapely.linearrings(points, indices=rings)).reshape(-1, self.rects)
        return out[0] if isinstance(which, int) else out

    @cached_property
    def boxes(self) -> Array:
        """West, south, east, north of each segment [m], (n, 4)."""
        begins = self.starts[: -1 : self.rects]
        low, high = np.minimum.reduceat(self.points, begins), np.maximum.reduceat(self.points, begins)
        return np.concatenate([low, high], axis=1)

    def then(self, other: "Swept") -> "Swept":
        """These and those of a path behind it."""
        starts = np.concatenate([self.starts, other.starts[1:] + self.starts[-1]])
        return Swept(np.concatenate([self.points, other.points]), starts, self.rects)

    def until(self, count: int) -> "Swept":
        """Of its first segments."""
        starts = self.starts[: count * self.rects + 1]
        return Swept(self.points[: starts[-1]], starts, self.rects)


def swept_by(body: Body, places: Array, first: Any, last: Any, gap: float) -> Swept:
    """What a body, wider by a gap [m], sweeps between places of a path, (n, 4): from the first to the last
    of each segment.
    """
    from swath.fleet import ground_kernel

    parts = np.array([*body.own, *body.towed]) + np.array([-gap, gap, -gap, gap])
    count, first, last = len(parts), np.asarray(first, np.int32), np.asarray(last, np.int32)
    most = int((last - first).max() + 1) * 4
    numbers = np.array([body.hitch, body.drawbar, count, len(body.towed), len(first), len(places)], float)
    points = np.zeros((int((last - first + 1).sum()) * 4 * count + 2, 2))
    starts = np.zeros(len(first) * count + 1, np.int32)
    its = filled(
        ground_kernel.Sweep, numbers=numbers, places=places.ravel(),
        rectangles=parts.ravel(), first=first, last=last,
        room=np.zeros(2 * most), outlines=points.ravel(), starts=starts,
    )  # fmt: skip
    launch(ground_kernel.sweep_path, its)
    return Swept(points[: starts[-1]].copy(), starts, count)


class Rows:
    """Rows of an array that grows and shrinks at its end; `all` has room behind them."""

    def __init__(self, width: int, dtype: Any) -> None:
        self.all = np.zeros((1024, width), dtype)
        self.count = 0

    def add(self, rows: Any) -> None:
        """More at the end."""
        need = self.count + len(rows)
        if need > len(self.all):
            more = np.zeros((2 * need, self.all.shape[1]), self.all.dtype)
            more[: self.count] = self.all[: self.count]
            self.all = more
        self.all[self.count : need] = rows
        self.count = need


class Taken:
    """Outlines of all segments of a table, by their numbers, and who meets them."""

    def __init__(self) -> None:
        self.points, self.starts = Rows(2, np.float64), Rows(1, np.int32)
        self.boxes, self.blocks = Rows(4, np.float64), Rows(4, np.float64)
        self.first, self.machines = Rows(1, np.int32), Rows(1, np.int32)
        self.starts.add([[0]])
        self.first.add([[0]])
        self._number: dict[str, int] = {}
        self._found = np.zeros(2048, np.int32)

    def __len__(self) -> int:
        return self.boxes.count

    def add(self, machine: str, swept: Swept) -> None:
        """Segments of a machine."""
        number = self._number.setdefault(machine, len(self._number))
        self.starts.add(swept.starts[1:, None] + self.points.count)
        outlines = self.first.all[self.first.count - 1, 0] + swept.rects * np.arange(1, len(swept) + 1)
        self.first.add(outlines[:, None])
        self.points.add(swept.points)
        self.boxes.add(swept.boxes)
        self.machines.add(np.full((len(swept), 1), number))
        self._grow()

    def back(self, count: int) -> None:
        """Only so many."""
        self.boxes.count = self.machines.count = count
        self.first.count = count + 1
        self.starts.count = int(self.first.all[count, 0]) + 1
        self.points.count = int(self.starts.all[self.starts.count - 1, 0])
        self.blocks.count = min(self.blocks.count, count // BLOCK)
        self._grow()

    def _grow(self) -> None:
        """Boxes of blocks, the last one anew."""
        self.blocks.count = max(self.blocks.count - 1, 0)
        begins = np.arange(self.blocks.count * BLOCK, len(self), BLOCK)
        if len(begins):
            boxes = self.boxes.all[begins[0] : len(self)]
            low, high = boxes[:, :2], boxes[:, 2:]
            at = begins - begins[0]
            self.blocks.add(
                np.concatenate([np.minimum.reduceat(low, at), np.maximum.reduceat(high, at)], axis=1)
            )

    def met_by(self, swept: Swept, but: str) -> list[list[int]]:
        """Numbers of segments that sweep ground of each segment of a path, none of one machine."""
        from swath.fleet import ground_kernel

        own = len(swept), swept.rects, len(self), BLOCK, self._number.get(but, -1)
        while True:
            most = (len(self._found) - 1) // 2
            its = filled(
                ground_kernel.Meets, numbers=np.array([*own, most], float),
                found=self._found, own_points=swept.points.ravel(),
                own_starts=swept.starts, own_boxes=swept.boxes.ravel(),
                points=self.points.all.ravel(), starts=self.starts.all.ravel(),
                first_outline=self.first.all.ravel(), machines=self.machines.all.ravel(),
                boxes=self.boxes.all.ravel(), blocks=self.blocks.all.ravel(),
            )  # fmt: skip
            launch(ground_kernel.meet_all, its)
            count = int(self._found[0])
            if count <= most:
                break
            self._found = np.zeros(4 * count, np.int32)
        pairs = self._found[1 : 1 + 2 * count].reshape(-1, 2)
        ends = np.searchsorted(pairs[:, 0], np.arange(1, len(swept)))
        return [part.tolist() for part in np.split(pairs[:, 1], ends)]


@dataclass
class Path:
    """track; first, last: samples of each segment; swept: outlines of all bodies over each; spent: time in
    each [s]; kinds: what is done there: way, cut, pour, dock ...
    """

    track: Track
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    swept: Swept
    spent: Array
    kinds: list[str]

    def __len__(self) -> int:
        return len(self.spent)

    def then(self, other: "Path") -> "Path":
        """Join another path to the end of this one."""
        if not len(self):
            return other
        track = joined([self.track, other.track])
        shift = len(self.track.places) - 1
        if len(other.track.places) < 2 or len(track.places) != shift + len(other.track.places):
            raise ValueError("expected paths of at least two samples")
        return Path(
            track, np.concatenate([self.first, other.first + shift]),
            np.concatenate([self.last, other.last + shift]), self.swept.then(other.swept),
            np.concatenate([self.spent, other.spent]), self.kinds + other.kinds,
        )  # fmt: skip

    def until(self, count: int) -> "Path":
        """Its first segments."""
        n, t = int(self.last[count - 1]) + 1, self.track
        track = Track(t.places[:n], t.distance[:n], t.ways[: n - 1], t.bends[: n - 1])
        swept, spent = self.swept.until(count), self.spent[:count].copy()
        return Path(track, self.first[:count], self.last[:count], swept, spent, self.kinds[:count])


def segments(track: Track, times: Array, body: Body, kind: str, marks: Array | None = None) -> Path:
    """A track as segments.

    times: at its samples [s]
    marks: distances where segments end [m], else by length
    """
    cuts = _cuts(track) if marks is None else np.unique(np.searchsorted(track.distance, marks - 1e-6))
    cuts = np.unique(np.concatenate([[0], cuts, [len(track.places) - 1]]))
    first, last = cuts[:-1], cuts[1:]
    swept = swept_by(body, track.places, first, last, GAPS.gap_m)
    return Path(track, first, last, swept, times[last] - times[first], [kind] * len(first))


def _cuts(track: Track) -> NDArray[np.int64]:
    cuts, begin, bends = [0], 0, False
    distance, bent = track.distance.tolist(), (track.bends != 0.0).tolist()
    ways = track.ways.tolist()
    for i in range(1, len(distance) - 1):
        bends = bends or bent[i - 1]
        most = PARAMS.straight_m / 3.0 if bends else PARAMS.straight_m
        changed = ways[i] != ways[i - 1] or bent[i] != bent[i - 1]
        if changed or distance[i + 1] - distance[begin] > most:
            cuts.append(i)
            begin, bends = i, False
    return np.array(cuts)


def standing(place: Place, body: Body, spent: float, kind: str) -> Path:
    """One segment of a machine that stands."""
    places = np.array([place, place])
    track = Track(places, np.zeros(2), np.ones(1), np.zeros(1))
    zero, one = np.zeros(1, np.int64), np.ones(1, np.int64)
    swept = swept_by(body, places, zero, one, GAPS.gap_m)
    return Path(track, zero, one, swept, np.array([spent]), [kind])


@dataclass
class Segment:
    """One of the table.

    path, index: which of a path
    into, out: times of entry and of leaving [s]
    next: the one that the machine enters then, -1 if none is known
    is_off: whether it was taken off
    """

    number: int
    machine: str
    path: Path
    index: int
    into: float
    out: float = math.inf
    next: int = -1
    is_off: bool = False

    @property
    def spent(self) -> float:
        """Time that it takes at least [s]."""
        return float(self.path.spent[self.index])

    @property
    def kind(self) -> str:
        """What is done there."""
        return self.path.kinds[self.index]


@dataclass
class Table:
    """segments of all machines; met: of each the earlier ones of others that sweep the same ground; last: of
    each machine; calls: (a, b): b is entered when a is left; together: (a, b): entered at once.
    """

    segments: list[Segment] = field(default_factory=list)
    met: list[Sequence[int]] = field(default_factory=list)
    last: dict[str, int] = field(default_factory=dict)
    calls: list[tuple[int, int]] = field(default_factory=list)
    together: list[tuple[int, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Room for the swept ground of all."""
        self._taken = Taken()
        self._off: list[tuple[int, int, list[Segment]]] = []  # what was taken off: behind what, its next one

    def stand(self, machine: str, path: Path, time: float = 0.0) -> None:
        """A machine's first place."""
        self._append(machine, path, [time], self.meets(path, machine))

    def cut_to(self, machine: str, place: Place) -> Track | None:
        """The pass that a machine has cut last, None where it has left the end of it."""
        own = (s for s in reversed(self.segments) if s.machine == machine and not s.is_off)
        s = next((s for s in own if s.kind == "cut"), None)
        if s is None:
            return None
        first = next((i + 1 for i in range(s.index, -1, -1) if s.path.kinds[i] != "cut"), 0)
        t, a, b = s.path.track, int(s.path.first[first]), int(s.path.last[s.index])
        if (t.places[b, :2] != place[:2]).any():
            return None
        return Track(t.places[a : b + 1], t.distance[a : b + 1], t.ways[a:b], t.bends[a:b])

    def meets(self, path: Path, but: str) -> list[list[int]]:
        """Numbers of segments of others that sweep ground of each segment of a path."""
        met = self._taken.met_by(path.swept, but)
        return [[n for n in numbers if not self.segments[n].is_off] for numbers in met]

    def earliest(
        self, machine: str, path: Path, time: float, *, exact: Mapping[int, float] | None = None,
        meets: Sequence[Sequence[int]] | None = None, stays: bool = True, early: bool = False,
        after: Mapping[int, float] | None = None,
    ) -> list[float] | None:  # fmt: skip
        """First times of entry into the segments of a path [s], begun at a time at the earliest; None where
        there are none. exact: times that are given; after: earliest ones;
        stays: it must be able to stand at the end for good;
        early: behind exact times it drives on as soon as it can, not only when it need not wait on the way.
        """
        meets = self.meets(path, machine) if meets is None else meets
        exact, after = exact or {}, {**(after or {}), **(exact or {})}
        labels: list[list[tuple[float, float, int]]] = []
        for i in range(len(path)):
            row: list[tuple[float, float, int]] = []
            came = (
                [(time, math.inf, -1)]
                if i == 0
                else [(t + float(path.spent[i - 1]), until, k) for k, (t, until, _) in enumerate(labels[-1])]
            )
            for low, high in self._safe(meets[i], time):
                best: tuple[float, float, int] | None = None
                for t, until, k in came:
                    enter = max(t, low, after.get(i, -math.inf))
                    if i in exact and enter > exact[i] + 1e-6:
                        continue
                    if enter <= until and enter < high and (best is None or enter < best[0]):
                        best = enter, high, k
                if best is not None:
                    row.append(best)
            if not row:
                return None
            labels.append(row)
        spent = float(path.spent[-1])
        ends = [
            (t, k)
            for k, (t, high, _) in enumerate(labels[-1])
            if high == math.inf or (not stays and t + spent < high)
        ]
        if not ends:
            return None
        t, k = min(ends)
        times: list[float] = []
        highs: list[float] = []
        for row in reversed(labels):
            times.append(row[k][0])
            highs.append(row[k][1])
            k = row[k][2]
        times.reverse()
        left_by = [math.inf, *highs[:0:-1]]
        for i in range(len(times) - 2 if not early else max(exact, default=0) - 1, -1, -1):
            if i not in exact:
                times[i] = max(times[i], min(times[i + 1] - float(path.spent[i]), left_by[i]))
        return times

    def called(self, caller: str, number: int) -> None:
        """Who is called sets out, with a segment, when the caller is as far as it is planned to be then."""
        start = self.segments[number].into
        own = (s for s in reversed(self.segments) if s.machine == caller and s.into < start and not s.is_off)
        entered, left = next(own, None), next(own, None)
        if entered is not None and left is not None:
            self.calls.append((left.number, number))

    def _safe(self, meets: Sequence[int], time: float) -> list[tuple[float, float]]:
        """Intervals from a time on in which nobody else has a place; the first begins before."""
        others = (self.segments[m] for m in meets if not self.segments[m].is_off)
        gap = PARAMS.gap_s
        taken = sorted((o.into - gap, o.out + gap) for o in others if o.out + gap > time)
        free, at = [], -math.inf
        for low, high in taken:
            if low > at:
                free.append((at, low))
            at = max(at, high)
        if at < math.inf:
            free.append((at, math.inf))
        return free

    def commit(
        self, machine: str, path: Path, times: Sequence[float], meets: Sequence[Sequence[int]] | None = None
    ) -> list[int]:
        """Grant a path at times of entry; returns the numbers of its segments."""
        meets = self.meets(path, machine) if meets is None else meets
        before = self.segments[self.last[machine]]
        numbers = self._append(machine, path, times, meets)
        before.out, before.next = times[0], numbers[0]
        return numbers

    def order(self) -> Iterator[tuple[int, int]]:
        """(a, b): b is entered when a is left.

        Of each other machine the last one before a segment, and the first one after: those between follow.
        """
        met: list[list[int]] = [[] for _ in self.segments]
        for b, others in enumerate(self.met):
            for a in others:
                if not (self.segments[a].is_off or self.segments[b].is_off):
                    met[b].append(a)
        for own, others in zip(self.segments, met, strict=True):
            earlier: dict[str, Segment] = {}
            later: dict[str, Segment] = {}
            for o in (self.segments[k] for k in others):
                if o.out <= own.into:
                    if o.machine not in earlier or earlier[o.machine].number < o.number:
                        earlier[o.machine] = o
                elif o.machine not in later or later[o.machine].number > o.number:
                    later[o.machine] = o
            yield from ((o.number, own.number) for o in earlier.values())
            yield from ((own.number, o.number) for o in later.values())
        yield from self.calls

    def _append(
        self, machine: str, path: Path, times: Sequence[float], meets: Sequence[Sequence[int]]
    ) -> list[int]:
        numbers: list[int] = []
        for i, t in enumerate(times):
            number = len(self.segments)
            if numbers:
                self.segments[numbers[-1]].out, self.segments[numbers[-1]].next = t, number
            self.segments.append(Segment(number, machine, path, i, float(t)))
            self.met.append(meets[i])
            numbers.append(number)
        self._taken.add(machine, path.swept)
        self.last[machine] = numbers[-1]
        return numbers

    def take_off(self, behind: int) -> None:
        """What a machine does behind one of its segments is no longer granted; it stands at its end."""
        last = self.segments[behind]
        gone, n = [], last.next
        while n >= 0:
            gone.append(self.segments[n])
            gone[-1].is_off, n = True, gone[-1].next
        self._off.append((behind, last.next, gone))
        last.out, last.next = math.inf, -1
        self.last[last.machine] = behind

    def clear(self) -> list[int]:
        """Forget what was taken off, and all swept ground, so that nothing more can be granted; returns the
        new number of each segment, -1 for those taken off.
        """
        new, count = [], 0
        for s in self.segments:
            new.append(-1 if s.is_off else count)
            count += not s.is_off
        self.calls = [(new[a], new[b]) for a, b in self.calls if new[a] >= 0 and new[b] >= 0]
        self.met = [
            [new[o] for o in others if new[o] >= 0]
            for s, others in zip(self.segments, self.met, strict=True)
            if not s.is_off
        ]
        self.segments = [s for s in self.segments if not s.is_off]
        for s in self.segments:
            s.number, s.next = new[s.number], new[s.next] if s.next >= 0 else -1
        self.last = {name: new[n] for name, n in self.last.items()}
        self.together = [(new[a], new[b]) for a, b in self.together]
        self._taken, self._off = Taken(), []
        return new

    def mark(self) -> tuple[int, int, int, int, dict[str, int]]:
        """What `back` goes back to."""
        sizes = len(self.segments), len(self.calls), len(self.together), len(self._off)
        return (*sizes, dict(self.last))

    def back(self, mark: tuple[int, int, int, int, dict[str, int]]) -> None:
        """Take back all that was granted, or taken off, since a mark."""
        segments, calls, together, off, last = mark
        self._taken.back(segments)
        del self.segments[segments:], self.met[segments:]
        del self.calls[calls:], self.together[together:]
        for behind, following, gone in reversed(self._off[off:]):
            self.segments[behind].out, self.segments[behind].next = gone[0].into, following
            for s in gone:
                s.is_off = False
        del self._off[off:]
        self.last = last
        for number in last.values():
            self.segments[number].out, self.segments[number].next = math.inf, -1


@dataclass
class Order:
    """The order of a table for execution, without its times.

    spent: least time in each segment [s]
    before: for each segment those that are entered before it, and whether their time is over then
    groups: segments that are entered at once, in an order in which each depends on earlier ones alone
    """

    spent: Array
    before: list[list[tuple[int, int]]]
    groups: list[list[int]]

    def times(self, spent: Array) -> Array:
        """Times of entry, (n, draws), with times spent in the segments, (n, draws) [s]."""
        into = np.zeros(spent.shape)
        for group in self.groups:
            t = np.zeros(spent.shape[1])
            for number in group:
                for other, waits in self.before[number]:
                    t = np.maximum(t, into[other] + (spent[other] if waits else 0.0))
            for number in group:
                into[number] = t
        return into


def order_of(table: Table) -> Order:
    """The order of a table. ValueError for a circle, which planned times exclude."""
    count = len(table.segments)
    before: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for s in table.segments:
        if s.next >= 0:
            before[s.next].append((s.number, 1))
    for a, b in table.order():
        leaves = table.segments[a].next
        if leaves < 0:
            raise ValueError(f"segment {b} waits for {a}, which is never left")
        before[b].append((leaves, 0))
    group_of = list(range(count))
    members = {i: [i] for i in range(count)}
    for a, b in table.together:
        if group_of[a] != group_of[b]:
            gone = group_of[b]
            for m in members[gone]:
                group_of[m] = group_of[a]
            members[group_of[a]] += members.pop(gone)
    needs = {g: {group_of[o] for m in ms for o, _ in before[m] if o != m} for g, ms in members.items()}
    try:
        groups = [members[g] for g in TopologicalSorter(needs).static_order()]
    except CycleError as error:
        raise ValueError(f"segments wait for each other in a circle: {error.args[1]}") from None
    return Order(np.array([s.spent for s in table.segments]), before, groups)
