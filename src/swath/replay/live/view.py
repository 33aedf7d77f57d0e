"""The run hook of `swath run --view`: sends frames to the pages that are open, and does what they ask.

A page sends JSON: {"id": 1, "do": "pause", "value": true}; do: pause, step, speed, set (with "key" and
"value"; null takes an obstacle away), branch (as set, with "at_s"), and the word `seen` after each frame. The
answer has the same id, "ok" and "text"; what has changed goes to all pages.

A frame holds the newest row of every machine, and scans, in at most `LARGEST` bytes.

Bytes of a frame: length of a JSON head (uint32, little endian), the head, padded with blanks to a multiple of
4, the values of its rows (float32), then the echoes of its scans (int16, in `ECHO_UNIT` about their middle).

The page and its websockets are served on the loopback interface, to whoever knows the token of its address.
"""

import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import shortened
from swath.core.schedule import NS
from swath.judge.evaluation import Evaluation, incident
from swath.judge.evaluators.edge_detection import EdgeDetection
from swath.record.charts import CHARTS
from swath.record.recorder import Recorder
from swath.record.tracks import SHOWN_ROWS, Tracks
from swath.replay.live.data import COLUMNS, ECHO_UNIT, live_data, starting_rows
from swath.replay.machines import derived, thinned
from swath.replay.moments import events_of
from swath.replay.things import things_of
from swath.replay.writer import origin_of, packed, render
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.run_control import Reply, RunControl
from swath.runtime.served import Server, Viewer
from swath.runtime.world import World
from swath.signals import F64, MachineLoad, ScanTruth

LARGEST = 3000  # of a frame [bytes]
OF_TRUTH = ("edge_true_m", "edge_error_m")  # judged while the run goes on
OF_HEADER = {curve.column for chart in CHARTS if chart.of_header for curve in chart.curves}
STRAW, STRAW_S = "straw_kg", 0.2  # on the ground so far; time between two looks at it [s]


