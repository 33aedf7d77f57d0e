"""The live page: what it sends, what it takes, who may come in, and that a run does not notice it."""

import contextlib
import errno
import importlib
import json
import socket
import sys
import threading
import urllib.error
import urllib.request
from functools import partial

import numpy as np
import pytest

pytest.importorskip("websockets")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect as open_socket

from swath.commands.main import main
from swath.core.errors import InputError
from swath.record.tracks import read_tracks
from swath.replay.live.data import ECHO_UNIT
from swath.replay.live.view import LARGEST, LiveView
from swath.runtime.changes import read_events
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from swath.runtime.run_control import RunControl
from swath.runtime.served import MOST, Server, bound
from swath.scenario.scenario import parse_scenario
from swath.signals import ScanTruth
from tests.replay.browser import Browser, NoBrowser
from tests.waiting import PATIENCE_S, ended, until

connect = partial(open_socket, open_timeout=PATIENCE_S)
TEXT = """
format: swath scenario 2
name: watched
seed: 6
run: {distance_m: 40, max_duration_s: 3}
field:
  stand: {level: uniform, stems_per_m2: 100}
  edge: {shape: straight}
  obstacles: [{kind: post, x_m: -6, y_m: 12, name: pole}]
machines:
  combine:
    motion: {start_speed_kmh: 7}
    lidar: {sub_rays: 1, sector_deg: [-40, 40], step_deg: 1.0}
"""

WALKS = "{kind: person, x_m: 20, y_m: -6, path: {to: [[20, 6]]}}"


def decoded(frame):
    """Head, rows by machine, echoes by scan (world less the origin) [m]."""
    length = int.from_bytes(frame[:4], "little")
    head, at = json.loads(frame[4 : 4 + length]), 4 + length
    rows, scans = [], []
    for count in head.get("rows", []):
        rows.append(np.frombuffer(frame, "<f4", count, at))
        at += 4 * count
    for _, _, *middle, count in head.get("scans", []):
        points = np.frombuffer(frame, "<i2", 3 * count, at).reshape(-1, 3)
        scans.append(points * ECHO_UNIT + np.array(middle))
        at += 6 * count
    return head, rows, scans


def live_address(view):
    return view.address.replace("http", "ws").replace("/?", "/live?")


class Watcher:
    """A viewer without a browser. frames, states, answers and last words as they come."""

    def __init__(self, view):
        self.frames, self.states, self.answers, self.over = [], [], {}, ""
        self._open = contextlib.ExitStack()
        self.socket = self._open.enter_context(connect(live_address(view)))
        self.is_there = threading.Event()
        self._came = threading.Condition()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        self._count = 0

    def _read(self):
        with contextlib.suppress(ConnectionClosed):
            self._take_all()

    def _take_all(self):
        for message in self.socket:
            with self._came:
                if isinstance(message, bytes):
                    if "rows" in decoded(message)[0]:
                        self.frames.append(message)
                        with contextlib.suppress(OSError):
                            self.socket.send("seen")
                else:
                    told = json.loads(message)
                    self.states += [told["state"]] if "state" in told else []
                    self.over = told.get("over", self.over)
                    if "id" in told:
                        self.answers[told["id"]] = told
                self._came.notify_all()
                self.is_there.set()

    def ask(self, do, **more):
        self._count += 1
        number = self._count
        self.socket.send(json.dumps({"id": number, "do": do, **more}))
        with self._came:
            assert self._came.wait_for(lambda: number in self.answers, PATIENCE_S)
        return self.answers[number]["ok"], self.answers[number]["text"]

    def close(self):
        self._open.close()
        ended(self._thread)


class Going:
    """A run in a thread of its own."""

    def __init__(self, out, *, is_paused=True, events=(), keep=()):
        self.control = RunControl(is_paused=is_paused)
        self.view, self.out, self.summary, self.error = LiveView(self.control), out, None, None
        self._hooks, self._events = [self.view, *keep], events
        self._thread = threading.Thread(target=self._drive, daemon=True)
        self._thread.start()

    def _drive(self):
        try:
            hooks = self._hooks
            self.summary = run_job(parse_scenario(TEXT), self.out, hooks=hooks, events=self._events).summary
        except BaseException as error:
            self.error = error
        finally:
            self.view.close()

    def end(self):
        ended(self._thread)
        assert self.error is None
        return self.summary


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "alone"
    return run_job(parse_scenario(TEXT), out).summary, out


