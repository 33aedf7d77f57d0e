"""How well a header kept its height, and what it lost."""

import numpy as np

from swath.core.blocks import Seen
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, KeptRows, Later, Metric, added_up, held
from swath.signals import CropFlow, HeaderState, MachineState

GROUP = "Header height"


class HeaderHeight(Later):
    """Height of the knife against the wanted one, after settling; grain that the header lost."""

    SIGNALS = (MachineState, CropFlow, HeaderState)
    METRICS = (
        Metric("header_in_band", "1", "share of the time after settling in which the knife's mean height is "
               "within its band", GROUP, "higher", "mean height within the band"),
        Metric("header_knife_in_band", "1", "share of the time and of the knife's length within the band, "
               "after settling", GROUP,
               "higher", "knife within the band"),
        Metric("header_height_p95_error_m", "m", "knife's height against the wanted one, 95th percentile of "
               "its size", GROUP, "lower", "height error, 95th percentile"),
        Metric("header_left_kg", "kg", "grain on ears below the knife, which stay in the field", GROUP,
               "lower", "grain left on the stubble"),
        Metric("header_loss_percent", "%", "grain shed by the header or left on ears below the knife, of all "
               "reached", GROUP, "lower", "grain lost at the header"),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._settling, self._distance = setup.settling_m, 0.0
        self._errors: KeptRows | None = None  # of the points of the knife [m]
        self._band = 0.0
        self._taken = self._left = self._lost = 0.0
        self._is_controlled = self._has_header = False

    def take(self, seen: Seen) -> None:
        """Note heights and losses."""
        states, flows, headers = seen.of(MachineState), seen.of(CropFlow), seen.of(HeaderState)
        if flows is not None:
            self._has_header = True
            self._taken = added_up(self._taken, flows["grain"])
            self._lost = added_up(self._lost, flows["lost_grain"])
            self._left = added_up(self._left, flows["left_grain"])
        if headers is not None:
            self._is_controlled, self._band = True, float(headers["band"][-1])
            is_settled = held(states, "distance", headers.orders, self._distance) >= self._settling
            if is_settled.any():
                errors = headers["heights"][is_settled] - headers["wanted"][is_settled, None]
                if self._errors is None:
                    self._errors = KeptRows(errors.shape[1])
                self._errors.add(errors)
        if states is not None:
            self._distance = float(states["distance"][-1])

    def metrics(self) -> dict[str, float]:
        """What there is to say; of heights nothing about a header that does not report its own."""
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


LEVEL = Level(HeaderHeight, None, summary="how well the header kept its height, and what it lost")
