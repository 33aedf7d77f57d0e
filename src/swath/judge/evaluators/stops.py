"""How often a machine stopped on its way."""

from collections.abc import Mapping, Sequence

from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Event, Metric
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

    def metrics(self) -> dict[str, float]:
        """How often."""
        return {"stop_count": float(len(self._events))}

    def events(self) -> Sequence[Event]:
        """Every stop."""
        return self._events


LEVEL = Level(Stops, None, summary="how often the machine stopped on its way")
