"""Your own evaluator: how often the steered axle changes its direction, per 100 m. One file is all it takes.

evaluators: [examples/my_evaluator.py:SteeringReversals]
expect: {steering_reversals_per_100_m: {max: 120}}
"""

from collections.abc import Mapping

from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.signals import MachineState, Signal, SteerState

DEAD_BAND = 0.002  # smaller swings are no reversal [rad]


class SteeringReversals:
    """Counts reversals of the steering after settling."""

    OF_FIELD = False
    SIGNALS = (MachineState, SteerState)
    METRICS = (
        Metric("steering_reversals_per_100_m", "1/100 m", "reversals of the steered axle, after settling",
               "Comfort", "lower", "steering reversals"),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.settling_m = setup.settling_m
        self.begin = self.distance = float("nan")
        self.turned_at, self.direction, self.count = 0.0, 0, 0

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Follow the way driven and the steered angle."""
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self.distance = signal.distance
                if signal.distance >= self.settling_m and self.begin != self.begin:
                    self.begin = signal.distance
            elif isinstance(signal, SteerState) and self.begin == self.begin:
                swing = signal.angle - self.turned_at
                if swing * self.direction > 0.0:
                    self.turned_at = signal.angle
                elif abs(swing) > DEAD_BAND:
                    self.count += self.direction != 0
                    self.direction = 1 if swing > 0.0 else -1
                    self.turned_at = signal.angle

    def metrics(self) -> dict[str, float]:
        """Reversals per 100 m; nan before the machine has settled."""
        way = self.distance - self.begin
        return {"steering_reversals_per_100_m": 100.0 * self.count / way if way > 0.0 else float("nan")}
