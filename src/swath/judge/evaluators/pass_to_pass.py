"""How passes lie beside each other: what is gone over twice, and what is left between them."""

import numpy as np

from swath.core.blocks import Seen
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, KeptRows, Later, Metric, even_path, held, mean
from swath.signals import F64, CropFlow, GuidanceState, MachineState

GROUP = "Passes"
PATH_M = 0.05  # spacing of the stored path
EVERY_M = 0.25  # along a pass, where it is held against the ones before
APART = 3.0  # m without crop, behind which another pass begins
SAME_WAY = 0.9  # cosine between two passes that are taken as driven the same way


class PassToPass(Later):
    """The header end that follows the edge, against where the other end went in a pass before.

    A pass is a way on which the header cuts, of a machine that has a path, too: none turns without.
    """

    SIGNALS = (CropFlow, MachineState)
    METRICS = (
        Metric("pass_overlap_m", "m", "mean overlap with a pass before, driven the same way beside it",
               GROUP, "", "overlap of passes"),
        Metric("pass_to_pass_p95_m", "m", "that overlap against the meant one, 95th percentile of its size",
               GROUP, "lower", "pass to pass, 95th percentile"),
        Metric("pass_gap_max_m", "m", "widest strip left between two such passes", GROUP, "lower",
               "strip left between passes"),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        machine = setup.machine
        self._overlap = setup.overlap
        self._width = abs(machine.geometry.header_end("left")[1] - machine.geometry.header_end("right")[1])
        sides = ("left", "right") if machine.edge_side == "left" else ("right", "left")
        self._inner, self._outer = ([*machine.geometry.header_end(side), 0.0] for side in sides)
        self._side = 1.0 if machine.edge_side == "left" else -1.0
        self._rows = KeptRows(6)  # pass, distance, inner end, outer end
        self._pass, self._cuts = 0, False
        self._last = float("inf")  # distance at which it cut last [m]
        self._next = float("-inf")  # distance from which on the next place is noted [m]
        self._counts = {GuidanceState, CropFlow} <= {*machine.outputs.values()}

    def take(self, seen: Seen) -> None:
        """Note where both ends of the header are while it cuts."""
        if not self._counts:
            return
        states, flows = seen.of(MachineState), seen.of(CropFlow)
        if states is not None:
            cuts = held(flows, "area", states.orders, float(self._cuts)) > 0.0
            for k in (cuts & (states["distance"] >= self._next)).nonzero()[0].tolist():
                way = float(states["distance"][k])
                if way >= self._next:
                    self._pass += way - self._last > APART
                    self._last = way
                    pose = states.sample(k).pose
                    inner, outer = pose.point(*self._inner), pose.point(*self._outer)
                    self._rows.add((self._pass, way, *inner[:2], *outer[:2]))
                    self._next = way + PATH_M
        if flows is not None:
            self._cuts = bool(flows["area"][-1] > 0.0)

    def metrics(self) -> dict[str, float]:
        """Metrics of all passes; none with fewer than two passes, nan where none lies beside another."""
        if not self._counts or self._pass == 0:
            return {}
        overlap = self.overlaps()
        if not len(overlap):
            return dict.fromkeys((m.name for m in self.METRICS), float("nan"))
        return {
            "pass_overlap_m": mean(overlap),
            "pass_to_pass_p95_m": float(np.percentile(np.abs(overlap - self._overlap), 95.0)),
            "pass_gap_max_m": max(0.0, -float(overlap.min())),
        }

    def overlaps(self) -> F64:
        """Overlap [m] every EVERY_M along all passes that have one before beside them, (n,)."""
        rows = self._rows.table()
        passes = [_even(rows[rows[:, 0] == number]) for number in np.unique(rows[:, 0])]
        found = [self._beside(own, passes[:i]) for i, own in enumerate(passes)]
        return np.concatenate([*found, np.zeros(0)])

    def _beside(self, own: F64, before: list[F64]) -> F64:
        """Overlap of one pass with the nearest that lies beside each of its places."""
        best = np.full(len(own), np.inf)
        for other in before:
            line = other[:, 2:]
            low, high = line.min(axis=0) - self._width, line.max(axis=0) + self._width
            near = np.all((own[:, :2] > low) & (own[:, :2] < high), axis=1).nonzero()[0]
            if len(near) and len(line) > 1:
                overlap = self._side * _left_of(own[near, :2], line)
                best[near] = np.where(np.abs(overlap) < np.abs(best[near]), overlap, best[near])
        found: F64 = best[np.abs(best) < 0.5 * self._width]
        return found


def _even(rows: F64) -> F64:
    """Inner and outer end of one pass every EVERY_M of way, (n, 4)."""
    columns = [even_path(rows[:, 1], rows[:, k], start=rows[0, 1], step=EVERY_M)[1] for k in range(2, 6)]
    return np.stack(columns, axis=1)


def _left_of(points: F64, line: F64) -> F64:
    """How far points lie to the left of a line [m], (n,); nan beyond its ends and where they go back."""
    begins, steps = line[:-1], np.diff(line, axis=0)
    lengths = np.hypot(*steps.T)
    along = steps / np.maximum(lengths, 1e-9)[:, None]
    course = np.gradient(points, axis=0) if len(points) > 1 else np.zeros_like(points)
    course /= np.maximum(np.hypot(*course.T), 1e-9)[:, None]
    found = np.full(len(points), np.nan)
    for i, point in enumerate(points):
        to = point - begins
        at = along[:, 0] * to[:, 0] + along[:, 1] * to[:, 1]
        across = along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]
        goes = along[:, 0] * course[i, 0] + along[:, 1] * course[i, 1]
        fits = (at >= 0.0) & (at <= lengths) & (goes > SAME_WAY)
        if fits.any():
            found[i] = min(across[fits], key=abs)
    return found


LEVEL = Level(PassToPass, None, summary="passes beside each other: overlap, and what is left between them")
