"""How old detected edges and steering commands are when they arrive."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from swath.core.blocks import Seen
from swath.core.number_text import num
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Later, Metric
from swath.signals import CropEdge, SteerCommand

OLD = 1.0  # age on arrival beyond which a time stamp is doubted [s], own choice
DOUBT = "is the t of what is sent the time [ns] for which it holds?"


class Delays(Later):
    """Time of arrival minus the time that a sample is valid for, by the samples' own time stamps.

    What arrives at the start of the run does not count: every reader has to have something to begin with.
    """

    SIGNALS = (CropEdge, SteerCommand)
    METRICS = (
        Metric("edge_delay_s", "s", "age of detected edges on arrival, 95th percentile", "Edge detection",
               "lower", "age of edges on arrival, 95th percentile"),
        Metric("command_delay_s", "s", "age of steering commands on arrival, 95th percentile", "Steering",
               "lower", "age of commands on arrival, 95th percentile"),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._ages: dict[str, Counter[int]] = {}  # how often each

    def take(self, seen: Seen) -> None:
        """Note the age of what arrives."""
        for name, kind in (("command_delay_s", SteerCommand), ("edge_delay_s", CropEdge)):
            arrived = seen.of(kind)
            if arrived is not None and (ages := (arrived.times - arrived["t"])[arrived.times > 0].tolist()):
                self._ages.setdefault(name, Counter()).update(ages)

    def metrics(self) -> dict[str, float]:
        """Metrics of what the machine has: none without an edge detection or automatic steering."""
        return {name: _percentile(ages, 95.0) / NS for name, ages in self._ages.items()}

    @property
    def notes(self) -> Sequence[str]:
        """Which are so old that their time stamps may be wrong."""
        old = [f"{n} {num(age)} s" for n, age in self.metrics().items() if not -OLD <= age <= OLD]
        return [f"{said}: {DOUBT}" for said in old]


def _percentile(ages: Counter[int], share: float) -> float:
    return float(np.percentile(np.repeat(list(ages.keys()), list(ages.values())), share))


LEVEL = Level(Delays, None, summary="how old detected edges and steering commands are on arrival")
