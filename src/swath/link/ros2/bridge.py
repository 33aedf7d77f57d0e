"""The ROS 2 bridge of a run: recorded signals as topics, `/clock`, and services that control the run.

    run_job(scenario, out, hooks=[Bridge()])

Node `/swath`. Services: `~/pause` (std_srvs/SetBool), `~/step`, `~/reset`, `~/save`, `~/branch`
(std_srvs/Trigger) and the parameter services that every node has: levels and parameters of the slots are its
parameters, obstacles too. Requests are served between two ticks by the thread of the run. Without requests
the results are those of a run without the bridge.

    ros2 param set /swath combine.speed.speed_kmh 5
    ros2 param set /swath combine.edge.level otsu
    ros2 param set /swath obstacles.pole "{kind: post, x_m: 12, y_m: 3}"
    ros2 param delete /swath obstacles.pole
"""

import threading
from collections.abc import Mapping
from typing import Any

from swath.core.errors import InputError
from swath.link.ros2.middleware import Clock, close_node, open_node
from swath.link.ros2.publisher import Publisher
from swath.runtime.changes import Interventions
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.run_control import RunControl

OWN = {"step_s": 0.02, "branch_at_s": -1.0, "branch_set": [""]}
"""Parameters of the node that are no keys of the run, and their values at first."""


class RunParameters:
    """Turns parameters set on the node into changes of the run. Runs in the ROS 2 thread, except `join`."""

    def __init__(self, node: Any, control: RunControl) -> None:
        self._node, self._control = node, control
        self._changes: Interventions | None = None
        self._declared: set[str] = set()
        self._own = threading.local()  # is_setting: this thread declares or sets for the run itself
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._after_set)

    def join(self, changes: Interventions) -> None:
        """Declare the parameters of a world at its start."""
        self._changes = changes
        self._declare()

    def _on_set(self, parameters: list[Any]) -> Any:
        from rcl_interfaces.msg import SetParametersResult

        ours = [p for p in parameters if p.name not in (*OWN, "use_sim_time")]
        if self._is_own() or not ours:
            return SetParametersResult(successful=True)
        if len(parameters) > 1:
            return SetParametersResult(successful=False, reason="expected one parameter at a time")
        name, value = ours[0].name, _plain(ours[0].value)

        successful, reason = self._control.set(name, value)
        return SetParametersResult(successful=successful, reason=reason)

    def _after_set(self, parameters: list[Any]) -> None:
        """A new level has other parameters: declare them."""
        if not self._is_own() and any(p.name.endswith(".level") for p in parameters):
            self._declare()

    def _declare(self) -> None:
        assert self._changes is not None
        self._own.is_setting = True
        try:
            self._set_all(self._changes.values())
        finally:
            self._own.is_setting = False

    def _is_own(self) -> bool:
        """True where this class sets parameters; what another thread asks for meanwhile is still checked."""
        return getattr(self._own, "is_setting", False)

    def _set_all(self, values: Mapping[str, Any]) -> None:
        from rcl_interfaces.msg import ParameterDescriptor
        from rclpy.parameter import Parameter

        for name in self._declared - set(values):
            if self._node.has_parameter(name):
                self._node.undeclare_parameter(name)
        self._declared = set(values)
        for name, value in values.items():
            if not self._node.has_parameter(name):
                self._node.declare_parameter(name, value, ParameterDescriptor(dynamic_typing=True))
            elif self._node.get_parameter(name).value != value:
                self._node.set_parameters([Parameter(name, value=value)])


def _plain(value: Any) -> Any:
    """A parameter's value as plain data."""
    return list(value) if isinstance(value, (list, tuple)) or hasattr(value, "tolist") else value


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
