"""What the levels share that look for the rim of a box and the grain in it: size, certainty, how long a find
is given.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Le

from swath.control.box.grain_profile import BoxLook, fill_of
from swath.control.box.rim_fit import Rim
from swath.core.component import Inputs, KeepsState, Outputs
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.signals import F64, BoxSeen, PeerState, box_unseen

STATION = 0.5  # between the places of the profile [m]
Size = tuple[float, float, float]


@dataclass(frozen=True)
class FinderParams:
    """length_m, width_m: of the box, inside; rim_m: of its rim above the ground; none = as the other machine
    says
    band_m: the rim is looked for so far above and below that height; reach_m: and so near to the sensor
    most_sd_m, most_sd_deg: a fit less certain than that is not seen; least_confidence: nor one below that
    keep_s: a find is given so long, then it is not seen any more
    """

    length_m: Annotated[float, Gt(0.5), Le(30)] | None = None
    width_m: Annotated[float, Gt(0.5), Le(10)] | None = None
    rim_m: Annotated[float, Gt(0.2), Le(6)] | None = None
    band_m: Annotated[float, Gt(0.05), Le(1)] = 0.25
    reach_m: Annotated[float, Gt(1), Le(50)] = 15.0
    most_sd_m: Annotated[float, Gt(0), Le(1)] = 0.05
    most_sd_deg: Annotated[float, Gt(0), Le(10)] = 0.5
    least_confidence: Annotated[float, Ge(0), Le(1)] = 0.5
    keep_s: Annotated[float, Ge(0), Le(10)] = 0.5


class BoxFinder(KeepsState, ABC):
    """Takes every look; a sample tells of the look that it comes from. A level gives `taken` and `look`."""

    kept: ClassVar[tuple[str, ...]] = ("_seen", "_latest")

    def __init__(self, params: FinderParams) -> None:
        self._p = params

    @abstractmethod
    def taken(self, inputs: Inputs) -> int | None:
        """When what there is to look at was taken [ns]; None where there is nothing."""

    @abstractmethod
    def look(self, t: int, inputs: Mapping[str, Any], size: Size) -> BoxSeen:
        """What it shows. size: length, width and height of the rim [m]"""

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._seen = -1
        self._latest = box_unseen(0)
        return {"box": self._latest}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """What the newest look shows."""
        taken = self.taken(inputs)
        if taken is not None and taken != self._seen:
            self._seen = taken
            size = self._size(inputs.get("peer"))
            found = box_unseen(taken) if size is None else self.look(taken, inputs, size)
            if found.is_seen or not self._latest.is_seen:
                self._latest = found
        if self._latest.is_seen and t + dt - self._latest.t > self._p.keep_s * NS:
            self._latest = box_unseen(t + dt)
        return {"box": self._latest}

    def _size(self, peer: PeerState | None) -> Size | None:
        """Length, width and height of the rim [m]; None where nobody said so yet."""
        p = self._p
        told = (
            (None,) * 3
            if peer is None or not peer.is_heard or peer.box_length != peer.box_length
            else (peer.box_length, peer.box_width, peer.rim_height)
        )
        size = [mine or theirs for mine, theirs in zip((p.length_m, p.width_m, p.rim_m), told, strict=True)]
        return None if None in size else (size[0] or 0.0, size[1] or 0.0, size[2] or 0.0)

    def is_sure(self, rim: Rim) -> bool:
        """Whether a fit is certain enough to be told."""
        p = self._p
        is_known = max(rim.sd[:2]) <= p.most_sd_m and rim.sd[2] <= p.most_sd_deg * pi / 180.0
        return is_known and confidence(rim) >= p.least_confidence


def sample(t: int, rim: Rim, inside: F64, look: BoxLook) -> BoxSeen:
    """A rim, and grain among points (n, 3) of the box's frame [m]."""
    fill = fill_of(inside, look, max(1, round(look.length / STATION)))
    return BoxSeen(
        t, True, rim.x, rim.y, rim.heading, rim.height, *rim.sd, rim.height_sd, confidence(rim),
        fill.height, fill.sd, fill.freeboard, fill.lean,
    )  # fmt: skip


def confidence(rim: Rim) -> float:
    """Share of the walls that were seen, times that of the edges or parts of walls that lie on it."""
    return 0.25 * rim.wall_count * rim.share
