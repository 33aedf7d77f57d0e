"""When each cell of an area was cut: the knives' ways again, from the tracks.

Between two rows of the tracks the knife sweeps a polygon (`machine.sweep`); a cell in it was passed at the
time that its distances from the knife before and after give. Cells are coarser than the field's.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import STANDING
from swath.machine.sweep import swept
from swath.replay.area import Area
from swath.signals import F64

STEP = 0.4  # between knife positions [m]; within one the time is interpolated
NEVER = 65535


@dataclass(frozen=True)
class KnifeWay:
    """times (n,) [s]; ends (n, 2, 2): left and right end in the stand frame [m]; heights (n,): cut [m]"""

    times: F64
    ends: F64
    heights: F64

    def thinned(self) -> "KnifeWay":
        """Rows at least STEP apart, and the last one."""
        keep, last = [0], self.ends[0]
        for i in range(1, len(self.times)):
            if np.hypot(*(self.ends[i] - last).T).max() >= STEP or i == len(self.times) - 1:
                keep.append(i)
                last = self.ends[i]
        return KnifeWay(self.times[keep], self.ends[keep], self.heights[keep])


@dataclass(frozen=True)
class CutTimes:
    """when: (rows, columns) uint16 in units of `unit` [s], 0 = cut before the start, NEVER = it stands to the
    end; codes: what is left, or will be [cm]
    """

    when: NDArray[np.uint16]
    codes: NDArray[np.uint8]
    unit: float


def cut_times(area: Area, codes: NDArray[np.uint8], ways: list[KnifeWay], duration: float) -> CutTimes:
    """codes: of the cells at the start, as in `field.memory_layout`."""
    unit = max(0.02, duration / (NEVER - 10))
    is_crop = codes == STANDING
    when = np.where(is_crop, np.float32(NEVER), np.float32(0.0))
    left = codes.copy()
    order = sorted(
        (step for way in ways for step in _steps(way.thinned(), area)), key=lambda step: float(step[0][0])
    )
    for (begin, end), before, after, height in order:
        for polygon in swept(before.tolist(), after.tolist()):
            found = _inside(np.array(polygon), when.shape)
            if found is None:
                continue
            rows, columns, inside = found
            part, code = when[rows, columns], left[rows, columns]
            taken = inside & is_crop[rows, columns] & (code > height)
            share = _share(before, after, rows, columns)
            time = np.maximum(np.rint((begin + share * (end - begin)) / unit), 1.0)
            part[taken] = np.minimum(part[taken], time[taken])
            code[taken] = height
    return CutTimes(when.astype(np.uint16), np.where(left == STANDING, 15, left).astype(np.uint8), unit)


def _steps(way: KnifeWay, area: Area) -> Iterator[tuple[tuple[float, float], F64, F64, int]]:
    """Times, knife before and after in cells, and height [cm] of every step."""
    cells = (way.ends / area.tile - np.array(area.first)) * area.cells
    heights = np.clip(np.rint(100.0 * way.heights), 0, STANDING - 1).astype(int)
    for i in range(len(way.times) - 1):
        if way.times[i] <= area.until_s:
            times = float(way.times[i]), float(way.times[i + 1])
            yield times, cells[i], cells[i + 1], int(heights[i + 1])


def _inside(polygon: F64, shape: tuple[int, ...]) -> tuple[slice, slice, NDArray[np.bool_]] | None:
    """The cells whose centres lie in a convex polygon, anticlockwise, in cell units; None without any."""
    low = np.maximum(np.floor(polygon.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(polygon.max(axis=0)).astype(int) + 1, [shape[1], shape[0]])
    if (low >= high).any():
        return None
    x, y = np.arange(low[0], high[0]) + 0.5, (np.arange(low[1], high[1]) + 0.5)[:, None]
    inside = np.ones((high[1] - low[1], high[0] - low[0]), bool)
    for (ax, ay), (bx, by) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        inside &= (bx - ax) * (y - ay) >= (by - ay) * (x - ax)
    return slice(low[1], high[1]), slice(low[0], high[0]), inside


def _share(before: F64, after: F64, rows: slice, columns: slice) -> F64:
    """How far on the way from the knife before to the knife after cells lie, 0 to 1."""
    x, y = np.arange(columns.start, columns.stop) + 0.5, (np.arange(rows.start, rows.stop) + 0.5)[:, None]
    away = [np.abs(_distance(line, x, y)) for line in (before, after)]
    total = away[0] + away[1]
    return np.asarray(away[0] / np.where(total > 0.0, total, 1.0))


def _distance(line: F64, x: F64, y: F64) -> F64:
    (ax, ay), (bx, by) = line
    length = max(float(np.hypot(bx - ax, by - ay)), 1e-9)
    return np.asarray(((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / length)