class Frames:
    """Makes the frames of one run. recorder: of its tracks; origin: places count from it [m].

    straw: per machine times [s] and mass on the ground [kg], as `note` has found them
    """

    def __init__(self, world: World, recorder: Recorder, origin: F64, evaluation: Evaluation) -> None:
        self.world = world
        self.origin, self._recorder = origin, recorder
        self._detections = {
            name: found
            for name, machine in world.machines.items()
            if machine.slots_of("edge") and (found := evaluation.find(name, EdgeDetection)) is not None
        }
        self.straw: dict[str, list[tuple[float, float]]] = {name: [] for name in world.machines}
        self.columns = {
            n: _shown(recorder.tracks[n], has_edge=n in self._detections, cuts=machine.cuts)
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
            own = self._recorder.tracks[name].arrays(is_over=False, most=SHOWN_ROWS)
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
        row: dict[str, Any] = dict(self._recorder.tracks[name].newest(self.columns[name]))
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
    """Columns of the page that are known while a run goes on. cuts: False for a machine without a header."""
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


SEEN = "seen"
PERIOD = NS // 25  # between two frames, on the wall [ns]


class LiveView(RunHook):
    """control: that others may use too. address: to open in a browser of this machine.

    frame_count, frame_s, largest: frames so far, CPU time that they took of the run's thread [s], bytes of
    the largest. Raises MissingExtra without websockets.
    """

    def __init__(self, control: RunControl) -> None:
        self._control = control
        control.listeners.append(self._tell_state)
        self._run: ActiveRun | None = None
        self._frames: Frames | None = None
        self._page: bytes | None = None
        self._is_ready = threading.Event()
        self._viewers: tuple[Viewer, ...] = ()
        self._lock = threading.Lock()
        self._due, self._shown, self._told = 0, -1, 0  # what was reported: events and changes
        self.frame_count, self.frame_s, self.largest = 0, 0.0, 0
        self._server = Server(self._talk, extra=("view", "the live page"), who="--view", page=self._html)
        self.address = self._server.address

    # in the thread of the run

    def begin(self, run: ActiveRun) -> None:
        """Connect to a world at its start."""
        before, self._run, self._frames, self._shown = self._frames, run, None, -1
        self._control.join(run)
        if run.start is not None and before is not None:  # the same field and way ahead: the page stays
            self._frames = Frames(run.world, run.recorder, before.origin, run.evaluation)
            for name, straw in before.straw.items():
                self._frames.straw[name] = [s for s in straw if s[0] <= run.world.graph.t / NS]
            self._tell({"again": True})
        else:
            self._is_ready.clear()
        run.world.graph.before_tick.insert(0, self._before_tick)

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Show the pages the end, and say how it ended."""
        if self._frames is not None and self._run is not None:
            last = self._frames.frame(self._run.world.graph.t)
            for viewer in self._viewers:
                viewer.put(last)
        word = "stopped" if summary["incomplete"] else "over"
        self._tell({"over": f"the run is {word} at {summary['simulated_s']:g} s"})

    def close(self) -> None:
        """No more pages."""
        self._control.close()
        self._is_ready.set()
        self._server.close()

    def _before_tick(self, t: int) -> None:
        assert self._run is not None
        if self._frames is None:
            self._begin_page(self._run)
        now = time.monotonic_ns()
        if t == self._shown or (now < self._due and not self._control.is_paused):
            return
        viewers = [v for v in self._viewers if v.is_free or self._control.is_paused]
        assert self._frames is not None
        if now >= self._due:
            self._frames.note()
        if not viewers:
            return
        self._due, self._shown = now + PERIOD, t
        began = time.thread_time()
        if (count := len(self._run.evaluation.events()) + len(self._run.changes.events)) != self._told:
            self._told = count
            self._tell_state()
        frame = self._frames.frame(t)
        for viewer in viewers:
            viewer.show(frame)
        self.frame_s += time.thread_time() - began
        self.frame_count, self.largest = self.frame_count + 1, max(self.largest, len(frame))

    def _begin_page(self, run: ActiveRun) -> None:
        origin = origin_of(starting_rows(run.world))
        self._frames = Frames(run.world, run.recorder, origin, run.evaluation)
        values, arrays = live_data(run.world, self._frames.columns, origin)
        page = render(f"{values['name']} (live)", packed(values, arrays), more=("live",))
        self._page = page.encode()
        self._is_ready.set()
        self._tell({"again": True})

    def _state(self, run: ActiveRun) -> dict[str, Any]:
        """What the controls of a page show."""
        changes, frames = run.changes, self._frames
        incidents = [incident(event) for event in run.evaluation.events()]
        things, mesh, _ = things_of(run.world, changes.events, frames.origin) if frames else ([], None, "")
        return {
            "t_s": run.world.graph.t / NS,
            "paused": self._control.is_paused,
            "speed": self._control.speed,
            "is_paced": run.world.scenario.is_paced,
            "no_way_back": self._control.back_refused,
            "folder": "" if run.out is None else run.out.name,
            "values": changes.values(),
            "levels": changes.levels(),
            "events": changes.events,
            "marks": events_of({"incidents": incidents, "events": changes.events}, {}),
            "things": things,
            "mesh": [] if mesh is None else mesh.ravel().tolist(),
        }

    def _tell_state(self) -> None:
        if self._run is not None and self._viewers:
            self._tell({"state": self._state(self._run)})

    # in the threads of the viewers

    def _html(self, patience_s: float) -> bytes | None:
        self._is_ready.wait(patience_s)
        return self._page

    def _talk(self, connection: Any) -> None:
        """Serve a page until it is closed."""
        from websockets.exceptions import ConnectionClosed

        viewer = Viewer(connection)

        def join(t: int) -> str:
            assert self._frames is not None
            assert self._run is not None
            viewer.put(self._frames.history())
            viewer.show(self._frames.frame(t))
            viewer.put(json.dumps({"state": self._state(self._run)}))
            with self._lock:
                self._viewers = (*self._viewers, viewer)
            return ""

        try:
            is_there, text = self._control.ask(join)
            if not is_there:
                viewer.put(json.dumps({"over": text}))
            for message in connection:
                if message == SEEN:
                    viewer.free()
                else:
                    viewer.put(json.dumps(self._answer(message)))
        except ConnectionClosed:
            return
        finally:
            with self._lock:
                self._viewers = tuple(v for v in self._viewers if v is not viewer)
            viewer.close()

    def _answer(self, message: str | bytes) -> dict[str, Any]:
        try:
            asked = json.loads(message)
            if not isinstance(asked, dict):
                raise TypeError("no mapping")
            deed = self._deeds(asked)[asked["do"]]
            ok, text = deed()
        except (ValueError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
            said = shortened(repr(error), 100)
            return {"id": None, "ok": False, "text": f"expected a request of this page ({said})"}
        return {"id": asked.get("id"), "ok": ok, "text": text}

    def _deeds(self, asked: Mapping[str, Any]) -> dict[str, Callable[[], Reply]]:
        control, value = self._control, asked.get("value")
        return {
            "pause": lambda: control.pause(bool(value)),
            "step": control.step,
            "speed": lambda: control.set_speed(float(value or 0.0)),
            "set": lambda: control.set(str(asked["key"]), value),
            "branch": lambda: control.branch(float(asked["at_s"]), {str(asked["key"]): value}),
        }

    def _tell(self, message: Mapping[str, Any]) -> None:
        text = json.dumps(message)
        for viewer in self._viewers:
            viewer.put(text)