class Scans(RunHook):
    """Keeps what the scanner really hit, by time. view: whose viewers have to keep up with the run."""

    def begin(self, run):
        self.truths, self.view = {}, None
        run.observers.append(self._see)
        run.world.graph.before_tick.append(lambda t: until(self._keep_up, "viewers take a frame"))

    def _keep_up(self):
        return self.view is None or all(viewer.is_free for viewer in self.view._viewers)

    def _see(self, slot, t, outputs):
        for signal in outputs.values():
            if isinstance(signal, ScanTruth):
                self.truths[signal.t] = signal.points.reshape(-1, 3)


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    """A run with two viewers, of which one goes away without a word."""
    kept = Scans()
    going = Going(tmp_path_factory.mktemp("runs") / "watched", keep=[kept])
    first, second = Watcher(going.view), Watcher(going.view)
    with urllib.request.urlopen(going.view.address, timeout=PATIENCE_S) as answer:
        page = answer.read()
    assert first.is_there.wait(PATIENCE_S)
    assert second.is_there.wait(PATIENCE_S)
    kept.view, before = going.view, len(second.frames)
    assert first.ask("pause", value=False)[0]
    until(lambda: len(second.frames) > before, "a frame of the run")
    second.socket.socket.shutdown(socket.SHUT_RDWR)  # as a browser that is killed
    summary = going.end()
    first.close()
    second.close()
    return summary, going, first, page, kept.truths


def test_a_run_with_viewers_is_the_run_without(alone, watched):
    summary, going, *_ = watched
    assert summary["digest"] == alone[0]["digest"]
    differing = {"wall_s", "real_time_factor", "cost"}
    mine, other = ({k: v for k, v in s.items() if k not in differing} for s in (summary, alone[0]))
    assert json.dumps(mine) == json.dumps(other)
    with_viewers, without = (read_tracks(out / "tracks.parquet") for out in (going.out, alone[1]))
    assert with_viewers.keys() == without.keys()
    for name, values in without.items():
        assert np.array_equal(values, with_viewers[name], equal_nan=values.dtype.kind == "f"), name


def test_frames_are_small_and_lie_where_the_run_was(watched):
    _, going, first, _, truths = watched
    assert len(first.frames) >= 5
    assert max(map(len, first.frames)) <= LARGEST
    assert "is over" in first.over
    tracks, columns = read_tracks(going.out / "tracks.parquet"), going.view._frames.columns["combine"]
    origin, compared, judged = going.view._frames.origin, 0, 0
    straw = []
    for frame in first.frames[2:]:
        head, rows, scans = decoded(frame)
        row = dict(zip(columns, rows[0], strict=True))
        x = np.interp(row["t_s"], tracks["t_s"], tracks["x_m"] - origin[0])
        y = np.interp(row["t_s"], tracks["t_s"], tracks["y_m"] - origin[1])
        assert np.hypot(row["x_m"] - x, row["y_m"] - y) < 0.002
        straw.append(row["straw_kg"])
        if np.isfinite(row["edge_true_m"]):
            same = np.flatnonzero(np.abs(tracks["edge_t_s"] - row["edge_t_s"]) < 1e-6)
            if len(same):
                assert abs(tracks["edge_true_m"][same[0]] - row["edge_true_m"]) < 1e-5
                error = row["edge_true_m"] - row["edge_offset_m"]  # on its left: > 0 towards the crop
                assert np.isclose(row["edge_error_m"], error, atol=1e-5, equal_nan=True)
                judged += 1
        for (_, t, *_), echoes in zip(head["scans"], scans, strict=True):
            truth = truths[round(t * 1e9)] - origin
            gaps = np.abs(truth[None] - echoes[:, None]).max(axis=2)
            assert np.nanmax(np.nanmin(gaps, axis=1)) < 0.004
            compared += len(echoes)
    assert compared > 100
    assert judged >= 3
    assert sorted(straw) == straw


def test_the_page_is_whole_and_asks_for_nothing(watched):
    page = watched[3].decode()
    assert "class Live" in page
    assert "<script src" not in page
    assert len(page) < 2_500_000


