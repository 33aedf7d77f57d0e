"""Steering by a controller box on a CAN bus, with the guidance messages of ISO 11783-7.

Every cycle the machine sends its guidance status (PGN 44032), wheel-based and ground-based speed (65096,
65097) and, in two proprietary messages, the crop edge its detector found; the box answers with the guidance
system command (44288). All of it is in `data/can/guidance.dbc`.

With `lock_step`, simulated time waits for the answer of each cycle: the result does not depend on the clock.
Without, the newest command counts, the run has to be paced, and a command that stays out releases the
steering.
"""

import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError, SwathError
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.documents import j1939
from swath.link.can import guidance
from swath.link.can.box import ControllerBox, make_law
from swath.link.can.bus import CLAIM, Message, Node, Where, check_bus
from swath.link.device.steered import check_steer
from swath.signals import CropEdge, GroundSpeed, Odometry, SteerCommand
from swath.signals.setup import ControlSetup, LinkSetup

ASK_AGAIN = 0.5  # s
Address = Annotated[int, Ge(0), Le(253)]


class BoxError(SwathError):
    """A controller box that is not there, or does not answer."""


@dataclass(frozen=True)
class Params:
    """The bus, the nodes on it, and what happens without an answer.

    interface: of python-can, such as socketcan, udp_multicast or virtual
    channel: of that interface, such as can0, or a multicast group
    options: further keys of that interface, such as bitrate or port; of udp_multicast also `peers`: addresses
        of other machines on the bus, without which it stays on this one
    box: outside = another process or a real controller; inside = a stand-in within the run
    lock_step: simulated time waits for every answer of the box; without it the run has to be paced
    law: steering level, or file.py:Class, that a stand-in runs, inside or by `swath can box`
    law_keys: its keys
    overlap_m: how far the box keeps the header end outside the crop; given to the law and to the metrics
    cycle_ms: how often the machine sends; the standard says 100
    timeout_ms: without lock_step: so long without a command, and the steering is released
    on_timeout: disengage, as a machine does, or fail
    wait_s: how long to look for the box at the start
    answer_s: with lock_step, longest wait for an answer
    address: of the machine
    box_address: of the box to obey, null = the first that sends a command
    """

    interface: str = "udp_multicast"
    channel: str = "239.74.163.2"
    options: dict[str, str | int | float | bool] = field(default_factory=dict)
    box: Literal["outside", "inside"] = "outside"
    lock_step: bool = False
    law: str = "preview"
    law_keys: dict[str, float | str | bool] = field(default_factory=dict)
    overlap_m: Annotated[float, Ge(-1), Le(3)] = 0.10
    cycle_ms: Annotated[float, Ge(10), Le(1000)] = 100.0
    timeout_ms: Annotated[float, Gt(0), Le(60_000)] = 300.0
    on_timeout: Literal["disengage", "fail"] = "disengage"
    wait_s: Annotated[float, Gt(0), Le(3600)] = 30.0
    answer_s: Annotated[float, Gt(0), Le(3600)] = 5.0
    address: Address = j1939.TRACTOR_ECU
    box_address: Address | None = None

    @property
    def foreign_code(self) -> tuple[str, ...]:
        """The law, where it is a file."""
        return (self.law,) if ".py:" in self.law else ()

    @property
    def where(self) -> Where:
        """The bus."""
        return Where(self.interface, self.channel, self.options)

    @property
    def period(self) -> int:
        """Length of a cycle [ns]."""
        return round(self.cycle_ms * 1e6)

    def make_law(self, control: ControlSetup, base: Path | None) -> Any:
        """What a stand-in runs; InputError where it cannot be had."""
        more: dict[str, Any] = {"period": self.period, "base": base, "overlap": self.overlap_m}
        return make_law(self.law, self.law_keys, control, **more)


