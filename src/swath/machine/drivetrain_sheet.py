"""Engine, drives, threshing and cleaning of a machine: sections of its data sheet, in SI.

The sections `engine`, `power`, `hydrostat`, `transport`, `threshing`, `cleaning` and `unloading` may be left
out of a sheet; the levels that need them then say so.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar

import numpy as np

from swath.core.errors import InputError
from swath.documents.data_sheets import Sheet
from swath.documents.sheet_fields import Quantity, Section
from swath.signals.setup import MachineGeometry

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Engine at full load: constant power from rated speed down to the speed of the largest torque.

    rated_power [W] at rated_speed [rad/s]; torque_rise: largest torque over rated, minus 1, at torque_speed
    idle_speed [rad/s] with idle_torque over rated; droop: speed without load over rated, minus 1
    inertia: of everything that turns with it [kg m2]; torque_lag [s]: turbocharger and injection
    fuel_per_work [kg/J]; fuel_idle: burnt by turning alone at rated speed [kg/s]
    """

    rated_power: Annotated[float, Quantity("kw", 1, 2000)]
    rated_speed: Annotated[float, Quantity("rpm", 500, 5000)]
    torque_rise: Annotated[float, Quantity("percent", 0, 100)]
    torque_speed: Annotated[float, Quantity("rpm", 400, 5000)]
    idle_speed: Annotated[float, Quantity("rpm", 300, 5000)]
    idle_torque: Annotated[float, Quantity("percent", 10, 150)]
    droop: Annotated[float, Quantity("percent", 0.5, 20)]
    inertia: Annotated[float, Quantity("kg_m2", 0.1, 500)]
    torque_lag: Annotated[float, Quantity("s", 0.02, 5)]
    fuel_per_work: Annotated[float, Quantity("g_kwh", 100, 400, key="fuel")]
    fuel_idle: Annotated[float, Quantity("g_s", 0, 20)]


@dataclass(frozen=True, kw_only=True)
class Consumers:
    """Power at rated speed. header_width: per metre [W/m]; the *_work are per mass [J/kg]; others [W].

    header_work, drum_work: of grain and straw
    separation_work, chopper_work: of straw
    speed_exponent: torque of the belts grows with engine speed to this power; 0 = the same at any speed, 1 =
        crop is accelerated to the speed of what it meets
    """

    header_width: Annotated[float, Quantity("kw_per_m", 0, 500, key="header")]
    header_work: Annotated[float, Quantity("kj_per_kg", 0, 500, key="header")]
    drum_work: Annotated[float, Quantity("kj_per_kg", 0, 500, key="drum")]
    separation_work: Annotated[float, Quantity("kj_per_kg", 0, 500, key="separation")]
    cleaning: Annotated[float, Quantity("kw", 0, 500)]
    chopper: Annotated[float, Quantity("kw", 0, 500)]
    chopper_work: Annotated[float, Quantity("kj_per_kg", 0, 500, key="chopper")]
    unloading: Annotated[float, Quantity("kw", 0, 500)]
    auxiliary: Annotated[float, Quantity("kw", 0, 500)]
    speed_exponent: Annotated[float, Quantity("", 0, 3)] = 0.0


@dataclass(frozen=True, kw_only=True)
class Hydrostat:
    """efficiency: wheel over engine; pull: largest force at the wheels [N]; power: largest at the wheels [W].

    relief_start, relief_end: engine speeds [rad/s] between which the drive gives way to an overloaded engine
    """

    efficiency: Annotated[float, Quantity("", 0.1, 1)]
    pull: Annotated[float, Quantity("kn", 1, 1000)]
    power: Annotated[float, Quantity("kw", 1, 1000)]
    relief_start: Annotated[float, Quantity("rpm", 300, 5000)]
    relief_end: Annotated[float, Quantity("rpm", 200, 5000)]


@dataclass(frozen=True, kw_only=True)
class Transport:
    """Delays [s] at the nominal flows [kg/s] of grain and straw (feed) and of grain (grain_feed).

    header: knife to feeder house
    header_spread: from the header's ends later than from its middle
    feeder: to the drum
    rotor: through the separation; shoe
    returns: to the drum; elevator, elevator_lag
    exponent: the header's and elevator's delay falls with flow^-exponent
    """

    feed: Annotated[float, Quantity("kg_s", 0.1, 200, key="nominal_feed")]
    grain_feed: Annotated[float, Quantity("kg_s", 0.1, 200, key="nominal_grain")]
    header: Annotated[float, Quantity("s", 0.05, 60)]
    header_spread: Annotated[float, Quantity("s", 0, 60)]
    feeder: Annotated[float, Quantity("s", 0.05, 60)]
    rotor: Annotated[float, Quantity("s", 0.05, 60)]
    shoe: Annotated[float, Quantity("s", 0.05, 60)]
    returns: Annotated[float, Quantity("s", 0.05, 60)]
    elevator: Annotated[float, Quantity("s", 0.05, 60)]
    elevator_lag: Annotated[float, Quantity("s", 0, 60)]
    exponent: Annotated[float, Quantity("", 0, 0.8, key="flow_exponent")]


