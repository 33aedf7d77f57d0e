"""What the scanners saw and the straw that was laid, from the recording of a run, as a page has them."""

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.schedule import NS
from swath.record.charts import Columns
from swath.record.read.files import open_log
from swath.record.read.scans import cloud_table
from swath.record.tracks import SHOWN_ROWS, EvenRows
from swath.runtime.world import Machine
from swath.signals import F64

MOST_POINTS = 160_000  # of all scanners together
KEPT_POINTS = 8 * MOST_POINTS  # of one while a recording is read, of which those are an even choice
LEAST_UNIT = 0.001  # of echoes about the middle of their scan [m]
MOST_UNITS = 32767  # int16
RECORDING = "run.mcap"
STEP = 0.5  # between stations of straw [m]
WIDTH = 1.4  # of a swath where the scenario does not say one [m]


@dataclass
class ScannerEchoes:
    """Of one scanner: times (n,) [s], echoes as they really were, world [m], (k, 3) each.

    Every `every`-th scan: of a long run no more than a page can choose from. recorded: scans in all
    """

    machine: str
    slot: str
    times: list[float] = field(default_factory=list)
    echoes: list[NDArray[np.float32]] = field(default_factory=list)
    every: int = 1
    recorded: int = 0
    point_count: int = 0

    def add(self, t: float, message: Any) -> None:
        """A scan of a time [s]."""
        if self.recorded % self.every == 0:
            table = cloud_table(message)
            self.times.append(t)
            self.echoes.append(np.stack([table[n].astype(np.float32) for n in "xyz"], axis=1))
            self.point_count += len(table)
        self.recorded += 1
        if self.point_count > KEPT_POINTS:
            self.times, self.echoes, self.every = self.times[::2], self.echoes[::2], 2 * self.every
            self.point_count = sum(map(len, self.echoes))


@dataclass
class Recorded:
    """scanners: with their echoes; straw: per machine times [s] and mass on the ground so far [kg]."""

    scanners: list[ScannerEchoes] = field(default_factory=list)
    straw: dict[str, F64] = field(default_factory=dict)


def recorded(folder: Path, scanners: Mapping[str, Collection[str]]) -> Recorded | None:
    """Of a run folder; None where nothing was recorded. scanners: slots by machine."""
    path = folder / RECORDING
    if not os.path.isfile(path):
        return None
    known = {f"/{m}/{slot}/truth": ScannerEchoes(m, slot) for m, slots in scanners.items() for slot in slots}
    loads = {f"/{machine}/process/load": machine for machine in scanners}
    log = open_log(path)
    topics = [t for t in log.topics() if t in known or t in loads]
    straw: dict[str, EvenRows] = {}
    for topic, t, message in log.messages(topics):
        if topic in known:
            known[topic].add(t / NS, message)
        else:
            row = np.array([[t / NS, float(message.dropped_straw)]])
            straw.setdefault(loads[topic], EvenRows(SHOWN_ROWS)).add({"": row})
    found = [scanner for scanner in known.values() if scanner.times]
    return Recorded(found, {name: rows.columns()[""] for name, rows in straw.items()})


@dataclass(frozen=True)
class PackedEchoes:
    """times: (n,) float32 [s]; starts: (n + 1,) uint32; middle: (n, 3) float32 [m]; points: (m, 3) int16.

    unit_m: of points about the middle of their scan: 1 mm, or what lets the farthest fit
    """

    times: NDArray[np.float32]
    starts: NDArray[np.uint32]
    middle: NDArray[np.float32]
    points: NDArray[np.int16]
    unit_m: float
    shown: int
    recorded: int

    def arrays(self) -> dict[str, NDArray[Any]]:
        """By name."""
        return {"times": self.times, "starts": self.starts, "middle": self.middle, "points": self.points}


def pack_echoes(scanner: ScannerEchoes, most: int, origin: F64) -> PackedEchoes:
    """Every n-th scan, so that at most about `most` echoes are left. origin: places count from it [m]."""
    every = max(1, -(-scanner.point_count // max(most, 1)))
    rows = range(0, len(scanner.times), every)
    echoes = [scanner.echoes[i].astype(np.float64) - origin for i in rows]
    middle = np.array([e.mean(axis=0) if len(e) else np.zeros(3) for e in echoes]).reshape(-1, 3)
    middle = middle.astype(np.float32)
    shifted = [e - m.astype(np.float64) for e, m in zip(echoes, middle, strict=True)]
    points = np.concatenate([*shifted, np.zeros((0, 3))])
    unit = max(LEAST_UNIT, float(np.abs(points).max(initial=0.0)) / MOST_UNITS)
    return PackedEchoes(
        np.array([scanner.times[i] for i in rows], np.float32),
        np.concatenate([[0], np.cumsum([len(e) for e in echoes])]).astype(np.uint32),
        middle,
        np.rint(points / unit).astype(np.int16),
        unit,
        len(rows),
        scanner.recorded,
    )


def swath_width(machine: Machine) -> tuple[float, bool]:
    """Width [m] on which straw is laid, and whether it is chopped and spread over the header's width."""
    for slot in machine.slots_of("process"):
        said: dict[str, Any] = machine.section.slots[slot].plain()
        if str(said.get("straw", "swath")) != "swath":
            return machine.sheet.header_width, True
        return float(said.get("swath_width_m", WIDTH)), False
    return WIDTH, False


def stations(columns: Columns, straw: F64, width: float, density: float) -> F64:
    """(n, 2): time [s] and mean depth [m] of the straw laid since the station before, along the way.

    straw: (m, 2) time [s] and mass on the ground so far [kg]; density: of straw on the ground [kg/m3]
    """
    distance = np.maximum.accumulate(np.nan_to_num(columns["distance_m"]))
    marks = np.arange(0.0, float(distance[-1]) if len(distance) else 0.0, STEP)
    times = np.interp(marks, distance, columns["t_s"])
    if len(times) < 2 or not len(straw):
        return np.zeros((0, 2))
    mass = np.interp(times, straw[:, 0], straw[:, 1])
    depth = np.diff(mass, prepend=mass[0]) / (STEP * width * density)
    return np.stack([times, np.maximum(depth, 0.0)], axis=1)
