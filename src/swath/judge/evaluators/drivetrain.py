"""Throughput, losses, engine and fuel of a machine."""

from collections import deque
from collections.abc import Mapping

import numpy as np

from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.signals import EngineState, MachineLoad, MachineState, Signal

GROUP = "Crop and engine"
AVERAGED_S = 2.0  # losses are averaged over this time before the peak is taken
DIESEL = 0.84  # [kg/l], EN 590 allows 0.820-0.845
RPM = np.pi / 30.0  # [rad/s]


class Drivetrain:
    """Judges loads and engine once the machine has driven the settling distance with crop in its drum."""

    OF_FIELD = False
    SIGNALS = (MachineState, MachineLoad, EngineState)
    NEWEST = (MachineState,)
    METRICS = (
        Metric("mean_throughput_t_h", "t/h", "grain taken in per hour, after settling", GROUP,
               "higher", "throughput of grain", "", 1),
        Metric("feed_cv_percent", "%", "coefficient of variation of the flow into the feeder house, after "
               "settling", GROUP, "lower", "scatter of the feed", "", 1),
        Metric("mean_loss_percent", "%", "grain lost in the machine, mean weighted by the flow", GROUP,
               "lower", "grain lost, mean"),
        Metric("peak_loss_percent", "%", "grain lost in the machine, largest mean over 2 s", GROUP,
               "lower", "grain lost, peak"),
        Metric("mean_engine_load", "1", "torque asked / largest torque at that speed, mean after settling",
               GROUP, "", "engine load, mean", "%", 0),
        Metric("peak_engine_load", "1", "torque asked / largest torque at that speed, largest", GROUP,
               "lower", "engine load, peak", "%", 0),
        Metric("lowest_engine_rpm", "1/min", "lowest engine speed after settling", GROUP,
               "higher", "lowest engine speed", "", 0),
        Metric("fuel_l_t", "l/t", "diesel per tonne of grain taken in", GROUP, "lower", "diesel"),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._settling, self._distance = setup.settling_m, 0.0
        self._recent: deque[tuple[int, float]] = deque()
        self._feed = [0.0, 0.0, 0.0]  # count, sum, sum of squares
        self._loss = [0.0, 0.0]  # weight, weighted sum
        self._peak_loss = 0.0
        self._engine = [0.0, 0.0]  # count, sum of loads
        self._peak_load, self._lowest = 0.0, float("inf")
        self._first: MachineLoad | None = None
        self._start: tuple[int, MachineLoad] | None = None
        self._last: MachineLoad | None = None
        self._fuel_first: float | None = None
        self._fuel = 0.0

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Note loads and engine."""
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._distance = signal.distance
            elif isinstance(signal, MachineLoad):
                self._first = self._first or signal
                self._last = signal
                if self._distance >= self._settling:
                    self._see_load(signal)
            elif isinstance(signal, EngineState):
                self._see_engine(signal)

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
            if self._first is not None and self._last is not None:
                tonnes = (_grain(self._last) - _grain(self._first)) / 1e3
                if tonnes > 0.0:
                    found["fuel_l_t"] = (self._fuel - (self._fuel_first or 0.0)) / DIESEL / tonnes
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
        self._recent.append((load.t, load.loss_share))
        while self._recent[0][0] <= load.t - round(AVERAGED_S * NS):
            self._recent.popleft()
        self._peak_loss = max(self._peak_loss, float(np.mean([v for _, v in self._recent])))

    def _see_engine(self, engine: EngineState) -> None:
        self._fuel = engine.fuel_used
        if self._fuel_first is None:
            self._fuel_first = engine.fuel_used
        if self._distance >= self._settling:
            self._engine[0] += 1.0
            self._engine[1] += engine.load
            self._peak_load = max(self._peak_load, engine.load)
            self._lowest = min(self._lowest, engine.speed)


def _grain(load: MachineLoad) -> float:
    """Grain that came in so far [kg]."""
    return load.tank_gain + load.lost_grain + load.held_grain


LEVEL = Level(Drivetrain, None, summary="throughput, losses, engine and fuel")