def test_changes_are_events_that_give_the_same_run_again(alone, tmp_path):
    going = Going(tmp_path / "changed")
    page = Watcher(going.view)
    assert page.ask("step")[1] == page.ask("pause", value=True)[1].replace("paused ", "")  # exactly one tick
    before = going.control.now()
    plan = list(going.view._run.world.graph.plan.walk(before, before + 10**9))
    assert page.ask("step")[0]
    assert going.control.now() == plan[0][0]
    assert page.ask("set", key="combine.speed.speed_kmh", value="5") == (True, "")
    assert page.ask("set", key="obstacles.stone", value="{kind: post, x_m: 14, y_m: 3}") == (True, "")
    assert page.ask("set", key="obstacles.man", value=WALKS) == (True, "")
    assert page.ask("set", key="obstacles.0", value=None) == (True, "")
    with pytest.raises(InputError) as line:
        parse_scenario(TEXT, sets=["combine.speed.speed_kmh=-3"])
    ok, text = page.ask("set", key="combine.speed.speed_kmh", value="-3")
    assert (ok, text) == (False, str(line.value))
    assert not page.ask("set", key="combine.edge.level", value="mine.py:Mine")[0]  # code that nobody named
    assert not page.ask("speed", value=-1)[0]
    page.socket.send("no request")
    for _ in range(3):
        page.ask("step")
    assert page.ask("set", key="combine.edge.level", value="otsu") == (True, "")
    assert [e["set"] for e in page.states[-1]["events"]][-1] == "combine.edge.level"
    assert {thing["name"] for thing in page.states[-1]["things"]} >= {"obstacles.stone", "obstacles.man"}
    until(lambda: "obstacles.man" in decoded(page.frames[-1])[0].get("ways", ()), "he is shown")
    assert going.control.set_speed(50.0)[0]  # by another than the page, as over ROS 2
    assert page.ask("pause", value=False)[0]
    told = [(s["paused"], s["speed"]) for s in page.states]
    assert [a for a, b in zip(told, [None, *told], strict=False) if a != b][-2:] == [
        (True, 50.0),
        (False, 50.0),
    ]
    page.close()  # a tab that is closed
    summary = going.end()
    assert len(summary["events"]) == 5
    assert summary["digest"] != alone[0]["digest"]
    again = run_job(parse_scenario(TEXT), tmp_path / "again", events=read_events(going.out)).summary
    assert again["digest"] == summary["digest"]
    assert again["events"] == summary["events"]


STRANGE = [
    "", "[]", "[1]", "null", "1", '"pause"', "{}", "nan", "[" * 9000, "{" * 9000, '{"do": []}', '{"do": {}}',
    '{"do": null}', '{"do": "speed", "value": 1e999}', b"\xff\xfe", b"\x00",
    '{"do": "speed", "value": []}', '{"do": "speed", "value": "fast"}', '{"do": "speed", "value": NaN}',
    '{"do": "speed", "value": 1' + "0" * 400 + "}", '{"do": "set"}', '{"do": "set", "key": "a"}',
    '{"do": "set", "key": {}, "value": 1}', '{"do": "set", "key": "combine.speed.speed_kmh", "value": {}}',
    '{"do": "set", "key": "combine.speed.speed_kmh", "value": 1e999}', '{"do": "set", "key": "", "value": 1}',
    '{"do": "set", "key": "..", "value": "\\ud800"}', '{"do": "set", "key": "\\u0000", "value": 1}',
    '{"do": "branch"}', '{"do": "branch", "at_s": 1e999, "key": "a", "value": 1}',
    '{"do": "branch", "at_s": -1e308, "key": "a", "value": 1}',
    '{"do": "branch", "at_s": NaN, "key": "combine.speed.speed_kmh", "value": 3}',
]  # fmt: skip


def test_no_message_closes_the_page_or_ends_the_run(tmp_path):
    going = Going(tmp_path / "run")
    page = Watcher(going.view)
    assert page.is_there.wait(PATIENCE_S)
    for message in STRANGE:
        page.socket.send(message)
    assert page.ask("step")[0]
    assert page.ask("set", key="combine.speed.speed_kmh", value=5)[0]
    assert page.ask("pause", value=False)[0]
    assert going.end() is not None
    page.close()


