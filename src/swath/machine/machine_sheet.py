"""Machine data sheets: `data/machines/*.yaml` as validated objects in SI.

What a multibody model needs beyond one rigid mass (`bodies`, `tank`, `suspension` and some keys of `mass`,
`tyres`, `drive`) may be left out; the motion levels that need it then say so.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from swath.core.errors import InputError, near_miss
from swath.documents.data_sheets import Sheet, read_sheet, sheet_folder, sheet_names
from swath.documents.sheet_fields import Quantity, Section
from swath.machine.drivetrain_sheet import Drivetrain, check_drivetrain
from swath.scenario.machine_types import MACHINE_TYPES
from swath.signals.settings import Works
from swath.signals.setup import Hitch, MachineGeometry, OpenBox, Pipe


@dataclass(frozen=True, kw_only=True)
class Tank:
    """Grain tank, a box: middle x ahead of the fixed axle, floor above ground, length, width [m].

    volume [m3]; density of the grain in bulk [kg/m3]
    """

    x: Annotated[float, Quantity("m", -20, 10)]
    floor: Annotated[float, Quantity("m", 0, 5)]
    length: Annotated[float, Quantity("m", 0.1, 10)]
    width: Annotated[float, Quantity("m", 0.1, 5)]
    volume: Annotated[float, Quantity("m3", 0.1, 100)]
    density: Annotated[float, Quantity("kg_m3", 50, 1500, key="grain_density")]

    def centre(self, grain: float) -> float:
        """Height of the centre of gravity of so much grain [kg] above ground [m]."""
        return self.floor + 0.5 * grain / (self.density * self.length * self.width)


@dataclass(frozen=True, kw_only=True)
class Masses:
    """Masses [kg], places [m, machine frame], inertias [kg m2] of the parts and what is left of the tyres.

    roll_inertia, pitch_inertia: of the whole machine about its centre of gravity, header on, tank empty
    header_x, header_z: centre of gravity of the header
    feeder_x, feeder_z: pivot of the feeder
    pivot_z: pendulum pivot of the rear axle above ground
    pendulum: its stop [rad]
    kingpin: kingpin inside of the wheel's middle [m]
    front_deflection, rear_deflection: of the tyre under its load [m]
    front_section, rear_section: height [m]
    tyre_damping: ratio of the vertical tyre spring
    load_sensitivity: cornering and slip stiffness over load go with load^-load_sensitivity
    stiffness_along, friction_along: as the lateral ones
    thrust: largest of the drive [N]; brake [N]
    ride_hz, ride_damping: of the front suspension, where one is fitted
    """

    roll_inertia: Annotated[float, Quantity("kg_m2", 10, 1e7, key="mass.roll_inertia")]
    pitch_inertia: Annotated[float, Quantity("kg_m2", 10, 1e7, key="mass.pitch_inertia")]
    header: Annotated[float, Quantity("kg", 1, 2e4, key="bodies.header")]
    header_x: Annotated[float, Quantity("m", -10, 15, key="bodies.header_x")]
    header_z: Annotated[float, Quantity("m", 0, 5, key="bodies.header_z")]
    feeder: Annotated[float, Quantity("kg", 1, 1e4, key="bodies.feeder")]
    feeder_x: Annotated[float, Quantity("m", -10, 10, key="bodies.feeder_x")]
    feeder_z: Annotated[float, Quantity("m", 0, 5, key="bodies.feeder_z")]
    front_wheel: Annotated[float, Quantity("kg", 1, 5e3, key="bodies.front_wheel")]
    rear_wheel: Annotated[float, Quantity("kg", 1, 5e3, key="bodies.rear_wheel")]
    rear_axle: Annotated[float, Quantity("kg", 1, 1e4, key="bodies.rear_axle")]
    pivot_z: Annotated[float, Quantity("m", 0, 3, key="bodies.pivot_height")]
    pendulum: Annotated[float, Quantity("deg", 0.5, 30, key="bodies.pendulum")]
    kingpin: Annotated[float, Quantity("m", 0, 1.5, key="bodies.kingpin_offset")]
    front_deflection: Annotated[float, Quantity("m", 0.005, 0.5, key="tyres.front_deflection")]
    rear_deflection: Annotated[float, Quantity("m", 0.005, 0.5, key="tyres.rear_deflection")]
    front_section: Annotated[float, Quantity("m", 0.05, 1, key="tyres.front_section_height")]
    rear_section: Annotated[float, Quantity("m", 0.05, 1, key="tyres.rear_section_height")]
    tyre_damping: Annotated[float, Quantity("", 0, 1, key="tyres.damping_ratio")]
    load_sensitivity: Annotated[float, Quantity("", 0, 1, key="tyres.load_sensitivity")]
    stiffness_along: Annotated[float, Quantity("", 0.5, 40, key="tyres.stiffness_along")]
    friction_along: Annotated[float, Quantity("", 0.05, 1.5, key="tyres.friction_along")]
    thrust: Annotated[float, Quantity("kn", 1, 1000, key="drive.thrust")]
    brake: Annotated[float, Quantity("kn", 1, 1000, key="drive.brake")]
    ride_hz: Annotated[float, Quantity("hz", 0.3, 10, key="suspension.ride")]
    ride_damping: Annotated[float, Quantity("", 0, 2, key="suspension.damping_ratio")]
    tank: Annotated[Tank, Section("tank.")]


@dataclass(frozen=True, kw_only=True)
class Axle:
    """An axle's tyres. radius: loaded; patch_length, patch_width: of one tyre; relaxation length; all [m]."""

    radius: Annotated[float, Quantity("m", 0.1, 3)]
    patch_length: Annotated[float, Quantity("m", 0.05, 3)]
    patch_width: Annotated[float, Quantity("m", 0.05, 3)]
    relaxation: Annotated[float, Quantity("m", 0.05, 5)]


