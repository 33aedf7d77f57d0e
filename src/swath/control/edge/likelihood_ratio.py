"""Learned likelihood ratios: every ray of some decimetres of travel says how likely it stands in the crop.

Scans become rays with a class and a place (`canopy_rays`); rays of 0.4 m of travel are a block (`blocks`);
what the classes are worth is learned on both sides of the edge (`populations`); the edge of each block goes
into a track that knows where the next one must be (`block_track`, `arc_track`); and what is reported is the
edge just ahead of the knife, between blocks seen before and behind it (`near_line`), moved from the canopy to
the feet of the crop (`canopy_feet`).
"""

from dataclasses import dataclass, replace
from math import cos, hypot, isfinite, nan, sin, sqrt, tan
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.control.edge.block_track import BLOCK, BlockTrack, Search
from swath.control.edge.canopy_classes import LIMIT
from swath.control.edge.canopy_rays import CanopyRays, EdgeFrame, Ground
from swath.control.edge.feet.overhang import HOLES_M, CutWidth, HeightOverhang, Overhang, density
from swath.control.edge.ground_profile import GroundProfile
from swath.control.edge.line.near_line import DISTANCE, LineFit, NearLine
from swath.control.edge.profile import EVENLY, LEAST_SURE, crop_sign, finite, no_edge
from swath.control.inclination import CRAB, Inclination
from swath.control.yaw_rate import YawRate
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Checked, Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.signals import CropEdge, CropFlow, Inertial, Odometry, Scan
from swath.signals.setup import ControlSetup

