"""How old detected edges and steering commands are when they arrive."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Samples
from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.judge.together import Bits
from swath.signals import CropEdge, Signal, SteerCommand


class Delays:
    """Time of arrival minus the time that a sample is valid for, by the samples' own time stamps.

    What arrives at the start of the run does not count: every reader has to have something to begin with.
    """

    OF_FIELD = False
    SIGNALS = (CropEdge, SteerCommand)
    METRICS = (
        Metric("edge_delay_s", "s", "age of detected edges on arrival, 95th percentile", "Edge detection",
               "lower", "age of edges on arrival, 95th percentile", "ms"),
        Metric("command_delay_s", "s", "age of steering commands on arrival, 95th percentile", "Steering",
               "lower", "age of commands on arrival, 95th percentile", "ms"),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._ages: dict[str, Counter[int]] = {}  # how often each

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Note the age of what arrives at t [ns]."""
        for signal in outputs.values():
            if t > 0 and isinstance(signal, SteerCommand):
                self._note("command_delay_s", t - signal.t)
            elif t > 0 and isinstance(signal, CropEdge):
                self._note("edge_delay_s", t - signal.t)

    def _note(self, name: str, age: int) -> None:
        if name not in self._ages:
            self._ages[name] = Counter()
        self._ages[name][age] += 1

    @classmethod
    def together(cls, evaluators: Sequence["Delays"]) -> "_Together":
        """Of many worlds."""
        return _Together(evaluators)

    def metrics(self) -> dict[str, float]:
        """Of what the machine has: nothing without an edge detection or automatic steering."""
        return {name: _percentile(ages, 95.0) / NS for name, ages in self._ages.items()}


def _percentile(ages: Counter[int], share: float) -> float:
    return float(np.percentile(np.repeat(list(ages.keys()), list(ages.values())), share))


class _Together:
    """The ages are those of all worlds."""

    def __init__(self, evaluators: Sequence[Delays]) -> None:
        self._evaluators, self._ages = evaluators, dict[str, Counter[int]]()

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None:
        """Note the age of what arrives at t [ns]."""
        for samples in outputs.values():
            if t > 0 and samples.kind in (SteerCommand, CropEdge):
                name = "command_delay_s" if samples.kind is SteerCommand else "edge_delay_s"
                self._ages.setdefault(name, Counter())[t - samples.t] += 1

    def give(self, world: int) -> None:
        """What was seen of a world."""
        self._evaluators[world]._ages = {name: ages.copy() for name, ages in self._ages.items()}


LEVEL = Level(Delays, None, summary="how old detected edges and steering commands are on arrival")
