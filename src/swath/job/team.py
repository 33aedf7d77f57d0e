"""Which combine takes which pass next, and in which direction."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

from swath.job.ground import CutGround
from swath.job.plan import FieldPlan, PlannedPass
from swath.job.states import CombineState, way_between

MOST_ORDERS = 5000  # in which passes may be shared out
LEAD = 100.0  # m that one is ahead of another that begins the side beside it. Estimate
TURN = 20.0  # s, of a turn onto the next pass; to tell who is there first


class Passes:
    """Passes of a plan, handed out. In echelon, neighbours are handed out side by side.

    Own lands: the sides of the opening rounds, then each combine keeps to the land that it has begun, and
    takes another that nobody has; when there is none it helps in the longest one, from its end, where it is
    there before those who work it. taken: pass and number of the combine, in the order of taking;
    ground: that is cut

    by: number of the combine that cuts each pass, in the order of the plan; none = as above
    """

    def __init__(
        self,
        plan: FieldPlan,
        combines: Sequence[CombineState],
        together: str,
        by: Sequence[int] | None = None,
    ) -> None:
        self.together, self._combines = together, combines
        self._shared_out: dict[int, deque[int]] | None = None
        if by is not None:
            numbers = {c.number for c in combines}
            self._shared_out = {k: deque(i for i, own in enumerate(by) if own == k) for k in numbers}
        self._all = list(plan.passes)
        self._headland = deque(i for i, p in enumerate(plan.passes) if p.kind == "headland")
        self._lands: dict[int, deque[int]] = {}
        for i, p in enumerate(plan.passes):
            if p.kind != "headland":
                self._lands.setdefault(p.land, deque()).append(i)
        self._own: dict[int, int] = {}
        self.taken: list[tuple[int, int]] = []
        self._row = deque(range(len(plan.passes)))
        spec = combines[0].spec
        self.ground = CutGround(plan.passes, spec.sheet.header_width, spec.pipe)
        self._is_order_open = together != "echelon" and len(combines) > 1
        self._outside = {i: self._outside_of(i) for i in self._headland} if self._is_order_open else {}

    def __getitem__(self, index: int) -> PlannedPass:
        return self._all[index]

    def left(self) -> int:
        """Passes not yet handed out."""
        if self._shared_out is not None:
            return sum(len(own) for own in self._shared_out.values())
        if self.together == "echelon":
            return len(self._row)
        return len(self._headland) + sum(len(q) for q in self._lands.values())

    def coming(self, combine: CombineState) -> list[int]:
        """Passes that a combine will take, in this order, as far as that does not turn on when others are
        done: in echelon, and in the opening rounds of several combines, it does.
        """
        if self._shared_out is not None:
            return list(self._shared_out[combine.number])
        if len(self._combines) > 1:
            if self.together == "echelon" or self._headland:
                return []
            return list(self._lands.get(self._own.get(combine.number, -1), ()))
        own = self._own.get(combine.number)
        lands = sorted(self._lands, key=lambda land: land != own)
        return [*self._headland, *(i for land in lands for i in self._lands[land])]

    def done(self, index: int) -> None:
        """A pass is cut."""
        self.ground.cut(index)

    def take(self, combine: CombineState) -> int | None:
        """Index of the next pass of a combine; None where there is no more for it.

        With several combines the order of the plan is not that of the work: whether a cart may drive beside a
        pass follows from what is cut when it is taken.
        """
        index = self._next(combine)
        if index is not None:
            self.taken.append((index, combine.number))
        if index is not None and self._is_order_open:
            task = self._all[index]
            beside = self.ground.is_free_beside(task, self._outside.get(index, ()))
            self._all[index] = replace(task, cart_beside=beside)
        return index

    def _next(self, combine: CombineState) -> int | None:
        if self._shared_out is not None:
            own = self._shared_out[combine.number]
            return own.popleft() if own else None
        if self.together == "echelon":
            return self._row.popleft() if self._row else None
        if self._headland:
            return self._side(combine)
        land = self._own.get(combine.number)
        if land is None or not self._lands[land]:
            land = self._free_land(combine)
        if land is None:
            return self._help(combine)
        self._own[combine.number] = land
        return self._lands[land].popleft()

    def _side(self, combine: CombineState) -> int:
        """The next side of the opening rounds. Several combines share out those outside of which nothing is
        left, or another one cuts well ahead: they follow each other round the field.
        """
        side = self._headland[0]
        if self._is_order_open:
            closed = {*self._headland, *(i for c in self._combines if c is not combine for i in _begins(c))}
            free = [i for i in self._headland if not self._outside[i] & closed]
            side = self._shared(combine, self._combines, free or [side])
        self._headland.remove(side)
        return side

    def _outside_of(self, index: int) -> set[int]:
        """Sides of the next round outside that lie beside one of an opening round."""
        task = self._all[index]
        outside = (i for i in self._headland if self._all[i].round_index == task.round_index - 1)
        return {i for i in outside if self.ground.is_beside(task, i)}

    def _free_land(self, combine: CombineState) -> int | None:
        """A land that nobody has begun; those who have none yet share out the next ones."""
        begun = set(self._own.values())
        free = [land for land, queue in self._lands.items() if queue and land not in begun]
        waiting = [c for c in self._combines if c.number not in self._own]
        if combine not in waiting or len(free) < len(waiting):
            return next(iter(free), None)
        firsts = {self._lands[land][0]: land for land in free[: len(waiting)]}
        return firsts[self._shared(combine, waiting, list(firsts))]

    def _shared(self, combine: CombineState, combines: Sequence[CombineState], passes: list[int]) -> int:
        """Which pass is that of a combine where several share them out so that their ways there, from the
        ends of what they cut, are the shortest together: who is done a moment earlier does not change the
        work of all. Where there are too few or too many for that: the nearest.
        """
        ways = {(c.number, i): self._way_to(c, i) for c in combines for i in passes}
        near = {
            i for c in combines for i in sorted(passes, key=lambda i: (ways[c.number, i], i))[: len(combines)]
        }
        if not 0 < math.perm(len(near), len(combines)) <= MOST_ORDERS:
            return min(passes, key=lambda i: (ways[combine.number, i], i))
        totals = {
            order: round(math.fsum(ways[c.number, i] for c, i in zip(combines, order, strict=True)))
            for order in permutations(sorted(near), len(combines))
        }
        return min(totals, key=lambda order: (totals[order], order))[list(combines).index(combine)]

    def _way_to(self, combine: CombineState, index: int) -> float:
        """From where a combine ends what it cuts to the start of a pass [m]."""
        here = combine.place if combine.task is None else combine.task.end
        return way_between(here, self._all[index].start)

    def _help(self, combine: CombineState) -> int | None:
        """The last pass of the land with most passes left, from its nearer end.

        The only one left of a land is taken where the combine is there before the land's own.
        """
        for land, queue in sorted(self._lands.items(), key=lambda item: (-len(item[1]), item[0])):
            if not queue:
                continue
            task = self._all[queue[-1]]
            ends = (way_between(combine.place, task.start), way_between(combine.place, task.end))
            time = TURN + min(ends) / combine.spec.transport
            if len(queue) == 1 and self._is_soon(land, combine, time):
                continue
            if ends[1] < ends[0]:
                self._all[queue[-1]] = task.reversed()
            return queue.pop()
        return None

    def _is_soon(self, land: int, helper: CombineState, time: float) -> bool:
        """True where one who works a land comes to its last pass within a time [s]."""
        own = [c for c in self._combines if c is not helper and self._own.get(c.number) == land]
        return any(c.phase == "cut" and c.left / max(c.pace, 0.1) + TURN < time for c in own)


def _begins(c: CombineState) -> list[int]:
    """Passes that a combine drives to, or whose first LEAD it cuts."""
    on_way = c.phase in ("way", "hold")
    is_at_begin = c.phase == "cut" and c.task is not None and c.task.length - c.left < LEAD
    return [c.taken, *([c.index] if on_way or is_at_begin else [])]
