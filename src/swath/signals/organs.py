"""What flows from organ to organ of a combine, and what an organ does with it."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import Quantity, Signal
from swath.signals.ranges import AMOUNT, MASS, POWER, RATIO, SHARE, STEP, TOTAL


@frozen
class CropStream(Signal):
    """Crop that went from one organ to the next within `dt`: over dt these are flows [kg/s]."""

    unthreshed: Annotated[float, Quantity("kg", "grain in the ear", is_amount=True, span=AMOUNT)] = 0.0
    free: Annotated[
        float, Quantity("kg", "grain out of the ear, broken grain too", is_amount=True, span=AMOUNT)
    ] = 0.0
    broken: Annotated[float, Quantity("kg", "broken grain, of the free one", is_amount=True, span=AMOUNT)] = (
        0.0
    )
    straw: Annotated[float, Quantity("kg", "long straw", is_amount=True, span=AMOUNT)] = 0.0
    short: Annotated[float, Quantity("kg", "short straw", is_amount=True, span=AMOUNT)] = 0.0
    chaff: Annotated[float, Quantity("kg", "chaff: husks and leaf", is_amount=True, span=AMOUNT)] = 0.0
    dt: Annotated[float, Quantity("s", "length of the step", is_amount=True, span=STEP)] = 0.0
    grain_moisture: Annotated[float, Quantity("", "water, share of the wet grain", span=SHARE)] = 0.14
    straw_moisture: Annotated[float, Quantity("", "water, share of the wet straw", span=SHARE)] = 0.12

    @property
    def grain(self) -> float:
        """Grain in the ear and out of it [kg]."""
        return self.unthreshed + self.free

    @property
    def mog(self) -> float:
        """Material other than grain [kg]."""
        return self.straw + self.short + self.chaff


@frozen
class OrganWork(Signal):
    """What an organ worked on within `dt`, what is in it now, and the power that it takes."""

    grain: Annotated[float, Quantity("kg", "grain worked on", is_amount=True, span=AMOUNT)] = 0.0
    mog: Annotated[
        float, Quantity("kg", "material other than grain worked on", is_amount=True, span=AMOUNT)
    ] = 0.0
    dt: Annotated[float, Quantity("s", "length of the step", is_amount=True, span=STEP)] = 0.0
    held_grain: Annotated[float, Quantity("kg", "grain in it", span=MASS)] = 0.0
    held_mog: Annotated[float, Quantity("kg", "material other than grain in it", span=MASS)] = 0.0
    power: Annotated[float, Quantity("W", "taken at the engine's rated speed", span=POWER)] = 0.0
    loss_share: Annotated[
        float,
        Quantity("", "grain over the rear, of what went in with the crop that leaves now, 0..1", span=SHARE),
    ] = 0.0

    blockage: Annotated[float, Quantity("", "its load over the one that blocks it", span=RATIO)] = 0.0


@frozen
class OrganLoads(Signal):
    """Powers of the organs at the engine's rated speed, and what came into the tank beside grain.

    `MachineLoad.held_straw` has `tank_mog` in it: it stays booked there when the tank is emptied.
    """

    header_power: Annotated[float, Quantity("W", "of header and feeder house", span=POWER)] = 0.0
    threshing_power: Annotated[float, Quantity("W", "of the threshing drum", span=POWER)] = 0.0
    separation_power: Annotated[float, Quantity("W", "of the separation", span=POWER)] = 0.0
    cleaning_power: Annotated[float, Quantity("W", "of cleaning and returns", span=POWER)] = 0.0
    tank_mog: Annotated[
        float,
        Quantity("kg", "material other than grain that came into the tank", column="tank_mog_kg", span=TOTAL),
    ] = 0.0
    tank_broken: Annotated[
        float, Quantity("kg", "broken grain that came into the tank", column="tank_broken_kg", span=TOTAL)
    ] = 0.0
    broken_share: Annotated[
        float, Quantity("", "broken, of the grain to the tank now", column="broken_share", span=SHARE)
    ] = 0.0
    mog_share: Annotated[
        float, Quantity("", "other material over grain to the tank now", column="mog_share", span=SHARE)
    ] = 0.0
    blockage: Annotated[
        float,
        Quantity(
            "", "load of an organ over the one that blocks it, the largest", column="blockage", span=RATIO
        ),
    ] = 0.0
