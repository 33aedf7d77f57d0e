"""The machine's inside: where the crop is, and the engine that drives it all."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Quantity, Signal
from swath.signals.ranges import ENGINE, FLOW, LOAD, MASS, MEASURED_SPEED, POWER, SHARE, SPEED_RATIO, TOTAL


@frozen
class MachineLoad(Signal, about=About(track_order=8)):
    """Where the crop is: grain in the tank now, other masses since the start, flows at this moment."""

    tank_grain: Annotated[float, Quantity("kg", "grain in the tank", column="tank_grain_kg", span=MASS)]
    lost_grain: Annotated[
        float,
        Quantity(
            "kg", "grain lost over the rear or the rim of a full tank", column="lost_grain_kg", span=TOTAL
        ),
    ]
    dropped_straw: Annotated[float, Quantity("kg", "straw laid or spread", span=TOTAL)]
    held_grain: Annotated[float, Quantity("kg", "grain inside the machine, not in the tank", span=MASS)]
    held_straw: Annotated[float, Quantity("kg", "straw inside the machine", span=MASS)]
    grain_flow: Annotated[float, Quantity("kg/s", "to the tank", column="grain_flow_kg_s", span=FLOW)]
    straw_flow: Annotated[float, Quantity("kg/s", "into the swath", span=FLOW)]
    unloaded_grain: Annotated[float, Quantity("kg", "grain that left the tank again", span=TOTAL)] = 0.0
    tank_start: Annotated[float, Quantity("kg", "grain in the tank before the start", span=MASS)] = 0.0
    header_flow: Annotated[float, Quantity("kg/s", "grain and straw at the knife", span=FLOW)] = 0.0
    feeder_flow: Annotated[
        float, Quantity("kg/s", "grain and straw into the feeder house", column="feeder_flow_kg_s", span=FLOW)
    ] = 0.0
    drum_flow: Annotated[
        float, Quantity("kg/s", "grain and straw into the threshing drum, with returns", span=FLOW)
    ] = 0.0
    rotor_flow: Annotated[float, Quantity("kg/s", "straw through the separation", span=FLOW)] = 0.0
    shoe_flow: Annotated[float, Quantity("kg/s", "grain and chaff over the cleaning shoe", span=FLOW)] = 0.0
    chopper_flow: Annotated[
        float, Quantity("kg/s", "straw through the chopper, 0 when it lies in a swath", span=FLOW)
    ] = 0.0
    return_flow: Annotated[float, Quantity("kg/s", "back to the drum", span=FLOW)] = 0.0
    unload_flow: Annotated[float, Quantity("kg/s", "out of the tank", span=FLOW)] = 0.0
    threshing_loss: Annotated[
        float, Quantity("kg/s", "unthreshed grain over the rear", column="threshing_loss_kg_s", span=FLOW)
    ] = 0.0
    separation_loss: Annotated[
        float, Quantity("kg/s", "grain in the straw over the rear", column="separation_loss_kg_s", span=FLOW)
    ] = 0.0
    cleaning_loss: Annotated[
        float, Quantity("kg/s", "grain in the chaff over the rear", column="cleaning_loss_kg_s", span=FLOW)
    ] = 0.0
    loss_share: Annotated[
        float,
        Quantity(
            "",
            "grain lost, of what was fed, for the crop that leaves now, 0..1",
            column="loss_share",
            span=SHARE,
        ),
    ] = 0.0
    tank_level: Annotated[
        float,
        Quantity(
            "", "filled share of the tank, 0..1; 0 where no tank is modelled", column="tank_level", span=SHARE
        ),
    ] = 0.0

    @property
    def tank_gain(self) -> float:
        """Grain that came into the tank since the start [kg], unloaded since or not."""
        return self.tank_grain - self.tank_start + self.unloaded_grain


@frozen
class EngineState(Signal, about=About(track_order=9)):
    """The engine and what it drives, as its controller reports it."""

    speed: Annotated[float, Quantity("rad/s", "engine speed", column="engine_speed_rad_s", span=ENGINE)]
    speed_ratio: Annotated[float, Quantity("", "speed over the rated speed", span=SPEED_RATIO)]
    load: Annotated[
        float,
        Quantity(
            "",
            "torque asked / largest torque at this speed; above 1 the speed falls",
            column="engine_load",
            span=LOAD,
        ),
    ]
    power: Annotated[float, Quantity("W", "given by the engine", span=POWER)]
    fuel: Annotated[float, Quantity("kg/s", "fuel burnt", column="fuel_kg_s", span=FLOW)]
    fuel_used: Annotated[float, Quantity("kg", "fuel burnt since the start", span=TOTAL)]
    header_power: Annotated[float, Quantity("W", "taken by the header", span=POWER)]
    threshing_power: Annotated[float, Quantity("W", "taken by the threshing drum", span=POWER)]
    separation_power: Annotated[float, Quantity("W", "taken by the separation", span=POWER)]
    cleaning_power: Annotated[float, Quantity("W", "taken by the cleaning", span=POWER)]
    chopper_power: Annotated[float, Quantity("W", "taken by the chopper", span=POWER)]
    unloading_power: Annotated[float, Quantity("W", "taken by the unloading", span=POWER)]
    propulsion_power: Annotated[float, Quantity("W", "taken by the propulsion", span=POWER)]
    auxiliary_power: Annotated[float, Quantity("W", "taken by everything else", span=POWER)]
    speed_limit: Annotated[
        float, Quantity("m/s", "largest ground speed the drive can give now", span=MEASURED_SPEED)
    ]
