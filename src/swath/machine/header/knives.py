"""Knives of headers in many worlds: what they sweep over is cut, and summed up into flows of crop."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swath.core.errors import SwathError
from swath.core.rows import row_of
from swath.core.together import KeepsRows
from swath.field.field import Field
from swath.kernels import Repeated
from swath.machine.header import FLOWS, OVER_M
from swath.machine.sweep import Corners, FieldTasks, Sweeps
from swath.signals import CropFlow


class Knives(KeepsRows):
    """Stiff knives of several points; sweeps: of them, the code of a run is the height of the cut [cm].

    fields, steps, widths: of each world; poses closer together than a step are joined [m]; of a header [m]
    flow: what it comes to
    """

    kept = ("_last", "_gauges")

    def __init__(
        self, fields: Sequence[Field], points: int, steps: Sequence[float], widths: Sequence[float]
    ) -> None:
        n = len(fields)
        self._fields, self._forget, self.sweeps = fields, OVER_M * np.array(widths), Sweeps(points, steps)
        self.flow = row_of(CropFlow, n, FLOWS)
        self._last, self._gauges = self.sweeps.last, np.zeros((n, 2))
        self._alone = list[Repeated]()

    def clear(self) -> None:
        """Nothing cut; where knives are is taken from the first poses that come."""
        self._last[:], self._gauges[:] = 0.0, 0.0
        self.flow.memory[:] = 0

    def launches(self, room: int, needs: Any, active: Any, clock: Any, **poses: Any) -> list[Repeated]:
        """Of a step of `room` poses at most: sweep, cut, after which `cut_rest` may be needed, sums."""
        sweeps, flows = self.sweeps, self.flow.memory.view(np.float64).reshape(len(self._fields), -1)
        sweeps.widen(room, active=active, clock=clock, **poses)
        self._tasks = FieldTasks(self._fields, sweeps.polygons, sweeps.found, needs)
        told = {"sums": self._tasks.sums, "forget": self._forget, "gauges": self._gauges, "flows": flows}
        vars(sweeps).update(told)
        return [sweeps.launch, self._tasks.launch("cut_polygons"), sweeps.launch_of("tell_flows")]

    def cut_rest(self) -> dict[int, SwathError]:
        """Cut what compiled code did not; by world why that is refused."""
        return self._tasks.rest(self._cut)

    def cut(self, t: int, dt: int, lines: Sequence[Any], runs: Sequence[Sequence[int]]) -> CropFlow:
        """A step of the only world, dt long, to t [ns]; raises what is refused. lines, runs: see `Sweeps`."""
        sweeps = self.sweeps
        if len(lines) > sweeps.lines.shape[1] or not self._alone:
            self._clock, needs = np.zeros(3, np.int64), np.zeros(1, np.int32)
            self._alone = self.launches(2 * len(lines) + 1, needs, sweeps.active, self._clock)
        sweeps.lines[0, : len(lines)], sweeps.runs[0, : len(runs)] = lines or 0.0, runs
        sweeps.counts[0], sweeps.runs[0, len(runs) :] = len(lines), -1
        self._clock[2], self.flow.stamp[0] = dt, t
        sweep, cut, tell = self._alone
        sweep.launch()
        cut.launch()
        for error in self.cut_rest().values():
            raise error
        tell.launch()
        found: CropFlow = self.flow.of(0)
        return found

    def _cut(self, world: int, polygon: Corners, area: float, code: float) -> None:
        cut = self._fields[world].cut(polygon, 0.01 * code)
        self._tasks.sums[world, :6] += cut.grain, cut.straw, cut.grain_left, cut.area, cut.stem_count, area
