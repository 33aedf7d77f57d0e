"""What the header cut, and what it left standing."""

from collections.abc import Mapping, Sequence

import numpy as np

from swath.core import portable
from swath.core.registry import Level
from swath.core.together import Samples, field_of
from swath.judge.evaluator import EvaluatorSetup, Metric, ratio
from swath.judge.header_path import HeaderPath, HeaderPaths
from swath.judge.together import Bits
from swath.signals import CropFlow, MachineState, Signal

GROUP = "Harvest"
OUTSIDE_M = 1.0  # uncut crop counts this far beyond the initial edge, where teeth may stand
NODE_M = 0.5  # length of the strips in which uncut crop is counted


class Harvest:
    """Area and grain cut, use of the header's width, crop left uncut."""

    OF_FIELD = False
    SIGNALS = (MachineState, CropFlow)
    METRICS = (
        Metric("header_use", "1", "area cut / area the header passed over, on the way after settling", GROUP,
               "higher", "", "%", 1),
        Metric("uncut_area_m2", "m2", "standing crop left on the cut side of the header end's path", GROUP,
               "lower", "left uncut"),
        Metric("area_cut_m2", "m2", "ground from which crop was cut", GROUP, "higher", "", "", 1),
        Metric("grain_cut_kg", "kg", "grain taken in by the header", GROUP, "higher", "", "", 1),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self.side = 1.0 if setup.machine.edge_side == "left" else -1.0
        self._path = HeaderPath(setup.machine)
        self._distance = 0.0
        self._has_header = False
        left, right = (setup.machine.geometry.header_end(side)[1] for side in ("left", "right"))
        self._width = left - right
        self._area = self._grain = self._settled_area = self._way = 0.0
        self._last: float | None = None  # distance at the last cut after settling

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Add what was cut."""
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._distance = signal.distance
                self._path.see(signal)
            elif isinstance(signal, CropFlow):
                self._has_header = True
                self._area += signal.area
                self._grain += signal.grain
                if self._distance >= self.setup.settling_m:
                    if self._last is not None:
                        self._settled_area += signal.area
                        self._way += self._distance - self._last
                    self._last = self._distance

    @classmethod
    def together(cls, evaluators: Sequence["Harvest"]) -> "_Together":
        """Of many worlds."""
        return _Together(evaluators)

    def metrics(self) -> dict[str, float]:
        """Of all that was cut; nothing of a machine without a header."""
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
        _, distance, x, y = self._path.arrays()
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


class _Together:
    """sums: grain and area, area and way after settling; last: distance at the last cut after settling"""

    def __init__(self, evaluators: Sequence[Harvest]) -> None:
        n = len(evaluators)
        self._evaluators = evaluators
        self._paths = HeaderPaths([e._path for e in evaluators])
        self._distance, self._last = np.zeros(n), np.full(n, np.nan)
        self._settling = np.array([e.setup.settling_m for e in evaluators])
        self._area, self._grain, self._settled_area, self._way = np.zeros((4, n))
        self._has_header = False

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None:
        """Add what was cut."""
        for samples in outputs.values():
            if samples.kind is MachineState:
                self._distance[:] = samples.arrays["distance"]
                self._paths.see(samples)
            elif samples.kind is CropFlow:
                self._has_header = True
                area = field_of(samples, "area")
                self._area += area
                self._grain += field_of(samples, "grain")
                is_settled = self._distance >= self._settling
                counts = is_settled & (self._last == self._last)
                self._settled_area += np.where(counts, area, 0.0)
                self._way += np.where(counts, self._distance - self._last, 0.0)
                self._last[is_settled] = self._distance[is_settled]

    def give(self, world: int) -> None:
        """What was seen of a world."""
        e = self._evaluators[world]
        self._paths.give(world)
        e._distance, e._has_header = float(self._distance[world]), self._has_header
        e._area, e._grain = float(self._area[world]), float(self._grain[world])
        e._settled_area, e._way = float(self._settled_area[world]), float(self._way[world])
        last = float(self._last[world])
        e._last = last if last == last else None


LEVEL = Level(Harvest, None, summary="what the header cut, and what it left standing")
