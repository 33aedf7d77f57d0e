"""From powers in a grid of distances, speeds and azimuths to detections: window, CFAR, peaks.

Bins lie half a resolution cell apart. The window is Hann's, so wide that two equal echoes one cell apart are
just distinguished. Constant false alarm rate: Richards 2014, Fundamentals of Radar Signal Processing, chapter
6; ordered statistics: Rohling 1983, doi:10.1109/TAES.1983.309350.
"""

from dataclasses import dataclass
from functools import cache
from math import expm1, fsum, log
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swath.sensing.radar.radar_sheet import RadarSheet
from swath.signals import F64

HANN_CELL = 1.44  # bins of a Fourier transform in a resolution cell: width of Hann's main lobe at half power
LOBE = 3  # bins of the grid to both sides that an echo reaches
GUARD = 4  # bins to both sides that are left out of the noise
RANK = 0.75  # of the training bins, for ordered statistics
Ints = NDArray[np.int64]


def window(offset: F64) -> F64:
    """Amplitude of an echo at offsets in resolution cells, 1 at its place, 0 outside the main lobe."""
    x = HANN_CELL * np.abs(offset)
    x = np.where(np.abs(x - 1.0) < 1e-6, 1.0 + 1e-6, x)
    return np.asarray(np.where(x < 2.0, np.sinc(x) / (1.0 - x * x), 0.0))


def ca_factor(training: int, false_alarm: float) -> float:
    """Threshold over the mean of so many training cells: N (Pfa^(-1/N) - 1)."""
    return training * expm1(-log(false_alarm) / training)


def ca_detection(snr: float, training: int, false_alarm: float) -> float:
    """Probability of detection of a Swerling 1 target: (1 + factor / (N (1 + SNR)))^-N. snr: mean, linear."""
    return float((1.0 + ca_factor(training, false_alarm) / (training * (1.0 + snr))) ** -training)


@cache
def os_factor(training: int, false_alarm: float) -> float:
    """Threshold over the k-th smallest of N training cells: Pfa = product of (N - i) / (N - i + factor)."""
    rank = max(int(RANK * training), 1)
    low, high = 0.0, 1e9
    for _ in range(200):
        factor = 0.5 * (low + high)
        chance = fsum(log((training - i) / (training - i + factor)) for i in range(rank))
        low, high = (factor, high) if chance > log(false_alarm) else (low, factor)
    return 0.5 * (low + high)


def thresholds(training: F64, false_alarm: float, kind: Literal["ca", "os"]) -> F64:
    """Thresholds (n,) of cells from the powers of their training cells (n, N)."""
    count = training.shape[1]
    if kind == "ca":
        return np.asarray(ca_factor(count, false_alarm) * training.mean(axis=1))
    rank = max(int(RANK * count), 1)
    return np.asarray(os_factor(count, false_alarm) * np.sort(training, axis=1)[:, rank - 1])


@cache
def processing_loss(training: int, false_alarm: float, sheet_false_alarm: float) -> float:
    """Power by which the data sheet's signal to noise has to be raised, linear: what the threshold from
    training cells and echoes between bins take, so that a target in noise with 50 % by the sheet has it here.
    """
    snr = log(sheet_false_alarm) / log(0.5) - 1.0
    places = (np.arange(7, dtype=np.float64) - 3.0) / 14.0  # in bins of half a cell, to both sides
    lobe = (window(0.5 * places) ** 2).tolist()
    kept = [a * b * c for a in lobe for b in lobe for c in lobe]
    low, high = 1.0, 100.0
    for _ in range(60):
        gain = 0.5 * (low + high)
        found = fsum(ca_detection(gain * snr * k, training, false_alarm) for k in kept) / len(kept)
        low, high = (gain, high) if found < 0.5 else (low, gain)
    return 0.5 * (low + high)


@dataclass(frozen=True)
class Grid:
    """Bins of a look: distances [m], azimuths [rad] and radial speeds [m/s], half a resolution cell apart."""

    ranges: F64
    azimuths: F64
    speeds: F64
    cell: tuple[float, float, float]  # of distance, azimuth and speed

    @staticmethod
    def of(sheet: RadarSheet) -> "Grid":
        """The grid of a radar."""
        cell = sheet.range_resolution, sheet.azimuth_resolution, sheet.speed_resolution
        half = int(sheet.azimuth_fov / cell[1])
        fast = int(2.0 * sheet.speed_max / cell[2])
        far = int(2.0 * (sheet.range_max - sheet.range_min) / cell[0]) + 1
        return Grid(
            sheet.range_min + 0.5 * cell[0] * np.arange(far, dtype=np.float64),
            0.5 * cell[1] * np.arange(-half, half + 1, dtype=np.float64),
            0.5 * cell[2] * np.arange(-fast, fast + 1, dtype=np.float64),
            cell,
        )

    @property
    def count(self) -> int:
        """Number of bins."""
        return len(self.ranges) * len(self.azimuths) * len(self.speeds)


