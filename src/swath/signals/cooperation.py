"""What machines that work side by side send each other, and how grain goes from one to the other."""

from math import isfinite
from typing import Annotated

import numpy as np

from swath.core.frozen import frozen
from swath.core.signal import About, Quantity, Signal
from swath.signals.arrays import F64
from swath.signals.ranges import (
    ACCELERATION,
    AGE,
    ANGLE,
    ASIDE,
    BOX,
    CURVATURE,
    DEVIATION,
    FAR,
    FLOW,
    FORCE,
    HEADING,
    HEIGHT,
    MASS,
    MEASURED_RATE,
    MEASURED_SPEED,
    PART,
    PLACE,
    SHARE,
    SIZE,
    TOTAL,
)

_NAN = float("nan")
_ALONG = "in run.mcap; figure `Unloading` of the report shows the true grain along the box"
NO_PROFILE = "no box, or not measured"


@frozen
class TrailerState(Signal, about=About("world")):
    """Truth about what a machine tows. Origin: middle of its axle, on the ground; x towards the hitch."""

    x: Annotated[float, Quantity("m", "east of the axle's middle", column="trailer_x_m", span=PLACE)]
    y: Annotated[float, Quantity("m", "north of it", column="trailer_y_m", span=PLACE)]
    z: Annotated[float, Quantity("m", "height of it", column="trailer_z_m", span=HEIGHT)]
    yaw: Annotated[float, Quantity("rad", "from east, > 0 left", column="trailer_yaw_rad", span=HEADING)]
    pitch: Annotated[float, Quantity("rad", "> 0 nose down", span=ANGLE)]
    roll: Annotated[float, Quantity("rad", "> 0 left side up", span=ANGLE)]
    hitch_angle: Annotated[float, Quantity("rad", "its heading less that of the machine", span=HEADING)]
    mass: Annotated[float, Quantity("kg", "with its load", span=MASS)]
    axle_load: Annotated[float, Quantity("N", "its axle on the ground", span=FORCE)]
    drawbar_load: Annotated[float, Quantity("N", "down on the hitch pin", span=FORCE)]
    drawbar_pull: Annotated[
        float, Quantity("N", "along the drawbar, > 0 pulled", nan="the level knows no forces", span=FORCE)
    ]


@frozen
class HeapState(Signal, about=About(seen_as="figure `Unloading` of the report")):
    """Grain in an open box: how much, and how its surface lies along the middle line."""

    grain: Annotated[float, Quantity("kg", "in the box", column="heap_grain_kg", span=MASS)]
    level: Annotated[
        float,
        Quantity("", "over the largest heap that stands on the rim, 0..1", column="heap_level", span=SHARE),
    ]
    spilled: Annotated[
        float, Quantity("kg", "ran over the rim since the start", column="heap_spilled_kg", span=TOTAL)
    ]
    highest: Annotated[float, Quantity("m", "highest point of the surface above the floor", span=BOX)]
    profile: Annotated[
        F64,
        Quantity(
            "m", "surface above the floor along the middle line, rear to front", shape=("station",),
            nan=NO_PROFILE, span=BOX,
        ),
    ]  # fmt: skip
    freeboard: Annotated[
        F64,
        Quantity(
            "m", "rim above the grain at the walls beside each station, the least", shape=("station",),
            nan=NO_PROFILE, span=BOX,
        ),
    ]  # fmt: skip
    lean: Annotated[
        float, Quantity("m", "grain at the left wall above that at the right one, mean", span=BOX)
    ] = 0.0


@frozen
class UnloadCommand(Signal, about=About()):
    """What the unloading auger is to do."""

    angle: Annotated[
        float,
        Quantity("rad", "wanted swing of the pipe, 0 folded back", column="unload_command_rad", span=ANGLE),
    ]
    is_running: Annotated[bool, Quantity("", "the auger turns", column="unload_command")]


