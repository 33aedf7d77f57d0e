"""Level `analog` of the slot `steer`: a box steers by a voltage, of which a converter sends samples.

The voltage is the angle of the model with one wheel per axle. It has no status: in a fault band (the line is
cut or shorted, or the box does not steer), or without a sample for `timeout_ms`, the steering is released; it
is taken again at the next good sample. The newest one counts: the run has to be paced.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.link.device import analog
from swath.link.device.address import read_address
from swath.link.device.nmea import split_lines
from swath.link.device.output import PROTOCOLS
from swath.link.device.steered import Steered, check_steer
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


class AnalogSteering(Steered):
    """The machine's input for the voltage."""

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        check_steer(setup, "analog", "signal")
        protocols = {"analog": PROTOCOLS["analog"]}
        where = read_address(params.address, protocols, "address").known((), "address")
        super().__init__(setup, where, params.overlap_m, params.on_fault)
        self._p, self._count = params, 0

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
        return found + self._told()

    def reset(self, stream: Stream) -> Outputs:
        """Listen; nobody steers yet. SwathError where the port cannot be had."""
        self._count, self._rest, self._heard_at = 0, b"", 0
        return self._listen()

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take the newest sample. SwathError where it is a fault, or late, and that is to fail."""
        end = t + dt
        lines, self._rest = split_lines(self._rest + b"".join(data for _, data, _ in self._heard(end)))
        for line in lines:
            try:
                self._hear(analog.read(line), end)
            except ValueError:
                self._wrong += 1
        silent = end - self._heard_at
        if silent > round(self._p.timeout_ms * 1e6):
            self._release(f"no sample for {silent / NS:.2f} s", end)
        return {"command": self._command}

    def _hear(self, volts: float, end: int) -> None:
        self._count += 1
        self._heard_at = end
        angle = self._p.angle(volts, self._machine.max_steer)
        if math.isnan(angle):
            band = f"{self._p.fault_below_v:g} to {self._p.fault_above_v:g} V"
            self._release(f"{volts:.2f} V, expected {band}", end)
            return
        if not self._command.is_engaged:
            self._events(f"{volts:.2f} V: the box steers")
        self._command = SteerCommand(end, math.tan(angle) / self._machine.wheelbase, True)


LEVEL = Level(
    AnalogSteering,
    Params,
    summary="slot steer: a box steers by a voltage, 0.4 to 4.6 V, by samples of a converter",
    cost="about 0.05 ms per step",
    tolerance="half a step of the converter, of 12 bit 0.02 deg; depends on the clock on the wall",
    is_link=True,
)
