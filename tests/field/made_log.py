"""A combine's log made from a known field: every number an import gives back can be checked against it."""

import csv
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

EPSG, EAST, NORTH = 32612, 533000.0, 5304000.0
HEADER, SPEED, LENGTH = 12.0, 2.0, 360.0


def grain_at(x, y):
    """Yield [kg/m2] of the made field."""
    return 0.60 + 0.15 * np.sin(x / 17.0 + 0.5) * np.cos(y / 13.0) + 0.10 * np.sin((x + 2 * y) / 29.0)


def ground_at(x, y):
    """Height [m] of the made field."""
    return 850.0 + 0.02 * x + 3.0 * np.sin(x / 90.0) + 2.0 * np.cos(y / 120.0)


@dataclass
class MadeLog:
    """20 passes, alternating, with turns; the flow is late by delay_s and follows with a lag of 1.5 s."""

    delay_s: float = 12.0
    drift_m: float = 0.0
    passes: int = 20
    machines: int = 1
    seed: int = 1
    rows: list[dict[str, object]] = field(default_factory=list)
    offsets: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        self.offsets = rng.normal(0.0, self.drift_m, self.passes)
        for machine in range(self.machines):
            self._drive(rng, machine)

    def _drive(self, rng, machine):
        x, y, z, cut = [], [], [], []
        for k in range(machine, self.passes, self.machines):
            up = (k // self.machines) % 2 == 0
            along = np.arange(0.0, LENGTH, SPEED)
            along = along if up else along[::-1]
            east = np.full(len(along), 12.0 * k) + rng.normal(0.0, 0.03, len(along))
            turn = np.linspace(0.0, np.pi, 12)[1:-1]
            radius = 6.0 * self.machines
            sign = 1.0 if up else -1.0
            end = along[-1]
            turn_x, turn_y = 12.0 * k + radius - radius * np.cos(turn), end + sign * 9.0 * np.sin(turn)
            x += [*east, *turn_x]
            y += [*along, *turn_y]
            z += [self.offsets[k]] * (len(along) + len(turn))
            cut += [True] * len(along) + [False] * len(turn)
        x, y, cut = np.array(x), np.array(y), np.array(cut)
        inflow = np.where(cut, grain_at(x, y) * SPEED * HEADER, 0.0)
        kernel = np.exp(-np.arange(10) / 1.5)
        late = np.convolve(inflow, kernel / kernel.sum())[: len(x)]
        lag = self.delay_s - float((np.arange(10) * kernel).sum() / kernel.sum())
        flow = np.interp(np.arange(len(x)) - lag, np.arange(len(x)), late, left=0.0)
        flow = flow * (1.0 + rng.normal(0.0, 0.02, len(x)))
        height = ground_at(x, y) + np.array(z) + rng.normal(0.0, 0.01, len(x))
        for i in range(len(x)):
            self.rows.append({
                "machine": f"M{machine + 1}", "time": float(i), "easting": EAST + x[i],
                "northing": NORTH + y[i], "elevation": height[i], "speed": SPEED, "swath": HEADER,
                "flow": max(flow[i], 0.0), "moisture": 13.0 + 0.005 * x[i],
            })  # fmt: skip

    def write(
        self, path: Path, *, drop: tuple[str, ...] = (), names: dict[str, str] | None = None, scale=None
    ):
        """Write as CSV. names: other headers. scale: header -> factor."""
        names, scale = names or {}, scale or {}
        keys = [k for k in self.rows[0] if k not in drop]
        with path.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow([names.get(k, k) for k in keys])
            for row in self.rows:
                writer.writerow(
                    [
                        f"{row[k] * scale.get(k, 1.0):.4f}" if not isinstance(row[k], str) else row[k]
                        for k in keys
                    ]
                )
        return path


COLUMNS = """
crs: EPSG:32612
machine: {column: machine, unit: text}
time: {column: time, unit: s}
easting: {column: easting, unit: m}
northing: {column: northing, unit: m}
elevation: {column: elevation, unit: m}
speed: {column: speed, unit: m/s}
header_width: {column: swath, unit: m}
grain_flow: {column: flow, unit: kg/s}
moisture: {column: moisture, unit: "%"}
"""
