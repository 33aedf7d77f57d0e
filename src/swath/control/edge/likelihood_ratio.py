"""Learned likelihood ratios: every ray of some decimetres of travel says how likely it stands in the crop.

Scans become rays with a class and a place (`canopy_rays`); rays of 0.4 m of travel are a block (`blocks`);
what the classes are worth is learned on both sides of the edge (populations.cpp); the edge of each block goes
into a track that knows where the next one must be (`block_tracks`); and what is reported is the edge just
ahead of the knife, between blocks seen before and behind it (line/near.cpp), moved from the canopy to
the feet of the crop (report.cpp).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.edge.block_tracks import spacing_of
from swath.control.edge.canopy_classes import LIMIT
from swath.control.edge.detectors import Detectors
from swath.control.edge.feet import overhang
from swath.control.edge.ground_profile import cells_of
from swath.control.edge.profile import crop_sign
from swath.control.inclination import CRAB, Inclination
from swath.control.yaw_rate import no_bias
from swath.core.component import Port
from swath.core.registry import Checked, Level
from swath.core.together import InWorlds
from swath.core.units import PERCENT
from swath.signals import CropEdge, CropFlow, Inertial, Odometry, Scan
from swath.signals.setup import ControlSetup

FLATTEST = 5.0  # m per m that the middle beam goes ahead while it falls
Outward = Callable[[float], tuple[float, float] | None]


@dataclass(frozen=True)
class Params:
    """The likelihood-ratio detector.

    search_m: standard deviation of where the edge is expected beside the header end, at the start
    hold_m: distance beyond the last place seen for which the edge is held
    reference_m: where ahead of the knife the edge is reported
    crab: side slip per side slope, or per lateral acceleration in g [1]
    upright_m: height of the crop where it stands upright, as the driver sees it; 0 = usual for the crop that
        he chose. Where it is lower the stand leans, perhaps out over the edge, which one scanner cannot see:
        the edge is not sure there
    stubble_m: height of the stubble beside the edge that the driver expects, such as the one he cuts at
    stubble_sd_m: standard deviation of that height, before the ground was driven over
    slip_percent: how much faster the wheels turn than the ground passes, 2 to 6 % on stubble (uncited)
    height_percent: standard deviation of the height of stands that stand upright about that, such as 14 for
        one of 60 to 120 %
    lean_deg: how far stands lean in the mean, as the driver sees them; half of them lean less than 0.7 of it
    cut_sd_m: standard deviation of the error of the cutting width that a run has alike, where it is measured
    closed_m: standard deviation in closed stands of the error that a whole run has alike and no fit shows:
        mounting, odometry. The 95 % band holds 99 % of the pooled errors of 60 drawn runs
        (`benchmarks/edge_pairs.py`, final 0 to 59), and 97.7 % of 120 (`benchmarks/edge_worlds.py`, judging)
    open_m: the same in open stands
    """

    search_m: Annotated[float, Gt(0.1), Le(10)] = 1.5
    hold_m: Annotated[float, Ge(0), Le(20)] = 5.0
    reference_m: Annotated[float, Ge(0), Le(20)] = 1.5
    crab: Annotated[float, Ge(0), Le(1)] = CRAB
    upright_m: Annotated[float, Ge(0), Le(5)] = 0.0
    stubble_m: Annotated[float, Ge(0), Le(1.5)] = 0.15
    stubble_sd_m: Annotated[float, Gt(0), Le(1)] = 0.1
    slip_percent: Annotated[float, Ge(0), Le(50)] = 3.0
    height_percent: Annotated[float, Gt(0), Le(100)] = 14.0
    lean_deg: Annotated[float, Ge(0), Le(60)] = 20.0
    cut_sd_m: Annotated[float, Gt(0), Le(5)] = 0.03
    closed_m: Annotated[float, Gt(0), Le(1)] = 0.026
    open_m: Annotated[float, Gt(0), Le(1)] = 0.028


class LikelihoodRatio(InWorlds):
    """Scan, odometry and, where there is one, an inertial unit in; crop edge out.

    view: height of the scanner over which no tops are seen [m], None = this one's
    outward: tells, from the lean that the height of the crop says [rad], the tangent of the lean out over the
        edge and its standard deviation as other scanners see it; None = they do not
    """

    inputs = (
        Port("scan", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry),
        Port("inertial", Inertial, history=True, optional=True),
        Port("flow", CropFlow, optional=True),
    )
    outputs = (Port("edge", CropEdge),)

    def __init__(
        self, params: Params, setup: ControlSetup, view: float | None = None, outward: Outward | None = None
    ) -> None:
        self.params, self.outward, machine = params, outward, setup.machine
        self.mounting, self.stubble = setup.mounting, (params.stubble_m, params.stubble_sd_m)
        unit = setup.mountings.get("inertial")
        self.memories = Inclination(unit).numbers, no_bias(machine.wheelbase, unit)
        sign, (knife_x, end_y) = crop_sign(setup.edge_side), machine.header_end(setup.edge_side)
        height = float(setup.mounting.position[2])
        ahead, _, up = setup.mounting.turn([1.0, 0.0, 0.0])
        flat = min(abs(ahead) / max(abs(up), 0.1), FLATTEST)
        usual = params.upright_m or setup.crop_height
        most = min((height if view is None else view) / usual, 1.0) if usual > 0.0 else 1.0
        self.row = (
            *(sign, knife_x + params.reference_m, knife_x, sign * end_y, params.hold_m, params.crab),
            *(params.open_m, params.closed_m, 0.5 * (1.0 - LIMIT) * flat, height),
            *(spacing_of(setup.row_spacing), params.cut_sd_m, usual, PERCENT * params.height_percent),
            *(params.search_m, 1.0 + PERCENT * params.slip_percent, machine.header_width, flat),
            *(-machine.steered_x, *cells_of(-machine.steered_x)),
            *(overhang.prior_of(params.lean_deg), np.minimum(overhang.TALL, most), overhang.HANGS.ravel()),
            *(overhang.NO_RAMP.ravel(), overhang.DEVIATIONS, overhang.NORMAL, setup.mounting.position),
        )  # as `detector_rows` has it

    @classmethod
    def together(cls, parts: Sequence["LikelihoodRatio"]) -> Detectors:
        """Make one object that steps these parts of many worlds together."""
        return Detectors(parts)

    @property
    def hang_sd(self) -> float:
        """Standard deviation of what hangs over the edge that was told last [m]."""
        alone: Any = self.alone
        return float(alone.feet["hang_sd"][0])


DRAWN = "benchmarks/edge_pairs.py"  # cases at random, against the true edge
LEVEL = Level(
    LikelihoodRatio,
    Params,
    summary="likelihood ratios learned on both sides, summed over travel, tracked along an arc",
    cost="0.1 ms per scan",
    tolerance="offset within 0.05 m RMS of the true edge at 50 to 700 stems/m2",
    checked=(
        Checked("stems_per_m2", 60.0, 600.0, DRAWN, "truth"),
        Checked("crop_height_m", 0.4, 2.4, DRAWN, "truth"),
        Checked("lean_deg", 0.0, 20.0, DRAWN, "truth"),
        Checked("weeds_per_m2", 0.0, 40.0, DRAWN, "truth"),
        Checked("dust_per_m", 0.0, 0.4, DRAWN, "truth"),
        Checked("other_crop", 0.0, 1.0, DRAWN, "truth"),
        Checked("cutting_height_m", 0.05, 0.45, DRAWN, "truth"),
    ),
)
