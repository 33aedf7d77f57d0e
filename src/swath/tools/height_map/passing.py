"""Beams that passed a cell without an echo: what the heights measured in it alone do not say.

Where crop stands beside cut ground, or is thin, most beams pass over the few plants of a cell and are counted
further on. The share of beams that a surface stops is therefore estimated as with lifetimes that come under
observation late: per layer of height the number of echoes over the number of times that beams went through
the layer (Nelson-Aalen: Aalen 1978, doi:10.1214/aos/1176344247), and the shares that go on are multiplied
from the top downwards.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.rays.height_grid import lattice_height
from swath.signals import F64
from swath.tools.height_map.place import Frame, Placed

LAYER_M = 0.05
LAYERS_MAX = 128
FLATTEST = 0.18  # tan of 10 deg: flatter beams count as if they fell this steeply


class Passing:
    """Times that beams went through the layers of a range of columns.

    first, count: columns
    row, row_count: rows
    top: highest height there [m]; layer [m]; times: (row_count, count, layers), 1 = one beam through the
        whole of it
    """

    def __init__(self, first: int, count: int, row: int, row_count: int, top: float) -> None:
        self.first, self.row = first, row
        self.layer = max(LAYER_M, top / LAYERS_MAX)
        layers = int(np.floor(max(top, 0.0) / self.layer)) + 1
        self.times = np.zeros((row_count, count, layers), np.float32)

    @property
    def columns(self) -> int:
        """Number of columns."""
        return int(self.times.shape[1])

    def add(self, echoes: Placed, frame: Frame, lattice: F64) -> None:
        """Follow beams from their echoes back towards the sensor, until they are above everything."""
        if echoes.sensor is None or len(echoes.points) == 0:
            return
        back = echoes.sensor - echoes.points
        far = np.linalg.norm(back, axis=1)
        first, after = self.first * frame.cell, (self.first + self.columns) * frame.cell
        low = np.minimum(echoes.points[:, 0], echoes.sensor[:, 0])
        high = np.maximum(echoes.points[:, 0], echoes.sensor[:, 0])
        here = np.flatnonzero((far > 1e-6) & (high >= first) & (low < after))
        direction = back[here] / far[here, None]
        flat = np.hypot(direction[:, 0], direction[:, 1])
        steep = np.abs(direction[:, 2])
        step = 0.5 * np.minimum(frame.cell / np.maximum(flat, 0.05), self.layer / np.maximum(steep, 0.05))
        weight = np.maximum(steep, FLATTEST * flat) * step / self.layer
        at = echoes.points[here] + 0.5 * step[:, None] * direction
        left = far[here] - 0.5 * step
        rows, columns, layers = self.times.shape
        flat_times = self.times.reshape(-1)
        top = layers * self.layer
        while len(at):
            height = at[:, 2] - lattice_height(lattice, frame.node, at[:, 0], at[:, 1])
            c = np.floor(at[:, 0] / frame.cell).astype(np.int64) - self.first
            r = np.floor(at[:, 1] / frame.cell).astype(np.int64) - self.row
            k = np.maximum(np.floor(height / self.layer).astype(np.int64), 0)
            inside = (c >= 0) & (c < columns) & (r >= 0) & (r < rows) & (k < layers)
            index = (r[inside] * columns + c[inside]) * layers + k[inside]
            np.add.at(flat_times, index, weight[inside].astype(np.float32))
            on = (left > step) & ((height < top) | (direction[:, 2] < 0.0))
            at, direction, step, weight, left = at[on], direction[on], step[on], weight[on], left[on]
            at = at + step[:, None] * direction
            left = left - step

    def pooled(self, row: int, column: int, shape: tuple[int, int], along: int, across: int) -> F64:
        """Times around each cell of a block, summed over the window, (rows, columns, layers)."""
        r0, c0 = row - self.row - across, column - self.first - along
        rows, columns = shape[0] + 2 * across, shape[1] + 2 * along
        part = np.zeros((rows + 1, columns + 1, self.times.shape[2]))
        r1, c1 = min(r0 + rows, self.times.shape[0]), min(c0 + columns, self.times.shape[1])
        if r1 > max(r0, 0) and c1 > max(c0, 0):
            held = self.times[max(r0, 0) : r1, max(c0, 0) : c1]
            part[1 + max(-r0, 0) : 1 + r1 - r0, 1 + max(-c0, 0) : 1 + c1 - c0] = held
        total = part.cumsum(axis=0).cumsum(axis=1)
        h, w = 2 * across + 1, 2 * along + 1
        return np.asarray(total[h:, w:] - total[:-h, w:] - total[h:, :-w] + total[:-h, :-w])


def thicknesses(cell: NDArray[Any], layer: NDArray[Any], number: F64, times: F64) -> tuple[F64, F64]:
    """Thickness of what stands above the upper side of each measured height, (n,), and of all there is in
    every cell: -log of the share of beams that get there from above.

    cell: of each sample, rising; layer: of its height, rising within a cell; number: echoes it stands for
    times: beams through its layer in its cell, all (n,)
    """
    key = np.flatnonzero((np.diff(cell, prepend=-1) != 0) | (np.diff(layer, prepend=-1) != 0))
    size = np.diff(key, append=len(cell))
    echoes = np.add.reduceat(number, key)
    number_through = np.maximum(times[key], 0.5 * FLATTEST * echoes)
    # exp(-echoes / times) scatters about exp(-hazard) with variance hazard / times; the second term takes
    # out what that adds to its mean (Jensen), to first order
    hazard = echoes / number_through * (1.0 + 0.5 / np.maximum(number_through, 4.0))
    run = np.cumsum(number)
    to_it = (run - np.repeat(run[key] - number[key], size)) / np.repeat(echoes, size)
    total = np.cumsum(hazard)
    last = np.flatnonzero(np.diff(cell[key], append=-1))  # highest layer of each cell
    first = np.concatenate([[0], last[:-1] + 1])
    over = np.repeat(total[last], np.diff(last, prepend=-1)) - total  # of the layers above
    stopped = np.repeat(-np.expm1(-hazard), size)  # share of the beams that get there, the same per echo
    upper: F64 = np.repeat(over, size) - np.log1p(-stopped * np.clip(1.0 - to_it, 0.0, 1.0))
    return upper, over[first] + hazard[first]