@dataclass(frozen=True, kw_only=True)
class Dynamics:
    """How heavy and how quick the machine is. Header on, grain tank empty.

    mass [kg]; yaw_inertia [kg m2]; cg_height [m]
    cg_behind: centre of gravity from the fixed axle towards the steered one [m], which is behind in combines
    stiffness: cornering stiffness over load, mean of the axles [1/rad]; friction: lateral;
    rolling_resistance: over load; understeer: gradient [rad per m/s2], see `tyre.axle_stiffness`
    speed_lag [s], accel, decel [m/s2], max_speed [m/s] of the speed loop
    steer_rate [rad/s], steer_dead_time, steer_lag [s], steer_dead_band: share of the valve's opening
    """

    mass: Annotated[float, Quantity("kg", 100, 1e5, key="mass.total")]
    yaw_inertia: Annotated[float, Quantity("kg_m2", 10, 1e7, key="mass.yaw_inertia")]
    cg_behind: Annotated[float, Quantity("m", 0.01, 10, key="mass.cg_behind_axle")]
    cg_height: Annotated[float, Quantity("m", 0.1, 5, key="mass.cg_height")]
    front: Annotated[Axle, Section("tyres.front_")]
    rear: Annotated[Axle, Section("tyres.rear_")]
    stiffness: Annotated[float, Quantity("per_rad", 0.5, 20, key="tyres.stiffness")]
    friction: Annotated[float, Quantity("", 0.05, 1.5, key="tyres.friction")]
    rolling_resistance: Annotated[float, Quantity("", 0, 0.3, key="tyres.rolling_resistance")]
    speed_lag: Annotated[float, Quantity("s", 0.01, 20, key="drive.time_constant")]
    accel: Annotated[float, Quantity("m_s2", 0.01, 10, key="drive.accel")]
    decel: Annotated[float, Quantity("m_s2", 0.01, 10, key="drive.decel")]
    max_speed: Annotated[float, Quantity("kmh", 0.1, 80, key="drive.max_speed")]
    steer_rate: Annotated[float, Quantity("deg_s", 0.1, 200, key="steering.rate")]
    steer_dead_time: Annotated[float, Quantity("s", 0, 5, key="steering.dead_time")]
    steer_lag: Annotated[float, Quantity("s", 0.001, 5, key="steering.lag")]
    steer_dead_band: Annotated[float, Quantity("percent", 0, 50, key="steering.dead_band")]
    understeer: Annotated[float, Quantity("deg_per_g", -20, 20, key="tyres.understeer")] = 0.0


@dataclass(frozen=True, kw_only=True)
class Chassis:
    """Axles and the box of the body: rear, front end [m ahead of the fixed axle], bottom, top [m]."""

    wheelbase: Annotated[float, Quantity("m", 0.5, 20)]
    front_track: Annotated[float, Quantity("m", 0.5, 10)]
    rear_track: Annotated[float, Quantity("m", 0.5, 10)]
    max_steer: Annotated[float, Quantity("deg", 1, 75)]
    rear_x: Annotated[float, Quantity("m", -30, 0)]
    front_x: Annotated[float, Quantity("m", 0, 30)]
    half_width: Annotated[float, Quantity("m", 0.1, 5)]
    bottom: Annotated[float, Quantity("m", 0, 10)]
    top: Annotated[float, Quantity("m", 0, 10)]


