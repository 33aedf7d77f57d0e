"""What every LiDAR level shares: the keys of its scanner, its ports, its sweep, what it saves."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs
from swath.core.random import Stream
from swath.core.units import DEG
from swath.field.site_setup import SiteSetup
from swath.sensing.echo import Weather
from swath.sensing.scanner import Scanner, ScannerParams
from swath.signals import F64, MachineState


@dataclass(frozen=True)
class OutdoorParams(ScannerParams):
    """angle_noise_deg: one sigma of the beams' direction; none = the data sheet's

    drop_out_percent: beams lost
    weather: dust, chaff and rain in the air
    """

    angle_noise_deg: Annotated[float, Ge(0), Le(5)] | None = None
    drop_out_percent: Annotated[float, Ge(0), Le(100)] = 0.0
    weather: Weather = field(default_factory=Weather)


class ScanningLidar(KeepsState, ABC):
    """A scanner on a moving machine; a level says what its beams meet.

    scanner: its beams, noise and sheet; ray_count: rays since the start
    """

    kept: ClassVar[tuple[str, ...]] = ("_last", "ray_count")

    def __init__(self, params: ScannerParams, setup: SiteSetup, *, echo_count: int = 1) -> None:
        angle_noise, dropout = None, 0.0
        if isinstance(params, OutdoorParams):
            angle_noise = None if params.angle_noise_deg is None else params.angle_noise_deg * DEG
            dropout = 0.01 * params.drop_out_percent
        self.setup = setup
        self.scanner = Scanner(params, setup, echo_count=echo_count, angle_noise=angle_noise, dropout=dropout)
        self.sheet, self.mounting = self.scanner.sheet, self.scanner.mounting
        self.azimuth, self.elevation = self.scanner.azimuth, self.scanner.elevation
        self.inputs, self.outputs = self.scanner.inputs, self.scanner.outputs
        self.ray_count = 0
        self._last: MachineState | None = None

    def reset(self, stream: Stream) -> Outputs:
        """An empty scan; draws the constant range bias of this instance, uniform in the data sheet's band."""
        self._stream = stream
        self._last = None
        self.ray_count = 0
        return self.scanner.reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The sweep that ends at t + dt, every beam from where the sensor was at its own time."""
        states: tuple[MachineState, ...] = inputs["state"]
        known = states if self._last is None else (self._last, *states)
        if states:
            self._last = states[-1]
        end = t + dt
        return self.scan_from(end, *self.scanner.sweep(known, end))

    @abstractmethod
    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A scan from sensor origins (beam_count, 3) and rotations (beam_count, 3, 3) in the world."""

    @property
    def range_limits(self) -> tuple[float, float]:
        """Least and greatest range of the data sheet [m]."""
        return self.sheet.range_min, self.sheet.range_max

    @property
    def identity(self) -> str:
        """By the data sheet."""
        return self.sheet.device_ident

    @property
    def notes(self) -> list[str]:
        """What the user of a run should know of the scanner."""
        return self.scanner.notes
