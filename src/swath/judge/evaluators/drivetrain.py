"""Throughput, losses, engine and fuel of a machine."""

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Samples, field_of
from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.judge.together import Bits
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

    @classmethod
    def together(cls, evaluators: Sequence["Drivetrain"]) -> "_Together":
        """Of many worlds."""
        return _Together(evaluators)

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
        total = 0.0
        for _, share in self._recent:  # in this order, whatever adds them up
            total += share
        self._peak_loss = max(self._peak_loss, total / len(self._recent))

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


class _Together:
    """Loads of all worlds; engines one by one. recent: time, where crop was in the drum, share lost"""

    def __init__(self, evaluators: Sequence[Drivetrain]) -> None:
        n = len(evaluators)
        self._evaluators = evaluators
        self._settling = np.array([e._settling for e in evaluators])
        self._distance, self._peak = np.zeros((2, n))
        self._feed, self._loss = np.zeros((3, n)), np.zeros((2, n))
        self._recent: deque[tuple[int, Bits, np.ndarray]] = deque()
        self._is_first = True
        self._load: Samples | None = None

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None:
        """Note loads and engines."""
        for name, samples in outputs.items():
            if samples.kind is MachineState:
                self._distance[:] = samples.arrays["distance"]
            elif samples.kind is MachineLoad:
                self._see_load(samples, active)
            elif samples.kind is EngineState:
                for world in np.flatnonzero(active).tolist():
                    self._evaluators[world]._distance = float(self._distance[world])
                    self._evaluators[world].see(slot, t, {name: samples.of(world)})

    def give(self, world: int) -> None:
        """What was seen of a world."""
        e = self._evaluators[world]
        e._distance, e._peak_loss = float(self._distance[world]), float(self._peak[world])
        e._feed, e._loss = self._feed[:, world].tolist(), self._loss[:, world].tolist()
        e._last = None if self._load is None else self._load.of(world)

    def _see_load(self, samples: Samples, active: Bits) -> None:
        self._load = samples
        drum, feeder, share = (field_of(samples, k) for k in ("drum_flow", "feeder_flow", "loss_share"))
        counts = (self._distance >= self._settling) & (drum > 0.0)
        begins = counts & (self._feed[0] == 0.0) & active
        for world in np.flatnonzero(begins | self._is_first).tolist():
            e, load = self._evaluators[world], samples.of(world)
            e._first = e._first or load
            if begins[world]:
                e._start = samples.t, load
        self._is_first = False
        for total, value in zip(self._feed, (1.0, feeder, feeder**2), strict=True):
            total += np.where(counts, value, 0.0)
        for total, value in zip(self._loss, (drum, drum * share), strict=True):
            total += np.where(counts, value, 0.0)
        self._recent.append((samples.t, counts, np.where(counts, share, 0.0)))
        while self._recent[0][0] <= samples.t - round(AVERAGED_S * NS):
            self._recent.popleft()
        number = np.sum([counted for _, counted, _ in self._recent], axis=0)
        total = np.zeros(len(drum))
        for _, _, share in self._recent:
            total += share
        mean = total / np.maximum(number, 1)
        self._peak = np.where(counts, np.maximum(self._peak, mean), self._peak)


LEVEL = Level(Drivetrain, None, summary="throughput, losses, engine and fuel")
