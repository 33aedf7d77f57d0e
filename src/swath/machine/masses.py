"""What a multibody model needs beyond one rigid mass: masses of the parts, grain tank, tyres along and up.

These sections of a machine's data sheet (`bodies`, `tank`, `suspension` and some keys of `mass`, `tyres`,
`drive`) may be left out; the motion levels that need them then say so.
"""

from dataclasses import dataclass
from typing import Annotated

from swath.documents.sheet_fields import Quantity, Section


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
    header_x, header_z: centre of gravity of the header; feeder_x, feeder_z: pivot of the feeder
    pivot_z: pendulum pivot of the rear axle above ground; pendulum: its stop [rad]; kingpin: kingpin inside
    of the wheel's middle [m]
    front_deflection, rear_deflection: of the tyre under its load [m]; front_section, rear_section: height [m]
    tyre_damping: ratio of the vertical tyre spring
    load_sensitivity: cornering and slip stiffness over load go with load^-load_sensitivity
    stiffness_along, friction_along: as the lateral ones; thrust: largest of the drive [N]; brake [N]
    ride_hz, ride_damping: of the front suspension, where one is fitted
    """

    roll_inertia: Annotated[float, Quantity("kg_m2", 10, 1e7, key="mass.roll_inertia")]
    pitch_inertia: Annotated[float, Quantity("kg_m2", 10, 1e7, key="mass.pitch_inertia")]
    header: Annotated[float, Quantity("kg", 0, 2e4, key="bodies.header")]
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
