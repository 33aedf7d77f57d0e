"""Metrics of a part of a run: another instance of the evaluator sees only the samples inside the window."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.core.component import KeepsState
from swath.core.schedule import NS
from swath.judge.evaluator import Evaluator, Event, HasEvents
from swath.signals import Signal

FIELD = "field"  # the subject of what is no machine's
LATE_S = 2.0  # an event may become known this much after it happened


@dataclass(frozen=True)
class Window:
    """A part of a run; what is None sets no bound.

    from_m, to_m: distance driven [m]
    from_s, to_s: time [s]; with `after`, a kind of event, they count from the event's end, with `before`
        backwards from its beginning
    """

    from_m: float | None = None
    to_m: float | None = None
    from_s: float | None = None
    to_s: float | None = None
    after: str = ""
    before: str = ""

    @property
    def kind(self) -> str:
        """The event that it hangs on, "" where it hangs on none."""
        return self.after or self.before

    def begins_at(self, event: Event) -> bool:
        """True when the event has come so far that the window hangs on it."""
        return event.kind == self.kind and (bool(self.before) or event.end_t is not None)

    def inside(self, event: Event | None, distance: Any, time: Any) -> Any:
        """Whether distances driven [m] and times [s], numbers or arrays, lie in the window.

        event: that the window hangs on; only what lies after it, or before it, is inside
        """
        least = -np.inf if event is None else 0.0
        if event is not None and self.before:
            distance, time = event.distance - distance, event.t / NS - time
        elif event is not None:
            at = event.distance if event.end_t == event.t else event.end_distance
            distance, time = distance - at, time - (event.end_t or 0) / NS
        from_m, from_s = (least if low is None else low for low in (self.from_m, self.from_s))
        to_m, to_s = (np.inf if high is None else high for high in (self.to_m, self.to_s))
        return (distance >= from_m) & (distance <= to_m) & (time >= from_s) & (time <= to_s)


def concerns(event: Event, subject: str) -> bool:
    """Whether an event is one of a machine's, or of `field`, whose are all."""
    return subject in (FIELD, event.machine, event.other)


def state_of(evaluator: Evaluator) -> dict[str, Any]:
    """All attributes of an evaluator."""
    return dict(vars(evaluator))


def restore(evaluator: Evaluator, state: Mapping[str, Any]) -> None:
    """Give an evaluator the attributes that another of its class had."""
    vars(evaluator).clear()
    vars(evaluator).update(state)


class EventFeed(KeepsState):
    """Tells of every event that a window hangs on, once, as soon as it has come so far.

    sources: the evaluators that note events of the window's kind
    subject: a machine, or `field`
    """

    kept = ("_open", "_seen")

    def __init__(self, window: Window, sources: Sequence[HasEvents], subject: str) -> None:
        self._window, self._subject = window, subject
        self._sources = list(sources)
        self._open: list[list[int]] = [[] for _ in sources]  # events that have not come so far
        self._seen = [0] * len(self._sources)

    def fresh(self) -> list[Event]:
        """Events since the last call, in order of time."""
        found: list[Event] = []
        for k, source in enumerate(self._sources):
            events = source.events()
            waiting = [*self._open[k], *range(self._seen[k], len(events))]
            self._seen[k] = len(events)
            self._open[k] = []
            for index in waiting:
                event = events[index]
                if event.kind != self._window.kind or not concerns(event, self._subject):
                    continue
                if self._window.begins_at(event):
                    found.append(event)
                else:
                    self._open[k].append(index)
        return sorted(found, key=lambda e: (e.t, e.machine))


@dataclass
class _Stretch:
    """One occurrence of a window. event: that it hangs on; count: samples seen."""

    evaluator: Evaluator
    event: Event | None
    count: int = 0


class WindowedEvaluator:
    """Shows the samples inside a window to evaluators of their own, one for each event.

    make: a fresh evaluator. Samples before an event are kept for the length of the window, and shown when the
        event has happened.
    """

    def __init__(self, window: Window, make: Callable[[], Evaluator], feed: EventFeed) -> None:
        self.window, self._make, self._feed = window, make, feed
        self.stretches: list[_Stretch] = [] if window.kind else [_Stretch(make(), None)]
        self._kept: deque[tuple[float, int, str, Mapping[str, Signal]]] = deque()
        self._marks: deque[tuple[float, int]] = deque()

    def save(self) -> dict[str, Any]:
        """What has been seen so far."""
        return {
            "stretches": [(state_of(s.evaluator), s.event, s.count) for s in self.stretches],
            "feed": self._feed.save(),
            "kept": list(self._kept),
            "marks": list(self._marks),
        }

    def load(self, state: Mapping[str, Any]) -> None:
        """Take on a state that `save` gave."""
        self.stretches = []
        for saved, event, count in state["stretches"]:
            self.stretches.append(_Stretch(self._make(), event, count))
            restore(self.stretches[-1].evaluator, saved)
        self._feed.load(state["feed"])
        self._kept, self._marks = deque(state["kept"]), deque(state["marks"])

    def look_for_events(self) -> None:
        """Open a stretch for every event that has come since the last call."""
        if self.window.kind:
            for event in self._feed.fresh():
                self._open(event)

    def see(self, distance: float, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """A sample, with the distance driven [m]."""
        if self.window.before:
            self._keep(distance, slot, t, outputs)
            return
        for stretch in self.stretches:
            self._show(stretch, distance, slot, t, outputs)

    def _open(self, event: Event) -> None:
        stretch = _Stretch(self._make(), event)
        self.stretches.append(stretch)
        for distance, t, slot, outputs in self._kept:
            self._show(stretch, distance, slot, t, outputs)

    def _show(
        self, stretch: _Stretch, distance: float, slot: str, t: int, outputs: Mapping[str, Signal]
    ) -> None:
        if self.window.inside(stretch.event, distance, t / NS):
            stretch.evaluator.see(slot, t, outputs)
            stretch.count += 1

    def _keep(self, distance: float, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Keep the sample; drop those that are too old even for an event of LATE_S ago."""
        self._kept.append((distance, t, slot, outputs))
        self._marks.append((distance, t))
        while self._marks[0][1] < t - LATE_S * NS:
            late_m, late = self._marks.popleft()
            while self._kept and self._is_over(*self._kept[0][:2], late_m, late):
                self._kept.popleft()

    def _is_over(self, distance: float, t: int, late_m: float, late: int) -> bool:
        far = self.window.to_m is not None and late_m - distance > self.window.to_m
        return far or (self.window.to_s is not None and (late - t) / NS > self.window.to_s)
