"""Box level `rim`: rim and grain of the box of the machine beside, in the scans of a LiDAR of several lines.

Size and height of the box are those of its data sheet: from the message of the other machine, or set. Scanner
and box drive side by side, so that a sweep needs no correction for the way.
"""

from dataclasses import dataclass
from math import isfinite, nan, pi
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.box.grain_profile import BoxLook, fill_of
from swath.control.box.rim_fit import Rim, edges_of, fit_rim, grid_of, in_box
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.signals import F64, BoxSeen, PeerState, Scan, box_unseen
from swath.signals.setup import ControlSetup

STATION = 0.5  # between the places of the profile [m]
Size = tuple[float, float, float]


@dataclass(frozen=True)
class Params:
    """The rim of a box among the echoes. A size that is left out is the one that the other machine sends.

    length_m: length of the box, inside
    width_m: width of the box, inside
    rim_m: height of its rim above the ground
    band_m: how far above and below that height the rim is looked for
    reach_m: distance from the sensor up to which the rim is looked for
    most_sd_m: standard deviation of the place above which a fit does not count
    most_sd_deg: standard deviation of the heading above which a fit does not count
    least_confidence: confidence below which a fit does not count [1]
    keep_s: time for which a find is reported; after it the box is not seen any more
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


class RimFit(KeepsState):
    """The rim as one scanner sees it; a sample has the time of the scan that it comes from."""

    inputs = (Port("scan", Scan, unit="m", shape=(None,)), Port("peer", PeerState, optional=True))
    outputs = (Port("box", BoxSeen),)
    kept: ClassVar[tuple[str, ...]] = ("_seen", "_latest")

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p = params
        self._mounting = setup.mounting

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._seen = -1
        self._latest = box_unseen(0)
        return {"box": self._latest}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """What the newest scan shows."""
        scan: Scan | None = inputs["scan"]
        if scan is not None and scan.t != self._seen:
            self._seen = scan.t
            size = self._size(inputs.get("peer"))
            found = box_unseen(scan.t) if size is None else self._look(scan, size)
            if found.is_seen or not self._latest.is_seen:
                self._latest = found
        if self._latest.is_seen and t + dt - self._latest.t > self._p.keep_s * NS:
            self._latest = box_unseen(t + dt)
        return {"box": self._latest}

    def _size(self, peer: PeerState | None) -> Size | None:
        """Length, width and height of the rim [m]; None where nobody said so yet."""
        p = self._p
        told = (nan,) * 3
        if peer is not None and peer.is_heard:
            told = peer.box_length, peer.box_width, peer.rim_height
        own = p.length_m, p.width_m, p.rim_m
        size = [mine or (said if isfinite(said) else None) for mine, said in zip(own, told, strict=True)]
        return None if None in size else (size[0] or 0.0, size[1] or 0.0, size[2] or 0.0)

    def _is_sure(self, rim: Rim) -> bool:
        """Whether a fit is certain enough to be reported."""
        p = self._p
        is_known = max(rim.sd[:2]) <= p.most_sd_m and rim.sd[2] <= p.most_sd_deg * pi / 180.0
        return is_known and confidence(rim) >= p.least_confidence

    def _look(self, scan: Scan, size: Size) -> BoxSeen:
        """Rectangle through the edges near the height of the rim, and what lies in it."""
        length, width, height = size
        own = self._mounting.apply(scan.points().reshape(-1, 3)).reshape(*scan.ranges.shape, 3)
        points, away = grid_of(scan, np.asarray(own))
        away = np.where(away <= self._p.reach_m, away, np.inf)
        edges = edges_of(points, away)
        edges = edges[np.abs(edges[:, 2] - height) < self._p.band_m]
        rim = fit_rim(edges, length, width)
        if rim is None or not self._is_sure(rim):
            return box_unseen(scan.t)
        near = points[np.isfinite(away)]
        inside = in_box(near, rim.x, rim.y, rim.heading)
        return sample(scan.t, rim, inside, BoxLook(length, width, rim.height, rim.height_sd))


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


LEVEL = Level(
    RimFit,
    Params,
    summary="rectangle through the rim and profile of the grain in the scans of a LiDAR of several lines",
    cost="15 ms for a scan of 24 000 beams",
    tolerance="rim within 0.10 m and 1 deg, grain within 0.10 m, or not seen",
)
