"""Scans as numbers that say how they look, whoever recorded them: what a twin is learned from.

First echoes lie in a matrix of lines and azimuths. In each of a few sectors: quantiles of the distance ahead,
in logarithms, of the steps between beams, and the share of beams without an echo. No pose, no ground and
no speed enters: they are the same for a simulation and for a recording that is longer. Beside them those of
`structure`, which are not learned from.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.core.units import DEG
from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.sensing.lidar_sheet import LidarSheet
from swath.signals import F32, F64, Scan, Signal
from swath.tools.height_map.source import Source
from swath.tools.twin.structure import NAMES as STRUCTURE
from swath.tools.twin.structure import quantiles, structure_of

SECTORS, GROUPS = 12, 4  # of the azimuth, and of lines at most
AHEAD, STEPS = (0.02, 0.1, 0.25, 0.5, 0.75, 0.9, 0.98), (0.1, 0.25, 0.5, 0.75, 0.9)  # quantiles
APART = (1, 4)  # beams from step to step
ASIDE = 75 * DEG  # a beam further aside counts as this far
NEAR_M = 2.5  # echoes nearer are puffs of dust, or the machine itself
FEWEST = 10  # echoes of a sector
LEAST_STEP = 1e-3  # in logarithms: finer ones are the resolution
BACK = 20 * DEG  # a beam may point this far back of the one before: lines do
MOST_BEAMS = 600  # of a scan that are looked at
EACH = len(AHEAD) + len(APART) * len(STEPS) + 1
COUNT = GROUPS * SECTORS * EACH + 2
NAMES = tuple(f"scan_look_{n:03d}" for n in range(COUNT))
EVERY = NAMES + STRUCTURE
Beams = tuple[F64, F64, F64, F64]
REFERENCE = f"{Path(__file__).resolve()}:ScanLooks"


@dataclass(frozen=True)
class View:
    """The beams that are looked at: first azimuth and step [rad], count; elevations of the lines [rad]."""

    first: float
    step: float
    count: int
    lines: tuple[float, ...]

    @property
    def azimuth(self) -> F64:
        """Azimuths, (count,)."""
        return np.asarray(self.first + self.step * np.arange(self.count), np.float64)

    @property
    def sector_deg(self) -> list[float]:
        """First and last azimuth, as a scenario has them."""
        return [round(float(a / DEG), 4) for a in self.azimuth[[0, -1]]]

    def ahead(self, ranges: F32) -> F64:
        """Distances ahead (..., count) [m] of ranges."""
        return np.asarray(ranges * np.cos(np.minimum(np.abs(self.azimuth), ASIDE)), np.float64)

    def laid(self, azimuth: F64, elevation: F64, ranges: Any, values: Any = None) -> F32:
        """Ranges (lines, count) [m] of a scan, nan = no echo; or other values of the same echoes.

        Of each place the beam next to it, and of that the first echo.
        """
        turned = np.mod(azimuth - self.first + 0.5 * self.step, 2.0 * np.pi)
        column = turned / self.step - 0.5
        nearest, known = np.rint(column).astype(np.int64), np.isfinite(ranges)
        off = np.abs(column - nearest)
        inside = known & (nearest >= 0) & (nearest < self.count) & (off <= 0.5)
        line = np.abs(elevation[inside, None] - np.array(self.lines)).argmin(axis=1)
        order = np.lexsort((np.asarray(ranges, np.float32)[inside], np.round(off[inside], 3)))
        last = order[::-1]  # of what lies in one place the last counts
        found = np.full((len(self.lines), self.count), np.nan, np.float32)
        laid = np.asarray(ranges if values is None else values, np.float32)
        found[line[last], nearest[inside][last]] = laid[inside][last]
        return found


def view_of(azimuth: F64, elevation: F64) -> View:
    """The view of a simulated scan: every beam of it."""
    lines = np.unique(np.round(elevation, 9))
    count = len(azimuth) // len(lines)
    first, last = float(azimuth.min()), float(azimuth.max())
    return View(first, (last - first) / max(1, count - 1) or 1.0, count, tuple(map(float, lines)))


def numbers_of(stack: F32, view: View) -> F64:
    """The numbers (COUNT,) of scans (scans, lines, beams); nan where a sector has too few echoes."""
    ahead = np.log(view.ahead(stack))
    parts = np.array_split(np.arange(view.count), SECTORS)
    groups = np.array_split(np.arange(len(view.lines)), min(GROUPS, len(view.lines)))
    found = [_sector(ahead[:, lines][:, :, beams]) for lines in groups for beams in parts]
    seen = np.isfinite(stack)
    whole = [np.sqrt(np.mean(stack[seen] < NEAR_M)) if seen.any() else np.nan, np.sqrt(1.0 - seen.mean())]
    out = np.full(COUNT, np.nan)
    out[: 2 + EACH * len(found)] = np.concatenate([whole, *found])
    return out


def _sector(ahead: F64) -> F64:
    silent = np.sqrt(1.0 - np.isfinite(ahead).mean())
    steps = [np.abs(ahead[..., n:] - ahead[..., :-n]) for n in APART]
    every: list[Any] = [
        quantiles(ahead, AHEAD, FEWEST),
        *(np.log(LEAST_STEP + quantiles(s, STEPS, FEWEST)) for s in steps),
        [silent],
    ]
    return np.concatenate(every)


class ScanLooks:
    """The numbers of the first scanner of a machine, as metrics of a run."""

    OF_FIELD = False
    SIGNALS = (Scan,)
    METRICS = tuple(Metric(name, "", "how its scans look", "Run") for name in EVERY)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._slot, self._scans, self._bright = "", list[F32](), list[F32]()
        self._view: View | None = None

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Keep a scan."""
        for scan in outputs.values():
            if isinstance(scan, Scan) and t > 0 and slot == (self._slot or slot):
                self._slot, self._view = slot, self._view or view_of(scan.azimuth, scan.elevation)
                beams = scan.azimuth, scan.elevation, scan.ranges[:, 0]
                self._scans.append(self._view.laid(*beams))
                self._bright.append(self._view.laid(*beams, scan.intensity[:, 0]))

    def metrics(self) -> dict[str, float]:
        """The numbers; nothing without scans."""
        if self._view is None:
            return {}
        stack = np.stack(self._scans)
        structure = structure_of(self._view.ahead(stack), np.stack(self._bright))
        every = np.concatenate([numbers_of(stack, self._view), structure])
        return dict(zip(EVERY, map(float, every), strict=True))


