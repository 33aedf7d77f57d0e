"""Machine cards: `data/machines/*.yaml` as validated objects in SI."""

from dataclasses import dataclass, replace
from pathlib import Path

from swath.core.errors import InputError
from swath.core.units import DEG, KMH, PERCENT
from swath.documents.data_sheets import Card, card_names, find_card
from swath.machine.drivetrain_sheet import Works, read_works
from swath.machine.masses import Masses, Tank, read_masses
from swath.signals.setup import MachineGeometry


@dataclass(frozen=True)
class Axle:
    """An axle's tyres. radius: loaded; patch_length, patch_width: of one tyre; relaxation length; all [m]."""

    radius: float
    patch_length: float
    patch_width: float
    relaxation: float


@dataclass(frozen=True)
class Dynamics:
    """How heavy and how quick the machine is. Header on, grain tank empty.

    mass [kg]; yaw_inertia [kg m2]; cg_height [m]
    cg_behind: centre of gravity from the fixed axle towards the steered one [m], which is behind in combines
    stiffness: cornering stiffness over load [1/rad]; friction: lateral; rolling_resistance: over load
    speed_lag [s], accel, decel [m/s2], max_speed [m/s] of the speed loop
    steer_rate [rad/s], steer_dead_time, steer_lag [s], steer_dead_band: share of the valve's opening
    """

    mass: float
    yaw_inertia: float
    cg_behind: float
    cg_height: float
    front: Axle
    rear: Axle
    stiffness: float
    friction: float
    rolling_resistance: float
    speed_lag: float
    accel: float
    decel: float
    max_speed: float
    steer_rate: float
    steer_dead_time: float
    steer_lag: float
    steer_dead_band: float


@dataclass(frozen=True)
class MachineCard(MachineGeometry):
    """A machine's geometry with its dynamics. It fits wherever the geometry is asked for.

    masses: of its parts, None for a card without the section `bodies`
    works: what turns and threshes, None for a card without the section `engine`
    """

    name: str
    dynamics: Dynamics
    masses: Masses | None = None
    works: Works | None = None


def load_machine(name: str, *, base: Path | None = None, header_width_m: float | None = None) -> MachineCard:
    """A bundled machine by name (`lexion-700` also finds `lexion-700-class`), or the user's own YAML file.

    base: folder that a relative path starts from; header_width_m: another header on the same machine, the
    mass and inertia kept. Raises InputError with key and file.
    """
    machine = read_machine(Card(find_machine(name, base)))
    if header_width_m is None:
        return machine
    if not 0.5 <= header_width_m <= 30.0:
        raise InputError("header_width_m", header_width_m, "expected 0.5 to 30")
    return replace(machine, header_width=float(header_width_m))


def find_machine(name: str, base: Path | None = None) -> Path:
    """Path of a bundled machine's card by name, or of the user's own file."""
    bundled = card_names("machines")
    return find_card("machines", f"{name}-class" if f"{name}-class" in bundled else name, base)


def read_machine(card: Card) -> MachineCard:
    """The machine of a card. Raises InputError with key and file."""
    geometry = _geometry(card)
    dynamics = _dynamics(card)
    if dynamics.cg_behind >= geometry["wheelbase"]:
        raise card.error("mass.cg_behind_axle_m", dynamics.cg_behind, "expected less than the wheelbase")
    made = MachineCard(
        **geometry,
        steers_ahead=_steers_ahead(card),
        body=_body(card),
        name=card.text("name"),
        dynamics=dynamics,
        masses=read_masses(card),
        works=read_works(card),
    )
    free = [] if made.masses else ["mass", "tyres", "suspension", "tank"]
    free += (
        []
        if made.works
        else ["tank", "power", "hydrostat", "transport", "threshing", "cleaning", "unloading"]
    )
    card.refuse_unknown("kind", "note", "cart", *free)
    return made