@dataclass(frozen=True, kw_only=True)
class Threshing:
    """Rates per length of the drum and of the rotors, at the nominal straw flow [kg/s].

    *_threshing: of grain out of the ear (lambda); *_separation: of free grain through the concave (beta)
    *_exponent: both fall with layer^-exponent; chaff: share of the straw that falls through with the grain
    """

    straw: Annotated[float, Quantity("kg_s", 0.1, 100, key="nominal_straw")]
    drum_threshing: Annotated[float, Quantity("", 0.05, 50)]
    drum_separation: Annotated[float, Quantity("", 0.05, 50)]
    drum_exponent: Annotated[float, Quantity("", 0, 5)]
    rotor_threshing: Annotated[float, Quantity("", 0.05, 50)]
    rotor_separation: Annotated[float, Quantity("", 0.05, 50)]
    rotor_exponent: Annotated[float, Quantity("", 0, 5)]
    chaff: Annotated[float, Quantity("percent", 0, 80)]


@dataclass(frozen=True, kw_only=True)
class Cleaning:
    """Shoe at its nominal flow of grain and chaff [kg/s].

    loss: share lost up to `knee` times that flow, then doubling every `doubling` of it
    side_slope, up_slope: how much heavier a slope of 1 loads it
    returns: share sent back, grows with flow
    """

    flow: Annotated[float, Quantity("kg_s", 0.1, 200, key="nominal")]
    loss: Annotated[float, Quantity("percent", 0, 10)]
    knee: Annotated[float, Quantity("", 0.5, 5)]
    doubling: Annotated[float, Quantity("percent", 1, 200)]
    side_slope: Annotated[float, Quantity("", 0, 20)]
    up_slope: Annotated[float, Quantity("", 0, 20)]
    returns: Annotated[float, Quantity("percent", 0, 40)]


@dataclass(frozen=True, kw_only=True)
class Unloading:
    """flow: of grain out of the tank [m3/s]."""

    flow: Annotated[float, Quantity("l_s", 1, 1000)]


@dataclass(frozen=True, kw_only=True)
class Bulk:
    """The grain tank. volume [m3]; density: of the grain in bulk [kg/m3].

    when_full: grain runs over its rim and is lost, or the machine stops, which ends the run
    """

    volume: Annotated[float, Quantity("m3", 0.1, 100)] = 0.0
    density: Annotated[float, Quantity("kg_m3", 50, 1500, key="grain_density")] = 770.0
    when_full: Literal["spills", "stops"] = "spills"

    @property
    def capacity(self) -> float:
        """Grain that it holds [kg]; 0 where the sheet has none."""
        return self.volume * self.density

    def over_rim(self, content: Any, coming: Any) -> Any:
        """Of grain that comes [kg] what it does not hold, with so much in it already; numbers or arrays."""
        if self.capacity <= 0.0:
            return 0.0 * coming
        return np.minimum(np.maximum(content + coming - self.capacity, 0.0), coming)


def tank_of(machine: MachineGeometry) -> Bulk:
    """The grain tank of a machine; without volume where its sheet has none."""
    drivetrain = getattr(machine, "drivetrain", None)
    return drivetrain.bulk if isinstance(drivetrain, Drivetrain) else Bulk()


@dataclass(frozen=True, kw_only=True)
class Drivetrain:
    """Engine, what it drives and how crop goes through the machine. None: it does not thresh, or clean."""

    engine: Annotated[Engine, Section("engine.")]
    consumers: Annotated[Consumers, Section("power.")]
    hydrostat: Annotated[Hydrostat, Section("hydrostat.")]
    transport: Annotated[Transport, Section("transport.")]
    threshing: Annotated[Threshing | None, Section("threshing.", when="threshing")]
    cleaning: Annotated[Cleaning | None, Section("cleaning.", when="cleaning")]
    bulk: Annotated[Bulk, Section("tank.")]
    unload: Annotated[Unloading, Section("unloading.")]

    @property
    def tank(self) -> float:
        """Grain that the tank holds [kg]; 0 where the sheet has none."""
        return self.bulk.capacity

    @property
    def unloading(self) -> float:
        """Grain out of the tank [kg/s]."""
        return self.unload.flow * self.bulk.density


SPEEDS = {
    "engine.torque_speed_rpm": "engine.rated_speed_rpm",
    "engine.idle_speed_rpm": "engine.torque_speed_rpm",
    "hydrostat.relief_end_rpm": "hydrostat.relief_start_rpm",
}
"""Key -> the key whose speed it has to lie below."""


def drivetrain_of(machine: MachineGeometry) -> Drivetrain:
    """The drivetrain of a machine. InputError for a data sheet without it."""
    drivetrain = getattr(machine, "drivetrain", None)
    if not isinstance(drivetrain, Drivetrain):
        raise InputError("machine", _name(machine), "expected a machine data sheet with `engine`")
    return drivetrain


def threshing_of(machine: MachineGeometry) -> Threshing:
    """How a machine threshes. InputError where its data sheet does not say."""
    return _needed(machine, drivetrain_of(machine).threshing, "threshing")


def cleaning_of(machine: MachineGeometry) -> Cleaning:
    """How a machine cleans grain. InputError where its data sheet does not say."""
    return _needed(machine, drivetrain_of(machine).cleaning, "cleaning")


def _needed(machine: MachineGeometry, part: T | None, section: str) -> T:
    if part is None:
        raise InputError("machine", _name(machine), f"expected a machine data sheet with `{section}`")
    return part


def _name(machine: MachineGeometry) -> str:
    return str(getattr(machine, "name", type(machine).__name__))


def check_drivetrain(sheet: Sheet) -> None:
    """Raise InputError for speeds that contradict each other."""
    for key, above in SPEEDS.items():
        speed, limit = sheet.value(key), sheet.value(above)
        if speed is not None and limit is not None and speed > limit - 1:
            raise sheet.error(key, f"expected less than {above} = {limit:g}")
