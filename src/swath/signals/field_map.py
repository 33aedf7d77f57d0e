"""What a stored map says of the crop ahead."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Quantity, Signal
from swath.signals.arrays import F64
from swath.signals.ranges import AGE, CROP, DEVIATION, FAR

_N = ("place_count",)


@frozen
class FieldMap(Signal, about=About(seen_as="in run.mcap: the places move with the machine")):
    """Values of a stored map at places straight ahead of the header, averaged over its width."""

    ahead: Annotated[F64, Quantity("m", "of the places in front of the fixed axle", _N, span=FAR)]
    grain: Annotated[
        F64, Quantity("kg/m2", "grain on the ground's area", _N, "the map says nothing", span=CROP)
    ]
    grain_sd: Annotated[F64, Quantity("kg/m2", "1 sigma of it", _N, "not known", span=DEVIATION)]
    age: Annotated[F64, Quantity("s", "since it was measured", _N, "not known", span=AGE)]
    boundary: Annotated[
        float,
        Quantity("m", "in front of the fixed axle, where the field ends", nan="not within reach", span=FAR),
    ]