def dynamics_of(machine: MachineGeometry) -> Dynamics:
    """The dynamics that come with a card. InputError for a bare geometry."""
    if not isinstance(machine, MachineCard):
        raise InputError("machine", type(machine).__name__, "expected a machine card with masses and tyres")
    return machine.dynamics


def masses_of(machine: MachineGeometry) -> Masses:
    """The parts of a machine. InputError for a card without them."""
    if not isinstance(machine, MachineCard) or machine.masses is None:
        name = getattr(machine, "name", type(machine).__name__)
        raise InputError("machine", name, "expected a machine card with `bodies`")
    return machine.masses


def with_grain(machine: MachineCard, grain: float) -> MachineCard:
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


def _geometry(card: Card) -> dict[str, float]:
    return {
        "wheelbase": card.number("chassis.wheelbase_m", low=0.5, high=20),
        "front_track": card.number("chassis.front_track_m", low=0.5, high=10),
        "rear_track": card.number("chassis.rear_track_m", low=0.5, high=10),
        "max_steer": card.number("chassis.max_steer_deg", low=1, high=75) * DEG,
        "header_width": card.number("header.width_m", low=0.5, high=30),
        "knife_x": card.number("header.knife_x_m", low=0.1, high=15),
        "header_y": card.number("header.offset_m", low=-10, high=10),
        "header_height": card.number("header.body_height_m", low=0, high=5),
        "header_depth": card.number("header.body_depth_m", low=0, high=5),
    }


def _steers_ahead(card: Card) -> bool:
    if "steers" not in card.data:
        return False
    axle = card.text("steers")
    if axle not in ("front", "rear"):
        raise card.error("steers", axle, "expected front or rear")
    return axle == "front"


def _body(card: Card) -> tuple[float, float, float, float, float]:
    rear, front = card.number("chassis.rear_x_m", high=0), card.number("chassis.front_x_m", low=0)
    bottom, top = card.number("chassis.bottom_m", low=0), card.number("chassis.top_m", high=10)
    if bottom >= top:
        raise card.error("chassis.top_m", top, f"expected more than bottom_m = {bottom:g}")
    return rear, front, card.number("chassis.half_width_m", low=0.1, high=5), bottom, top


def _axle(card: Card, end: str) -> Axle:
    return Axle(
        radius=card.number(f"tyres.{end}_radius_m", low=0.1, high=3),
        patch_length=card.number(f"tyres.{end}_patch_length_m", low=0.05, high=3),
        patch_width=card.number(f"tyres.{end}_patch_width_m", low=0.05, high=3),
        relaxation=card.number(f"tyres.{end}_relaxation_m", low=0.05, high=5),
    )


def _dynamics(card: Card) -> Dynamics:
    return Dynamics(
        mass=card.number("mass.total_kg", low=100, high=1e5),
        yaw_inertia=card.number("mass.yaw_inertia_kg_m2", low=10, high=1e7),
        cg_behind=card.number("mass.cg_behind_axle_m", low=0.01, high=10),
        cg_height=card.number("mass.cg_height_m", low=0.1, high=5),
        front=_axle(card, "front"),
        rear=_axle(card, "rear"),
        stiffness=card.number("tyres.stiffness_per_rad", low=0.5, high=20),
        friction=card.number("tyres.friction", low=0.05, high=1.5),
        rolling_resistance=card.number("tyres.rolling_resistance", low=0, high=0.3),
        speed_lag=card.number("drive.time_constant_s", low=0.01, high=20),
        accel=card.number("drive.accel_m_s2", low=0.01, high=10),
        decel=card.number("drive.decel_m_s2", low=0.01, high=10),
        max_speed=card.number("drive.max_speed_kmh", low=0.1, high=80) * KMH,
        steer_rate=card.number("steering.rate_deg_s", low=0.1, high=200) * DEG,
        steer_dead_time=card.number("steering.dead_time_s", low=0, high=5),
        steer_lag=card.number("steering.lag_s", low=0.001, high=5),
        steer_dead_band=card.number("steering.dead_band_percent", low=0, high=50) * PERCENT,
    )
