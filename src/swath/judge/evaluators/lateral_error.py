"""How far the header end is from where it should be beside the initial edge."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from swath.core.blocks import Seen
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Later, Metric, even_path, mean, rms
from swath.judge.header_path import HeaderPath
from swath.record.tracks import Column
from swath.signals import F64, CropFlow, MachineState

GROUP = "Steering"


@dataclass(frozen=True)
class PathSeries:
    """The course of a run, (n,) each: t [s], distance [m], x and y of the header end and its error [m]."""

    t: F64
    distance: F64
    x: F64
    y: F64
    lateral: F64


class LateralError(Later):
    """Lateral error of the header end against the initial edge, after settling."""

    SIGNALS = (MachineState, CropFlow)
    COLUMNS = ("lateral_error_m",)
    METRICS = (
        Metric("lateral_rms_m", "m", "lateral error of the header end after settling, root mean square",
               GROUP, "lower", "lateral error, RMS"),
        Metric("lateral_p95_m", "m", "the lateral error's 95th percentile, of its size", GROUP,
               "lower", "lateral error, 95th percentile"),
        Metric("lateral_bias_m", "m", "mean of the lateral error; > 0 towards the standing crop", GROUP,
               "", "lateral error, mean"),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self.shared_path = HeaderPath(setup.machine)
        self._has_header = False

    def take(self, seen: Seen) -> None:
        """Note where the header end is."""
        if (states := seen.of(MachineState)) is not None:
            self.shared_path.take(states)
        self._has_header |= seen.of(CropFlow) is not None

    def metrics(self) -> dict[str, float]:
        """Metrics of the whole path; none of a machine without a header."""
        if not self._has_header:
            return {}
        series = self.series()
        return lateral_metrics(series.distance, series.lateral, settling=self.setup.settling_m)

    def columns(self) -> tuple[Column, ...]:
        """The lateral error at any time."""

        def lateral(tracks: Mapping[str, F64]) -> F64:
            return self._error(tracks["header_end_x_m"], tracks["header_end_y_m"])

        meaning = "header end, > 0 towards the standing crop"
        return (Column("lateral_error_m", "m", meaning, later=lateral, is_by_row=True),)

    def _error(self, x: F64, y: F64) -> F64:
        """Lateral error [m] of header ends at world points [m], nan beyond the end of the edge."""
        edge = self.setup.edge
        inside = np.asarray(edge.signed_distance(x, y), dtype=float)
        return np.where(edge.project(x, y)[0] <= edge.length, inside + self.setup.overlap, np.nan)

    def series(self, most: int | None = None) -> PathSeries:
        """The course of the run so far. most: samples, spread evenly, where there are more."""
        t, distance, x, y = self.shared_path.arrays(most)
        return PathSeries(t, distance, x, y, self._error(x, y))


def lateral_metrics(distance: F64, error: F64, *, settling: float) -> dict[str, float]:
    """Quality of a driven path from its lateral error [m] at travelled distances [m], both (n,).

    The error is taken at even steps along the path, between samples by linear interpolation, so that it
    depends neither on the sample rate nor on the speed (the interpolation method of dynamic tests after
    ISO 12188; nearest samples err by up to several mm at harvest speed).
    """
    settled = even_path(distance, error, start=settling)[1]
    settled = settled[np.isfinite(settled)]
    p95 = float(np.percentile(np.abs(settled), 95.0)) if len(settled) else float("nan")
    return {"lateral_rms_m": rms(settled), "lateral_p95_m": p95, "lateral_bias_m": mean(settled)}


LEVEL = Level(LateralError, None, summary="the header end against where it should be beside the initial edge")
