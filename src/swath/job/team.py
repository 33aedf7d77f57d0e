"""Which combine takes which pass next, and in which direction."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from swath.job.ground import CutGround
from swath.job.plan import FieldPlan, PlannedPass
from swath.job.states import CombineState, way_between

TURN = 20.0  # s, of a turn onto the next pass; to tell who is there first


class Passes:
    """Passes of a plan, handed out. In echelon, neighbours are handed out side by side.

    Own lands: the sides of the opening rounds, then each combine keeps to the land that it has begun, and
    takes another that nobody has; when there is none it helps in the longest one, from its end, where it is
    there before those who work it.
    """

    def __init__(self, plan: FieldPlan, combines: Sequence[CombineState], together: str) -> None:
        self.together, self._combines = together, combines
        self._all = list(plan.passes)
        self._headland = deque(i for i, p in enumerate(plan.passes) if p.kind == "headland")
        self._lands: dict[int, deque[int]] = {}
        for i, p in enumerate(plan.passes):
            if p.kind != "headland":
                self._lands.setdefault(p.land, deque()).append(i)
        self._own: dict[int, int] = {}
        self._row = deque(range(len(plan.passes)))
        self._ground: CutGround | None = None
        if together != "echelon" and len(combines) > 1:
            spec = combines[0].spec
            self._ground = CutGround(plan.passes, spec.sheet.header_width, spec.pipe)

    def __getitem__(self, index: int) -> PlannedPass:
        return self._all[index]

    def left(self) -> int:
        """Passes not yet handed out."""
        if self.together == "echelon":
            return len(self._row)
        return len(self._headland) + sum(len(q) for q in self._lands.values())

    def done(self, index: int) -> None:
        """A pass is cut."""
        if self._ground is not None:
            self._ground.cut(index)

    def take(self, combine: CombineState) -> int | None:
        """Index of the next pass of a combine; None where there is no more for it.

        With several combines the order of the plan is not that of the work: whether a cart may drive beside a
        pass follows from what is cut when it is taken.
        """
        index = self._next(combine)
        if index is not None and self._ground is not None:
            task = self._all[index]
            self._all[index] = replace(task, cart_beside=self._ground.is_free_beside(task))
        return index

    def _next(self, combine: CombineState) -> int | None:
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
        """Of the outermost round that is left: the next side; with several combines the nearest."""
        now = self._all[self._headland[0]].round_index
        sides = [i for i in self._headland if self._all[i].round_index == now]
        if self._ground is not None:
            sides.sort(key=lambda i: (way_between(combine.place, self._all[i].start), i))
        self._headland.remove(sides[0])
        return sides[0]

    def _free_land(self, combine: CombineState) -> int | None:
        """A land that nobody has begun."""
        others = {land for c, land in self._own.items() if c != combine.number}
        return next((land for land, queue in self._lands.items() if queue and land not in others), None)

    def _help(self, combine: CombineState) -> int | None:
        """The last pass of the land with most passes left, from its nearer end.

        The only one left is taken where the combine is there before the land's own.
        """
        land = max(
            (land for land, queue in self._lands.items() if queue),
            key=lambda land: (len(self._lands[land]), -land), default=None,
        )  # fmt: skip
        if land is None:
            return None
        index = self._lands[land][-1]
        task = self._all[index]
        ends = (way_between(combine.place, task.start), way_between(combine.place, task.end))
        if len(self._lands[land]) == 1 and self._is_soon(land, combine, min(ends) / combine.spec.transport):
            return None
        if ends[1] < ends[0]:
            self._all[index] = task.reversed()
        return self._lands[land].pop()

    def _is_soon(self, land: int, helper: CombineState, time: float) -> bool:
        """True where one who works a land comes to its last pass within a time [s]."""
        own = [c for c in self._combines if c is not helper and self._own.get(c.number) == land]
        return any(c.phase == "cut" and c.left / max(c.pace, 0.1) + TURN < time for c in own)