@dataclass(frozen=True)
class Recorded:
    """Scans of recordings. stack: (scans, lines, beams) [m]; rate: scans a second [Hz].

    bright: intensity of the same echoes, nan = not known; times: of the scans of each recording [s]
    """

    view: View
    stack: F32
    rate: float
    bright: F32
    times: Sequence[F64]

    @property
    def numbers(self) -> F64:
        """As `numbers_of`."""
        return numbers_of(self.stack, self.view)

    def structure(self, rate: float, parts: Sequence[float]) -> F64:
        """As `structure_of` at so many scans a second, of the first part of each recording; their mean."""
        ahead, first, found = self.view.ahead(self.stack), 0, list[F64]()
        for times, part in zip(self.times, parts, strict=True):
            wanted = np.arange(times[0], times[0] + part * (times[-1] - times[0]) + 1e-6, 1.0 / rate)
            scans = first + np.unique(np.abs(times - wanted[:, None]).argmin(axis=1))
            found.append(structure_of(ahead[scans], self.bright[scans]))
            first += len(times)
        return np.asarray(np.mean(found, axis=0), np.float64)


def read_looks(sources: Sequence[Source], sheet: LidarSheet, view: View | None = None) -> Recorded:
    """The scans of recordings by one scanner. view: None = every beam, of many some.

    InputError for scans that are in the map already, or without echoes.
    """
    scans, times = list[Beams](), list[F64]()
    for source in sources:
        if source.frame_is_world:
            raise InputError(
                "scans", source.name, "expected scans in the frame of the scanner, not of the map"
            )
        made = [*_scans(source)]
        scans += [scan for _, scan in made]
        times.append(np.array([t for t, _ in made]))
    if not scans:
        raise InputError("scans", ", ".join(s.name for s in sources), "expected scans with echoes")
    view = view or _seen_by(scans, sheet)
    stack = np.stack([view.laid(*scan[:3]) for scan in scans])
    bright = np.stack([view.laid(*scan) for scan in scans])
    gaps = np.concatenate([np.diff(t) for t in times])
    rate = 1.0 / float(np.median(gaps[gaps > 0.0])) if (gaps > 0.0).any() else sheet.rates_hz[0]
    return Recorded(view, stack, rate, bright, [t for t in times if len(t)])


