"""How often a machine stopped on its way."""

from collections.abc import Mapping, Sequence

import numpy as np

from swath.core.registry import Level
from swath.core.together import Samples
from swath.judge.evaluator import EvaluatorSetup, Event, Metric
from swath.judge.together import Bits, Woken, newest_of
from swath.signals import MachineState, Signal

STANDS, DRIVES = (
    0.05,
    0.5,
)  # slower than the first it stands, it has driven once it was faster than the second


class Stops:
    """Events `stop`: the machine drove, and stands."""

    OF_FIELD = False
    SIGNALS = (MachineState,)
    METRICS = (
        Metric("stop_count", "", "times that the machine drove and then stood", "Driving", decimals=0),
    )
    EVENTS = ("stop",)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._setup = setup
        self._drove = False
        self._events: list[Event] = []

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Does it drive, does it stand?"""
        for signal in outputs.values():
            if not isinstance(signal, MachineState):
                continue
            self._drove = self._drove or abs(signal.speed) > DRIVES
            if self._drove and abs(signal.speed) < STANDS:
                self._drove = False
                x, y, _ = signal.pose.position.tolist()
                gap, other = self._setup.bodies.clearance(self._setup.name)
                near = f", {gap:.1f} m before {other}" if other and gap < 20.0 else ""
                name, text = self._setup.name, f"{self._setup.name} stands{near}"
                self._events.append(Event(signal.t, "stop", name, x, y, signal.distance, text, signal.t))

    @classmethod
    def together(cls, evaluators: Sequence["Stops"]) -> Woken:
        """Of many worlds."""
        drove = np.zeros(len(evaluators), np.bool_)

        def asks(t: int, outputs: Mapping[str, Samples], active: Bits) -> Bits | None:
            state = newest_of(outputs, MachineState)
            if state is None:
                return None
            speed = np.abs(state.arrays["speed"])
            begins = ~drove & (speed > DRIVES)
            ends = drove & (speed < STANDS)
            drove[begins], drove[ends] = True, False
            changes: Bits = begins | ends
            return changes

        return Woken(evaluators, asks)

    def metrics(self) -> dict[str, float]:
        """How often."""
        return {"stop_count": float(len(self._events))}

    def events(self) -> Sequence[Event]:
        """Every stop."""
        return self._events


LEVEL = Level(Stops, None, summary="how often the machine stopped on its way")
