"""A detector of one's own over many worlds at once: numpy arrays whose first axis is the world.

    python examples/many_worlds.py

Beams are crop or stubble by a height midway between both; the split that leaves the fewest on the wrong side
is the edge of a scan, and a line through those of the last metres, carried along by odometry, is the edge.
"""

from collections.abc import Sequence

import numpy as np

import swath
from swath.core.component import Port
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.together import Given, InWorlds, KeepsRows, Samples
from swath.signals import CropEdge, Odometry, Scan, beam_directions
from swath.signals.setup import ControlSetup

MIDDLE, KEPT, AHEAD = (
    0.5,
    64,
    8.0,
)  # height between crop and stubble [m], edge points, where ahead it holds [m]


class Split(InWorlds):
    """Scan and odometry in, crop edge out; the crop lies to the right."""

    inputs = (Port("scan", Scan, unit="m", shape=(None,)), Port("odometry", Odometry))
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params: None, setup: ControlSetup) -> None:
        self.mounting = setup.mounting

    @classmethod
    def together(cls, parts: Sequence["Split"]) -> "Splits":
        return Splits(parts)


class Splits(KeepsRows):
    """The detectors of all worlds."""

    kept = ("points", "line")

    def __init__(self, parts: Sequence[Split]) -> None:
        self.mounting, self.errors = parts[0].mounting, {}
        self.points, self.line = np.zeros((len(parts), KEPT, 2)), np.zeros((len(parts), 3))

    def reset(self, streams: Sequence[Stream]) -> dict[str, Samples]:
        self.points[:], self.line[:] = np.nan, 0.0
        return self._edge(0)

    def step(self, t: int, dt: int, inputs: Given) -> dict[str, Samples]:
        scan, odometry = inputs["scan"], inputs["odometry"].arrays
        if scan.t == t + dt:
            self._move(odometry["speed"] * dt / NS, odometry["yaw_rate"] * dt / NS)
            self._look(scan)
        return self._edge(t + dt)

    def _move(self, way: np.ndarray, turn: np.ndarray) -> None:
        c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
        x, y = self.points[..., 0] - way[:, None], self.points[..., 1] - 0.5 * (way * turn)[:, None]
        self.points[..., 0], self.points[..., 1] = c * x + s * y, c * y - s * x

    def _look(self, scan: Samples) -> None:
        ranges = np.nan_to_num(scan.arrays["ranges"][:, :, 0].astype(float))
        at = self.mounting.apply(
            ranges[..., None] * beam_directions(scan.alike["azimuth"], scan.alike["elevation"])
        )
        at = at[:, np.argsort(-scan.alike["azimuth"])]  # from the left, where the stubble is
        is_crop = at[..., 2] > MIDDLE
        wrong = np.cumsum(is_crop, 1) - is_crop + np.cumsum(~is_crop[:, ::-1], 1)[:, ::-1]
        split, worlds = wrong.argmin(1), np.arange(len(at))
        found = at[worlds, split, :2]
        found[wrong[worlds, split] > 0.1 * at.shape[1]] = np.nan
        self.points = np.concatenate([self.points[:, 1:], found[:, None]], axis=1)
        x, y = self.points[..., 0] - AHEAD, self.points[..., 1]
        use = np.isfinite(x) & (np.abs(x) < 6.0)
        n, sx, sy, sxx, sxy = (np.where(use, q, 0.0).sum(1) for q in (1.0, x, y, x * x, x * y))
        slope = (n * sxy - sx * sy) / np.maximum(n * sxx - sx * sx, 1e-3)
        self.line = np.stack([(sy - slope * sx) / np.maximum(n, 1.0), slope, 1.0 * (n > 8)], axis=1)

    def _edge(self, t: int) -> dict[str, Samples]:
        offset, slope, sure = self.line.T
        same = {"crop_height": 2 * MIDDLE, "stubble_height": 0.0, "curvature": 0.0, "reference_x": AHEAD}
        arrays = {"offset": offset, "heading": np.arctan(slope), "confidence": sure}
        return {"edge": Samples(CropEdge, t, arrays, same)}


def main() -> None:
    sets = {
        "combine.lidar.level": "profile",
        "combine.header.level": "profile",
        "combine.motion.level": "kinematic",
        "combine.edge": Split,
        "run.distance_m": 20,
    }
    vary = {"combine.speed.speed_kmh": (4.0, 9.0)}
    for run in swath.worlds("straight", n=8, vary=vary, sets=sets):
        speed, rms = run.entry["sets"]["combine.speed.speed_kmh"], run.summary["lateral_rms_m"]
        print(f"{speed:.1f} km/h: lateral RMS {100.0 * rms:.1f} cm")


if __name__ == "__main__":
    main()