@dataclass(frozen=True, kw_only=True)
class Header:
    """knife_x: ahead of the fixed axle; offset: leftward; body: above and behind the knife; all [m]."""

    width: Annotated[float, Quantity("m", 0.5, 30)]
    knife_x: Annotated[float, Quantity("m", 0.1, 15)]
    offset: Annotated[float, Quantity("m", -10, 10)]
    body_height: Annotated[float, Quantity("m", 0, 5)]
    body_depth: Annotated[float, Quantity("m", 0, 5)]


@dataclass(frozen=True, kw_only=True)
class Trailer:
    """What is hitched to a tractor. hitch_x: pin ahead of the fixed axle; drawbar: from the pin to the axle.

    length: from the pin to the rear end
    height: of the rim [m]; empty [kg]; volume [m3]

    radius: of its tyres, loaded
    relaxation: their length
    cg_ahead: centre of gravity, empty, ahead of its axle [m]
    stiffness: cornering stiffness over load [1/rad]
    """

    hitch_x: Annotated[float, Quantity("m", -15, 5)]
    drawbar: Annotated[float, Quantity("m", 0.5, 20)]
    track: Annotated[float, Quantity("m", 0.5, 10)]
    width: Annotated[float, Quantity("m", 0.5, 10)]
    length: Annotated[float, Quantity("m", 0.5, 30)]
    height: Annotated[float, Quantity("m", 0.5, 6)]
    empty: Annotated[float, Quantity("kg", 100, 1e5)]
    volume: Annotated[float, Quantity("m3", 0.1, 200)]
    radius: Annotated[float, Quantity("m", 0.1, 3)] = 0.8
    relaxation: Annotated[float, Quantity("m", 0.05, 5)] = 0.65
    cg_ahead: Annotated[float, Quantity("m", -3, 5)] = 0.4
    stiffness: Annotated[float, Quantity("per_rad", 0.5, 20)] = 4.0


@dataclass(frozen=True, kw_only=True)
class Set:
    """Settings for wheat, as `signals.settings.Works`."""

    radius: Annotated[float, Quantity("m", 0.05, 2, key="drum_radius")]
    drum: Annotated[float, Quantity("rpm", 50, 3000)]
    concave: Annotated[float, Quantity("mm", 1, 100)]
    fan: Annotated[float, Quantity("rpm", 50, 5000)]
    upper: Annotated[float, Quantity("mm", 1, 60, key="upper_sieve")]
    lower: Annotated[float, Quantity("mm", 1, 60, key="lower_sieve")]
    vane: Annotated[float, Quantity("deg", 1, 80)]


@dataclass(frozen=True, kw_only=True)
class Sections:
    """What stands in a machine's data sheet, section by section."""

    format: str
    name: str
    type: str
    steers: Literal["front", "rear"] = "rear"
    slots: dict[str, str] = field(default_factory=dict)
    note: str = ""
    chassis: Annotated[Chassis, Section("chassis.")]
    header: Annotated[Header | None, Section("header.", when="header")]
    dynamics: Annotated[Dynamics, Section("")]
    masses: Annotated[Masses | None, Section("", when="bodies")]
    drivetrain: Annotated[Drivetrain | None, Section("", when="engine")]
    trailer: Annotated[Trailer | None, Section("trailer.", when="trailer")]
    box: Annotated[OpenBox | None, Section("box.", when="box")]
    pipe: Annotated[Pipe | None, Section("pipe.", when="pipe")]
    works: Annotated[Set | None, Section("settings.", when="settings")]


@dataclass(frozen=True)
class MachineSheet(MachineGeometry):
    """A machine's geometry with its dynamics. It fits wherever the geometry is asked for.

    type: which slots it has by itself
    slots: name of a slot -> level, or `off`, instead of the type's own
    masses: of its parts, None for a sheet without the section `bodies`
    drivetrain: engine, threshing and cleaning, None for a sheet without the section `engine`
    trailer: what is hitched to it
    """

    name: str
    dynamics: Dynamics
    masses: Masses | None = None
    drivetrain: Drivetrain | None = None
    type: str = "combine"
    slots: Mapping[str, str] = field(default_factory=dict)
    trailer: Trailer | None = None


