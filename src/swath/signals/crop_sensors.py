"""Readings of the sensors in the crop's way through the machine."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import Quantity, Signal
from swath.signals.ranges import FLOW, SHARE


@frozen
class FeedReading(Signal):
    """Throughput as the layer sensor in the feeder house reads it."""

    flow: Annotated[float, Quantity("kg/s", "grain and straw", span=FLOW)]


@frozen
class YieldReading(Signal):
    """Grain at the top of the elevator."""

    flow: Annotated[float, Quantity("kg/s", "grain", span=FLOW)]
    moisture: Annotated[float, Quantity("", "water, share of the wet mass", span=SHARE)]
    tank_level: Annotated[float, Quantity("", "filled share of the tank, 0..1", span=SHARE)]


@frozen
class LossReading(Signal):
    """Grain over the rear as the impact sensors read it."""

    separation: Annotated[float, Quantity("kg/s", "over the rotors", span=FLOW)]
    cleaning: Annotated[float, Quantity("kg/s", "over the shoe", span=FLOW)]


@frozen
class ReturnsReading(Signal):
    """What comes back from the shoe as the sensor in the returns elevator reads it."""

    flow: Annotated[float, Quantity("kg/s", "grain and other material", span=FLOW)]


@frozen
class GrainImage(Signal):
    """Grain on its way to the tank as a camera judges it."""

    broken: Annotated[float, Quantity("", "broken, of the grain", span=SHARE)]
    foreign: Annotated[float, Quantity("", "other material over the grain", span=SHARE)]
