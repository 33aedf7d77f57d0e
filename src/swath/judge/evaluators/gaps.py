"""When the header end passes a gap in the crop's edge."""

from collections.abc import Sequence
from dataclasses import replace
from math import hypot

from swath.core.blocks import Seen
from swath.core.number_text import num
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Event, Later, Metric
from swath.judge.header_path import HeaderPath
from swath.signals import MachineState

BESIDE_M = 5.0  # the header end passes a gap when it is no farther from the edge than this
STEP_M = 0.05  # driven between two looks


class Gaps(Later):
    """Events `gap`: from where the header end comes beside a gap of its edge to where it leaves it."""

    SIGNALS = (MachineState,)
    METRICS: tuple[Metric, ...] = ()
    EVENTS = ("gap",)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._end = HeaderPath(setup.machine).end
        self._looked_at = -STEP_M
        self._events: list[Event] = []
        self._open: dict[int, int] = {}  # gap -> index of its event
        self._circles: list[tuple[float, float, float]] | None = None  # around gaps: x, y, radius [m]

    def take(self, seen: Seen) -> None:
        """Look where the header end was."""
        states = seen.of(MachineState) if self.setup.gaps else None
        if states is not None:
            for k, way in enumerate(states["distance"].tolist()):
                if way - self._looked_at >= STEP_M:
                    self._looked_at = way
                    self._look(states.sample(k))

    def metrics(self) -> dict[str, float]:
        """None."""
        return {}

    def events(self) -> Sequence[Event]:
        """Every gap that was passed."""
        return self._events

    def _is_near(self, x: float, y: float) -> bool:
        """Whether a place can be beside a gap: its ends are half its length from its middle at most."""
        if self._circles is None:
            middles = [(g, self.setup.edge.point_at(0.5 * (g.start + g.end))) for g in self.setup.gaps]
            self._circles = [
                (float(at[0]), float(at[1]), 0.5 * (g.end - g.start) + BESIDE_M + 1e-3) for g, at in middles
            ]
        return any(hypot(x - u, y - v) <= radius for u, v, radius in self._circles)

    def _look(self, state: MachineState) -> None:
        x, y, _ = (float(v) for v in state.pose.apply(self._end))
        if not self._open and not self._is_near(x, y):
            return
        along, offset = (float(v) for v in self.setup.edge.project(x, y))
        for index, gap in enumerate(self.setup.gaps):
            is_beside = gap.start <= along < gap.end and abs(offset) <= BESIDE_M
            if is_beside and index not in self._open:
                text = f"passes a gap of {num(gap.end - gap.start)} m, {num(gap.depth)} m deep"
                self._open[index] = len(self._events)
                self._events.append(
                    Event(state.t, "gap", self.setup.name, x, y, state.distance, text, end_t=None)
                )
            elif not is_beside and index in self._open:
                at = self._open.pop(index)
                self._events[at] = replace(self._events[at], end_t=state.t, end_distance=state.distance)


LEVEL = Level(Gaps, None, summary="when the header end passes a gap in the edge")
