"""How far a machine drove."""

from swath.core.blocks import Seen
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Later, Metric
from swath.signals import MachineState


class Driving(Later):
    """The way of the middle of the fixed axle."""

    SIGNALS = (MachineState,)
    METRICS = (Metric("distance_m", "m", "way of the fixed axle's centre", "Run", "", ""),)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._first: float | None = None
        self._last = 0.0

    def take(self, seen: Seen) -> None:
        """Note the distance."""
        if (states := seen.of(MachineState)) is not None:
            way = states["distance"]
            self._last = float(way[-1])
            if self._first is None:
                self._first = float(way[0])

    def metrics(self) -> dict[str, float]:
        """The distance driven."""
        return {"distance_m": self._last - (self._first or 0.0)}


LEVEL = Level(Driving, None, summary="how far the machine drove")
