"""When a machine that cuts leaves its field, or passes the end of its edge."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from swath.core.blocks import Seen
from swath.core.number_text import num
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Event, Later, Metric
from swath.judge.header_path import HeaderPath
from swath.signals import F64, CropFlow, MachineState

GROUP = "Harvest"
BESIDE_M = 2.0  # the field without a boundary ends this far on the cut side of the edge
STEP_M = 0.5  # driven between two looks
CHUNK = 16  # of them are judged together


class LeftField(Later):
    """Events `left_the_field`: both ends and the middle of the knife are outside; and `edge_end`: the header
    end passes the end of its edge.

    Outside is what lies beyond the boundary or the map of the terrain, in a field without a boundary also
    what lies more than BESIDE_M on the cut side of the edge. Nothing is said before the knife was inside.
    Places are judged later, many together: what they are judged by stays as it is.
    """

    SIGNALS = (MachineState, CropFlow)
    METRICS = (
        Metric("left_the_field_count", "", "times that the whole header left the field", GROUP, "lower",
               "left the field, times"),
        Metric("left_the_field_m", "m", "way driven with the whole header outside the field", GROUP, "lower",
               "left the field, distance"),
    )  # fmt: skip
    EVENTS = ("left_the_field", "edge_end")

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._end = HeaderPath(setup.machine).end
        (x, left), (_, right) = (setup.machine.geometry.header_end(side) for side in ("left", "right"))
        self._knife = [(x, left, 0.0), (x, 0.5 * (left + right), 0.0), (x, right, 0.0)]
        self._looked_at, self._next = 0.0, 0.0
        self._waiting: list[MachineState] = []
        self._side, self._end_row = (1.0, 0) if setup.machine.edge_side == "left" else (-1.0, 2)
        self._has_header = self._was_inside = self._is_beyond = False
        self._open: int | None = None  # index of the event that lasts
        self._events: list[Event] = []
        self._way = 0.0

    def take(self, seen: Seen) -> None:
        """Look where the knife was, once the header has reported."""
        states, flows = seen.of(MachineState), seen.of(CropFlow)
        if states is not None and (self._has_header or flows is not None):
            begin = 0 if self._has_header or flows is None else states.before(flows.orders[:1])[0] + 1
            for k, way in enumerate(states["distance"][begin:].tolist(), begin):
                if way >= self._next:
                    self._waiting.append(states.sample(k))
                    self._next = way + STEP_M
                    if len(self._waiting) == CHUNK:
                        self._judge()
        self._has_header |= flows is not None

    def metrics(self) -> dict[str, float]:
        """Metrics of the whole path; none of a machine without a header."""
        if not self._has_header:
            return {}
        left = len([e for e in self.events() if e.kind == "left_the_field"])
        return {"left_the_field_count": float(left), "left_the_field_m": self._way}

    @property
    def notes(self) -> Sequence[str]:
        """Whether it left the field or its edge."""
        return [f"{e.text} at {num(e.distance, places=1)} m" for e in self.events()]

    def events(self) -> Sequence[Event]:
        """Every time that it left the field or its edge."""
        self._judge()
        return self._events

    def _judge(self) -> None:
        """Take in the places that wait."""
        states, self._waiting = self._waiting, []
        if not states:
            return
        knife = np.array([[state.pose.point(*p)[:2] for p in self._knife] for state in states])
        along, left = self.setup.edge.project(knife[..., 0].ravel(), knife[..., 1].ravel())
        rows = zip(states, knife, along.reshape(-1, 3), left.reshape(-1, 3), strict=True)
        for state, places, far, aside in rows:
            self._look(state, places, far, aside)
            self._looked_at = state.distance

    def _look(self, state: MachineState, knife: F64, along: F64, left: F64) -> None:
        """knife: places (3, 2); along, left: where they are on the edge [m], (3,)."""
        if self._open is not None:
            self._way += state.distance - self._looked_at
        x, y = knife.T
        inside = float((-self._side * left).max())
        why = self._why_outside(x, y, inside)
        if not why:
            self._was_inside = True
            if self._open is not None:
                self._end_event(self._open, state)
        elif self._was_inside and self._open is None:
            self._open = len(self._events)
            self._note(state, "left_the_field", f"left the field, {why}", end_t=None)
        is_beyond = bool(along[self._end_row] > self.setup.edge.length)
        if is_beyond and not self._is_beyond and self._was_inside:
            self._note(state, "edge_end", "passed the end of its edge", end_t=state.t)
        self._is_beyond = is_beyond

    def _why_outside(self, x: F64, y: F64, inside: float) -> str:
        """Why no part of the knife is in the field, "" where one is. inside: of its innermost part [m]."""
        field = self.setup.field
        if why := field.why_outside(x, y):
            return why
        if field.boundary is None and inside < -BESIDE_M:
            return f"more than {num(BESIDE_M)} m beside its edge"
        return ""

    def _note(self, state: MachineState, kind: str, text: str, *, end_t: int | None) -> None:
        x, y, _ = (float(v) for v in state.pose.apply(self._end))
        name = self.setup.name
        self._events.append(Event(state.t, kind, name, x, y, state.distance, text, end_t=end_t))

    def _end_event(self, index: int, state: MachineState) -> None:
        event = self._events[index]
        text = f"{event.text}, for {num(state.distance - event.distance, places=1)} m"
        self._events[index] = replace(event, text=text, end_t=state.t, end_distance=state.distance)
        self._open = None


LEVEL = Level(LeftField, None, summary="when the machine leaves its field or passes the end of its edge")
