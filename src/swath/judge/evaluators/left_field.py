"""When a machine that cuts leaves its field, or passes the end of its edge."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from swath.core.blocks import Seen
from swath.core.number_text import num
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Event, Later, Metric
from swath.signals import CropFlow, MachineState

GROUP = "Harvest"
BESIDE_M = 2.0  # the field without a boundary ends this far on the cut side of the edge
STEP_M = 0.5  # driven between two looks
CHUNK = 16  # of them are judged together

_Place = tuple[int, float, list[float]]  # time [ns], distance [m], pose


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
        self._end = setup.machine.geometry.header_end(setup.machine.edge_side)
        (x, left), (_, right) = (setup.machine.geometry.header_end(side) for side in ("left", "right"))
        self._knife = np.array([(x, left), (x, 0.5 * (left + right)), (x, right)])
        self._looked_at, self._next = 0.0, 0.0
        self._waiting: list[_Place] = []
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
            times, ways, poses = states["t"], states["distance"], states["pose"]
            while len(due := (ways[begin:] >= self._next).nonzero()[0]):
                begin += int(due[0])
                way = ways[begin].item()
                self._waiting.append((times[begin].item(), way, poses[begin].tolist()))
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
        places, self._waiting = self._waiting, []
        if not places:
            return
        pose = np.array([numbers for *_, numbers in places])[..., None]
        x = pose[:, 3] * self._knife[:, 0] + pose[:, 4] * self._knife[:, 1] + pose[:, 0]  # (n, 3)
        y = pose[:, 6] * self._knife[:, 0] + pose[:, 7] * self._knife[:, 1] + pose[:, 1]
        setup = self.setup
        along, left = setup.edge.project(x.ravel(), y.ravel())
        inside = (-self._side * left).reshape(x.shape).max(axis=1).tolist()
        beyond = along.reshape(x.shape)[:, self._end_row] > setup.edge.length
        beside = f"more than {num(BESIDE_M)} m beside its edge"
        is_bounded = setup.field.boundary is not None
        for place, why, within, is_beyond in zip(
            places, setup.field.each_outside(x, y), inside, beyond.tolist(), strict=True
        ):
            why = why or ("" if is_bounded or within >= -BESIDE_M else beside)
            _, distance, _ = place
            if self._open is not None:
                self._way += distance - self._looked_at
            if not why:
                self._was_inside = True
                if self._open is not None:
                    self._end_event(self._open, place)
            elif self._was_inside and self._open is None:
                self._open = len(self._events)
                self._note(place, "left_the_field", f"left the field, {why}", is_over=False)
            if is_beyond and not self._is_beyond and self._was_inside:
                self._note(place, "edge_end", "passed the end of its edge", is_over=True)
            self._is_beyond, self._looked_at = is_beyond, distance

    def _note(self, place: "_Place", kind: str, text: str, *, is_over: bool) -> None:
        (t, distance, p), (ahead, aside) = place, self._end
        x, y = p[3] * ahead + p[4] * aside + p[0], p[6] * ahead + p[7] * aside + p[1]
        end = t if is_over else None
        self._events.append(Event(t, kind, self.setup.name, x, y, distance, text, end_t=end))

    def _end_event(self, index: int, place: "_Place") -> None:
        event, (t, distance, _) = self._events[index], place
        text = f"{event.text}, for {num(distance - event.distance, places=1)} m"
        self._events[index] = replace(event, text=text, end_t=t, end_distance=distance)
        self._open = None


LEVEL = Level(LeftField, None, summary="when the machine leaves its field or passes the end of its edge")
