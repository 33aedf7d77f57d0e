"""What turns and threshes in a machine: sections of a machine card as validated objects in SI.

The sections `engine`, `power`, `hydrostat`, `transport`, `threshing`, `cleaning` and `unloading` may be left
out of a card; the levels that need them then say so.
"""

from dataclasses import dataclass
from math import pi

from swath.core.errors import InputError
from swath.core.units import PERCENT
from swath.documents.data_sheets import Card
from swath.signals.setup import MachineGeometry

RPM = pi / 30.0
G_PER_KWH = 1e-3 / 3.6e6  # [kg/J]


@dataclass(frozen=True)
class Engine:
    """Engine at full load: constant power from rated speed down to the speed of the largest torque.

    rated_power [W] at rated_speed [rad/s]; torque_rise: largest torque over rated, minus 1, at torque_speed
    idle_speed [rad/s] with idle_torque over rated; droop: speed without load over rated, minus 1
    inertia: of everything that turns with it [kg m2]; torque_lag [s]: turbocharger and injection
    fuel_per_work [kg/J]; fuel_idle: burnt by turning alone at rated speed [kg/s]
    """

    rated_power: float
    rated_speed: float
    torque_rise: float
    torque_speed: float
    idle_speed: float
    idle_torque: float
    droop: float
    inertia: float
    torque_lag: float
    fuel_per_work: float
    fuel_idle: float


@dataclass(frozen=True)
class Consumers:
    """Power at rated speed. header_width: per metre [W/m]; the *_work are per mass [J/kg]; others [W].

    header_work, drum_work: of grain and straw; separation_work, chopper_work: of straw
    speed_exponent: torque of the belts grows with engine speed to this power; 0 = the same at any speed,
    1 = crop is accelerated to the speed of what it meets
    """

    header_width: float
    header_work: float
    drum_work: float
    separation_work: float
    cleaning: float
    chopper: float
    chopper_work: float
    unloading: float
    auxiliary: float
    speed_exponent: float = 0.0


@dataclass(frozen=True)
class Hydrostat:
    """efficiency: wheel over engine; pull: largest force at the wheels [N]; power: largest at the wheels [W].

    relief_start, relief_end: engine speeds [rad/s] between which the drive gives way to an overloaded engine
    """

    efficiency: float
    pull: float
    power: float
    relief_start: float
    relief_end: float


@dataclass(frozen=True)
class Transport:
    """Delays [s] at the nominal flows [kg/s] of grain and straw (feed) and of grain (grain_feed).

    header: knife to feeder house; header_spread: from the header's ends later than from its middle
    feeder: to the drum; rotor: through the separation; shoe; returns: to the drum; elevator, elevator_lag
    exponent: the header's and elevator's delay falls with flow^-exponent
    """

    feed: float
    grain_feed: float
    header: float
    header_spread: float
    feeder: float
    rotor: float
    shoe: float
    returns: float
    elevator: float
    elevator_lag: float
    exponent: float


@dataclass(frozen=True)
class Threshing:
    """Rates per length of the drum and of the rotors, at the nominal straw flow [kg/s].

    *_threshing: of grain out of the ear (lambda); *_separation: of free grain through the concave (beta)
    *_exponent: both fall with layer^-exponent; chaff: share of the straw that falls through with the grain
    """

    straw: float
    drum_threshing: float
    drum_separation: float
    drum_exponent: float
    rotor_threshing: float
    rotor_separation: float
    rotor_exponent: float
    chaff: float


@dataclass(frozen=True)
class Cleaning:
    """Shoe at its nominal flow of grain and chaff [kg/s].

    loss: share lost up to `knee` times that flow, then doubling every `doubling` of it
    side_slope, up_slope: how much heavier a slope of 1 loads it; returns: share sent back, grows with flow
    """

    flow: float
    loss: float
    knee: float
    doubling: float
    side_slope: float
    up_slope: float
    returns: float


@dataclass(frozen=True)
class Works:
    """All that turns and threshes. tank [kg]: 0 where the card has none; unloading [kg/s]."""

    engine: Engine
    consumers: Consumers
    hydrostat: Hydrostat
    transport: Transport
    threshing: Threshing
    cleaning: Cleaning
    tank: float
    unloading: float


def works_of(machine: MachineGeometry) -> Works:
    """The works of a machine. InputError for a card without them."""
    works = getattr(machine, "works", None)
    if not isinstance(works, Works):
        name = getattr(machine, "name", type(machine).__name__)
        raise InputError("machine", name, "expected a machine card with `engine` and `threshing`")
    return works


def read_works(card: Card) -> Works | None:
    """The works of a card that has them, None for one without. InputError names a missing key."""
    if not card.has("engine"):
        return None
    has_tank = card.has("tank.volume_m3")
    density = card.number("tank.grain_density_kg_m3", low=50, high=1500) if has_tank else 770.0
    volume = card.number("tank.volume_m3", low=0.1, high=100) if has_tank else 0.0
    return Works(
        engine=_engine(card),
        consumers=_consumers(card),
        hydrostat=_hydrostat(card),
        transport=_transport(card),
        threshing=_threshing(card),
        cleaning=_cleaning(card),
        tank=volume * density,
        unloading=card.number("unloading.flow_l_s", low=1, high=1000) * 1e-3 * density,
    )


