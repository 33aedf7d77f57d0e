"""The header: how it hangs over the ground, and what it takes in."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Quantity, Signal, TrackColumn
from swath.signals.arrays import F64
from swath.signals.ranges import AMOUNT, CANOPY, COUNT, SHARE, STEEP, STEP


@frozen
class CropFlow(Signal, about=About(track_order=6)):
    """What the header took in during its last step. Lost and left grain are not part of `grain`."""

    grain: Annotated[float, Quantity("kg", "grain that went in", is_amount=True, span=AMOUNT)]
    straw: Annotated[float, Quantity("kg", "straw that went in", is_amount=True, span=AMOUNT)]
    area: Annotated[float, Quantity("m2", "area that was cut", is_amount=True, span=AMOUNT)]
    stem_count: Annotated[int, Quantity("", "stems that were cut", is_amount=True, span=COUNT)]
    header_fill: Annotated[
        float,
        Quantity(
            "",
            "share of the header's width that cuts crop, over the last metre, 0..1",
            column="header_fill",
            span=SHARE,
        ),
    ]
    dt: Annotated[float, Quantity("s", "length of the step", is_amount=True, span=STEP)]
    lost_grain: Annotated[
        float, Quantity("kg", "grain that the header cut but shed on the ground", is_amount=True, span=AMOUNT)
    ] = 0.0
    left_grain: Annotated[
        float, Quantity("kg", "grain on stems whose ear was below the knife", is_amount=True, span=AMOUNT)
    ] = 0.0


@frozen
class HeaderState(Signal, about=About(track_order=7, seen_as="in run.mcap, feeler by feeler")):
    """The header over the ground."""

    heights: Annotated[
        F64,
        Quantity(
            "m",
            "true heights of the knife above the ground, at even steps from left to right; < 0 digs in",
            ("place_count",),
            columns=(
                TrackColumn(
                    "knife_height_m",
                    "m",
                    "mean height of the knife above the ground",
                    lambda h: float(h.mean()),
                ),
            ),
            span=CANOPY,
        ),
    ]
    readings: Annotated[
        F64,
        Quantity(
            "m",
            "of the feelers from left to right",
            ("feeler_count",),
            "before the first reading",
            span=CANOPY,
        ),
    ]
    wanted: Annotated[float, Quantity("m", "cutting height", span=CANOPY)]
    band: Annotated[float, Quantity("m", "tolerated to both sides of it", span=CANOPY)]
    lift: Annotated[float, Quantity("rad", "of the feeder, > 0 raised", column="header_lift_rad", span=STEEP)]
    tilt: Annotated[
        float,
        Quantity(
            "rad", "of the header against the machine, > 0 left side up", column="header_tilt_rad", span=STEEP
        ),
    ]
    contact: Annotated[float, Quantity("", "share of the knife in the ground, 0..1", span=SHARE)]