BEGIN = 3  # blocks: a line through two shows nothing of its own error
RAGGED, EVEN = 2.8, 0.03  # of the scatter beyond that of an even edge, of its height: bites, swing
BENT = 0.4  # m per bend of 1/m: rays that cross the edge show it less well
SLIPPED = 0.12  # m per rad that the edge turns away from the crop: 1.3 % of wheel slip, not known
HIDDEN = 0.4  # of what the wall lies to and fro along the edge: bites behind what stands out
BITES = 0.8  # of the depth of bites: the edge lies 0.76 of it further in than the line, at most
ROWS = 0.125  # of their spacing: scatter of single plants in rows, which are no bites
UNSURE, HELD = 0.45, 0.167  # greatest confidence of an edge that is held, not seen; m, its least deviation
BETWEEN = 0.7  # m to the nearest block from which on an edge is held
FLATTEST = 5.0  # m per m that the middle beam goes ahead while it falls
OVER_M = 1.0  # m of travel over which the header tells its width
OLD, LATE = 0.15, 0.4  # s: age of the newest scan from which on an edge is less sure, and is none
LEAST_COS = 0.2  # of the edge's angle to the machine
AHEAD_OF_REFERENCE = 4.0  # m that blocks lie ahead of where the edge is reported


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
    """Scan, odometry and, where there is one, an inertial unit in; crop edge out."""

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

    def __init__(self, params: Params, setup: ControlSetup, overhang: Overhang | None = None) -> None:
        self._p = params
        self._sign = crop_sign(setup.edge_side)
        knife_x, end_y = setup.machine.header_end(setup.edge_side)
        usual = params.upright_m or setup.crop_height, params.height_percent, params.lean_deg
        self._overhang = overhang or HeightOverhang(*usual, float(setup.mounting.position[2]))
        self._cut, self._width = CutWidth(params.cut_sd_m), setup.machine.header_width
        self._knife = knife_x
        self._centre = self._sign * end_y
        self._reference = knife_x + params.reference_m
        self._blocks = BlockTrack(
            Search(
                params.search_m,
                params.hold_m + AHEAD_OF_REFERENCE,
                setup.row_spacing,
                float(setup.mounting.position[2]),
            )
        )
        self._ground, self._rays = Ground(), CanopyRays(setup.mounting, self._sign)
        self._profile = GroundProfile(-setup.machine.steered_x, (params.stubble_m, params.stubble_sd_m))
        self._line = LineFit(self._reference)
        ahead, _, up = setup.mounting.turn([1.0, 0.0, 0.0])
        flat = min(abs(ahead) / max(abs(up), 0.1), FLATTEST)
        self._early = 0.5 * (1.0 - LIMIT) * flat
        self._flat = flat
        self._inclination = Inclination(setup.mountings.get("inertial"))
        self._yaw_rate = YawRate(setup.machine.wheelbase, setup.mountings.get("inertial"))
        self._forget()

    def _forget(self) -> None:
        self._time = 0
        self._at = (0.0, 0.0, 0.0)  # x, u [m] and heading [rad] in the frame at rest
        self._cut.clear()
        self._blocks.clear()
        self._ground.clear()
        self._profile.clear()
        self._rays.clear()
        self._inclination.clear()
        self._yaw_rate.clear()

    def reset(self, stream: Stream) -> Outputs:
        """No edge at t = 0: nothing was seen yet."""
        self._forget()
        self._line.compile()
        self._blocks.feet.compile()
        return {"edge": no_edge(0, self._reference)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take a new scan, if there is one, and report the edge in the machine frame of t + dt."""
        scan, odometry = inputs["scan"], inputs["odometry"]
        speed = finite(odometry.speed) / (1.0 + PERCENT * self._p.slip_percent)
        inertial = inputs.get("inertial")
        yaw_rate = self._sign * finite(self._yaw_rate.of(odometry, inertial, dt / NS))
        self._inclination.take(inertial, speed)
        flow = inputs.get("flow")
        missing = self._width * (1.0 - flow.header_fill) if flow is not None else nan
        if scan is not None and scan.t > self._time:
            self._take(scan, speed, yaw_rate)
        return {"edge": self._report(t + dt, speed, yaw_rate, (missing, abs(speed) * dt / NS))}

    def _moved(self, speed: float, yaw_rate: float, seconds: float) -> tuple[float, float, float]:
        """Where the machine stands some seconds after `_at`: along its heading, and aside by crab."""
        x, u, heading = self._at
        crab = self._inclination.crab(self._p.crab, self._sign * speed * yaw_rate)
        course = heading + 0.5 * yaw_rate * seconds - self._sign * crab
        travel = speed * seconds
        return x + travel * cos(course), u + travel * sin(course), heading + yaw_rate * seconds

    def _rise(self) -> tuple[float, float]:
        """How far the top of an upright plant seems to stand ahead and toward the crop of its foot [1]."""
        ahead, left = self._inclination.rise
        return ahead, self._sign * left

    def _take(self, scan: Scan, speed: float, yaw_rate: float) -> None:
        seconds = min((scan.t - self._time) / NS, 1.0)
        self._time = scan.t
        self._at = self._moved(speed, yaw_rate, seconds)
        arc, (low, high) = self._blocks.track.arc, Ground.OUTSIDE
        if arc is None:
            frame = EdgeFrame(self._reference, self._centre, 0.0, 0.0)
            low, high = low - 0.5, -self._p.search_m
        else:
            frame = arc.frame(*self._at)
        self._rays.take(scan, (speed, yaw_rate), frame, self._ground, low, high)
        travel, rise = abs(speed) * seconds, self._rise()
        grade = self._go_over(travel, frame, rise)
        rays = self._rays.answers(self._ground, grade, self._blocks.height, rise)
        self._blocks.add(rays, travel, frame, self._at, self._profile.stubble)

    def _go_over(self, travel: float, frame: EdgeFrame, rise: tuple[float, float]) -> float:
        """The ground under the wheels and ahead; by how much it rises there between crop and stubble [1]."""
        ground, felt = self._ground, rise if self._inclination.is_sure else None
        if ground.middle is None:
            if ground.is_known:
                self._profile.take(travel, None, felt)
            return 0.0
        x, beside = ground.middle
        level = ground.level + ground.slope * beside
        self._profile.take(travel, (x, frame.u + beside, level, ground.slope), felt)
        return self._profile.grade(x - self._flat * self._blocks.height, x)

    def _report(self, now: int, speed: float, yaw_rate: float, cut: tuple[float, float]) -> CropEdge:
        """The edge now. cut: how much of the header's width cut nothing, over a travel [m]."""
        age = (now - self._time) / NS
        if self._blocks.track.arc is None or age > LATE:
            return no_edge(now, self._reference)
        has_begun = self._blocks.followed >= BEGIN
        line = self._near(self._moved(speed, yaw_rate, age)) if has_begun else None
        if line is None or (line.gap > self._p.hold_m and not self._lies_ahead(line)):
            return no_edge(now, self._reference)
        edge = self._as_edge(now, line, cut)
        fresh = min((LATE - age) / (LATE - OLD), 1.0)
        return edge if fresh >= 1.0 else replace(edge, confidence=max(fresh * edge.confidence, LEAST_SURE))

    def _lies_ahead(self, line: NearLine) -> bool:
        """All that was seen of the edge lies ahead of the reported place: what is ahead will be reached."""
        first, last = (float(self._blocks.points.rows[k, DISTANCE]) for k in (0, -1))
        return line.seen_to > last - first

    def _near(self, at: tuple[float, float, float]) -> NearLine | None:
        """The edge abreast of the reference, seen from a machine at x, u [m] with a heading [rad]."""
        arc, bite = self._blocks.track.arc, self._blocks.bite
        if arc is None:
            return None
        line = self._line.near(self._blocks.points.rows, at, arc.frame(*at), arc.distance)
        if line is None or (bite == 0.0 and self._blocks.points.shows_beyond(self._way_of(line) - BETWEEN)):
            return line
        frame, sd = _abreast(arc.frame(*at), self._reference), max(line.offset_sd, BITES * bite)
        return replace(line, frame=frame, offset_sd=sd, angle_sd=max(line.angle_sd, self._blocks.turn_sd))

    def _way_of(self, line: NearLine) -> float:
        """Along the edge, of the reported place [m]."""
        return float(self._blocks.points.rows[-1, DISTANCE]) - line.seen_to

    def _as_edge(self, now: int, line: NearLine, cut: tuple[float, float]) -> CropEdge:
        sign, edge = self._sign, line.frame
        steep = max(cos(edge.angle), LEAST_COS)
        crop, stubble, stopped = self._blocks.populations.heights()
        plane = self._profile.stubble
        crop, stubble = crop + plane, stubble + plane
        dust = self._blocks.populations.dust()
        canopy = _canopy(edge, self._reference, steep)
        feet = self._blocks.feet
        top = self._blocks.height
        shift, shift_sd, ramp = feet.shift(top, crop, stopped, line.spread, dust)
        rows = feet.rows(shift)[0]  # of plants, which stand out by themselves
        dense = max(stopped, rows)  # where its plants are
        self._hear(line, shift, steep, cut)
        hang = self._overhang.of(crop, self._profile.stubble_sd, dense, ramp, self._cut)
        is_smooth = self._blocks.bite > 0.0
        even = max(EVEN * top, ROWS * rows * feet.spacing)
        ragged = 0.0 if is_smooth else sqrt(max(0.0, self._blocks.scatter - even**2))
        swing = 0.0 if is_smooth else self._blocks.jagged.swing(top)
        hidden = HIDDEN * density(stopped) * (1.0 - rows) * swing
        known = hypot(line.offset_sd, RAGGED * ragged, hidden, shift_sd)
        alike = self._p.open_m + density(stopped) * (self._p.closed_m - self._p.open_m)
        known = hypot(known, BENT * edge.bend, SLIPPED * min(edge.angle, 0.0), alike)
        known = hypot(known, self._blocks.blank / EVENLY)  # evenly anywhere in it
        sd, other = hypot(known, hang.sd) / steep, hang.modes[0]
        sure = hang.within(known) * min(1.0, self._blocks.agreed / 0.8)
        if is_smooth or not isfinite(crop) or not self._shows(line, crop):
            sure, sd = min(sure, UNSURE), max(sd, HELD)
        return CropEdge(
            t=now,
            offset=sign * (canopy + (shift + hang.told) / steep),
            heading=sign * edge.angle,
            curvature=sign * edge.bend,
            reference_x=self._reference,
            confidence=min(max(sure, LEAST_SURE), 1.0),
            crop_height=crop,
            stubble_height=stubble,
            offset_sd=sd,
            heading_sd=line.angle_sd,
            seen_to=self._reference + (line.seen_to + 0.5 * BLOCK) * steep,
            is_held=line.gap > 1.0,
            other_offset=sign * (canopy + (shift + other.place) / steep) if other.chance > 0.0 else nan,
            other_chance=other.chance,
        )

    def _hear(self, line: NearLine, shift: float, steep: float, cut: tuple[float, float]) -> None:
        """What the header cut over the last way driven, beside where the canopy's edge lies there."""
        missing, travel = cut
        edge, blocks = line.frame, self._blocks
        knife = self._way_of(line) + (self._knife - edge.x)
        if missing < HOLES_M and blocks.points.shows(knife, BETWEEN, OVER_M):
            canopy = _canopy(edge, self._knife, steep)
            self._cut.add(missing, canopy + shift / steep - self._centre, travel)

    def _shows(self, line: NearLine, crop: float) -> bool:
        """Standing crop was seen at the reported place.

        The wall behind a hole is seen from over it. Rays on their way down from the canopy's top to the lower
        limit are stopped by it; a block lies in the middle of that way.
        """
        early = self._early * crop + 0.5 * BLOCK
        return self._blocks.points.shows(self._way_of(line), BETWEEN, early)


def _canopy(edge: EdgeFrame, x: float, steep: float) -> float:
    """Where the canopy's edge lies aside at a place ahead of the machine's origin [m]; steep: its cosine."""
    beyond = x - edge.x
    return edge.u + beyond * tan(edge.angle) + 0.5 * edge.bend * (beyond / steep) ** 2 / steep


def _abreast(edge: EdgeFrame, reference: float) -> EdgeFrame:
    """A parabola's frame moved along it, to a place ahead of the machine's origin [m]."""
    along = (reference - edge.x) / max(cos(edge.angle), LEAST_COS)
    u = edge.u + (reference - edge.x) * tan(edge.angle) + 0.5 * edge.bend * along**2
    return EdgeFrame(reference, u, edge.angle + edge.bend * along, edge.bend)


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
