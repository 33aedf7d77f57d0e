"""Combines that work together: each goes where their ways meet only in the order that was planned, and in
echelon stays behind the one ahead on its left.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, inf, isfinite, sin
from typing import Annotated

from annotated_types import Ge, Le

from swath.control.job.passes import Pass, place_at_end
from swath.control.steer.guidance_line import wrapped
from swath.signals import PeerState, Phase

SAME_WAY = 0.5  # rad, between the directions of two passes that are cut side by side
BEFORE = 1.0  # m before the begin of a pass, where a combine waits for the one ahead
Progress = tuple[int, float]


@dataclass(frozen=True)
class GivesWay:
    """Not farther than way_m along the pass with the number `task`, and the turn behind it, before the other
    combine has come other_m along its pass `other`, and the turn behind that
    """

    task: Annotated[int, Ge(0), Le(100_000)]
    way_m: Annotated[float, Ge(-1e5), Le(1e5)]
    other: Annotated[int, Ge(0), Le(100_000)]
    other_m: Annotated[float, Ge(-1e5), Le(1e5)]


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
    """passes: of all combines; number: of this one; lag: behind the one ahead in echelon [m]; rules: where it
    waits
    """

    def __init__(
        self, passes: Sequence[Pass], number: int, lag: float | None, rules: Sequence[GivesWay]
    ) -> None:
        self._passes, self._own = passes, own_passes(passes, number)
        self._lag, self._rules = lag, rules

    def free(self, index: int, way: float, whole: float, said: Sequence[PeerState]) -> float:
        """Way [m] that it has before it, from so far along the index-th of its passes; inf where all is free.

        whole: length of the pass and the turn behind it [m]; said: what the other combines tell
        """
        told = {self._passes[m.task].combine: m for m in said if m.is_heard and m.task >= 0}
        free = inf
        for task, begin in zip(self._own[index : index + 2], (0.0, whole), strict=False):
            for rule in self._rules:
                if rule.task == task and not self._has_come(rule, told):
                    free = min(free, begin + rule.way_m - way)
            free = min(free, begin + self._until(task, told) - way)
        return free

    def _has_come(self, rule: GivesWay, told: Mapping[int, PeerState]) -> bool:
        said = told.get(self._passes[rule.other].combine)
        if said is None:
            return False
        return said.phase == Phase.DONE or _progress(said) >= (rule.other, rule.other_m)

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


def _progress(said: PeerState) -> Progress:
    return said.task, said.come if isfinite(said.come) else -inf
