"""Level `analog` of the slot `steer`: a box steers by a voltage, of which a converter sends samples.

The voltage is the angle of the model with one wheel per axle. It has no status: in a fault band (the line is
cut or shorted, or the box does not steer), or without a sample for `timeout_ms`, the steering is released; it
is taken again at the next good sample. The newest one counts: the run has to be paced.
"""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError, SwathError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.link.device import analog
from swath.link.device.address import read_address
from swath.link.device.nmea import split_lines
from swath.link.device.output import PROTOCOLS
from swath.link.device.wires import Events, Reader
from swath.scenario.slots import kind_of
from swath.signals import SteerCommand
from swath.signals.setup import LinkSetup


@dataclass(frozen=True)
class Params(analog.Line):
    """address: of the converter, or where it is heard, as in docs/how-to/devices.md.

    timeout_ms: longest time without a sample
    on_fault: `disengage` releases the steering in a fault band or after a timeout, `fail` ends the run
    overlap_m: how far the box keeps the header end outside the crop, for the metrics
    """

    address: str = f"analog+udp://127.0.0.1:{analog.PORT}"
    timeout_ms: Annotated[float, Gt(0), Le(60_000)] = 300.0
    on_fault: Literal["disengage", "fail"] = "disengage"
    overlap_m: Annotated[float, Ge(-1), Le(3)] = 0.10


class AnalogSteering(KeepsState):
    """The machine's input for the voltage."""

    kept: ClassVar[tuple[str, ...]] = ("_command", "_heard_at")

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        kind = kind_of(setup.slot)
        if kind is None or kind.name != "steer":
            raise InputError("level", "analog", "expected in a slot steer, it has no other signal")
        protocols = {"analog": PROTOCOLS["analog"]}
        self._where = read_address(params.address, protocols, "address").known((), "address")
        self._p, self._name, self._machine = params, setup.name, setup.control.machine
        self.overlap = params.overlap_m
        self.inputs: tuple[Port, ...] = ()
        self.outputs = (Port("command", SteerCommand),)
        self._reader: Reader | None = None
        self._events = Events()
        self._count = self._wrong = 0

    @property
    def needs_real_time(self) -> str:
        """Why the run has to be paced."""
        return "a box steers in real time"

    @property
    def notes(self) -> list[str]:
        """How many samples came, then what happened."""
        found = [f"steer: {self._count} samples from {self._where}"]
        if self._wrong:
            found.append(f"steer: {self._wrong} lines were no voltage")
        return found + [f"steer: at {t:.2f} s: {text}" for t, text in list(self._events.list)]

    def reset(self, stream: Stream) -> Outputs:
        """Listen; nobody steers yet. SwathError where the port cannot be had."""
        self.close()
        self._events = Events()
        self._reader = Reader(self._where, self._events)
        self._count = self._wrong = 0
        self._rest = b""
        self._heard_at = 0
        self._command = SteerCommand(0, 0.0, False)
        return {"command": self._command}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take the newest sample. SwathError where it is a fault, or late, and that is to fail."""
        if self._reader is None:
            raise SwathError(f"{self._name}: the line is closed")
        end = self._events.t = t + dt
        lines, self._rest = split_lines(self._rest + b"".join(data for _, data, _ in self._reader.take()))
        for line in lines:
            try:
                self._hear(analog.read(line), end)
            except ValueError:
                self._wrong += 1
        silent = end - self._heard_at
        if silent > round(self._p.timeout_ms * 1e6):
            self._released(f"no sample for {silent / NS:.2f} s", end)
        return {"command": self._command}

    def close(self) -> None:
        """Leave the line. Calling it again does nothing."""
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    def _hear(self, volts: float, end: int) -> None:
        self._count += 1
        self._heard_at = end
        angle = self._p.angle(volts, self._machine.max_steer)
        if math.isnan(angle):
            band = f"{self._p.fault_below_v:g} to {self._p.fault_above_v:g} V"
            self._released(f"{volts:.2f} V, expected {band}", end)
            return
        if not self._command.is_engaged:
            self._events(f"{volts:.2f} V: the box steers")
        self._command = SteerCommand(end, math.tan(angle) / self._machine.wheelbase, True)

    def _released(self, text: str, end: int) -> None:
        if not self._command.is_engaged:
            return
        if self._p.on_fault == "fail":
            raise SwathError(f"{self._name}: {text}, at {end / NS:g} s of simulated time")
        self._events(f"{text}; the steering was released")
        self._command = SteerCommand(end, self._command.curvature, False)


LEVEL = Level(
    AnalogSteering,
    Params,
    summary="slot steer: a box steers by a voltage, 0.4 to 4.6 V, by samples of a converter",
    cost="about 0.05 ms per step",
    tolerance="half a step of the converter, of 12 bit 0.02 deg; depends on the clock on the wall",
    is_link=True,
)