def _engine(card: Card) -> Engine:
    rated = card.number("engine.rated_speed_rpm", low=500, high=5000)
    peak = card.number("engine.torque_speed_rpm", low=400, high=rated - 1)
    idle = card.number("engine.idle_speed_rpm", low=300, high=peak - 1)
    return Engine(
        rated_power=card.number("engine.rated_power_kw", low=1, high=2000) * 1e3,
        rated_speed=rated * RPM,
        torque_rise=card.number("engine.torque_rise_percent", low=0, high=100) * PERCENT,
        torque_speed=peak * RPM,
        idle_speed=idle * RPM,
        idle_torque=card.number("engine.idle_torque_percent", low=10, high=150) * PERCENT,
        droop=card.number("engine.droop_percent", low=0.5, high=20) * PERCENT,
        inertia=card.number("engine.inertia_kg_m2", low=0.1, high=500),
        torque_lag=card.number("engine.torque_lag_s", low=0.02, high=5),
        fuel_per_work=card.number("engine.fuel_g_kwh", low=100, high=400) * G_PER_KWH,
        fuel_idle=card.number("engine.fuel_idle_g_s", low=0, high=20) * 1e-3,
    )


def _consumers(card: Card) -> Consumers:
    def kilo(key: str) -> float:
        return card.number(f"power.{key}", low=0, high=500) * 1e3

    key = "power.speed_exponent"
    exponent = card.number(key, low=0, high=3) if card.has(key) else 0.0
    return Consumers(
        header_width=kilo("header_kw_per_m"),
        header_work=kilo("header_kj_per_kg"),
        drum_work=kilo("drum_kj_per_kg"),
        separation_work=kilo("separation_kj_per_kg"),
        cleaning=kilo("cleaning_kw"),
        chopper=kilo("chopper_kw"),
        chopper_work=kilo("chopper_kj_per_kg"),
        unloading=kilo("unloading_kw"),
        auxiliary=kilo("auxiliary_kw"),
        speed_exponent=exponent,
    )


def _hydrostat(card: Card) -> Hydrostat:
    start = card.number("hydrostat.relief_start_rpm", low=300, high=5000)
    return Hydrostat(
        efficiency=card.number("hydrostat.efficiency", low=0.1, high=1),
        pull=card.number("hydrostat.pull_kn", low=1, high=1000) * 1e3,
        power=card.number("hydrostat.power_kw", low=1, high=1000) * 1e3,
        relief_start=start * RPM,
        relief_end=card.number("hydrostat.relief_end_rpm", low=200, high=start - 1) * RPM,
    )


def _transport(card: Card) -> Transport:
    def seconds(key: str, low: float = 0.05) -> float:
        return card.number(f"transport.{key}", low=low, high=60)

    return Transport(
        feed=card.number("transport.nominal_feed_kg_s", low=0.1, high=200),
        grain_feed=card.number("transport.nominal_grain_kg_s", low=0.1, high=200),
        header=seconds("header_s"),
        header_spread=seconds("header_spread_s", 0.0),
        feeder=seconds("feeder_s"),
        rotor=seconds("rotor_s"),
        shoe=seconds("shoe_s"),
        returns=seconds("returns_s"),
        elevator=seconds("elevator_s"),
        elevator_lag=seconds("elevator_lag_s", 0.0),
        exponent=card.number("transport.flow_exponent", low=0, high=0.8),
    )


def _threshing(card: Card) -> Threshing:
    def rate(key: str) -> float:
        return card.number(f"threshing.{key}", low=0.05, high=50)

    return Threshing(
        straw=card.number("threshing.nominal_straw_kg_s", low=0.1, high=100),
        drum_threshing=rate("drum_threshing"),
        drum_separation=rate("drum_separation"),
        drum_exponent=card.number("threshing.drum_exponent", low=0, high=5),
        rotor_threshing=rate("rotor_threshing"),
        rotor_separation=rate("rotor_separation"),
        rotor_exponent=card.number("threshing.rotor_exponent", low=0, high=5),
        chaff=card.number("threshing.chaff_percent", low=0, high=80) * PERCENT,
    )


def _cleaning(card: Card) -> Cleaning:
    return Cleaning(
        flow=card.number("cleaning.nominal_kg_s", low=0.1, high=200),
        loss=card.number("cleaning.loss_percent", low=0, high=10) * PERCENT,
        knee=card.number("cleaning.knee", low=0.5, high=5),
        doubling=card.number("cleaning.doubling_percent", low=1, high=200) * PERCENT,
        side_slope=card.number("cleaning.side_slope", low=0, high=20),
        up_slope=card.number("cleaning.up_slope", low=0, high=20),
        returns=card.number("cleaning.returns_percent", low=0, high=40) * PERCENT,
    )
