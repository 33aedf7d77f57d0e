"""What scanners of a machine saw, as `--metric scans` compares it: how high echoes lie."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.signals import Scan, Signal

SCANS = "scans"  # as a metric
SHARES = tuple(range(5, 100, 10))  # of the echoes that lie lower [%]
NAMES = tuple(f"scan_height_p{share:02d}_m" for share in SHARES)
LOWEST, HIGHEST, STEP = -1.0, 4.0, 0.01  # heights that are told apart [m]
REFERENCE = f"{Path(__file__).resolve()}:ScanHeights"


class ScanHeights:
    """Quantiles of the heights of echoes over the plane that the machine stands on.

    The mean of how far quantiles of two runs lie apart is the Wasserstein-1 distance of their heights, by
    which `swath compare scans` compares a pass with a simulation.
    """

    OF_FIELD = False
    SIGNALS = (Scan,)
    METRICS = tuple(
        Metric(name, "m", f"height that {share} % of the echoes lie below", "Run")
        for name, share in zip(NAMES, SHARES, strict=True)
    )

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._mounting = setup.machine.mounting if setup.name else {}
        self._edges = np.linspace(LOWEST, HIGHEST, round((HIGHEST - LOWEST) / STEP) + 1)
        self._counts = np.zeros(len(self._edges) - 1)

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Count the echoes of a scan."""
        pose: Any = self._mounting.get(slot.rpartition(".")[2])
        for scan in outputs.values():
            if isinstance(scan, Scan) and pose is not None:
                heights = pose.apply(scan.points().reshape(-1, 3))[:, 2]
                self._counts += np.histogram(heights[np.isfinite(heights)], self._edges)[0]

    def metrics(self) -> dict[str, float]:
        """The quantiles; nothing without echoes."""
        below = np.cumsum(self._counts)
        if not len(below) or below[-1] == 0.0:
            return {}
        heights = np.interp(np.array(SHARES) * 0.01 * below[-1], below, self._edges[1:])
        return dict(zip(NAMES, map(float, heights), strict=True))


def heights_of(metrics: Mapping[str, float | None]) -> list[float] | None:
    """The quantiles in the metrics of a run; None without."""
    found = [metrics.get(name) for name in NAMES]
    return None if None in found else [float(value or 0.0) for value in found]