def _scans(source: Source) -> Iterator[tuple[float, Beams]]:
    """Time [s], and azimuth, elevation [rad], range [m] and intensity of the echoes, of each scan."""
    for echoes in source.sweeps():
        x, y, z = echoes.points.T
        azimuth, flat = np.arctan2(y, x), np.hypot(x, y)
        cuts = np.zeros(0, np.int64)
        if echoes.scan_count > 1:  # of a table: a scan begins with each whole turn
            turns = np.diff(azimuth)
            ahead = np.mod(np.sign(np.median(turns)) * turns + BACK, 2.0 * np.pi) - BACK
            cuts = np.flatnonzero(np.diff(np.floor(np.cumsum(ahead) / (2.0 * np.pi) + 1e-6), prepend=0.0)) + 1
        every = np.stack([echoes.time, azimuth, np.arctan2(z, flat), np.hypot(flat, z), echoes.intensity])
        for time, *beams in np.split(every, cuts, axis=1):
            if len(time):
                yield float(time[0]), (beams[0], beams[1], beams[2], beams[3])


def _seen_by(scans: Sequence[Beams], sheet: LidarSheet) -> View:
    """The view of recorded scans: sector and step by their echoes, lines by the data sheet."""
    lines = tuple(map(float, np.unique(sheet.line_elevation)))
    some = scans[:: max(1, len(scans) // 50)]
    each = [np.sort(a[np.abs(e[:, None] - lines).argmin(axis=1) == 0]) for a, e, *_ in some]
    steps = np.concatenate([np.diff(a) for a in each])
    steps = steps[steps > 1e-5]
    if not len(steps):
        raise InputError("scans", None, "expected scans of several beams beside each other")
    step = float(np.median(steps))
    every = np.sort(np.concatenate([a for a, *_ in some]))
    begins = int(np.argmax(np.diff(every, prepend=every[-1] - 2.0 * np.pi)))  # behind the widest gap
    first, last = float(every[begins]), float(every[begins - 1])
    beams = round(float(np.mod(last - first, 2.0 * np.pi)) / step) + 1
    thin = -(-beams * len(lines) // MOST_BEAMS)
    return View(first, thin * step, (beams - 1) // thin + 1, lines)


def check_view(view: View, other: View) -> None:
    """InputError where a recording was not seen by the beams that a bank knows."""
    told = [f"{v.sector_deg[0]} to {v.sector_deg[1]} deg" for v in (view, other)]
    if (
        abs(view.first - other.first) > 2.0 * other.step
        or abs(view.azimuth[-1] - other.azimuth[-1]) > 2.0 * other.step
    ):
        raise InputError(
            "scans", told[0], f"expected the sector that the bank was made for, {told[1]}; or --bank"
        )
    ratio = other.step / view.step
    if ratio < 0.95 or (other.lines == (0.0,) and abs(ratio - round(ratio)) > 0.05):
        raise InputError(
            "scans", f"step {num(view.step / DEG, 'deg')}", f"expected {num(other.step / DEG, 'deg')}"
        )
