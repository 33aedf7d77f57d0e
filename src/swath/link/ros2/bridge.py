"""The ROS 2 bridge of a run: recorded signals as topics, `/clock`, and services that control the run.

    run_job(scenario, out, hooks=[Bridge()])

Node `/swath`. Services: `~/pause` (std_srvs/SetBool), `~/step`, `~/reset` (std_srvs/Trigger) and the
parameter services that every node has: levels and parameters of the slots are its parameters, obstacles too.
Requests are served between two ticks by the thread of the run. Without requests the results are those of a
run without the bridge.
"""

import threading
import time
from collections.abc import Callable
from typing import Any

from swath.core.errors import InputError, SwathError
from swath.core.schedule import NS
from swath.link.ros2.middleware import Clock, close_node, open_node
from swath.link.ros2.parameters import RunParameters
from swath.link.ros2.publisher import Publisher
from swath.link.ros2.request_queue import RequestQueue
from swath.runtime.changes import Restart
from swath.runtime.hooks import ActiveRun, RunHook

POLL_S = 0.1
STEP_S = 0.02


class Bridge(RunHook):
    """Run hook. is_paused: the run waits before its first tick.

    Raises MissingExtra without rclpy.
    """

    def __init__(self, *, is_paused: bool = False, name: str = "swath") -> None:
        self._node = open_node(name, "the ROS 2 bridge", allow_undeclared_parameters=True)
        self._requests = RequestQueue()
        self._is_paused, self._until = is_paused, 0
        self._is_waiting = threading.Event()  # the run is paused and has reached the time asked for
        self._graph: Any = None
        self._rest: Callable[[int], None] = lambda duration: None
        self._clock = Clock(self._node)
        self._publisher: Publisher | None = None
        self._node.declare_parameter("step_s", STEP_S)
        self._parameters = RunParameters(self._node, self._requests)
        self._offer()
        self._spinner = threading.Thread(target=self._spin, name="ros2", daemon=True)
        self._spinner.start()

    # in the thread of the run

    def begin(self, run: ActiveRun) -> None:
        """Connect to a world at its start."""
        world, recorder = run.world, run.recorder
        if recorder.file is None:
            raise InputError("run.record", "none", "expected messages: --ros2 publishes what is recorded")
        self._rest = run.rest
        if self._publisher is not None:
            self._publisher.close()
        self._publisher = Publisher(self._node, recorder.file.store)
        recorder.file.taps.append(self._publisher)
        self._parameters.join(run.changes)
        world.graph.before_tick.insert(0, self._before_tick)
        self._graph = world.graph
        self._until = 0
        self._clock.publish(0)

    def summarize(self, t: int) -> dict[str, Any]:
        """The entry of the bridge in summary.json."""
        if self._publisher is None:
            return {"ros2": {"messages": 0}}
        left_out = {"left_out": self._publisher.left_out} if self._publisher.left_out else {}
        return {"ros2": {"messages": self._publisher.count, **left_out}}

    def close(self) -> None:
        """Shut the node down."""
        self._requests.close()
        self._is_waiting.set()
        self._executor.shutdown(timeout_sec=2.0)
        self._spinner.join(2.0)
        close_node(self._node)

    def _before_tick(self, t: int) -> None:
        self._requests.serve(t)
        self._hold(t)
        if t >= self._clock.due:
            self._clock.publish(t)

    def _hold(self, t: int) -> None:
        """Wait before the tick at t [ns] while the run is paused."""
        if not self._is_paused:
            return
        began = time.monotonic_ns()
        while self._is_paused and t > self._until:
            self._is_waiting.set()
            self._requests.serve(t, wait_s=POLL_S)
        self._rest(time.monotonic_ns() - began)

    # in the ROS 2 thread

    def _offer(self) -> None:
        import rclpy.executors
        from std_srvs.srv import SetBool, Trigger

        for kind, name, serve in (
            (SetBool, "~/pause", self._serve_pause),
            (Trigger, "~/step", self._serve_step),
            (Trigger, "~/reset", self._serve_reset),
        ):
            self._node.create_service(kind, name, serve)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._node.context)
        self._executor.add_node(self._node)

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException, ShutdownException

        try:
            self._executor.spin()
        except (ExternalShutdownException, ShutdownException):
            return

    def _serve_pause(self, request: Any, response: Any) -> Any:
        def pause(t: int) -> str:
            self._is_paused, self._until = bool(request.data), self._graph.t
            return f"{'paused' if request.data else 'running'} at {self._graph.t / NS:g} s"

        response.success, response.message = self._requests.ask(pause)
        return response

    def _serve_step(self, request: Any, response: Any) -> Any:
        def step(t: int) -> str:
            if not self._is_paused:
                raise SwathError("expected a paused run: call ~/pause first")
            length = float(self._node.get_parameter("step_s").value)
            self._until = self._graph.t + max(1, round(length * NS))
            self._is_waiting.clear()
            return ""

        response.success, response.message = self._requests.ask(step)
        if response.success:
            self._is_waiting.wait()
            response.message = f"at {self._graph.t / NS:g} s"
        return response

    def _serve_reset(self, request: Any, response: Any) -> Any:
        def restart(t: int) -> str:
            raise Restart(f"reset at {self._graph.t / NS:g} s")

        response.success, response.message = self._requests.ask(restart)
        return response
