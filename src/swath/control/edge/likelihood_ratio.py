"""Learned likelihood ratios: every ray of some decimetres of travel says how likely it stands in the crop.

Scans become rays with a class and a place (`canopy_rays`); rays of 0.4 m of travel are a block (`blocks`);
what the classes are worth is learned on both sides of the edge (`populations`); the edge of each block goes
into a track that knows where the next one must be (`block_track`, `arc_track`); and what is reported is the
edge just ahead of the knife, between blocks seen before and behind it (`near_line`), moved from the canopy to
the feet of the crop (`canopy_feet`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from struct import Struct
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.edge.block_track import BlockTrack, Search
from swath.control.edge.canopy_classes import LIMIT
from swath.control.edge.canopy_rays import CanopyRays, EdgeFrame, Ground
from swath.control.edge.edge_report import EdgeReports
from swath.control.edge.feet import overhang
from swath.control.edge.ground_profile import GroundProfile
from swath.control.edge.profile import crop_sign, finite, no_edge
from swath.control.edge.report_rows import ALL, DRIVE, EDGE, FEET, ROWS
from swath.control.inclination import CRAB, Inclination
from swath.control.inertial_memory import Number, Numbers
from swath.control.yaw_rate import YawRate
from swath.core.component import Inputs, KeepsState, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Checked, Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.signals import F64, CropEdge, CropFlow, Inertial, Odometry, Scan
from swath.signals.setup import ControlSetup

BEGIN = 3  # blocks: a line through two shows nothing of its own error
FLATTEST = 5.0  # m per m that the middle beam goes ahead while it falls
AHEAD_OF_REFERENCE = 4.0  # m that blocks lie ahead of where the edge is reported
DRIVEN, DRIVEN_AT = Struct("6d"), 8 * 7  # what comes with a step, after the state in its row
STEP = len(ROWS["step"].names or ())
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


class LikelihoodRatio(KeepsState):
    """Scan, odometry and, where there is one, an inertial unit in; crop edge out.

    view: height of the scanner over which no tops are seen [m], None = this one's
    outward: tells, from the lean that the height of the crop says [rad], the tangent of the lean out over the
        edge and its standard deviation as other scanners see it; None = they do not
    """

    kept = (
        *("_cut", "_time", "_at", "_blocks", "_ground", "_profile", "_rays", "_inclination", "_yaw_rate"),
    )
    inputs = (
        Port("scan", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry),
        Port("inertial", Inertial, history=True, optional=True),
        Port("flow", CropFlow, optional=True),
    )
    outputs = (Port("edge", CropEdge),)

    _at, _time, _cut = Numbers(slice(3)), Number(3, int), Numbers(slice(4, 7))  # state of a step's row

    def __init__(
        self, params: Params, setup: ControlSetup, view: float | None = None, outward: Outward | None = None
    ) -> None:
        self._p, self._outward = params, outward
        self._sign = crop_sign(setup.edge_side)
        knife_x, end_y = setup.machine.header_end(setup.edge_side)
        self._width = setup.machine.header_width
        self._centre = self._sign * end_y
        self._reference = knife_x + params.reference_m
        height = float(setup.mounting.position[2])
        search = Search(params.search_m, params.hold_m + AHEAD_OF_REFERENCE, setup.row_spacing, height)
        self._blocks = BlockTrack(search)
        self._ground, self._rays = Ground(), CanopyRays(setup.mounting, self._sign)
        self._profile = GroundProfile(-setup.machine.steered_x, (params.stubble_m, params.stubble_sd_m))
        ahead, _, up = setup.mounting.turn([1.0, 0.0, 0.0])
        self._flat = min(abs(ahead) / max(abs(up), 0.1), FLATTEST)
        self._inclination = Inclination(setup.mountings.get("inertial"))
        self._yaw_rate = YawRate(setup.machine.wheelbase, setup.mountings.get("inertial"))
        self._reports = EdgeReports(1)
        self.numbers: F64 = self._reports.rows.view(np.float64)[:STEP]
        usual = params.upright_m or setup.crop_height
        most = min((height if view is None else view) / usual, 1.0) if usual > 0.0 else 1.0
        self._reports.detectors[0] = (
            *(self._sign, self._reference, knife_x, self._centre, params.hold_m, params.crab),
            *(params.open_m, params.closed_m, 0.5 * (1.0 - LIMIT) * self._flat, height),
            *(self._blocks.feet.spacing, params.cut_sd_m, usual, PERCENT * params.height_percent),
            *(overhang.prior_of(params.lean_deg), np.minimum(overhang.TALL, most), overhang.HANGS.ravel()),
            *(overhang.NO_RAMP.ravel(), overhang.DEVIATIONS, overhang.NORMAL),
        )
        self._forget()

    def _forget(self) -> None:
        self.numbers[:] = 0.0
        self._reports.blocks["is_begun"] = 0.0
        self._blocks.clear()
        self._ground.clear()
        self._profile.clear()
        self._rays.clear()
        self._inclination.clear()
        self._yaw_rate.clear()

    def reset(self, stream: Stream) -> Outputs:
        """No edge at t = 0: nothing was seen yet."""
        self._forget()
        self._reports.compile()
        self._blocks.feet.compile()
        return {"edge": no_edge(0, self._reference)}

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""
        super().load(state)
        self._learn()

    @property
    def hang_sd(self) -> float:
        """Standard deviation of what hangs over the edge that was told last [m]."""
        return float(self._reports.feet["hang_sd"][0])

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take a new scan, if there is one, and report the edge in the machine frame of t + dt."""
        scan, odometry = inputs["scan"], inputs["odometry"]
        speed = finite(odometry.speed) / (1.0 + PERCENT * self._p.slip_percent)
        inertial = inputs.get("inertial")
        yaw_rate = self._sign * finite(self._yaw_rate.of(odometry, inertial, dt / NS))
        self._inclination.take(inertial, speed)
        flow = inputs.get("flow")
        missing = self._width * (1.0 - flow.header_fill) if flow is not None else nan
        rise, travel = self._inclination.rise[1], abs(speed) * dt / NS
        DRIVEN.pack_into(self.numbers.data, DRIVEN_AT, t + dt, speed, yaw_rate, rise, missing, travel)
        if scan is not None and scan.t > self._time:
            self._take(scan, speed, yaw_rate)
        return {"edge": self._report(t + dt)}

    def _rise(self) -> tuple[float, float]:
        """How far the top of an upright plant seems to stand ahead and toward the crop of its foot [1]."""
        ahead, left = self._inclination.rise
        return ahead, self._sign * left

    def _take(self, scan: Scan, speed: float, yaw_rate: float) -> None:
        self.numbers[-1] = seconds = min((scan.t - self._time) / NS, 1.0)
        self._reports.launch(DRIVE)
        self._time = scan.t
        x, u, heading = self._at
        at = x, u, heading
        arc, (low, high) = self._blocks.track.arc, Ground.OUTSIDE
        if arc is None:
            frame = EdgeFrame(self._reference, self._centre, 0.0, 0.0)
            low, high = low - 0.5, -self._p.search_m
        else:
            frame = arc.frame(*at)
        self._rays.take(scan, (speed, yaw_rate), frame, self._ground, low, high)
        travel, rise = abs(speed) * seconds, self._rise()
        grade, is_new = self._go_over(travel, frame, rise)
        rays = self._rays.answers(self._ground, grade, self._blocks.height, rise)
        if self._blocks.add(rays, travel, frame, at, self._profile.stubble) or is_new:
            self._learn()

    def _go_over(self, travel: float, frame: EdgeFrame, rise: tuple[float, float]) -> tuple[float, bool]:
        """The ground under the wheels and ahead: by how much it rises there between crop and stubble [1], and
        whether the profile has changed.
        """
        ground, felt = self._ground, rise if self._inclination.is_sure else None
        if ground.middle is None:
            return 0.0, ground.is_known and self._profile.take(travel, None, felt)
        x, beside = ground.middle
        level = ground.level + ground.slope * beside
        is_new = self._profile.take(travel, (x, frame.u + beside, level, ground.slope), felt)
        return self._profile.grade(x - self._flat * self._blocks.height, x), is_new

    def _learn(self) -> None:
        """What the report reads of the blocks."""
        blocks, arc = self._blocks, self._blocks.track.arc
        if arc is None or blocks.followed < BEGIN:
            self._reports.blocks["is_begun"] = 0.0
            return
        feet, ground, top = blocks.feet, self._profile, blocks.height
        rows = *feet.tops.tolist(), feet.noise, feet.along if feet.spacing else 0.0
        row = (
            *(1.0, arc.x, arc.u, arc.angle, arc.bend, arc.distance),
            *(blocks.bite, blocks.turn_sd, blocks.agreed, blocks.scatter, blocks.blank, top),
            *(*blocks.populations.heights(), blocks.populations.dust(), blocks.jagged.swing(top)),
            *(ground.stubble, ground.stubble_sd, *feet.lean[:2], *rows, feet.overhang(top)),
        )
        self._reports.learn(0, row, blocks.points.rows, blocks.points.returns)

    def _report(self, now: int) -> CropEdge:
        """The edge now [ns], as the rows of the step say."""
        reports = self._reports
        if self._outward is None:
            reports.launch(ALL)
        else:
            reports.launch(FEET)
            feet = reports.feet[0]
            told = self._outward(float(feet["low"])) if feet["is_found"] else None
            reports.told[0] = (told is not None, *(told or (0.0, 0.0)))
            reports.launch(EDGE)
        return CropEdge(now, *reports.edges.memory.item(0))


DRAWN = "benchmarks/edge_pairs.py"  # cases at random, against the true edge
LEVEL = Level(
    LikelihoodRatio,
    Params,
    summary="likelihood ratios learned on both sides, summed over travel, tracked along an arc",
    cost="0.6 ms per scan",
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