class CanSteering(KeepsState):
    """The machine's node on a bus, steered by a controller box; an external box keeps its own state."""

    kept = ("_guidance", "_cycle", "_distance", "_peer", "_box")

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        check_steer(setup, "can", "messages")
        check_bus(params.where)
        self.overlap = params.overlap_m
        self._p, self._name, self._control = params, setup.name, setup.control
        own = setup.control.period * NS
        self._cycle_ns = round(params.period / own) * own
        if abs(params.period - self._cycle_ns) > 1.0 or not self._cycle_ns:
            expected = f"expected a multiple of the slot's {setup.control.period * 1e3:g} ms"
            raise InputError("cycle_ms", params.cycle_ms, expected)
        inside = params.box == "inside"
        self._law = params.make_law(setup.control, setup.base) if inside else None
        wanted = {"edge": CropEdge, "odometry": Odometry, "ground": GroundSpeed}
        self.inputs = tuple(p for p in setup.inputs if wanted.get(p.name) is p.signal)
        self.outputs = (Port("command", SteerCommand),)
        self._node: Node | None = None
        self._box: ControllerBox | None = None
        self._box_node: Node | None = None
        self.notes: list[str] = []

    @property
    def needs_real_time(self) -> str:
        """Why the run has to be paced; empty where it need not be."""
        return "" if self._p.lock_step else "without lock_step the box runs in real time"

    def reset(self, stream: Stream) -> Outputs:
        """Switch the machine on: claim its address, look for the box. BoxError when there is none."""
        self.close()
        p, self.notes = self._p, []
        self._guidance = guidance.Guidance(round(p.timeout_ms * 1e6))
        self._cycle, self._distance = 0, 0.0
        self._peer = p.box_address
        where = p.where
        if self._law is not None and p.interface == "virtual":
            where = Where(p.interface, f"{p.channel} {id(self)}", p.options)
        self._node = Node(where, p.address, device_class=j1939.HARVESTER)
        if self._law is not None:
            self._box_node = Node(where, p.box_address or j1939.NAVIGATION, device_class=j1939.NO_CLASS)
            wheelbase = self._control.machine.wheelbase
            self._box = ControllerBox(self._law, self._box_node, period=p.period, wheelbase=wheelbase)
        self._node.claim()
        self._find_box()
        return {"command": self._guidance.command}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Send when a cycle is due, take the newest command, valid at t + dt. BoxError when none came."""
        end = t + dt
        odometry = inputs.get("odometry")
        if odometry is not None:
            self._distance += abs(odometry.speed) * dt / NS
        node = self._open()
        while (heard := node.receive()) is not None:
            if not self._p.lock_step:
                self._hear(heard, end)
        if end + 1 >= (self._cycle + 1) * self._cycle_ns:  # both are rounded to a nanosecond
            self._send_cycle(node, end, inputs)
            if self._p.lock_step:
                self._await_answer(node, end)
        if not self._p.lock_step and self._guidance.is_overdue(end):
            self._released(end)
        return {"command": self._guidance.command}

    def close(self) -> None:
        """Switch the machine off and leave the bus. Calling it again does nothing."""
        node, self._node = self._node, None
        if node is not None:
            off = guidance.speed_values("Wheel", 0.0, self._distance)
            with suppress(SwathError):  # the bus may be gone already
                node.send(guidance.WHEEL, {**off, "KeySwitch": 0})
            node.close()
        box, self._box_node = self._box_node, None
        if box is not None:
            box.close()

    def _open(self) -> Node:
        if self._node is None:
            raise SwathError(f"{self._name}: the bus is closed")
        return self._node

    def _find_box(self) -> None:
        if self._box is not None:
            return
        node, until = self._open(), time.monotonic() + self._p.wait_s
        while (left := until - time.monotonic()) > 0.0:
            node.request_claims()
            message = node.receive(min(left, ASK_AGAIN))
            if message is not None and self._is_box(message):
                return
        sender = "a box" if self._p.box_address is None else f"the box {self._p.box_address}"
        raise BoxError(f"{self._name}: {sender} was not found on {self._p.where} within {self._p.wait_s:g} s")

    def _is_box(self, message: Message) -> bool:
        """Whether a message comes from the box to obey."""
        return self._peer in (None, message.source) and message.name in (CLAIM, guidance.COMMAND)

    def _hear(self, message: Message, t: int) -> bool:
        """Take a command; True when it was one."""
        if message.name != guidance.COMMAND or not self._is_box(message):
            return False
        self._peer = message.source
        self._guidance.hear(message, t)
        return True

    def _send_cycle(self, node: Node, t: int, inputs: Inputs) -> None:
        wheelbase = self._control.machine.wheelbase
        odometry: Odometry | None = inputs.get("odometry")
        ground: GroundSpeed | None = inputs.get("ground")
        speed = None if odometry is None else odometry.speed
        line, quality = guidance.edge_values(inputs.get("edge"), t, self._cycle)
        over_ground = (speed, self._distance) if ground is None else (ground.speed, ground.distance)
        node.send(guidance.WHEEL, guidance.speed_values("Wheel", speed, self._distance))
        node.send(guidance.GROUND, guidance.speed_values("Ground", *over_ground))
        node.send(guidance.STATUS, guidance.status_values(self._guidance, odometry, wheelbase))
        node.send(guidance.EDGE_LINE, line)
        node.send(guidance.EDGE_QUALITY, quality)
        self._cycle += 1
        if self._box is not None:
            self._box.serve()

    def _await_answer(self, node: Node, t: int) -> None:
        until = time.monotonic() + self._p.answer_s
        while (left := until - time.monotonic()) > 0.0:
            message = node.receive(left)
            if message is not None and self._hear(message, t):
                return
        sender = "the box" if self._peer is None else f"the box {self._peer}"
        raise BoxError(
            f"{self._name}: {sender} on {self._p.where} did not answer within {self._p.answer_s:g} s, "
            f"at {t / NS:g} s of simulated time"
        )

    def _released(self, t: int) -> None:
        assert self._guidance.heard_at is not None
        text = (
            f"no guidance command of the box {self._peer} for {self._p.timeout_ms:g} ms, "
            f"the last one at {self._guidance.heard_at / NS:g} s"
        )
        if self._p.on_timeout == "fail":
            raise BoxError(f"{self._name}: {text}")
        self.notes.append(f"steer: {text}; the steering was released at {t / NS:g} s")
