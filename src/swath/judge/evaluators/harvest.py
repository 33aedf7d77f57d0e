"""What the header cut, and what it left standing."""

import numpy as np

from swath.core import portable
from swath.core.blocks import Seen
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Later, Metric, added_up, held, ratio
from swath.judge.header_path import HeaderPath
from swath.signals import CropFlow, MachineState

GROUP = "Harvest"
OUTSIDE_M = 1.0  # uncut crop counts this far beyond the initial edge, where teeth may stand
NODE_M = 0.5  # length of the strips in which uncut crop is counted


class Harvest(Later):
    """Area and grain cut, use of the header's width, crop left uncut."""

    SIGNALS = (MachineState, CropFlow)
    METRICS = (
        Metric("header_use", "1", "area cut / area the header passed over, on the way after settling", GROUP,
               "higher", ""),
        Metric("uncut_area_m2", "m2", "standing crop left on the cut side of the header end's path", GROUP,
               "lower", "left uncut"),
        Metric("area_cut_m2", "m2", "ground from which crop was cut", GROUP, "higher", ""),
        Metric("grain_cut_kg", "kg", "grain taken in by the header", GROUP, "higher", ""),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self.side = 1.0 if setup.machine.edge_side == "left" else -1.0
        self.shared_path = HeaderPath(setup.machine)
        self._distance = 0.0
        self._has_header = False
        left, right = (setup.machine.geometry.header_end(side)[1] for side in ("left", "right"))
        self._width = left - right
        self._area = self._grain = self._settled_area = self._way = 0.0
        self._last: float | None = None  # distance at the last cut after settling

    def take(self, seen: Seen) -> None:
        """Add what was cut."""
        states, flows = seen.of(MachineState), seen.of(CropFlow)
        if states is not None:
            self.shared_path.take(states)
        if flows is not None:
            self._has_header = True
            area, way = flows["area"], held(states, "distance", flows.orders, self._distance)
            self._area, self._grain = added_up(self._area, area), added_up(self._grain, flows["grain"])
            is_settled = way >= self.setup.settling_m
            if is_settled.any():
                area, way = area[is_settled], way[is_settled]
                before = way[:1] if self._last is None else [self._last]
                steps = np.diff(way, prepend=before)
                if self._last is None:
                    area, steps = area[1:], steps[1:]
                self._settled_area = added_up(self._settled_area, area)
                self._way = added_up(self._way, steps)
                self._last = float(way[-1])
        if states is not None:
            self._distance = float(states["distance"][-1])

    def metrics(self) -> dict[str, float]:
        """Metrics of all that was cut; none of a machine without a header."""
        if not self._has_header:
            return {}
        return {
            "header_use": ratio(self._settled_area, self._width * self._way),
            "uncut_area_m2": self.uncut_area(),
            "area_cut_m2": self._area,
            "grain_cut_kg": self._grain,
        }

    def uncut_area(self) -> float:
        """Standing crop on the cut side of the header end's path [m2].

        Up to OUTSIDE_M beyond the initial edge.
        """
        _, distance, x, y = self.shared_path.arrays()
        if len(distance) < 2 or distance[-1] - distance[0] < NODE_M:
            return 0.0
        at = np.append(np.arange(distance[0], distance[-1], NODE_M), distance[-1])
        px, py = np.interp(at, distance, x), np.interp(at, distance, y)
        inside = np.asarray(self.setup.edge.signed_distance(px, py), dtype=float)
        depth = np.maximum(inside, 0.0) + OUTSIDE_M
        heading = portable.arctan2(np.gradient(py), np.gradient(px))
        outer_x = px - self.side * np.sin(heading) * depth
        outer_y = py + self.side * np.cos(heading) * depth
        inner, outer = np.stack([px, py], axis=1), np.stack([outer_x, outer_y], axis=1)
        first = np.stack([inner[:-1], inner[1:], outer[1:]], axis=1)
        second = np.stack([inner[:-1], outer[1:], outer[:-1]], axis=1)
        triangles = np.stack([first, second], axis=1).reshape(-1, 3, 2)
        area = 0.0
        for standing in self.setup.field.standing_areas(triangles).tolist():
            area += standing
        return area


LEVEL = Level(Harvest, None, summary="what the header cut, and what it left standing")
