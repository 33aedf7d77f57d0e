"""How well a header kept its height, and what it lost."""

import numpy as np

from swath.judge.metrics import SETTLING_M
from swath.signals import F64, CropFlow, HeaderState, Signal


class HeaderWatch:
    """Watches the header of one machine; heights count once it has driven SETTLING_M.

    lost_grain: shed by the header since the start [kg]
    """

    def __init__(self) -> None:
        self._errors: list[F64] = []
        self._band = 0.0
        self._taken = self._left = 0.0
        self._is_controlled = False
        self.lost_grain = 0.0

    def see(self, signal: Signal, distance: float) -> None:
        """Note a sample; distance [m] driven so far."""
        if isinstance(signal, CropFlow):
            self._taken += signal.grain
            self.lost_grain += signal.lost_grain
            self._left += signal.left_grain
        elif isinstance(signal, HeaderState):
            self._is_controlled, self._band = True, signal.band
            if distance >= SETTLING_M:
                self._errors.append(signal.heights - signal.wanted)

    def metrics(self) -> dict[str, float]:
        """What there is to say; nothing about a header that does not tell its height."""
        if not self._is_controlled:
            return {}
        found = dict.fromkeys(
            ("header_in_band", "header_knife_in_band", "header_height_p95_error_m"), float("nan")
        )
        if self._errors:
            error = np.array(self._errors)
            size = np.abs(error)
            found = {
                "header_in_band": float(np.mean(np.abs(error.mean(axis=1)) <= self._band)),
                "header_knife_in_band": float(np.mean(size <= self._band)),
                "header_height_p95_error_m": float(np.percentile(size, 95.0)),
            }
        whole = self._taken + self.lost_grain + self._left
        share = (self.lost_grain + self._left) / whole if whole > 0.0 else float("nan")
        return {**found, "header_loss_percent": 100.0 * share}
