"""Means and percentiles of what was judged; nan where there is nothing."""

from typing import Any

import numpy as np

from swath.signals import F64

STEP_M = 0.1  # spacing of the interpolated path


def rms(values: F64) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def mean(values: Any) -> float:
    """Mean."""
    return float(np.mean(values)) if len(values) else float("nan")


def ratio(part: float, whole: float) -> float:
    """part / whole."""
    return part / whole if whole > 0.0 else float("nan")


def even_path(distance: F64, value: F64, *, start: float = 0.0, step: float = STEP_M) -> tuple[F64, F64]:
    """Distances [m] every `step` from `start` on and the values interpolated there; empty when too short."""
    if len(distance) < 2 or distance[-1] < start:
        return np.zeros(0), np.zeros(0)
    at = np.arange(start, distance[-1], step)
    at = at[at >= distance[0]]
    return at, np.interp(at, distance, value)
