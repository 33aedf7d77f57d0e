"""Edge level `truth`: the crop edge straight from the field. For isolating steering from perception."""

from dataclasses import dataclass
from math import atan, cos
from typing import Annotated

import numpy as np
from annotated_types import Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.portable import solve
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.signals import CropEdge, MachineState


@dataclass(frozen=True)
class Params:
    """reference_x_m: where ahead of the fixed axle the edge is reported; reach_m: half search width."""

    reference_x_m: Annotated[float, Gt(0), Le(40)] = 10.0
    reach_m: Annotated[float, Gt(0), Le(20)] = 3.0


class TruthEdge(KeepsState):
    """Looks the edge up in the field's cut cells at three distances ahead."""

    inputs = (Port("state", MachineState),)
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._p, self._setup = params, setup

    def reset(self, stream: Stream) -> Outputs:
        """No edge yet."""
        return {"edge": _no_edge(0, self._p.reference_x_m)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The edge at t + dt, from lateral lines at 0.8, 1.0 and 1.2 of the reference distance."""
        x = self._p.reference_x_m * np.array([0.8, 1.0, 1.2])
        y = np.array([true_offset(self._setup, inputs["state"], float(v), self._p.reach_m) for v in x])
        if np.any(np.isnan(y)):
            return {"edge": _no_edge(t + dt, float(x[1]))}
        ahead = x - x[1]
        offset, slope, bend = solve(np.stack([np.ones(3), ahead, ahead * ahead], axis=1), y).tolist()
        heading = atan(slope)
        curvature = 2.0 * bend * cos(heading) ** 3
        edge = CropEdge(t + dt, offset, heading, curvature, float(x[1]), 1.0, np.nan, np.nan)
        return {"edge": edge}


def true_offset(setup: SiteSetup, state: MachineState, x: float, reach: float) -> float:
    """y of the true edge in the machine frame at x ahead [m], nan when there is none within `reach`.

    Searched on the lateral line through the header end that follows the edge, from the cut side inwards.
    """
    outward = 1.0 if setup.edge_side == "left" else -1.0
    y0 = setup.machine.header_end(setup.edge_side)[1] + outward * reach
    y1 = y0 - outward * 2 * reach
    start, end = state.pose.apply([[x, y0, 0.0], [x, y1, 0.0]])
    return y0 - outward * setup.field.edge_offset(start[:2], end[:2])


def _no_edge(t: int, reference_x: float) -> CropEdge:
    return CropEdge(t, np.nan, np.nan, 0.0, reference_x, 0.0, np.nan, np.nan)


LEVEL = Level(
    TruthEdge,
    Params,
    "the true edge, for testing steering alone",
    cost="0.1 ms",
    tolerance="15.6 mm cells",
    sees_truth=True,
)
