"""What a multibody model needs beyond one rigid mass: masses of the parts, grain tank, tyres along and up.

These sections of a machine card (`bodies`, `tank`, `suspension` and some keys of `mass`, `tyres`, `drive`)
may be left out of a card; the motion levels that need them then say so.
"""

from dataclasses import dataclass

from swath.core.units import DEG
from swath.documents.data_sheets import Card


@dataclass(frozen=True)
class Tank:
    """Grain tank, a box: middle x ahead of the fixed axle, floor above ground, length, width [m].

    volume [m3]; density of the grain in bulk [kg/m3]
    """

    x: float
    floor: float
    length: float
    width: float
    volume: float
    density: float

    def centre(self, grain: float) -> float:
        """Height of the centre of gravity of so much grain [kg] above ground [m]."""
        return self.floor + 0.5 * grain / (self.density * self.length * self.width)


@dataclass(frozen=True)
class Masses:
    """Masses [kg], places [m, machine frame], inertias [kg m2] of the parts and what is left of the tyres.

    roll_inertia, pitch_inertia: of the whole machine about its centre of gravity, header on, tank empty
    header_x, header_z: centre of gravity of the header; feeder_x, feeder_z: pivot of the feeder
    pivot_z: pendulum pivot of the rear axle above ground; pendulum: its stop [rad]; kingpin: kingpin inside
    of the wheel's middle [m]
    front_deflection, rear_deflection: of the tyre under its load [m]; front_section, rear_section: height [m]
    tyre_damping: ratio of the vertical tyre spring
    load_sensitivity: cornering and slip stiffness over load go with load^-load_sensitivity
    stiffness_along, friction_along: as the lateral ones; thrust: largest of the drive [N]; brake [N]
    ride_hz, ride_damping: of the front suspension, where one is fitted
    """

    roll_inertia: float
    pitch_inertia: float
    header: float
    header_x: float
    header_z: float
    feeder: float
    feeder_x: float
    feeder_z: float
    front_wheel: float
    rear_wheel: float
    rear_axle: float
    pivot_z: float
    pendulum: float
    kingpin: float
    front_deflection: float
    rear_deflection: float
    front_section: float
    rear_section: float
    tyre_damping: float
    load_sensitivity: float
    stiffness_along: float
    friction_along: float
    thrust: float
    brake: float
    ride_hz: float
    ride_damping: float
    tank: Tank


def read_masses(card: Card) -> Masses | None:
    """The parts of a card that has them, None for one without. InputError names a missing key."""
    if not card.has("bodies"):
        return None
    number = card.number
    return Masses(
        roll_inertia=number("mass.roll_inertia_kg_m2", low=10, high=1e7),
        pitch_inertia=number("mass.pitch_inertia_kg_m2", low=10, high=1e7),
        header=number("bodies.header_kg", low=0, high=2e4),
        header_x=number("bodies.header_x_m", low=-10, high=15),
        header_z=number("bodies.header_z_m", low=0, high=5),
        feeder=number("bodies.feeder_kg", low=1, high=1e4),
        feeder_x=number("bodies.feeder_x_m", low=-10, high=10),
        feeder_z=number("bodies.feeder_z_m", low=0, high=5),
        front_wheel=number("bodies.front_wheel_kg", low=1, high=5e3),
        rear_wheel=number("bodies.rear_wheel_kg", low=1, high=5e3),
        rear_axle=number("bodies.rear_axle_kg", low=1, high=1e4),
        pivot_z=number("bodies.pivot_height_m", low=0, high=3),
        pendulum=number("bodies.pendulum_deg", low=0.5, high=30) * DEG,
        kingpin=number("bodies.kingpin_offset_m", low=0, high=1.5),
        front_deflection=number("tyres.front_deflection_m", low=0.005, high=0.5),
        rear_deflection=number("tyres.rear_deflection_m", low=0.005, high=0.5),
        front_section=number("tyres.front_section_height_m", low=0.05, high=1),
        rear_section=number("tyres.rear_section_height_m", low=0.05, high=1),
        tyre_damping=number("tyres.damping_ratio", low=0, high=1),
        load_sensitivity=number("tyres.load_sensitivity", low=0, high=1),
        stiffness_along=number("tyres.stiffness_along", low=0.5, high=40),
        friction_along=number("tyres.friction_along", low=0.05, high=1.5),
        thrust=number("drive.thrust_kn", low=1, high=1000) * 1e3,
        brake=number("drive.brake_kn", low=1, high=1000) * 1e3,
        ride_hz=number("suspension.ride_hz", low=0.3, high=10),
        ride_damping=number("suspension.damping_ratio", low=0, high=2),
        tank=_tank(card),
    )


def _tank(card: Card) -> Tank:
    return Tank(
        x=card.number("tank.x_m", low=-20, high=10),
        floor=card.number("tank.floor_m", low=0, high=5),
        length=card.number("tank.length_m", low=0.1, high=10),
        width=card.number("tank.width_m", low=0.1, high=5),
        volume=card.number("tank.volume_m3", low=0.1, high=100),
        density=card.number("tank.grain_density_kg_m3", low=50, high=1500),
    )