def test_no_one_else_comes_in(tmp_path):
    view = LiveView(RunControl())
    try:
        live = live_address(view)
        wrong = [(live.split("?")[0], {}), (live + "x", {}), (live, {"origin": "http://else.example"})]
        for address, more in wrong:
            with pytest.raises(InvalidStatus) as refused, connect(address, **more):
                pass
            assert refused.value.response.status_code == 403
        for address, headers in (
            (view.address.split("?")[0], {}),
            (view.address, {"Origin": "http://else.example"}),
            (view.address, {"Host": "else.example"}),
        ):
            with pytest.raises(urllib.error.HTTPError) as error:
                urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=PATIENCE_S)
            error.value.close()
            assert error.value.code == 403
        assert view._server._server.socket.getsockname()[0] == "127.0.0.1"
    finally:
        view.close()


def test_without_websockets_one_line_says_what_to_install(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "websockets.sync.server", None)
    assert main(["run", "straight", "--view", "--out", str(tmp_path / "run")]) == 2
    assert (
        capsys.readouterr().err == "swath: the live page needs an optional part: pip install 'swath[view]'\n"
    )
    importlib.invalidate_caches()


def test_a_browser_shows_it(tmp_path):
    going = Going(tmp_path / "shown", is_paused=True)
    try:
        with Browser() as browser:
            ready = "globalThis.swath && swath.live && swath.live.frames > 0"
            browser.open(going.view.address, ready=ready)
            before = browser.ask("swath.live.at")
            assert browser.ask("swath.live.ask('step')")["ok"]
            shown = "document.getElementById('verdict').textContent"
            assert browser.ask(shown) == "paused"
            levels = "swath.live.key.value = 'combine.edge.level', swath.live.fillValue(), "
            levels += "[...swath.live.change.elements.value.options].map((o) => o.value)"
            assert {"otsu", "truth"} <= set(browser.ask(levels))
            assert browser.ask("swath.live.ask('set', {key: 'combine.speed.speed_kmh', value: '6'})")["ok"]
            assert before < going.control.now() / 1e9 < 0.1
            assert browser.told == []
            outside = [r for r in browser.requests if r != going.view.address and not r.startswith("data:")]
            assert outside == []
            browser.ask("document.getElementById('play').click()")  # the one control of the run
            waited = f"new Promise((done) => {{ const look = () => ({shown}.includes('over') ? "
            waited += f"done({shown}) : setTimeout(look, 50)); look(); }})"
            assert browser.ask(waited) == "the run is over at 3 s"
    except NoBrowser as missing:
        pytest.skip(str(missing))
    finally:
        going.control.pause(False)
        summary = going.end()
    assert [e["set"] for e in summary["events"]] == ["combine.speed.speed_kmh"]


def test_idle_connections_take_no_more_than_their_places_and_end_nothing():
    """A flood of them is closed at once, whoever comes when it is over is served."""
    server = Server(lambda connection: None, extra=("view", ""), who="", page=lambda wait: b"page")
    threads = threading.active_count()
    idle = []
    try:
        idle += [socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) for _ in range(300)]
        for connection in idle[MOST:]:
            with contextlib.suppress(ConnectionResetError):
                assert connection.recv(1) == b""
        assert threading.active_count() <= threads + 2 * MOST
    finally:
        for connection in idle:
            connection.close()

    def served():
        with contextlib.suppress(OSError):
            return urllib.request.urlopen(server.address, timeout=PATIENCE_S).read()

    assert until(served, "somebody is served") == b"page"
    server.close()
    assert not server._thread.is_alive()


def test_where_no_file_is_left_the_next_connection_waits(monkeypatch):
    listener = bound("127.0.0.1", 0, socket.SOCK_STREAM, "")
    real, faults = socket.socket.accept, [errno.EMFILE, errno.ENFILE]

    def accept(self):
        if faults:
            raise OSError(faults.pop(), "too many open files")
        return real(self)

    monkeypatch.setattr(socket.socket, "accept", accept)
    with listener, socket.create_connection(listener.getsockname(), timeout=PATIENCE_S):
        taken, _ = listener.accept()
        taken.close()
    assert not faults
    with pytest.raises(OSError, match="closed"):
        listener.accept()
