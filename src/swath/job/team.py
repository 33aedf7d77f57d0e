"""Which combine takes which pass next."""

from collections import deque

from swath.job.plan import FieldPlan, PlannedPass


class Passes:
    """Passes of a plan, handed out. In echelon, neighbours are handed out side by side.

    Own lands: headland passes to whoever asks; then each combine keeps to the land that it has begun, and
    takes another that nobody has; when there is none it helps in the longest one, from its end.
    """

    def __init__(self, plan: FieldPlan, combines: int, together: str) -> None:
        self.together, self._count = together, combines
        self._all = plan.passes
        self._headland = deque(i for i, p in enumerate(plan.passes) if p.kind == "headland")
        self._lands: dict[int, deque[int]] = {}
        for i, p in enumerate(plan.passes):
            if p.kind != "headland":
                self._lands.setdefault(p.land, deque()).append(i)
        self._own: dict[int, int] = {}
        self._row = deque(range(len(plan.passes)))

    def __getitem__(self, index: int) -> PlannedPass:
        return self._all[index]

    def left(self) -> int:
        """Passes not yet handed out."""
        if self.together == "echelon":
            return len(self._row)
        return len(self._headland) + sum(len(q) for q in self._lands.values())

    def take(self, combine: int) -> int | None:
        """Index of the next pass of a combine; None where there is no more."""
        if self.together == "echelon":
            return self._row.popleft() if self._row else None
        if self._headland:
            return self._headland.popleft()
        land = self._own.get(combine)
        if land is None or not self._lands[land]:
            land = self._choose(combine)
            if land is None:
                return None
        taken_by_others = any(own == land for c, own in self._own.items() if c != combine)
        queue = self._lands[land]
        if taken_by_others and land != self._own.get(combine):
            return queue.pop()
        self._own[combine] = land
        return queue.popleft()

    def _choose(self, combine: int) -> int | None:
        """A land that nobody has begun, else the one with most passes left."""
        others = {land for c, land in self._own.items() if c != combine}
        open_lands = [land for land, queue in self._lands.items() if queue]
        free = [land for land in open_lands if land not in others]
        if free:
            return free[0]
        return max(open_lands, key=lambda land: (len(self._lands[land]), -land), default=None)
