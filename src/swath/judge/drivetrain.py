"""How a machine's inside fared: throughput, losses, engine, fuel."""

from collections import deque

import numpy as np

from swath.core.schedule import NS
from swath.judge.metrics import SETTLING_M
from swath.signals import EngineState, MachineLoad, Signal

WINDOW_S = 2.0  # losses are averaged over this time before the peak is taken
DIESEL = 0.84  # [kg/l], EN 590 allows 0.820-0.845
RPM = np.pi / 30.0  # [rad/s]


class WorksWatch:
    """Watches loads and engine of one machine once it has driven SETTLING_M with crop in its drum."""

    def __init__(self) -> None:
        self._window: deque[tuple[int, float]] = deque()
        self._feed = [0.0, 0.0, 0.0]  # count, sum, sum of squares
        self._loss = [0.0, 0.0]  # weight, weighted sum
        self._peak_loss = 0.0
        self._engine = [0.0, 0.0]  # count, sum of loads
        self._peak_load, self._lowest = 0.0, float("inf")
        self._start: tuple[int, MachineLoad] | None = None
        self._last: MachineLoad | None = None
        self._fuel = 0.0

    def see(self, signal: Signal, distance: float) -> None:
        """Note a sample; distance [m] driven so far."""
        if isinstance(signal, MachineLoad):
            self._last = signal
            if distance >= SETTLING_M:
                self._see_load(signal)
        elif isinstance(signal, EngineState):
            self._fuel = signal.fuel_used
            if distance >= SETTLING_M:
                self._engine[0] += 1.0
                self._engine[1] += signal.load
                self._peak_load = max(self._peak_load, signal.load)
                self._lowest = min(self._lowest, signal.speed)

    def metrics(self) -> dict[str, float]:
        """What there is to say; without a load or an engine their metrics are left out."""
        found: dict[str, float] = {}
        if self._start is not None and self._last is not None and self._feed[0] > 0.0:
            count, total, squares = self._feed
            mean = total / count
            spread = np.sqrt(max(squares / count - mean * mean, 0.0))
            hours = (self._last.t - self._start[0]) / NS / 3600.0
            grain = _grain(self._last) - _grain(self._start[1])
            found = {
                "mean_throughput_t_h": grain / 1e3 / hours if hours > 0.0 else float("nan"),
                "feed_cv_percent": 100.0 * float(spread / mean) if mean > 0.0 else float("nan"),
                "mean_loss_percent": 100.0 * self._loss[1] / self._loss[0] if self._loss[0] else float("nan"),
                "peak_loss_percent": 100.0 * self._peak_loss,
            }
        if self._engine[0] > 0.0:
            found |= {
                "mean_engine_load": self._engine[1] / self._engine[0],
                "peak_engine_load": self._peak_load,
                "lowest_engine_rpm": self._lowest / RPM,
            }
            if self._last is not None and (tonnes := _grain(self._last) / 1e3) > 0.0:
                found["fuel_l_t"] = self._fuel / DIESEL / tonnes
        return found

    def _see_load(self, load: MachineLoad) -> None:
        if load.drum_flow <= 0.0:
            return
        if self._start is None:
            self._start = (load.t, load)
        for k, value in enumerate((1.0, load.feeder_flow, load.feeder_flow**2)):
            self._feed[k] += value
        self._loss[0] += load.drum_flow
        self._loss[1] += load.drum_flow * load.loss_share
        self._window.append((load.t, load.loss_share))
        while self._window[0][0] <= load.t - round(WINDOW_S * NS):
            self._window.popleft()
        self._peak_loss = max(self._peak_loss, float(np.mean([v for _, v in self._window])))


def _grain(load: MachineLoad) -> float:
    """Grain that came in so far [kg]."""
    return load.tank_grain + load.lost_grain + load.held_grain
