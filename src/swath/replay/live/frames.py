"""Frames of a run that goes on: the newest row of every machine, and scans, in at most `LARGEST` bytes.

Bytes of a frame: length of a JSON head (uint32, little endian), the head, padded with blanks to a multiple of
4, the values of its rows (float32), then the echoes of its scans (int16, in `ECHO_UNIT` about their middle).
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.schedule import NS
from swath.judge.evaluation import Evaluation
from swath.judge.evaluators.edge_detection import EdgeDetection
from swath.record.tracks import SHOWN_ROWS, Tracks
from swath.replay.charts import CHARTS
from swath.replay.live.data import COLUMNS, ECHO_UNIT
from swath.replay.machines import derived, thinned
from swath.runtime.world import World
from swath.signals import F64, MachineLoad, ScanTruth

LARGEST = 3000  # of a frame [bytes]
OF_TRUTH = ("edge_true_m", "edge_error_m")  # judged while the run goes on
OF_HEADER = {curve.column for chart in CHARTS if chart.of_header for curve in chart.curves}
STRAW, STRAW_S = "straw_kg", 0.2  # on the ground so far; time between two looks at it [s]


class Frames:
    """Makes the frames of one run. tracks: of its recorder, by machine; origin: places count from it [m]

    straw: per machine times [s] and mass on the ground [kg], as `note` has found them
    """

    def __init__(
        self, world: World, tracks: Mapping[str, Tracks], origin: F64, evaluation: Evaluation
    ) -> None:
        self.world = world
        self.origin, self._tracks = origin, tracks
        self._detections = {
            name: found
            for name, machine in world.machines.items()
            if machine.slots_of("edge") and (found := evaluation.find(name, EdgeDetection)) is not None
        }
        self.straw: dict[str, list[tuple[float, float]]] = {name: [] for name in world.machines}
        self.columns = {
            n: _shown(tracks[n], has_edge=n in self._detections, cuts=machine.cuts)
            for n, machine in world.machines.items()
        }
        self._shift = {name: _shift(columns, origin) for name, columns in self.columns.items()}
        self._scanners = [f"{n}.{slot}" for n, m in world.machines.items() for slot in m.slots_of("lidar")]
        self._sent = [-1] * len(self._scanners)

    def frame(self, t: int) -> bytes:
        """The world before the tick at t [ns]."""
        rows = [self._rows(name, self._newest(name)) for name in self.columns]
        head: dict[str, Any] = {"rows": [row.size for row in rows]}
        if ways := self._ways(t):
            head["ways"] = ways
        fresh = self._fresh()
        room = LARGEST - 4 - len(_json(head)) - 4 * sum(head["rows"]) - 16 - 60 * len(fresh)
        scans, points = [], []
        for k, truth in fresh:
            middle, echoes = self._echoes(truth, max(room, 0) // (6 * len(fresh)))
            scans.append([k, truth.t / NS, *(round(float(v), 3) for v in middle), len(echoes)])
            points.append(echoes)
        head["scans"] = scans
        return _packed(head, *(row.tobytes() for row in rows), *(p.tobytes() for p in points))

    def history(self) -> bytes:
        """All rows so far, thinned as in a replay."""
        tables = []
        for name in self.columns:
            own = self._tracks[name].arrays(is_over=False, most=SHOWN_ROWS)
            tables.append(self._rows(name, self._completed(name, thinned(own)) if len(own["t_s"]) else {}))
        return _packed({"history": [list(table.shape) for table in tables]}, *(t.tobytes() for t in tables))

    def note(self) -> None:
        """Keep how much straw lies on the ground."""
        for name, straw in self.straw.items():
            load = self.world.graph.latest(f"{name}.process", "load")
            if isinstance(load, MachineLoad) and (not straw or load.t / NS >= straw[-1][0] + STRAW_S):
                straw.append((load.t / NS, load.dropped_straw))

    def _newest(self, name: str) -> dict[str, Any]:
        """One row of a machine, with the true edge where it is known for the edge of that row."""
        row: dict[str, Any] = dict(self._tracks[name].newest(self.columns[name]))
        if row:
            detection, straw, true = self._detections.get(name), self.straw[name], np.nan
            if detection is not None and detection.newest_t / NS == row["edge_t_s"][0]:
                true = detection.true_offset
            row["edge_true_m"] = np.array([true])
            row[STRAW] = np.array([straw[-1][1] if straw else np.nan])
        return derived(row, self.world.machines[name].edge_side)

    def _completed(self, name: str, columns: Mapping[str, Any]) -> dict[str, Any]:
        """Rows of the past, with true edge and straw."""
        found, straw = dict(columns), np.array(self.straw[name]).reshape(-1, 2)
        for column in self._detections[name].columns() if name in self._detections else ():
            found[column.name] = column.later(found) if column.later is not None else found[column.name]
        empty = np.full(len(found["t_s"]), np.nan)
        found[STRAW] = np.interp(found["t_s"], *straw.T) if len(straw) else empty
        return derived(found, self.world.machines[name].edge_side)

    def _rows(self, name: str, columns: Mapping[str, Any]) -> NDArray[np.float32]:
        """Rows of what is shown of a machine, (rows, columns)."""
        if not columns:
            return np.zeros((0, len(self.columns[name])), np.float32)
        table = np.stack([columns[c] for c in self.columns[name]], axis=1)
        return (table - self._shift[name]).astype(np.float32)

    def _fresh(self) -> list[tuple[int, ScanTruth]]:
        """Scans that were not sent yet."""
        found = []
        for k, name in enumerate(self._scanners):
            truth = self.world.graph.latest(name, "truth")
            if isinstance(truth, ScanTruth) and truth.t != self._sent[k]:
                self._sent[k] = truth.t
                found.append((k, truth))
        return found

    def _echoes(self, truth: ScanTruth, most: int) -> tuple[F64, NDArray[np.int16]]:
        """Middle [m] and echoes about it, an even choice of at most `most`."""
        points = truth.points.reshape(-1, 3)
        points = points[np.isfinite(points[:, 0])]
        if len(points) > most:
            points = points[:: -(-len(points) // most)] if most else points[:0]
        if not len(points):
            return np.zeros(3), np.zeros((0, 3), np.int16)
        places = points - self.origin
        middle = np.round(places.mean(axis=0), 3)
        return middle, np.clip(np.rint((places - middle) / ECHO_UNIT), -32767, 32767).astype("<i2")

    def _ways(self, t: int) -> dict[str, list[float]]:
        """t, x, y, z, yaw of what goes."""
        found = {}
        for name in self.world.bodies.going():
            pose = self.world.bodies.pose_of(name)
            place = [*(pose.position - self.origin), pose.euler()[2]]
            found[name] = [t / NS, *(round(float(v), 3) for v in place)]
        return found


def _shown(tracks: Tracks, *, has_edge: bool, cuts: bool) -> list[str]:
    """Columns of the page that are known while a run goes on. cuts: False for a machine without a header"""
    names = {c.name for c in tracks.columns if c.later is None or c.is_by_row}
    names -= set() if cuts else OF_HEADER
    return [*(c for c in COLUMNS if c in names or (has_edge and c in OF_TRUTH)), STRAW]


def _shift(columns: Sequence[str], origin: F64) -> list[float]:
    axes = {"x_m": 0, "y_m": 1, "trailer_x_m": 0, "trailer_y_m": 1}
    return [float(origin[axes[c]]) if c in axes else 0.0 for c in columns]


def _json(head: Mapping[str, Any]) -> bytes:
    return json.dumps(head, separators=(",", ":")).encode()


def _packed(head: Mapping[str, Any], *parts: bytes) -> bytes:
    text = _json(head)
    text += b" " * (-len(text) % 4)
    return b"".join([len(text).to_bytes(4, "little"), text, *parts])