@frozen
class UnloadState(Signal, about=About()):
    """The unloading auger, and where its stream comes down (truth)."""

    angle: Annotated[
        float, Quantity("rad", "swing of the pipe, 0 folded back", column="unload_angle_rad", span=ANGLE)
    ]
    flow: Annotated[float, Quantity("kg/s", "out of the mouth", column="unload_flow_kg_s", span=FLOW)]
    drawn: Annotated[float, Quantity("kg", "taken from the tank since the start", span=TOTAL)]
    held: Annotated[float, Quantity("kg", "in the auger and in the air", span=MASS)]
    caught: Annotated[
        float, Quantity("kg", "came down in a box since the start", column="caught_kg", span=TOTAL)
    ]
    missed: Annotated[
        float,
        Quantity(
            "kg", "came down on the ground or on a machine since the start", column="missed_kg", span=TOTAL
        ),
    ]
    impact_x: Annotated[float, Quantity("m", "where the stream passes the height of a rim, ahead", span=PART)]
    impact_y: Annotated[float, Quantity("m", "the same, leftward", span=PART)]


@frozen
class PeerState(Signal, about=About()):
    """What a machine knows of the one it works with, from the newest message.

    Relative pose: of the other one's origin in the own frame, at the time the message is valid for, which
    was `age` ago. Its box and where its stream comes down are in the other one's frame.
    """

    is_heard: Annotated[bool, Quantity("", "a message has ever come", column="peer_heard")]
    age: Annotated[
        float, Quantity("s", "of the newest message", nan="none yet", column="peer_age_s", span=AGE)
    ]
    x: Annotated[float, Quantity("m", "of the other one, ahead", nan="none yet", column="peer_x_m", span=FAR)]
    y: Annotated[float, Quantity("m", "leftward", nan="none yet", column="peer_y_m", span=FAR)]
    heading: Annotated[float, Quantity("rad", "> 0 turned left", nan="none yet", span=HEADING)]
    speed: Annotated[float, Quantity("m/s", "of the other one", nan="none yet", span=MEASURED_SPEED)]
    yaw_rate: Annotated[
        float, Quantity("rad/s", "of the other one, > 0 left", nan="none yet", span=MEASURED_RATE)
    ]
    acceleration: Annotated[
        float, Quantity("m/s2", "of the other one", nan="none yet", span=ACCELERATION)
    ] = _NAN
    box_x: Annotated[
        float, Quantity("m", "middle of its box, ahead of its origin", nan="no box", span=PART)
    ] = _NAN
    box_y: Annotated[float, Quantity("m", "leftward", nan="no box", span=PART)] = _NAN
    box_heading: Annotated[float, Quantity("rad", "of its box against it", nan="no box", span=HEADING)] = _NAN
    box_length: Annotated[float, Quantity("m", "of its box", nan="no box", span=SIZE)] = _NAN
    box_width: Annotated[float, Quantity("m", "of its box", nan="no box", span=SIZE)] = _NAN
    rim_height: Annotated[float, Quantity("m", "of its box above the ground", nan="no box", span=BOX)] = _NAN
    impact_x: Annotated[
        float, Quantity("m", "where its stream comes down, ahead", nan="no pipe", span=PART)
    ] = _NAN
    impact_y: Annotated[float, Quantity("m", "leftward", nan="no pipe", span=PART)] = _NAN
    tank_level: Annotated[float, Quantity("", "of its tank, 0..1", nan="no tank", span=SHARE)] = _NAN
    tank_grain: Annotated[float, Quantity("kg", "in its tank", nan="no tank", span=MASS)] = _NAN
    is_pouring: Annotated[bool, Quantity("", "grain leaves its pipe")] = False
    is_full: Annotated[bool, Quantity("", "it takes no grain now")] = False
    body_front: Annotated[
        float, Quantity("m", "of its chassis, ahead of its origin", nan="not reported", span=PART)
    ] = _NAN
    body_rear: Annotated[float, Quantity("m", "likewise, < 0 behind it", nan="not reported", span=PART)] = (
        _NAN
    )
    body_width: Annotated[float, Quantity("m", "of its chassis", nan="not reported", span=SIZE)] = _NAN
    header_front: Annotated[float, Quantity("m", "of its header, ahead", nan="no header", span=PART)] = _NAN
    header_left: Annotated[
        float, Quantity("m", "middle of its header, leftward", nan="no header", span=PART)
    ] = _NAN
    header_width: Annotated[float, Quantity("m", "of its header", nan="no header", span=SIZE)] = _NAN

    @property
    def has_place(self) -> bool:
        """Whether a message says where the other one is, and how it moves."""
        whole = self.age, self.x, self.y, self.heading, self.speed, self.yaw_rate
        return self.is_heard and all(map(isfinite, whole))

    @property
    def has_box(self) -> bool:
        """Whether it says where its box is, and how large."""
        whole = self.box_x, self.box_y, self.box_heading, self.box_length, self.box_width
        return self.is_heard and all(map(isfinite, whole))

    @property
    def has_stream(self) -> bool:
        """Whether it says where its stream comes down."""
        return self.is_heard and isfinite(self.impact_x) and isfinite(self.impact_y)


