"""Whether a machine gets stuck in soft soil; the run then ends."""

from collections.abc import Mapping, Sequence
from math import nan

from swath.core.blocks import number_of, samples_of
from swath.core.number_text import num
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Event, Metric
from swath.machine.on_soil import in_field
from swath.machine.soil import STUCK
from swath.signals import MachineLoad, MachineState, Signal

PERIOD = NS // 10  # of looking [ns]
DRIVES = 0.05  # slower it stands [m/s]


class Stuck:
    """Event `stuck`: the mobility number of a driven wheel of a machine that drives is below 1.85, the least
    with which a vehicle gets through (`machine/soil.py`). Only where the field has soil, for machines whose
    data sheet tells their tyres. What digs itself in would have to be towed, so that the run ends, and fails.
    """

    OF_FIELD = False
    SIGNALS: tuple[type[Signal], ...] = (MachineState, MachineLoad)
    METRICS = (
        Metric("stuck_count", "", "times that the machine got stuck, which ends the run", "Safety", "lower",
               "got stuck", is_windowed=False),
        Metric("least_mobility", "", "least mobility number of a driven wheel: below 1.85 it is stuck",
               "Safety", "higher", "least mobility number", is_windowed=False),
    )  # fmt: skip
    EVENTS = ("stuck",)
    LIMITS: Mapping[str, Mapping[str, float]] = {}

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._name, self._next, self._grain, self._least = setup.name, 0, 0.0, nan
        self._events: list[Event] = []
        self._on = in_field(setup.field, setup.machine.geometry)
        if self._on is None:
            self.SIGNALS = ()
        else:
            self.LIMITS = {"stuck_count": {"max": 0.0}}

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look what is under the wheels."""
        for load in samples_of(outputs, MachineLoad):
            self._grain = max(load.tank_grain, 0.0)
        now = number_of(outputs, MachineState, "t")
        if now is None or now < self._next or self._events or self._on is None:
            return
        self._next = int(now) + PERIOD
        (state,) = samples_of(outputs, MachineState)
        if abs(state.speed) < DRIVES:
            return
        x, y, _ = state.pose.position.tolist()
        number = self._on.number(x, y, state.pose.euler()[2], self._grain)
        self._least = min(number, self._least)
        if number < STUCK:
            where = f"at {num(state.t / NS, places=1)} s, x = {num(x, places=1)} m, y = {num(y, places=1)} m"
            text = f"stuck {where}: mobility number {num(number)}, {num(STUCK)} is needed"
            begun = state.t, "stuck", self._name, x, y, state.distance
            self._events.append(Event(*begun, text, end_t=state.t))

    def metrics(self) -> dict[str, float]:
        """1 for a machine that got stuck, else 0; nothing on firm ground."""
        if self._on is None:
            return {}
        return {"stuck_count": float(len(self._events)), "least_mobility": self._least}

    def events(self) -> Sequence[Event]:
        """At most one."""
        return self._events

    def end_reason(self, t: int) -> str:
        """Where it got stuck, once it did."""
        return self._events[0].text if self._events else ""


LEVEL = Level(Stuck, None, summary="whether a machine gets stuck in soft soil, which ends the run")
