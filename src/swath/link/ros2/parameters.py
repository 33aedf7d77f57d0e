"""The parameters of the node `/swath`: levels and parameters of every slot, and the obstacles.

ros2 param set /swath combine.speed.speed_kmh 5
ros2 param set /swath combine.edge.level otsu
ros2 param set /swath obstacles.pole "{kind: post, x_m: 12, y_m: 3}"
ros2 param delete /swath obstacles.pole
"""

import threading
from collections.abc import Mapping
from typing import Any

from swath.runtime.changes import Interventions
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