@frozen
class Station(Signal, about=About()):
    """Where a machine that keeps beside another one wants to be, in its own frame now."""

    is_active: Annotated[bool, Quantity("", "there is a station to keep", column="station_active")]
    ahead: Annotated[
        float, Quantity("m", "wanted place ahead of where it is", column="station_ahead_m", span=FAR)
    ]
    left: Annotated[float, Quantity("m", "wanted path to the left", column="station_left_m", span=FAR)]
    heading: Annotated[float, Quantity("rad", "of the wanted path, > 0 bears left", span=HEADING)]
    curvature: Annotated[float, Quantity("1/m", "of the wanted path, > 0 left", span=CURVATURE)]
    speed: Annotated[float, Quantity("m/s", "of the wanted place", span=MEASURED_SPEED)]
    acceleration: Annotated[float, Quantity("m/s2", "of the wanted place", span=ACCELERATION)]
    spot: Annotated[
        float,
        Quantity(
            "m", "where in the box grain is to come down, ahead of its middle", column="spot_m", span=BOX
        ),
    ]
    is_full: Annotated[bool, Quantity("", "no grain now: the box is full there", column="station_full")]


@frozen
class BoxSeen(Signal, about=About(seen_as=_ALONG)):
    """The open box of the machine beside, as a machine sees it, in its own frame at the time t.

    The grain is reported against the rim: heights at even places along the middle line of the box.
    """

    is_seen: Annotated[bool, Quantity("", "there is a box", column="box_seen")]
    x: Annotated[
        float, Quantity("m", "middle of the box, ahead", nan="not seen", column="box_seen_x_m", span=ASIDE)
    ]
    y: Annotated[float, Quantity("m", "leftward", nan="not seen", column="box_seen_y_m", span=ASIDE)]
    heading: Annotated[
        float,
        Quantity(
            "rad", "of its length, > 0 left", nan="not seen", column="box_seen_heading_rad", span=HEADING
        ),
    ]
    rim_height: Annotated[
        float, Quantity("m", "above the ground under the fixed axle", nan="not seen", span=BOX)
    ]
    x_sd: Annotated[float, Quantity("m", "standard deviation of x", nan="not seen", span=DEVIATION)]
    y_sd: Annotated[float, Quantity("m", "of y", nan="not seen", span=DEVIATION)]
    heading_sd: Annotated[float, Quantity("rad", "of the heading", nan="not seen", span=DEVIATION)]
    rim_height_sd: Annotated[float, Quantity("m", "of the height of the rim", nan="not seen", span=DEVIATION)]
    confidence: Annotated[
        float, Quantity("", "that it is the box, 0..1", column="box_seen_confidence", span=SHARE)
    ]
    profile: Annotated[
        F64,
        Quantity(
            "m", "grain above the rim along the middle line, rear to front, < 0 below", shape=("station",),
            nan="not seen there", span=BOX,
        ),
    ]  # fmt: skip
    profile_sd: Annotated[
        F64, Quantity("m", "its standard deviation", ("station",), "not seen there", span=DEVIATION)
    ]
    freeboard: Annotated[
        F64,
        Quantity(
            "m", "rim above the grain at the walls beside each place, the least", shape=("station",),
            nan="not seen there", span=BOX,
        ),
    ]  # fmt: skip
    lean: Annotated[
        float, Quantity("m", "grain at the left wall above that at the right one, mean", span=BOX)
    ] = 0.0


def box_unseen(t: int) -> BoxSeen:
    """No box is seen at t [ns]."""
    none = np.full(1, _NAN)
    return BoxSeen(t, False, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, 0.0, none, none, none)
