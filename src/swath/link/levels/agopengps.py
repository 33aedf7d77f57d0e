"""Level `agopengps` of the slot `steer`: AgOpenGPS, or a box that speaks like it, steers over UDP.

PGN 254 says whether to steer and at what angle; PGN 253 answers each with the angle of the wheels. The angle
is the one of the model with one wheel per axle. Without a PGN 254 for `timeout_ms` the steering is released,
as the module of AgOpenGPS does. The newest message counts: the run has to be paced.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs
from swath.core.errors import InputError
from swath.core.foreign_code import NotNamed
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.link.device import pgn
from swath.link.device.address import read_address
from swath.link.device.steered import Steered, check_steer
from swath.link.device.wires import UdpSender
from swath.signals import Odometry, SteerCommand
from swath.signals.setup import LinkSetup


@dataclass(frozen=True)
class Params:
    """listen: host:port where PGN 254 is heard; this machine alone, unless another address is named.

    reply: host:port that gets PGN 253
    timeout_ms: longest time without PGN 254
    on_timeout: `disengage` releases the steering then, `fail` ends the run with an error
    overlap_m: how far the box keeps the header end outside the crop, for the metrics
    """

    listen: str = "127.0.0.1:8888"
    reply: str = "127.0.0.1:9999"
    timeout_ms: Annotated[float, Gt(0), Le(60_000)] = pgn.WATCHDOG_MS
    on_timeout: Literal["disengage", "fail"] = "disengage"
    overlap_m: Annotated[float, Ge(-1), Le(3)] = 0.10


class AgOpenGpsSteering(Steered):
    """The machine as a steering module."""

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        check_steer(setup, "agopengps", "messages")
        where = _at("listen", params.listen, pgn.LISTENS)
        super().__init__(setup, where, params.overlap_m, params.on_timeout)
        self._p = params
        self._reply = _at("reply", params.reply, pgn.ANSWERS_TO)
        self.inputs = tuple(p for p in setup.inputs if p.name == "odometry" and p.signal is Odometry)
        self._answers: UdpSender | None = None
        self._arrived: list[int] = []
        self._peer: Any = None
        self._others = 0

    @property
    def needs_real_time(self) -> str:
        """Why the run has to be paced."""
        return "AgOpenGPS steers in real time"

    @property
    def notes(self) -> list[str]:
        """How many messages came and how evenly, then what happened."""
        found = [f"steer: {len(self._arrived)} messages PGN 254 from {_shown(self._peer)}"]
        if len(self._arrived) > 2:
            median, high = np.percentile(np.diff(self._arrived) * 1e-6, (50, 99))
            found[0] += f", an interval of {median:.1f} ms, p99 {high:.1f} ms"
        if self._wrong:
            found.append(f"steer: {self._wrong} datagrams were no message of AgOpenGPS")
        if self._others:
            found.append(f"steer: {self._others} datagrams of other senders were left out")
        return found + self._told()

    def reset(self, stream: Stream) -> Outputs:
        """Listen; nobody steers yet. SwathError where the port cannot be had."""
        begin = self._listen()
        self._answers = UdpSender(self._reply, self._events)
        self._arrived, self._others, self._peer = [], 0, None
        self._heard_at: int | None = None
        return begin

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take the newest message, answer it. SwathError where none came in time and that is to fail."""
        odometry, end = inputs.get("odometry"), t + dt
        angle = math.nan if odometry is None else odometry.steer_angle
        for arrived, data, sender in self._heard(end):
            self._hear(data, sender, arrived, end, angle)
        if self._heard_at is not None and self._command.is_engaged:
            silent = end - self._heard_at
            if silent > round(self._p.timeout_ms * 1e6):
                self._release(f"no PGN 254 for {silent / NS:.2f} s", end)
                self._peer = None  # another may take over
        return {"command": self._command}

    def close(self) -> None:
        """Leave the ports. Calling it again does nothing."""
        super().close()
        answers, self._answers = self._answers, None
        if answers is not None:
            answers.close()

    def _hear(self, data: bytes, sender: Any, arrived: int, end: int, angle: float) -> None:
        message = pgn.unframed(data)
        if message is None:
            self._wrong += 1
            return
        _, number, content = message
        if number == pgn.HELLO:
            self._say(pgn.hello(angle))
        command = pgn.read_steer_data(content) if number == pgn.STEER_DATA else None
        if command is None:
            return
        if self._peer is None:
            self._peer = sender
            self._events(f"{_shown(sender)} steers")
        if sender != self._peer:
            if not self._others:
                self._events(f"{_shown(sender)} wants to steer, too, and is left out")
            self._others += 1
            return
        self._arrived.append(arrived)
        self._heard_at = end
        is_on = command.is_on and command.speed >= pgn.SLOWEST
        curvature = math.tan(command.angle) / self._machine.wheelbase
        self._command = SteerCommand(end, curvature if is_on else self._command.curvature, is_on)
        self._say(pgn.steer_response(angle, is_free=True))

    def _say(self, data: bytes) -> None:
        assert self._answers is not None
        self._answers.send(data)


def _at(key: str, text: str, port: int) -> Any:
    try:
        return read_address(f"agopengps://{text}", {"agopengps": (("udp",), port)}, key, said=text).known(())
    except NotNamed:
        raise
    except InputError as error:
        raise InputError(key, text, "expected host:port, such as 127.0.0.1:8888") from error


def _shown(sender: Any) -> str:
    return "nobody" if sender is None else f"{sender[0]}:{sender[1]}"


LEVEL = Level(
    AgOpenGpsSteering,
    Params,
    summary="slot steer: AgOpenGPS steers over UDP, by its PGN 254",
    cost="about 0.05 ms per step",
    tolerance="0.005 deg of the angle; depends on the clock on the wall",
    is_link=True,
)
