"""Grain handed over on the go: how well the station is kept, how much is caught, and what is spilled."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, fsum, hypot, inf, sin

import numpy as np

from swath.core.blocks import Block, Seen
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Later, Metric
from swath.signals import F64, HeapState, MachineState, Signal, Station, TrailerState, UnloadState
from swath.signals.setup import MachineGeometry

GROUP = "Unloading"
EVERY = 1.0  # s between two profiles of the grain that are kept; twice that once there are
MOST = 1500  # of them
REACHED = 0.3  # m along and across: there the station is reached
ANEW = 4.0  # s without grain, after which a cart has to reach it anew
COMES_UP = 10.0  # s of grain, after which it is judged, reached or not


@dataclass(frozen=True)
class UnloadingSeries:
    """The course of a run, for a report.

    t [s], along, across [m]: deviations while grain flows, arrays of shape (n,)

    heaps: machine -> rows of its box
    missed: of what all pipes gave, came down elsewhere [kg]
    """

    t: F64
    along: F64
    across: F64
    heaps: Mapping[str, "HeapRows"]
    missed: float


@dataclass(frozen=True)
class HeapRows:
    """A box over a run, m times. t [s]; profile: above the floor along the middle line, rear to front, shape
    (m, stations) [m]; level: over the largest heap; flow: of all pipes [kg/s]; length, depth: of the box [m].
    """

    t: F64
    profile: F64
    level: F64
    flow: F64
    length: float
    depth: float


@dataclass
class _Load:
    """What one machine pours into another one without a pause. begun, latest: grain flowed [s]."""

    begun: float = -inf
    latest: float = -inf
    is_reached: bool = False

    def is_judged(self, now: float, away: float) -> bool:
        """Grain flows at a time [s]; away: from the station, along or across [m]."""
        if now - self.latest > ANEW:
            self.begun, self.is_reached = now, False
        self.latest = now
        self.is_reached |= away <= REACHED
        return self.is_reached or now - self.begun > COMES_UP


class Unloading(Later):
    """Pairs a machine that pours with the one that keeps a station beside it, by the truth of both.

    A deviation is that of the point where the stream comes down from where it was wanted in the box, along
    and across, judged while grain flows. Grain may flow as soon as the stream is over the box, while the cart
    still comes up: of each load that is judged only from where the station was reached, or after COMES_UP.
    """

    OF_FIELD = True
    SIGNALS = (MachineState, TrailerState, UnloadState, Station, HeapState)
    METRICS = (
        Metric("unloaded_kg", "kg", "grain that came down in a box", GROUP, "", ""),
        Metric("spill_share", "1", "grain that missed a box or ran over its rim, of what left the tank",
               GROUP, "lower", "spilled"),
        Metric("box_level", "1", "grain in the fullest box, of the largest heap on its rim", GROUP, "higher",
               ""),
        Metric("unloading_s", "s", "time with grain flowing from a pipe", GROUP, "", ""),
        Metric("station_along_mean_m", "m",
               "mean |deviation| along while grain flows, once it is reached", GROUP, "lower"),
        Metric("station_along_max_m", "m",
               "largest |deviation| along while grain flows, once it is reached", GROUP, "lower"),
        Metric("station_across_mean_m", "m",
               "mean |deviation| across while grain flows, once it is reached", GROUP, "lower"),
        Metric("station_across_max_m", "m",
               "largest |deviation| across while grain flows, once it is reached", GROUP, "lower"),
        Metric("station_mean_m", "m", "mean distance from the wanted point, likewise", GROUP, "lower"),
        Metric("station_late_s", "s", "time with grain flowing before the station is reached", GROUP,
               "lower", ""),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._latest: dict[tuple[str, type[Signal]], Signal] = {}
        self._times: dict[str, int] = {}  # machine -> time of its pipe's last sample
        self._judged: list[float] = []  # times [s]
        self._rows: dict[str, list[tuple[float, F64, float, float]]] = {}
        self._every: dict[str, float] = {}
        self._along: list[float] = []
        self._across: list[float] = []
        self._loads: dict[tuple[str, str], _Load] = {}  # by the machine that pours and that with the box
        self._flowing = self._late = 0.0

    def take(self, seen: Seen) -> None:
        """Keep the newest; judge at every sample of a pipe."""
        known = [block for block in seen.blocks if issubclass(block.kind, self.SIGNALS)]
        carriers = [block for block in known if issubclass(block.kind, (MachineState, TrailerState))]
        sent = [block for block in known if block not in carriers]
        for order, place, k in sorted((o, i, k) for i, b in enumerate(sent) for k, o in enumerate(b.orders)):
            name, signal = sent[place].slot.partition(".")[0], sent[place].sample(k)
            self._latest[name, type(signal)] = signal
            if isinstance(signal, HeapState):
                self._keep(name, signal)
            elif isinstance(signal, UnloadState):
                since = (signal.t - self._times.get(name, signal.t)) / NS
                self._times[name] = signal.t
                if signal.flow > 0.0:
                    self._flowing += since
                    for block in carriers:
                        self._note(block, int(block.before(np.array([order]))[0]))
                    self._judge(name, signal, since)
        for block in carriers:
            self._note(block, block.count - 1)

    def _note(self, carrier: Block, k: int) -> None:
        """Where a machine or trailer is: the kth of its samples, -1 = the last one before."""
        if k >= 0:
            sample = carrier.newest if k == carrier.count - 1 else carrier.sample(k)
            self._latest[carrier.slot.partition(".")[0], carrier.kind] = sample

    def metrics(self) -> dict[str, float]:
        """Nothing where no machine has a pipe with an auger."""
        pipes = [s for s in self._latest.values() if isinstance(s, UnloadState)]
        if not pipes:
            return {}
        drawn, caught = fsum(s.drawn for s in pipes), fsum(s.caught for s in pipes)
        levels = [s.level for s in self._latest.values() if isinstance(s, HeapState)]
        found = {
            "unloaded_kg": caught,
            "spill_share": fsum(s.missed for s in pipes) / drawn if drawn > 0.0 else float("nan"),
            "box_level": max(levels, default=float("nan")),
            "unloading_s": self._flowing,
        }
        for way, rows in (("along", self._along), ("across", self._across)):
            found[f"station_{way}_mean_m"] = fsum(rows) / len(rows) if rows else float("nan")
            found[f"station_{way}_max_m"] = max(rows, default=float("nan"))
        away = [hypot(a, b) for a, b in zip(self._along, self._across, strict=True)]
        found["station_mean_m"] = fsum(away) / len(away) if away else float("nan")
        found["station_late_s"] = self._late
        return found

    def series(self) -> UnloadingSeries:
        """Series for a report."""
        heaps = {}
        missed = fsum(s.missed for s in self._latest.values() if isinstance(s, UnloadState))
        for name, rows in self._rows.items():
            box = self.setup.machines[name].geometry.box
            if box is not None and len(rows) > 1:
                t, profile, level, flow = (np.array(column) for column in zip(*rows, strict=True))
                heaps[name] = HeapRows(t, profile, level, flow, box.length, box.depth)
        return UnloadingSeries(
            np.array(self._judged), np.array(self._along), np.array(self._across), heaps, missed
        )

    def _keep(self, name: str, heap: HeapState) -> None:
        """The grain of a box, now and then: every other row goes where there are too many."""
        rows, every = self._rows.setdefault(name, []), self._every.setdefault(name, EVERY)
        now = heap.t / NS
        if rows and now - rows[-1][0] < every - 1e-6:
            return
        pipes = [s for s in self._latest.values() if isinstance(s, UnloadState)]
        rows.append((now, heap.profile, heap.level, fsum(s.flow for s in pipes)))
        if len(rows) > MOST:
            self._rows[name], self._every[name] = rows[::2], 2.0 * every

    def _judge(self, name: str, unload: UnloadState, since: float) -> None:
        """Of several machines with a station, the one whose box is nearest to the stream is poured into.

        since: the last sample of the pipe [s]
        """
        state = self._latest.get((name, MachineState))
        if not isinstance(state, MachineState):
            return
        px, py, _ = state.pose.apply([unload.impact_x, unload.impact_y, 0.0]).tolist()
        found: list[tuple[float, float, float, str]] = []
        for (other, kind), station in self._latest.items():
            if kind is Station and isinstance(station, Station) and station.is_active:
                middle = self._middle(other)
                if middle is not None:
                    x, y, yaw = middle
                    dx, dy = px - x, py - y
                    along = abs(cos(yaw) * dx + sin(yaw) * dy - station.spot)
                    found.append((hypot(dx, dy), along, abs(cos(yaw) * dy - sin(yaw) * dx), other))
        if found:
            _, along, across, other = min(found)
            load = self._loads.setdefault((name, other), _Load())
            if not load.is_judged(unload.t / NS, max(along, across)):
                self._late += since
                return
            self._judged.append(unload.t / NS)
            self._along.append(along)
            self._across.append(across)

    def _middle(self, name: str) -> tuple[float, float, float] | None:
        """Middle of a machine's box and its heading, in the world."""
        geometry: MachineGeometry = self.setup.machines[name].geometry
        carrier, box = self._latest.get((name, TrailerState)), geometry.box
        if box is None:
            return None
        if isinstance(carrier, TrailerState):
            x, y, yaw = carrier.x, carrier.y, carrier.yaw
        else:
            state = self._latest.get((name, MachineState))
            if not isinstance(state, MachineState):
                return None
            x, y, _ = state.pose.position.tolist()
            yaw = state.pose.euler()[2]
        return x + box.x * cos(yaw), y + box.x * sin(yaw), yaw


LEVEL = Level(Unloading, None, summary="grain handed over on the go: station, fill and spill")
