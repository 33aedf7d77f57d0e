"""Whether a machine touches an obstacle or another machine, and how near it comes to them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isnan

import numpy as np

from swath.core.number_text import num
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import TRAILER, Contact
from swath.judge.evaluator import NEVER, EvaluatorSetup, Event, KeptRows, Metric
from swath.record.tracks import Column
from swath.signals import F64, MachineState, Signal

PERIOD = NS // 20  # of looking [ns]
FAR_M = 50.0  # what is farther away is nothing
APART_S = 1.0  # after so long without touching a contact has ended


@dataclass
class _Touch:
    """A contact that lasts. last: the machine when they touched last; index: of its event, if it has one."""

    last: MachineState
    index: int | None = None


class ContactWatch:
    """Events `contact`: the body of the machine overlaps an obstacle or the body of another machine.

    Looked for at most 20 times per second. A contact ends when the two have not touched for APART_S. Two
    machines that touch each count it, and one event reports both.
    """

    OF_FIELD = False
    SIGNALS = (MachineState,)
    METRICS = (
        Metric("contact_count", "", "times that the machine touched an obstacle or another machine", "Safety",
               "lower", "contacts", margin="least_clearance_m"),
        Metric("least_clearance_m", "m", "least distance to an obstacle or machine, a lower bound above 5 m",
               "Safety", "higher", "least clearance"),
    )  # fmt: skip
    COLUMNS = ("clearance_m",)
    EVENTS = ("contact",)
    LIMITS: Mapping[str, Mapping[str, float]] = {"contact_count": {"max": 0.0}}

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._next = 0
        self._count = 0
        self._noted = KeptRows(2)  # times [s] from which on the clearance is another [m]
        self._since, self._clearance, self._least = float("-inf"), float("nan"), float("inf")
        self._touched: dict[str, _Touch] = {}  # by the other body
        self._events: list[Event] = []
        self._reason = ""

    @property
    def rests_until(self) -> int:
        """For ever where there is nothing to look at."""
        return NEVER if self.setup.bodies.is_alone else self._next

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look around whenever the machine has moved for a while."""
        for signal in outputs.values():
            if isinstance(signal, MachineState) and signal.t >= self.rests_until:
                self._next = signal.t + PERIOD
                self._look(signal)

    def metrics(self) -> dict[str, float]:
        """How often it touched something, and how near it came where there is something."""
        least = {"least_clearance_m": self._least} if self._least < float("inf") else {}
        return {"contact_count": float(self._count), **least}

    def columns(self) -> tuple[Column, ...]:
        """Distance to the nearest body."""
        meaning = "to the nearest obstacle or machine, a lower bound above 5 m; nan = none within 50 m"
        return (Column("clearance_m", "m", meaning, later=self._at_rows, is_by_row=True),)

    def events(self) -> Sequence[Event]:
        """Every contact, of two machines only in the list of the first by name."""
        return self._events

    def end_reason(self, t: int) -> str:
        """The first contact, where contacts end the run."""
        return self._reason if self._reason and self.setup.contact_ends_run else ""

    def _at_rows(self, tracks: Mapping[str, F64]) -> F64:
        """The clearance at the rows of the tracks: as it was found last."""
        at = tracks["t_s"]
        if len(at) and at[0] >= self._since:
            return np.full(len(at), self._clearance)
        t, clearance = np.vstack([[[-np.inf, np.nan]], self._noted.table()]).T
        return np.asarray(clearance[np.searchsorted(t, at, side="right") - 1])

    def _look(self, state: MachineState) -> None:
        bodies, nearest = self.setup.bodies, float("inf")
        for body in bodies.own(self.setup.name):
            distance, _ = bodies.clearance(body)
            nearest = min(nearest, distance)
            for contact in bodies.contacts(body) if distance == 0.0 else []:
                other = contact.second.removesuffix(TRAILER)
                if other not in self._touched:
                    self._begin(replace(contact, second=other), state)
                self._touched[other].last = state
        self._least = min(self._least, nearest)
        before, self._clearance = self._clearance, nearest if nearest <= FAR_M else float("nan")
        if self._clearance != before and not (isnan(self._clearance) and isnan(before)):
            self._since = state.t / NS
            self._noted.add([[self._since, self._clearance]])
        for other, touch in list(self._touched.items()):
            if state.t - touch.last.t >= APART_S * NS:
                self._end(self._touched.pop(other))

    def _begin(self, contact: Contact, state: MachineState) -> None:
        name, other = self.setup.name, contact.second
        self._count += 1
        self._reason = self._reason or f"touched {other} at {num(state.t / NS, places=1)} s"
        self._touched[other] = _Touch(state)
        if other in self.setup.machines and other < name:
            return  # the other one reports it
        self._touched[other].index = len(self._events)
        begun = state.t, "contact", name, contact.point[0], contact.point[1], state.distance
        self._events.append(Event(*begun, f"{name} touches {other}", end_t=None, other=other))

    def _end(self, touch: _Touch) -> None:
        if touch.index is not None:
            event, t = self._events[touch.index], touch.last.t
            text = f"{event.machine} touched {event.other} for {num((t - event.t) / NS, places=2)} s"
            ended = replace(event, text=text, end_t=t, end_distance=touch.last.distance)
            self._events[touch.index] = ended


LEVEL = Level(ContactWatch, None, summary="whether the machine touches an obstacle or another machine")
