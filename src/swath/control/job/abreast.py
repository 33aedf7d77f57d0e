"""Combines that work together: each goes where their ways meet only in the order that was planned, and in
echelon stays behind the one ahead on its left.
"""

from collections.abc import Mapping, Sequence
from math import cos, inf, sin

from swath.control.job.crossings import Crossings
from swath.control.job.passes import Pass, place_at_end
from swath.control.steer.guidance_line import wrapped
from swath.signals import PeerState, Phase

SAME_WAY = 0.5  # rad, between the directions of two passes that are cut side by side
BEFORE = 1.0  # m before the begin of a pass, where a combine waits for the one ahead


def own_passes(passes: Sequence[Pass], combine: int) -> list[int]:
    """Numbers of the passes that a combine cuts, in its order."""
    return [i for i, work in enumerate(passes) if work.combine == combine]


def leader_of(passes: Sequence[Pass], task: int) -> int | None:
    """Number of the pass beside, that another combine cuts ahead the same way; None = nobody is ahead."""
    if task == 0 or passes[task - 1].combine == passes[task].combine:
        return None
    turned = wrapped(
        place_at_end(passes[task - 1].line_m).heading - place_at_end(passes[task].line_m).heading
    )
    return task - 1 if abs(turned) < SAME_WAY else None


def begins_ahead(lead: Pass, then: Pass) -> float:
    """How far ahead of the begin of one pass another one begins, along its end's direction [m]."""
    (ax, ay), (bx, by) = lead.line_m[0], then.line_m[0]
    course = place_at_end(then.line_m).heading
    return (ax - bx) * cos(course) + (ay - by) * sin(course)


class Abreast:
    """passes: of all combines; number: of this one; lag: behind the one ahead in echelon [m]"""

    def __init__(self, passes: Sequence[Pass], number: int, lag: float | None, crossings: Crossings) -> None:
        self._passes, self._own = passes, own_passes(passes, number)
        self._lag, self._crossings = lag, crossings

    def free(self, index: int, way: float, whole: float, said: Sequence[PeerState]) -> float:
        """Way [m] that it has before it, from so far along the index-th of its passes; inf where all is free.

        whole: length of the pass and the turn behind it [m]; said: what the other combines tell
        """
        told = {self._passes[m.task].combine: m for m in said if m.is_heard and m.task >= 0}
        next_ones = dict(zip(self._own[index : index + 2], (0.0, whole), strict=False))
        free = inf
        for task, begin in next_ones.items():
            free = min(free, begin + self._until(task, told) - way)
            for rule in self._crossings.rules(task):
                if not self._crossings.has_come(rule, told):
                    free = min(free, begin + rule.hold(self._own[index], way) - way)
        return free

    def _until(self, task: int, told: Mapping[int, PeerState]) -> float:
        """How far along a pass it may go for the one ahead [m]."""
        if self._lag is None or (lead := leader_of(self._passes, task)) is None:
            return inf
        ahead, said = self._passes[lead], told.get(self._passes[lead].combine)
        if said is None or said.task < lead:
            return -BEFORE
        if said.task > lead or said.phase in (Phase.TURNS, Phase.DONE):
            return inf
        return max(begins_ahead(ahead, self._passes[task]) + said.come - self._lag, -BEFORE)
