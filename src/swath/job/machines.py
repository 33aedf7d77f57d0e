"""What a job needs of its machines, in SI: widths, flows, speeds, loads; from data sheets and the job's
file.
"""

import math
from dataclasses import dataclass
from pathlib import Path

from swath.core.errors import InputError
from swath.core.units import KMH
from swath.job.fleet import CartSettings, CombineSettings, FleetFile
from swath.job.turns import TurnLimits, limits_of
from swath.machine.drivetrain_sheet import Drivetrain, drivetrain_of
from swath.machine.heap.surface import largest_heap, slope_of
from swath.machine.machine_sheet import MachineSheet, dynamics_of, load_machine

REPOSE = math.radians(25.0)  # wheat, published 22-27 deg
REVERSE = 1.0  # m/s, backwards in a corner; an estimate
SHIFT = 2.0  # s, from forwards to backwards or back; an estimate


@dataclass(frozen=True)
class Combine:
    """speed, turn_speed, transport [m/s]; flow: most grain that it threshes [kg/s]; tank [kg]; auger [kg/s];
    swing: time until the pipe is out [s]; pipe: how far left of the middle it ends [m]
    """

    name: str
    sheet: MachineSheet
    drivetrain: Drivetrain
    speed: float
    turn_speed: float
    transport: float
    limits: TurnLimits
    flow: float
    tank: float
    auger: float
    swing: float
    pipe: float
    call: float
    start: float

    def speed_in(self, grain: float) -> float:
        """Speed [m/s] in a crop with so much grain per metre of pass [kg/m]."""
        return self.speed if grain <= 0.0 else min(self.speed, self.flow / grain)

    def corner_path(self, angle: float) -> float:
        """Way [m] in a corner: reversing, an arc, reversing again until the knife is behind the crop."""
        half = math.tan(0.5 * min(angle, math.radians(150.0)))
        return 2.0 * self.limits.radius * half + self.sheet.knife_x + self.limits.radius * angle

    def corner_back(self, angle: float) -> float:
        """Way [m] that it reverses first in a corner."""
        return self.limits.radius * math.tan(0.5 * min(angle, math.radians(150.0)))

    def corner_time(self, angle: float) -> float:
        """Time [s] to get round a corner of an angle [rad] at the end of a headland pass."""
        half = math.tan(0.5 * min(angle, math.radians(150.0)))
        backwards = 2.0 * self.limits.radius * half + self.sheet.knife_x
        return backwards / REVERSE + self.limits.radius * angle / self.turn_speed + 2.0 * SHIFT


@dataclass(frozen=True)
class Cart:
    """speed [m/s]; load: at which it is full [kg]; leave: from which it drives to the truck [kg]; out: its
    auger [kg/s]; align: until it stands right beside a combine [s]
    """

    name: str
    sheet: MachineSheet
    speed: float
    load: float
    leave: float
    out: float
    align: float

    @property
    def length_behind(self) -> float:
        """From its axle to the end of the box [m]."""
        hitch, box = self.sheet.hitch, self.sheet.box
        assert box is not None
        end = 0.5 * box.length - box.x
        return end if hitch is None else hitch.drawbar - hitch.x + end


def combine_of(name: str, s: CombineSettings, base: Path | None) -> Combine:
    """A combine of a job. InputError for a machine without a header, a tank or a pipe."""
    sheet = load_machine(s.machine, base=base)
    if not sheet.has_header or sheet.pipe is None:
        raise InputError(f"combines.{name}.machine", s.machine, "expected a machine with a header and a pipe")
    drivetrain = drivetrain_of(sheet)
    if drivetrain.tank <= 0.0 or drivetrain.unloading <= 0.0:
        raise InputError(f"combines.{name}.machine", s.machine, "expected a grain tank and an auger")
    turning = s.turn_speed_kmh * KMH
    limits = limits_of(sheet.wheelbase, s.turn_radius_m, dynamics_of(sheet).steer_rate, turning)
    return Combine(
        name, sheet, drivetrain, s.speed_kmh * KMH, turning, s.transport_speed_kmh * KMH, limits,
        flow=s.grain_kg_s or drivetrain.transport.grain_feed,
        tank=drivetrain.tank, auger=drivetrain.unloading,
        swing=sheet.pipe.swing / sheet.pipe.rate, pipe=sheet.pipe.y + sheet.pipe.length,
        call=s.call_percent / 100.0 * drivetrain.tank, start=s.tank_start_percent / 100.0 * drivetrain.tank,
    )  # fmt: skip


def cart_of(name: str, s: CartSettings, base: Path | None, density: float) -> Cart:
    """A cart of a job. density: of the grain [kg/m3]. InputError for a machine without a box."""
    sheet = load_machine(s.machine, base=base)
    if sheet.box is None:
        raise InputError(f"carts.{name}.machine", s.machine, "expected a machine with a box")
    most = largest_heap(sheet.box, slope_of(REPOSE)) * density
    load = s.fill_percent / 100.0 * most
    leave = min(s.leave_percent / 100.0, 1.0) * load
    return Cart(name, sheet, s.speed_kmh * KMH, load, leave, s.unload_l_s / 1000.0 * density, s.align_s)


@dataclass(frozen=True)
class Fleet:
    """The machines of a job, in the order of its file."""

    combines: tuple[Combine, ...]
    carts: tuple[Cart, ...]
    truck: MachineSheet

    @property
    def density(self) -> float:
        """Of the grain in bulk [kg/m3]."""
        return self.combines[0].drivetrain.bulk.density


def fleet_of(file: FleetFile, base: Path | None = None) -> Fleet:
    """The machines of a job."""
    combines = tuple(combine_of(n, s, base) for n, s in file.combines.items())
    density = combines[0].drivetrain.bulk.density
    widths = {c.sheet.header_width for c in combines}
    if len(widths) > 1:
        raise InputError("combines", sorted(widths), "expected headers of one width")
    carts = tuple(cart_of(n, s, base, density) for n, s in file.carts.items())
    truck = load_machine(file.truck.machine, base=base)
    if truck.box is None:
        raise InputError("truck.machine", file.truck.machine, "expected a machine with a box")
    return Fleet(combines, carts, truck)
