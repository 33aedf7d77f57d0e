"""What a machine does in the work of a whole field: which pass, how fast, and what its other parts may do."""

from enum import IntEnum
from typing import Annotated

from swath.core.frozen import frozen
from swath.core.packed_state import saved_type
from swath.core.signal import About, Quantity, Signal

_NAN = float("nan")


@saved_type()
class Phase(IntEnum):
    """What a machine does. STANDS: to hand grain over; BESIDE: keeps a station; EMPTIES: its box."""

    WAITS = 0
    CUTS = 1
    TURNS = 2
    STANDS = 3
    DRIVES = 4
    BESIDE = 5
    EMPTIES = 6
    DONE = 7


@frozen
class JobState(Signal, about=About()):
    """What a machine does now, and what its steering, speed, header, pipe and box may do."""

    phase: Annotated[
        int,
        Quantity(
            "", "0 waits, 1 cuts, 2 turns, 3 stands, 4 drives, 5 beside, 6 empties, 7 done",
            column="job_phase",
        ),
    ]  # fmt: skip
    task: Annotated[int, Quantity("", "number of the pass, from 0; -1 = none", column="job_pass")]
    speed: Annotated[float, Quantity("m/s", "that is to be driven, at most")]
    remaining: Annotated[float, Quantity("m", "to the end of the pass", nan="in no pass")]
    by_edge: Annotated[bool, Quantity("", "the crop edge may lead")] = False
    by_station: Annotated[bool, Quantity("", "the station beside the other machine leads")] = False
    may_unload: Annotated[bool, Quantity("", "a cart may drive beside, under the pipe")] = False
    calls: Annotated[bool, Quantity("", "a cart is wanted", column="job_calls")] = False
    empties: Annotated[bool, Quantity("", "the box is emptied into the truck")] = False
    come: Annotated[float, Quantity("m", "along its pass and the turn behind it", nan="in no pass")] = _NAN
    to_come: Annotated[
        float,
        Quantity("kg", "in the tank and, forecast, on its last two passes", nan="before those"),
    ] = _NAN
    stands_in: Annotated[
        float, Quantity("s", "forecast, until it stands for a cart if none comes before", nan="not known")
    ] = _NAN
    lets_first: Annotated[
        int, Quantity("", "crossing at which it lets another combine go first; -1 = none")
    ] = -1
    serves: Annotated[
        int, Quantity("", "machine that it works with: 0 = that of `peer_link`, 1 = of `peer_link_1`")
    ] = 0


@frozen
class HeaderCommand(Signal, about=About()):
    """Whether the header works."""

    is_down: Annotated[bool, Quantity("", "it is at its height of work, and cuts", column="header_down")]
