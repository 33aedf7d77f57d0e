"""Throughput, losses, engine and fuel of a machine."""

from collections import deque

import numpy as np

from swath.core.blocks import Block, Seen
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Later, Metric, added_up, held
from swath.signals import EngineState, MachineLoad, MachineState

GROUP = "Crop and engine"
AVERAGED_S = 2.0  # losses are averaged over this time before the peak is taken
DIESEL = 0.84  # [kg/l], EN 590 allows 0.820-0.845
RPM = np.pi / 30.0  # [rad/s]


class Drivetrain(Later):
    """Judges loads and engine once the machine has driven the settling distance with crop in its drum."""

    SIGNALS = (MachineState, MachineLoad, EngineState)
    METRICS = (
        Metric("mean_throughput_t_h", "t/h", "grain taken in per hour, after settling", GROUP,
               "higher", "throughput of grain"),
        Metric("feed_cv_percent", "%", "coefficient of variation of the flow into the feeder house, after "
               "settling", GROUP, "lower", "scatter of the feed"),
        Metric("mean_loss_percent", "%", "grain lost in the machine, mean weighted by the flow", GROUP,
               "lower", "grain lost, mean"),
        Metric("peak_loss_percent", "%", "grain lost in the machine, largest mean over 2 s", GROUP,
               "lower", "grain lost, peak"),
        Metric("mean_engine_load", "1", "torque asked / largest torque at that speed, mean after settling",
               GROUP, "", "engine load, mean"),
        Metric("peak_engine_load", "1", "torque asked / largest torque at that speed, largest", GROUP,
               "lower", "engine load, peak"),
        Metric("lowest_engine_rpm", "1/min", "lowest engine speed after settling", GROUP,
               "higher", "lowest engine speed"),
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

    def take(self, seen: Seen) -> None:
        """Note loads and engine."""
        states, loads, engines = seen.of(MachineState), seen.of(MachineLoad), seen.of(EngineState)
        if loads is not None:
            self._first = self._first or loads.sample(0)
            self._last = loads.newest
            is_settled = held(states, "distance", loads.orders, self._distance) >= self._settling
            for k in (is_settled & (loads["drum_flow"] > 0.0)).nonzero()[0].tolist():
                self._see_load(loads, k)
        if engines is not None:
            used = engines["fuel_used"].tolist()
            self._fuel_first, self._fuel = used[0] if self._fuel_first is None else self._fuel_first, used[-1]
            is_settled = held(states, "distance", engines.orders, self._distance) >= self._settling
            load, speed = engines["load"][is_settled], engines["speed"][is_settled]
            if len(load):
                self._engine = [self._engine[0] + len(load), added_up(self._engine[1], load)]
                self._peak_load = max(self._peak_load, float(load.max()))
                self._lowest = min(self._lowest, float(speed.min()))
        if states is not None:
            self._distance = float(states["distance"][-1])

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

    def _see_load(self, loads: Block, k: int) -> None:
        """The kth of some loads, with crop in the drum."""
        t, feeder, drum, share = (loads[n][k].item() for n in ("t", "feeder_flow", "drum_flow", "loss_share"))
        if self._start is None:
            self._start = (t, loads.sample(k))
        for i, value in enumerate((1.0, feeder, feeder**2)):
            self._feed[i] += value
        self._loss[0] += drum
        self._loss[1] += drum * share
        self._recent.append((t, share))
        while self._recent[0][0] <= t - round(AVERAGED_S * NS):
            self._recent.popleft()
        total = 0.0
        for _, share in self._recent:  # in this order, whatever adds them up
            total += share
        self._peak_loss = max(self._peak_loss, total / len(self._recent))


def _grain(load: MachineLoad) -> float:
    """Grain that came in so far [kg]."""
    return load.tank_gain + load.lost_grain + load.held_grain


LEVEL = Level(Drivetrain, None, summary="throughput, losses, engine and fuel")
