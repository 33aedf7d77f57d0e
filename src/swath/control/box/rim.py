"""Box level `rim`: rim and grain of the box of the machine beside, in the scans of a LiDAR of several lines.

Size and height of the box are those of its data sheet: from the message of the other machine, or set. Scanner
and box drive side by side, so that a sweep needs no correction for the way.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.control.box.finder import BoxFinder, FinderParams, Size, sample
from swath.control.box.grain_profile import BoxLook
from swath.control.box.rim_fit import edges_of, fit_rim, grid_of, in_box
from swath.core.component import Inputs, Port
from swath.core.registry import Level
from swath.signals import BoxSeen, PeerState, Scan, box_unseen
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params(FinderParams):
    """Those that every level has that looks for a rim."""


class RimFit(BoxFinder):
    """Of one scanner."""

    inputs = (Port("scan", Scan, unit="m", shape=(None,)), Port("peer", PeerState, optional=True))
    outputs = (Port("box", BoxSeen),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        super().__init__(params)
        self._mounting = setup.mounting

    def taken(self, inputs: Inputs) -> int | None:
        """Of the newest scan."""
        scan: Scan | None = inputs["scan"]
        return None if scan is None else scan.t

    def look(self, t: int, inputs: Mapping[str, Any], size: Size) -> BoxSeen:
        """Rectangle through the edges near the height of the rim, and what lies in it."""
        scan: Scan = inputs["scan"]
        length, width, height = size
        own = self._mounting.apply(scan.points().reshape(-1, 3)).reshape(*scan.ranges.shape, 3)
        points, away = grid_of(scan, np.asarray(own))
        away = np.where(away <= self._p.reach_m, away, np.inf)
        edges = edges_of(points, away)
        edges = edges[np.abs(edges[:, 2] - height) < self._p.band_m]
        rim = fit_rim(edges, length, width)
        if rim is None or not self.is_sure(rim):
            return box_unseen(t)
        near = points[np.isfinite(away)]
        inside = in_box(near, rim.x, rim.y, rim.heading)
        return sample(t, rim, inside, BoxLook(length, width, rim.height, rim.height_sd))


LEVEL = Level(
    RimFit,
    Params,
    summary="rectangle through the rim and profile of the grain in the scans of a LiDAR of several lines",
    cost="15 ms for a scan of 24 000 beams",
    tolerance="rim within 0.10 m and 1 deg, grain within 0.10 m, or not seen",
)
