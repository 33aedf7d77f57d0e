"""Run control: pause, step, restart, speed and changes of a run, asked for by other threads.

    control = RunControl()
    run_job(scenario, out, hooks=[control])
    control.pause(True)               # call it from another thread, as all methods but `join`

The ROS 2 services and the live page use the same one. Requests are served between two ticks by the thread of
the run. Only changes alter results, and `events` lists them. Going back ends the run, and another one goes on
from an earlier moment of it.
"""

import queue
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any

from swath.core.errors import InputError, SwathError
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.runtime.branch import ask_branch
from swath.runtime.changes import Interventions, Restart
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.saves import Saves

Action = Callable[[int], str]  # called with the simulated time [ns], returns a message for the reply
Reply = tuple[bool, str]
OVER: Reply = (False, "the run is over")


class RequestQueue:
    """Requests in order of arrival. `ask` is for other threads; `serve` and `close` for the run's thread."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[tuple[Action, Future[Reply]]] = queue.SimpleQueue()
        self._closed = threading.Event()

    def ask(self, action: Action) -> Reply:
        """Have an action done between two ticks; blocks. Returns (success, message)."""
        reply: Future[Reply] = Future()
        self._waiting.put((action, reply))
        while not self._closed.is_set():
            try:
                return reply.result(0.1)
            except TimeoutError:
                continue
        return reply.result() if reply.done() else OVER

    def serve(self, t: int, *, wait_s: float = 0.0) -> None:
        """Serve all requests before the tick at t [ns]; wait up to `wait_s` for a first one.

        A SwathError of an action becomes its reply; any other exception ends the run.
        """
        while True:
            try:
                action, reply = self._waiting.get(block=wait_s > 0.0, timeout=wait_s or None)
            except queue.Empty:
                return
            wait_s = 0.0
            try:
                reply.set_result((True, action(t)))
            except SwathError as error:
                reply.set_result((False, str(error)))
            except BaseException as error:
                reply.set_result((True, str(error)))
                raise

    def close(self) -> None:
        """Refuse all waiting and later requests."""
        self._closed.set()
        while not self._waiting.empty():
            self._waiting.get()[1].set_result(OVER)


POLL_S = 0.1
SPEEDS = (0.05, 100.0)  # simulated seconds per second


class RunControl(RunHook):
    """Hook through which other threads control a run.

    is_paused: whether the run waits before its first tick
    speed: simulated seconds per second, 0 = as fast as it can
    saves: another hook of the run, without which it cannot go back
    listeners: called in the thread of the run when something was changed
    """

    def __init__(self, *, is_paused: bool = False, speed: float = 0.0, saves: Saves | None = None) -> None:
        self.is_paused, self.speed, self.saves = is_paused, speed, saves
        self.listeners: list[Callable[[], None]] = []
        self._until = 0
        self._requests = RequestQueue()
        self._is_waiting = threading.Event()  # the run is paused and has reached the time asked for
        self._run: ActiveRun | None = None
        self._origin: tuple[int, int] | None = None  # simulated and wall time [ns] that belong together

    # in the thread of the run

    def begin(self, run: ActiveRun) -> None:
        """Connect to a world at its start."""
        self.join(run)

    def join(self, run: ActiveRun) -> None:
        """As `begin`; again for the same run it does nothing."""
        if self._run is None or self._run.world is not run.world:
            self._run, self._origin = run, None
            self._until = run.start.at if run.start is not None else 0
            run.world.graph.before_tick.insert(0, self._before_tick)

    def close(self) -> None:
        """The run is over: refuse what is asked from now on."""
        self._requests.close()
        self._is_waiting.set()

    def _before_tick(self, t: int) -> None:
        self._requests.serve(t)
        if self.speed and not self.is_paused and t > self._until:
            self._keep_pace(t)
        while self.is_paused and t > self._until:  # asked for before, or while it kept pace
            self._hold(t)

    def _hold(self, t: int) -> None:
        """Wait before the tick at t [ns] while the run is paused."""
        began = time.monotonic_ns()
        if self._run is not None:
            self._run.recorder.write_waiting()
        while self.is_paused and t > self._until:
            self._is_waiting.set()
            self._requests.serve(t, wait_s=POLL_S)
        self._origin = None
        if self._run is not None:
            self._run.rest(time.monotonic_ns() - began)

    def _keep_pace(self, t: int) -> None:
        """Serve until the tick at t [ns] is due; a run that is late goes on from where it is."""
        while self.speed and not self.is_paused:
            now = time.monotonic_ns()
            if self._origin is None:
                self._origin = t, now
            left = self._origin[1] + (t - self._origin[0]) / self.speed - now
            if left <= 0.0:
                if left < -POLL_S * NS:
                    self._origin = None
                return
            self._requests.serve(t, wait_s=min(left / NS, POLL_S))

    # in other threads

    @property
    def changes(self) -> Interventions:
        """Changes of the present run."""
        assert self._run is not None  # requests are served once a run has begun
        return self._run.changes

    def ask(self, action: Callable[[int], str]) -> Reply:
        """Have an action done between two ticks; blocks. Returns (success, message)."""
        return self._requests.ask(action)

    def pause(self, wanted: bool) -> Reply:
        """Wait before the next tick, or go on."""

        def act(t: int) -> str:
            self.is_paused, self._until, self._origin = wanted, self.now(), None
            self._tell()
            return f"{'paused' if wanted else 'running'} at {num(self.now() / NS)} s"

        return self.ask(act)

    def step(self, length_s: float | None = None) -> Reply:
        """Go on by a time [s] of a paused run, None = to the end of the next tick, and come back then."""

        def act(t: int) -> str:
            if not self.is_paused:
                raise SwathError("expected a paused run: pause it first")
            wanted = t if length_s is None else self.now() + max(1, round(length_s * NS))
            self._until = max(wanted, self._until)  # a run that went back is still driving to its moment
            self._is_waiting.clear()
            return ""

        success, message = self.ask(act)
        if not success:
            return success, message
        self._is_waiting.wait()
        return True, f"at {num(self.now() / NS)} s"

    def restart(self) -> Reply:
        """Begin anew, into the same folder."""

        def act(t: int) -> str:
            raise Restart(f"reset at {num(self.now() / NS)} s")

        return self.ask(act)

    @property
    def back_refused(self) -> str:
        """Why the run cannot go back, empty where it can."""
        if self.saves is None:
            return "the run is not saved while it runs (--save-every-s)"
        return self.saves.refused

    def save(self) -> Reply:
        """Save the world as it is now; a branch can then start from there at once."""

        def act(t: int) -> str:
            if self.saves is None:
                raise SwathError(self.back_refused)
            return f"saved at {num(self.saves.save_now())} s"

        return self.ask(act)

    def branch(self, at_s: float | None, sets: Mapping[str, Any]) -> Reply:
        """End the run; another goes on from `at_s` [s] with something changed there, into its own folder.

        None: from the tick behind the newest save.
        """

        def act(t: int) -> str:
            if self.back_refused:
                raise SwathError(self.back_refused)
            assert self._run is not None
            assert self.saves is not None
            if at_s is None and not self.saves.times:
                raise SwathError("there is no save yet to branch off from")
            now, begin = self.now(), at_s
            if begin is None:  # the first tick behind that of the save
                behind = self.saves.times[-1] + 1
                now, begin = max(now, behind), behind / NS
            raise ask_branch(self.changes, self._run.out, now, begin, sets)

        return self.ask(act)

    def set_speed(self, value: float) -> Reply:
        """Simulated seconds per second, 0 = as fast as it can."""

        def act(t: int) -> str:
            if self._run is not None and self._run.world.scenario.is_paced:
                raise SwathError("the run is paced by --real-time, its speed stays")
            if value and not SPEEDS[0] <= value <= SPEEDS[1]:
                raise InputError("speed", value, f"expected 0, or {num(SPEEDS[0])} to {num(SPEEDS[1])}")
            self.speed, self._origin = value, None
            self._tell()
            return f"speed {num(value)}" if value else "as fast as it can"

        return self.ask(act)

    def set(self, key: str, value: Any) -> Reply:
        """Another parameter, level or obstacle, as `Interventions.set`; nothing where it is so already."""

        def act(t: int) -> str:
            current = self.changes.values()
            if key not in current or current[key] != value:
                self.changes.set(t, key, value)
                self._tell()
            return ""

        return self.ask(act)

    def _tell(self) -> None:
        for listener in self.listeners:
            listener()

    def now(self) -> int:
        """Time of the run, 0 before it began [ns]."""
        return self._run.world.graph.t if self._run is not None else 0
