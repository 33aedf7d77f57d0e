"""How far a machine drove."""

from collections.abc import Mapping

from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.signals import MachineState, Signal


class Driving:
    """The way of the middle of the fixed axle."""

    OF_FIELD = False
    SIGNALS = (MachineState,)
    NEWEST = (MachineState,)
    METRICS = (Metric("distance_m", "m", "way of the fixed axle's centre", "Run", "", "", "", 1),)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._first: float | None = None
        self._last = 0.0

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Note the distance."""
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._last = signal.distance
                if self._first is None:
                    self._first = self._last

    def metrics(self) -> dict[str, float]:
        """The distance driven."""
        return {"distance_m": self._last - (self._first or 0.0)}


LEVEL = Level(Driving, None, summary="how far the machine drove")
