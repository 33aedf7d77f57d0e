"""The run hook of `swath run --view`: sends frames to the pages that are open, and does what they ask.

A page sends JSON: {"id": 1, "do": "pause", "value": true}; do: pause, step, speed, set (with "key" and
"value"; null takes an obstacle away), branch (as set, with "at_s"), and the word `seen` after each frame. The
answer has the same id, "ok" and "text"; what has changed goes to all pages.
"""

import json
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from swath.core.errors import shortened
from swath.core.schedule import NS
from swath.judge.evaluation import incident
from swath.replay.charts import events_of
from swath.replay.collect import origin_of
from swath.replay.live.data import live_data, starting_rows
from swath.replay.live.frames import Frames
from swath.replay.live.server import Server, Viewer
from swath.replay.pack import packed
from swath.replay.things import things_of
from swath.replay.writer import render
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.request_queue import Reply
from swath.runtime.run_control import RunControl

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
        self._due, self._shown, self._told = 0, -1, 0  # what was told of: events and changes
        self.frame_count, self.frame_s, self.largest = 0, 0.0, 0
        self._server = Server(self._html, self._talk)
        self.address = self._server.address

    # in the thread of the run

    def begin(self, run: ActiveRun) -> None:
        """Connect to a world at its start."""
        before, self._run, self._frames, self._shown = self._frames, run, None, -1
        self._control.join(run)
        if run.start is not None and before is not None:  # the same field and way ahead: the page stays
            self._frames = Frames(run.world, run.recorder.tracks, before.origin, run.evaluation)
            for name, straw in before.straw.items():
                self._frames.straw[name] = [s for s in straw if s[0] <= run.world.graph.t / NS]
            self._tell({"again": True})
        else:
            self._is_ready.clear()
        run.world.graph.before_tick.insert(0, self._before_tick)

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Show the pages the end, and tell them how it ended."""
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
        self._frames = Frames(run.world, run.recorder.tracks, origin, run.evaluation)
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

    def _talk(self, viewer: Viewer) -> None:
        """Serve a page until it is closed."""
        from websockets.exceptions import ConnectionClosed

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
            for message in viewer.connection:
                if message == SEEN:
                    viewer.free()
                else:
                    viewer.put(json.dumps(self._answer(message)))
        except ConnectionClosed:
            return
        finally:
            with self._lock:
                self._viewers = tuple(v for v in self._viewers if v is not viewer)

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
