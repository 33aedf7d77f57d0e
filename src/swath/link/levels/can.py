"""Level `can` of the slot `steer`: a controller box on a CAN bus (`link/can/steering.py`)."""

from swath.core.registry import Level
from swath.link.can.steering import CanSteering, Params

LEVEL = Level(
    CanSteering,
    Params,
    summary="a controller box steers over CAN, by the guidance messages of ISO 11783-7",
    cost="about 0.5 ms per cycle",
    tolerance="the law behind a bus: within 1 cm of the same law in process",
    is_link=True,
)