@dataclass(frozen=True)
class Columns:
    """Powers over noise by distance (c, m), of azimuths and speeds (c,) in which there is more than noise.

    index: number of a column by azimuth and speed, -1 where there is none
    """

    power: F64
    azimuth: Ints
    speed: Ints
    index: Ints

    def at(self, azimuth: Ints, speed: Ints, place: Ints) -> F64:
        """Powers of bins, 1 of those that hold noise alone or lie outside."""
        inside = (azimuth >= 0) & (azimuth < self.index.shape[0]) & (place >= 0)
        inside &= (speed >= 0) & (speed < self.index.shape[1]) & (place < self.power.shape[1])
        a, s, p = (np.where(inside, v, 0) for v in (azimuth, speed, place))
        column = np.where(inside, self.index[a, s], -1)
        return np.where(column >= 0, self.power[column, p], 1.0)


def peaks(
    columns: Columns, grid: Grid, training: int, false_alarm: float, kind: Literal["ca", "os"]
) -> list[tuple[float, float, float, float, float]]:
    """What is above the threshold, the strongest first, one of each resolution cell: power over thermal
    noise, power over what is around, distance, azimuth, speed.
    """
    factor = ca_factor(training, false_alarm) if kind == "ca" else os_factor(training, false_alarm)
    column, place = np.nonzero(columns.power > 0.25 * factor)
    a, s = columns.azimuth[column], columns.speed[column]
    power = columns.power[column, place]
    beside = [columns.at(a, s, place + k) for k in (-1, 1)]
    beside += [columns.at(a + k, s, place) for k in (-1, 1)] + [columns.at(a, s + k, place) for k in (-1, 1)]
    kept = np.all([power > p for p in beside[::2]] + [power >= p for p in beside[1::2]], axis=0)
    a, s, place, power = a[kept], s[kept], place[kept], power[kept]
    beside = [p[kept] for p in beside]
    train = surroundings(columns, grid, a, s, place, training)
    above = power > thresholds(train, false_alarm, kind)
    found: list[tuple[float, float, float, float, float]] = []
    order = np.lexsort((place, s, a, -power))
    for k in order[above[order]].tolist():
        level = float(train[k].mean())
        shift = [_between(float(low[k]), float(power[k]), float(high[k])) for low, high in _pairs(beside)]
        distance, azimuth, speed = (
            0.5 * cell * (float(i) + d) + float(first)
            for cell, i, d, first in zip(
                grid.cell,
                (place[k], a[k], s[k]),
                shift,
                (grid.ranges[0], grid.azimuths[0], grid.speeds[0]),
                strict=True,
            )
        )
        new = float(power[k]), float(power[k]) / max(level, 0.5), distance, azimuth, speed
        if not any(_same(new[2:], known[2:], grid.cell) for known in found):
            found.append(new)
    return found


def surroundings(columns: Columns, grid: Grid, a: Ints, s: Ints, place: Ints, training: int) -> F64:
    """Powers (n, training) beside bins (n,), as clutter over flat ground, R^-4, would have them there."""
    reach = GUARD + training // 2
    steps = np.array([k for k in range(-reach, reach + 1) if abs(k) > GUARD])
    last = columns.power.shape[1] - 1
    around = place[:, None] + steps
    around = np.where(around < 0, place[:, None] + reach - around, around)  # the other side at the ends
    around = np.where(around > last, place[:, None] - reach - (around - last), around)
    around = np.clip(around, 0, last)
    slope = (grid.ranges[around] / grid.ranges[place][:, None]) ** 2
    return np.asarray(columns.at(a[:, None], s[:, None], around) * slope * slope)


def _pairs(values: list[F64]) -> list[tuple[F64, F64]]:
    return [(values[0], values[1]), (values[2], values[3]), (values[4], values[5])]


def _between(low: float, middle: float, high: float) -> float:
    """Place of a peak in bins from its middle one, by a parabola through the logarithms of powers."""
    a, b, c = (log(max(v, 1e-12)) for v in (low, middle, high))
    bend = a - 2.0 * b + c
    return min(max(0.5 * (a - c) / bend, -0.5), 0.5) if bend < -1e-12 else 0.0


def _same(a: tuple[float, ...], b: tuple[float, ...], cell: tuple[float, float, float]) -> bool:
    return all(abs(p - q) < size for p, q, size in zip(a, b, cell, strict=True))
