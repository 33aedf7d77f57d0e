"""The ROS 2 bridge of a run: recorded signals as topics, `/clock`, and services that control the run.

    run_job(scenario, out, hooks=[Bridge()])

Node `/swath`. Services: `~/pause` (std_srvs/SetBool), `~/step`, `~/reset`, `~/save`, `~/branch`
(std_srvs/Trigger) and the parameter services that every node has: levels and parameters of the slots are its
parameters, obstacles too. Requests are served between two ticks by the thread of the run. Without requests
the results are those of a run without the bridge.
"""

import threading
from typing import Any

from swath.core.errors import InputError
from swath.link.ros2.middleware import Clock, close_node, open_node
from swath.link.ros2.parameters import OWN, RunParameters
from swath.link.ros2.publisher import Publisher
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.run_control import RunControl


class Bridge(RunHook):
    """Run hook. is_paused: the run waits before its first tick; control: one that others use too.

    Raises MissingExtra without rclpy.
    """

    def __init__(
        self, *, is_paused: bool = False, name: str = "swath", control: RunControl | None = None
    ) -> None:
        self._node = open_node(name, "the ROS 2 bridge", allow_undeclared_parameters=True)
        self._control = control or RunControl(is_paused=is_paused)
        self._clock = Clock(self._node)
        self._publisher: Publisher | None = None
        for key, value in OWN.items():
            self._node.declare_parameter(key, value)
        self._parameters = RunParameters(self._node, self._control)
        self._offer()
        self._spinner = threading.Thread(target=self._spin, name="ros2", daemon=True)
        self._spinner.start()

    # in the thread of the run

    def begin(self, run: ActiveRun) -> None:
        """Connect to a world at its start."""
        world, recorder = run.world, run.recorder
        if recorder.file is None:
            raise InputError("run.record", "none", "expected messages: --ros2 publishes what is recorded")
        if self._publisher is not None:
            self._publisher.close()
        self._publisher = Publisher(self._node, recorder.file.store)
        recorder.file.taps.append(self._publisher)
        self._parameters.join(run.changes)
        self._control.join(run)
        world.graph.before_tick.append(self._before_tick)
        self._clock.publish(0)

    def summarize(self, t: int) -> dict[str, Any]:
        """The entry of the bridge in summary.json."""
        if self._publisher is None:
            return {"ros2": {"messages": 0}}
        left_out = {"left_out": self._publisher.left_out} if self._publisher.left_out else {}
        return {"ros2": {"messages": self._publisher.count, **left_out}}

    def close(self) -> None:
        """Shut the node down."""
        self._control.close()
        self._executor.shutdown(timeout_sec=2.0)
        self._spinner.join(2.0)
        close_node(self._node)

    def _before_tick(self, t: int) -> None:
        if t >= self._clock.due:
            self._clock.publish(t)

    # in the ROS 2 thread

    def _offer(self) -> None:
        import rclpy.executors
        from std_srvs.srv import SetBool, Trigger

        for kind, name, serve in (
            (SetBool, "~/pause", self._serve_pause),
            (Trigger, "~/step", self._serve_step),
            (Trigger, "~/reset", self._serve_reset),
            (Trigger, "~/save", self._serve_save),
            (Trigger, "~/branch", self._serve_branch),
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
        response.success, response.message = self._control.pause(bool(request.data))
        return response

    def _serve_step(self, request: Any, response: Any) -> Any:
        length = float(self._node.get_parameter("step_s").value)
        response.success, response.message = self._control.step(length)
        return response

    def _serve_reset(self, request: Any, response: Any) -> Any:
        response.success, response.message = self._control.restart()
        return response

    def _serve_save(self, request: Any, response: Any) -> Any:
        response.success, response.message = self._control.save()
        return response

    def _serve_branch(self, request: Any, response: Any) -> Any:
        """From `branch_at_s`, below 0 from the newest save, with `branch_set`."""
        at_s = float(self._node.get_parameter("branch_at_s").value)
        texts = [text for text in self._node.get_parameter("branch_set").value or () if text]
        wrong = next((text for text in texts if "=" not in text), None)
        if wrong is not None:
            response.success, response.message = False, f"branch_set: expected KEY=VALUE, not {wrong!r}"
            return response
        sets = {key.strip(): value for key, _, value in (text.partition("=") for text in texts)}
        response.success, response.message = self._control.branch(at_s if at_s >= 0.0 else None, sets)
        return response