def load_machine(name: str, *, base: Path | None = None, header_width_m: float | None = None) -> MachineSheet:
    """A bundled machine by name (`lexion-700` also finds `lexion-700-class`), or the user's own YAML file.

    base: folder that a relative path starts from; header_width_m: another header on the same machine, the
    mass and inertia kept. Raises InputError with key and file.
    """
    is_own = Path(name).suffix in (".yaml", ".yml") and Path(name).parent != sheet_folder("machines")
    machine = read_machine(open_machine(name, base)) if is_own else _bundled(name)
    if header_width_m is None:
        return machine
    if not machine.has_header:
        raise InputError("header_width_m", header_width_m, f"expected none, {machine.name} has no header")
    if not 0.5 <= header_width_m <= 30.0:
        raise InputError("header_width_m", header_width_m, "expected 0.5 to 30")
    return replace(machine, header_width=float(header_width_m))


@cache
def _bundled(name: str) -> MachineSheet:
    return read_machine(open_machine(name))


def open_machine(name: str, base: Path | None = None) -> Sheet:
    """The data sheet of a machine by name, or the user's own file, not yet checked."""
    bundled = sheet_names("machines")
    return read_sheet("machines", f"{name}-class" if f"{name}-class" in bundled else name, base)


def read_machine(sheet: Sheet) -> MachineSheet:
    """The machine of a data sheet. Raises InputError with key and file."""
    s = sheet.read(Sections)
    chassis, header = s.chassis, s.header
    if s.dynamics.cg_behind >= chassis.wheelbase:
        raise sheet.error("mass.cg_behind_axle_m", "expected less than the wheelbase")
    if chassis.bottom >= chassis.top:
        raise sheet.error("chassis.top_m", f"expected more than bottom_m = {chassis.bottom:g}")
    if s.type not in MACHINE_TYPES:
        raise sheet.error(
            "type", f"expected one of {', '.join(MACHINE_TYPES)}{near_miss(s.type, MACHINE_TYPES)}"
        )
    for key, there, needed in (
        ("header", header, "header" in MACHINE_TYPES[s.type]),
        ("trailer", s.trailer, s.type == "tractor_with_trailer"),
    ):
        if (there is not None) != needed:
            raise sheet.error(key, f"expected {'a' if needed else 'no'} section `{key}` for type {s.type}")
    check_drivetrain(sheet)
    return MachineSheet(
        wheelbase=chassis.wheelbase,
        front_track=chassis.front_track,
        rear_track=chassis.rear_track,
        max_steer=chassis.max_steer,
        header_width=header.width if header else 0.0,
        knife_x=header.knife_x if header else chassis.front_x,
        header_y=header.offset if header else 0.0,
        header_height=header.body_height if header else 0.0,
        header_depth=header.body_depth if header else 0.0,
        body=(chassis.rear_x, chassis.front_x, chassis.half_width, chassis.bottom, chassis.top),
        steers_ahead=s.steers == "front",
        name=s.name,
        dynamics=s.dynamics,
        masses=s.masses,
        drivetrain=s.drivetrain,
        type=s.type,
        slots=s.slots,
        trailer=s.trailer,
        hitch=None if s.trailer is None else Hitch(s.trailer.hitch_x, s.trailer.drawbar),
        box=s.box,
        pipe=s.pipe,
        works=Works() if s.works is None else Works(**vars(s.works)),
    )


def dynamics_of(machine: MachineGeometry) -> Dynamics:
    """The dynamics that come with a data sheet. InputError for a bare geometry."""
    if not isinstance(machine, MachineSheet):
        expected = "expected a machine data sheet with masses and tyres"
        raise InputError("machine", type(machine).__name__, expected)
    return machine.dynamics


def masses_of(machine: MachineGeometry) -> Masses:
    """The parts of a machine. InputError for a data sheet without them."""
    if not isinstance(machine, MachineSheet) or machine.masses is None:
        name = getattr(machine, "name", type(machine).__name__)
        raise InputError("machine", name, "expected a machine data sheet with `bodies`")
    return machine.masses


def with_grain(machine: MachineSheet, grain: float) -> MachineSheet:
    """The machine with grain [kg] in its tank as one rigid mass: mass, centre of gravity, yaw inertia."""
    return replace(machine, dynamics=loaded(machine.dynamics, masses_of(machine).tank, grain))


def loaded(d: Dynamics, tank: Tank, grain: float) -> Dynamics:
    """Dynamics with grain [kg] in the tank."""
    mass = d.mass + grain
    behind = (d.mass * d.cg_behind - grain * tank.x) / mass
    height = (d.mass * d.cg_height + grain * tank.centre(grain)) / mass
    own = grain * (tank.length**2 + tank.width**2) / 12.0
    apart = d.mass * grain / mass * (d.cg_behind + tank.x) ** 2
    return replace(d, mass=mass, cg_behind=behind, cg_height=height, yaw_inertia=d.yaw_inertia + own + apart)
