"""How well a header kept its height, and what it lost."""

from collections.abc import Mapping, Sequence

import numpy as np

from swath.core.registry import Level
from swath.core.together import Samples, field_of
from swath.judge.evaluator import EvaluatorSetup, KeptRows, Metric
from swath.judge.together import Bits
from swath.signals import CropFlow, HeaderState, MachineState, Signal

GROUP = "Header height"


class HeaderHeight:
    """Height of the knife against the wanted one, after settling; grain that the header lost."""

    OF_FIELD = False
    SIGNALS = (MachineState, CropFlow, HeaderState)
    NEWEST = (MachineState,)
    METRICS = (
        Metric("header_in_band", "1", "share of the time after settling in which the knife's mean height is "
               "within its band", GROUP, "higher", "mean height within the band", "%", 1),
        Metric("header_knife_in_band", "1", "share of the time and of the knife's length within the band, "
               "after settling", GROUP,
               "higher", "knife within the band", "%", 1),
        Metric("header_height_p95_error_m", "m", "knife's height against the wanted one, 95th percentile of "
               "its size", GROUP, "lower", "height error, 95th percentile", "cm"),
        Metric("header_left_kg", "kg", "grain on ears below the knife, which stay in the field", GROUP,
               "lower", "grain left on the stubble", "", 1),
        Metric("header_loss_percent", "%", "grain shed by the header or left on ears below the knife, of all "
               "reached", GROUP, "lower", "grain lost at the header"),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._settling, self._distance = setup.settling_m, 0.0
        self._errors: KeptRows | None = None  # of the points of the knife [m]
        self._band = 0.0
        self._taken = self._left = self._lost = 0.0
        self._is_controlled = self._has_header = False

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Note heights and losses."""
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._distance = signal.distance
            elif isinstance(signal, CropFlow):
                self._has_header = True
                self._taken += signal.grain
                self._lost += signal.lost_grain
                self._left += signal.left_grain
            elif isinstance(signal, HeaderState):
                self._is_controlled, self._band = True, signal.band
                if self._distance >= self._settling:
                    self._note((signal.heights - signal.wanted).tolist())

    @classmethod
    def together(cls, evaluators: Sequence["HeaderHeight"]) -> "_Together":
        """Of many worlds."""
        return _Together(evaluators)

    def metrics(self) -> dict[str, float]:
        """What there is to say; of heights nothing about a header that does not tell its own."""
        found = dict.fromkeys([m.name for m in self.METRICS[:3]] if self._is_controlled else [], float("nan"))
        if self._errors is not None:
            error = self._errors.table()
            size = np.abs(error)
            found["header_in_band"] = float(np.mean(np.abs(error.mean(axis=1)) <= self._band))
            found["header_knife_in_band"] = float(np.mean(size <= self._band))
            found["header_height_p95_error_m"] = float(np.percentile(size, 95.0))
        if self._has_header:
            whole, lost = self._taken + self._lost + self._left, self._lost + self._left
            found["header_left_kg"] = self._left
            found["header_loss_percent"] = 100.0 * lost / whole if whole > 0.0 else float("nan")
        return found

    def _note(self, errors: list[float]) -> None:
        if self._errors is None:
            self._errors = KeptRows(len(errors))
        self._errors.add(errors)


class _Together:
    """Sums of flows; heights of knives one by one."""

    def __init__(self, evaluators: Sequence[HeaderHeight]) -> None:
        self._evaluators = evaluators
        self._distance, *self._sums = np.zeros((4, len(evaluators)))
        self._has_header = False

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None:
        """Note heights and losses."""
        for name, samples in outputs.items():
            if samples.kind is MachineState:
                self._distance[:] = samples.arrays["distance"]
            elif samples.kind is CropFlow:
                self._has_header = True
                for total, part in zip(self._sums, ("grain", "lost_grain", "left_grain"), strict=True):
                    total += field_of(samples, part)
            elif samples.kind is HeaderState:
                for world in np.flatnonzero(active).tolist():
                    self._evaluators[world]._distance = float(self._distance[world])
                    self._evaluators[world].see(slot, t, {name: samples.of(world)})

    def give(self, world: int) -> None:
        """What was seen of a world."""
        e = self._evaluators[world]
        e._taken, e._lost, e._left = (float(total[world]) for total in self._sums)
        e._distance, e._has_header = float(self._distance[world]), self._has_header


LEVEL = Level(HeaderHeight, None, summary="how well the header kept its height, and what it lost")
