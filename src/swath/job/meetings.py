"""Where ways of combines meet whose passes are shared out before the job: who waits for whom.

By the rules of the level with sensors (`swath.control.job.crossings`): the order is a planned one, and
whoever is to go first lets another one go that waits there, where all are done earlier for it. What combines
tell each other is heard at once.
"""

from collections.abc import Sequence
from math import inf, nan, sqrt
from typing import NamedTuple

from swath.control.job.abreast import own_passes
from swath.control.job.crossings import Crossing, Crossings
from swath.control.job.passes import Pass, way_along
from swath.control.job.turn_speed import BRAKE
from swath.core.schedule import NS
from swath.job.states import CombineState
from swath.signals import PeerState, Phase

AT_HOLD = 1.0  # m before where it has to wait, at which it stands
PHASES = {"cut": Phase.CUTS, "way": Phase.TURNS, "stand": Phase.STANDS, "done": Phase.DONE}


class Held(NamedTuple):
    """free: way [m] that a combine has before it has to wait, inf = none; by: number of the one it waits for
    there, -1 = nobody
    """

    free: float = inf
    by: int = -1

    @property
    def is_held(self) -> bool:
        """Whether it has to stand here."""
        return self.free <= AT_HOLD

    @property
    def limit(self) -> float:
        """Speed from which it comes to rest there [m/s]."""
        return 0.0 if self.is_held else sqrt(2.0 * BRAKE * (self.free - 0.5 * AT_HOLD))


class Meetings:
    """passes: as machines are told them; crossings: of all combines; combines: in their order"""

    def __init__(
        self, passes: Sequence[Pass], crossings: Sequence[Crossing], combines: Sequence[CombineState]
    ) -> None:
        self._passes, self._lengths = passes, [way_along(work.line_m) for work in passes]
        self._own = [own_passes(passes, c.number) for c in combines]
        self._rules = [Crossings(passes, c.number, crossings, c.spec.turn_speed) for c in combines]
        self._told: dict[int, PeerState] = {}

    def update(self, time: float, combines: Sequence[CombineState]) -> None:
        """Hears how far all have come; one that waits may be let go first."""
        self._told = {c.number: self._tells(time, c) for c in combines}
        for n, rules in enumerate(self._rules):
            others = [said for number, said in self._told.items() if number != n]
            rules.update(round(time * NS), self._told[n], others)
            for other in self._rules:
                other.hear(rules.turned)

    def held(self, c: CombineState) -> Held:
        """Where a combine has to wait next, in its pass, the turn behind it and the pass after that."""
        task, come = self._at(c)
        own, rules, found = self._own[c.number], self._rules[c.number], Held()
        if c.phase not in ("cut", "way"):
            return found
        whole = self._lengths[task] + self._passes[task].turn_length
        k = own.index(task)
        for then, begin in zip(own[k : k + 2], (0.0, whole), strict=False):
            for rule in rules.rules(then):
                free = begin + rule.hold(task, come) - come
                if free < found.free and not rules.has_come(rule, self._told):
                    found = Held(free, self._passes[rule.other].combine)
        return found

    def _tells(self, time: float, c: CombineState) -> PeerState:
        task, come = self._at(c)
        phase = PHASES.get(c.phase, Phase.STANDS)
        if c.phase == "cut" and c.left <= 0.0:
            phase = Phase.TURNS
        return PeerState(
            round(time * NS), True, 0.0, nan, nan, nan, c.speed, 0.0, phase=int(phase), task=task, come=come
        )

    def _at(self, c: CombineState) -> tuple[int, float]:
        """Number of its pass, or of the one behind which it turns, and how far it has come from its begin."""
        own = self._own[c.number]
        if c.index < 0:  # behind its last one
            return own[-1], self._lengths[own[-1]]
        if c.phase != "way":
            return c.index, self._lengths[c.index] - c.left
        if c.before < 0:
            return c.index, -c.left
        turn = self._passes[c.before].turn_length
        return c.before, self._lengths[c.before] + max(turn - c.left, 0.0)
