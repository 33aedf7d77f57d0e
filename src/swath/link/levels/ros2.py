"""Any slot played by a ROS 2 node, in lock-step: every step waits for that node's answer.

Per step swath publishes the inputs of the slot on `/machine/slot/step` and waits for the answer with the
same stamp on `/machine/slot/answer`; docs/how-to/ros2.md has the messages. Simulated time stands still
meanwhile, so a node that computes the same from the same numbers gives the same bytes as the law in process.
"""

import dataclasses
import time
from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Gt, Le

from swath.core.component import Inputs, KeptElsewhere, Outputs, Port
from swath.core.errors import InputError, SwathError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.link.ros2.slotnode import NodeSilent, SlotNode
from swath.signals import ScanTruth
from swath.signals.setup import LinkSetup

RESEND_S = 0.25  # the question at t = 0 is asked anew so often until a node has found us


@dataclass(frozen=True)
class Params:
    """mode: wait for the answer of each step, or go on with the newest one there is (then the clock on the
    wall enters the results)
    timeout_s: by the clock on the wall, for one answer; start_timeout_s: for the node to appear and to answer
    the first time
    history: inputs of which the node gets every sample since its last step, not only the newest.
    """

    mode: Literal["lockstep", "free"] = "lockstep"
    timeout_s: Annotated[float, Gt(0), Le(3600)] = 5.0
    start_timeout_s: Annotated[float, Gt(0), Le(3600)] = 30.0
    history: tuple[str, ...] = ()


class Ros2Slot(KeptElsewhere):
    """A slot of a machine whose part is a node."""

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        names = [port.name for port in setup.inputs]
        for index, port in enumerate(params.history):
            if port not in names:
                raise InputError(f"history.{index}", port, f"expected one of {', '.join(names) or 'none'}")
        self._p, self._setup = params, setup
        self.whose = f"{setup.name}: a slot played by a node, which keeps its state,"
        self.inputs = tuple(
            dataclasses.replace(p, history=p.name in params.history)
            for p in setup.inputs
            if p.signal is not ScanTruth
        )
        self.outputs: tuple[Port, ...] = tuple(p for p in setup.outputs if p.signal is not ScanTruth)
        self._node: SlotNode | None = SlotNode(setup, self.inputs, self.outputs)
        self._newest: Outputs = {}
        self._steps = self._stale = 0

    @property
    def notes(self) -> list[str]:
        """How often a free node was late."""
        if self._p.mode == "lockstep" or not self._steps:
            return []
        return [
            f"{self._setup.slot}: a node in free mode, the result depends on the wall clock; "
            f"{self._stale} of {self._steps} steps ran without a new answer"
        ]

    def reset(self, stream: Stream) -> Outputs:
        """Wait for the node, describe the machine to it, and have its output at t = 0."""
        node = self._open()
        self._steps = self._stale = 0
        self._tell_others()
        deadline = time.monotonic() + self._p.start_timeout_s
        node.find(deadline)
        while True:
            node.ask(0, 0, {}, is_reset=True)
            now = time.monotonic()
            answer = node.answer(0, min(deadline, now + RESEND_S))
            if answer is not None:
                self._newest = answer
                return answer
            if now >= deadline:
                raise NodeSilent(node.why_silent(0, self._p.start_timeout_s))

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The node's answer to the inputs of this step."""
        node, self._steps = self._open(), self._steps + 1
        if self._p.mode == "lockstep":
            self._tell_others()
        node.ask(t + dt, dt, inputs)
        if self._p.mode == "lockstep":
            answer = node.answer(t + dt, time.monotonic() + self._p.timeout_s)
            if answer is None:
                raise NodeSilent(node.why_silent(t + dt, self._p.timeout_s))
            return answer
        newest = node.newest()
        self._stale += newest is None
        self._newest = newest if newest is not None else self._newest
        return self._newest

    def close(self) -> None:
        """Leave the graph of ROS 2."""
        if self._node is not None:
            self._node.close()
            self._node = None

    def _tell_others(self) -> None:
        """What the node may want to know is sent before it is asked."""
        for call in self._setup.before_asking:
            call()

    def _open(self) -> SlotNode:
        if self._node is None:
            raise SwathError(f"{self._setup.name}: the node is closed")
        return self._node


LEVEL = Level(
    Ros2Slot,
    Params,
    summary="played by a ROS 2 node, in lock-step",
    cost="0.2 to 1 ms per step, and the node's own time",
    tolerance="the same bytes as the same law in process",
    is_link=True,
)
