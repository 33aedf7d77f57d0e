"""Where ways of combines meet whose passes are shared out before the job: who waits for whom.

By the rules of the level with sensors (`swath.control.job.crossings`): the order is a planned one, and
whoever is to go first lets another one go that waits there, where all are done earlier for it. What combines
tell each other is heard at once.
"""

from collections.abc import Sequence
from math import inf, sqrt
from typing import NamedTuple

from swath.control.job.crossings import Crossing, Crossings
from swath.control.job.passes import Pass
from swath.control.job.turn_speed import BRAKE
from swath.core.schedule import NS
from swath.job.messages import Messages
from swath.job.states import CombineState
from swath.signals import PeerState

AT_HOLD = 1.0  # m before where it has to wait, at which it stands


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
        self._passes, self._messages = passes, Messages(passes)
        self._rules = [Crossings(passes, c.number, crossings, c.spec.turn_speed) for c in combines]
        self._told: dict[int, PeerState] = {}

    def update(self, time: float, combines: Sequence[CombineState]) -> None:
        """Hears how far all have come; one that waits may be let go first."""
        self._told = {c.number: self._messages.progress(time, c) for c in combines}
        for n, rules in enumerate(self._rules):
            others = [said for number, said in self._told.items() if number != n]
            rules.update(round(time * NS), self._told[n], others)
            for other in self._rules:
                other.hear(rules.turned)

    def held(self, c: CombineState) -> Held:
        """Where a combine has to wait next, in its pass, the turn behind it and the pass after that."""
        task, come = self._messages.come(c)
        own, rules, found = self._messages.own(c), self._rules[c.number], Held()
        if c.phase not in ("cut", "way"):
            return found
        whole = self._messages.length(task) + self._passes[task].turn_length
        k = own.index(task)
        for then, begin in zip(own[k : k + 2], (0.0, whole), strict=False):
            for rule in rules.rules(then):
                free = begin + rule.hold(task, come) - come
                if free < found.free and not rules.has_come(rule, self._told):
                    found = Held(free, self._passes[rule.other].combine)
        return found
