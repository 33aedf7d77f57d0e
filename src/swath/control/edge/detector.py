"""The chain every built-in edge detector shares; a level adds the rule that splits a profile."""

from dataclasses import dataclass
from math import atan, tan
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.edge.canopy_offset import CanopyOffset
from swath.control.edge.height_step import Gates, SplitRule, Step, find_step
from swath.control.edge.line_fit import Line, LineFit, Prior, fit_line
from swath.control.edge.profile import Profile, Reach, crop_sign, finite, make_profile, no_edge
from swath.control.edge.tracking import EdgeTrack, Memory
from swath.control.inclination import CRAB, Inclination
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import DEG, MM
from swath.signals import CropEdge, Inertial, Odometry, Scan
from swath.signals.setup import ControlSetup

HEADROOM, ROOM = 1.25, 0.3  # [1], [m]: crop may stand this much above its 90th percentile, over uneven ground
TOPS = (1.5, 1.15)  # m, tried when the crop's height is not known and dust may hide the edge
CLEARER = 1.3  # times the separation that a lower top must reach to count


@dataclass(frozen=True)
class EdgeParams:
    """Parameters of an edge detector; the defaults suit cereals and a scanner that looks 6 to 12 m ahead.

    min_step_m: least difference of the mean heights of crop and stubble side
    min_gain: log-likelihood that two populations must gain over one [nat]
    min_separation: step over the root sum of both variances
    window_m: half width of the profile around the known edge; search_m: around the header end at the start
    track_m: travel whose edge points are fitted together; gate_m: how far a point may lie beside the edge
    lost_s: after so long without the edge it counts as lost; acquire_s: seen for so long it counts as found;
    jump_s: seen for so long when it lies beside the one just lost
    lean_deg: mean lean of the stems off the vertical; lean_share: part of it by which the canopy seems to
    hang over the edge: a first guess, wheat that is not lodged leans 5 to 8 deg
    learn_m: travel over which the canopy offset is learned from the scans; 0 = the guess holds throughout
    echo_parts: stems, ears or pods that make an echo together: as many as cover half of the spot when it is
    the median of the spot, 1 when the nearest counts
    spot_mm: spot diameter at the crop when the echo is the nearest of the spot (data sheet: at the cover plus
    divergence times range), half of which belongs to the first guess; 0 for a median echo
    reference_m: where ahead of the fixed axle the offset is reported, 0 = a little behind the footprint
    """

    min_step_m: Annotated[float, Gt(0), Le(2)] = 0.25
    min_gain: Annotated[float, Ge(0), Le(1000)] = 15.0
    min_separation: Annotated[float, Gt(0), Le(10)] = 1.2
    window_m: Annotated[float, Gt(0.3), Le(10)] = 3.0
    search_m: Annotated[float, Gt(0.3), Le(20)] = 5.0
    track_m: Annotated[float, Gt(0.5), Le(20)] = 7.5
    gate_m: Annotated[float, Gt(0.05), Le(2)] = 0.35
    lost_s: Annotated[float, Gt(0), Le(0.5)] = 0.4
    acquire_s: Annotated[float, Gt(0), Le(2)] = 0.2
    jump_s: Annotated[float, Gt(0), Le(10)] = 1.5
    lean_deg: Annotated[float, Ge(0), Le(60)] = 6.5
    lean_share: Annotated[float, Ge(0), Le(1)] = 0.5
    learn_m: Annotated[float, Ge(0), Le(1000)] = 30.0
    echo_parts: Annotated[int, Ge(1), Le(20)] = 3
    spot_mm: Annotated[float, Ge(0), Le(500)] = 0.0
    reference_m: Annotated[float, Ge(0), Le(30)] = 0.0


class EdgeDetector(KeepsState):
    """Scan and odometry in, crop edge out. Subclasses set `split`, and `fit` where the line is another's."""

    kept: ClassVar[tuple[str, ...]] = (
        "_track",
        "_canopy_offset",
        "_inclination",
        "_time",
        "_crop",
        "_stubble",
        "_ground",
    )

    Params = EdgeParams
    split: SplitRule
    fit: LineFit = staticmethod(fit_line)
    inputs = (
        Port("scan", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry),
        Port("inertial", Inertial, history=True, optional=True),
    )
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params: EdgeParams, setup: ControlSetup) -> None:
        p = params
        self._mounting = setup.mounting
        self._sign = crop_sign(setup.edge_side)
        self._centre = self._sign * setup.machine.header_end(setup.edge_side)[1]
        lean = p.lean_share * tan(p.lean_deg * DEG)
        self._canopy_offset = CanopyOffset(p.learn_m, lean, 0.5 * p.spot_mm * MM, parts=p.echo_parts)
        self._gates = Gates(
            min_step=p.min_step_m,
            min_gain=p.min_gain,
            min_separation=p.min_separation,
            window=p.window_m,
            search=p.search_m,
        )
        self._reach = Reach()
        self._lost = round(p.lost_s * NS)
        memory = Memory(p.track_m, gate=p.gate_m, lost_s=p.lost_s, acquire_s=p.acquire_s, jump_s=p.jump_s)
        self._reference = p.reference_m or footprint(setup) - 0.2 * p.track_m
        self._track = EdgeTrack(memory, Prior(), self._reference, self.fit)
        self._inclination = Inclination(setup.mountings.get("inertial"))
        self._time = 0
        self._crop, self._stubble, self._ground = float("nan"), float("nan"), 0.0

    def reset(self, stream: Stream) -> Outputs:
        """No edge at t = 0: nothing was seen yet."""
        self._track.clear()
        self._canopy_offset.clear()
        self._canopy_offset.compile()
        self._inclination.clear()
        self._time = 0
        self._crop, self._stubble, self._ground = float("nan"), float("nan"), 0.0
        return {"edge": no_edge(0, self._reference)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take a new scan, if there is one, and report the edge in the machine frame of t + dt."""
        scan, odometry = inputs["scan"], inputs["odometry"]
        speed, yaw_rate = finite(odometry.speed), finite(odometry.yaw_rate)
        self._inclination.take(inputs.get("inertial"), speed)
        if scan is not None and scan.t > self._time:
            self._take(scan, speed, yaw_rate)
        return {"edge": self._report(t + dt, speed, yaw_rate)}

    def _take(self, scan: Scan, speed: float, yaw_rate: float) -> None:
        elapsed = (scan.t - self._time) / NS
        self._time = scan.t
        crab = -self._sign * self._inclination.crab(CRAB, speed * yaw_rate)
        self._track.move(speed * elapsed, self._sign * yaw_rate * elapsed, elapsed, crab)
        self._canopy_offset.move(speed * elapsed)
        profile = make_profile(scan, self._mounting, self._sign, speed, yaw_rate, self._reach)
        line = self._track.line if self._track.is_found else None
        found = self._look(profile)
        self._track.update(found)
        if found is not None:
            self._remember_heights(found)
            if line is not None:
                self._canopy_offset.add(found.rays, found.u - float(line.at(found.x)), self._crop)

    def _look(self, profile: Profile) -> Step | None:
        """The step of a profile without what hangs above the crop: dust near the scanner.

        Once the crop's height is known all echoes above it go. Before that several tops are tried, and a
        lower one counts when it shows the step more clearly.
        """
        tops: tuple[float, ...] = (self._reach.high, *TOPS)
        if self._track.is_found and np.isfinite(self._crop):
            tops = (self._ground + HEADROOM * max(self._crop, 0.0) + ROOM,)
        rise = self._sign * self._inclination.rise[1] if self._inclination.is_known else None
        best: Step | None = None
        line = self._track.line
        for top in tops:
            step = find_step(profile.below(top), line, self._centre, self.split, self._gates, rise)
            if step is not None and (best is None or step.separation > CLEARER * best.separation):
                best = step
        return best

    def _remember_heights(self, found: Step) -> None:
        share = 0.1 if np.isfinite(self._crop) else 1.0
        old_crop, old_stubble = (self._crop, self._stubble) if share < 1.0 else (0.0, 0.0)
        self._crop = (1.0 - share) * old_crop + share * found.crop_height
        self._stubble = (1.0 - share) * old_stubble + share * found.stubble_height
        self._ground = (1.0 - share) * (self._ground if share < 1.0 else 0.0) + share * found.ground

    def _report(self, now: int, speed: float, yaw_rate: float) -> CropEdge:
        line, age = self._track.line, now - self._time
        if line is None or not self._track.is_found or age > self._lost:
            return no_edge(now, self._reference)
        line = line.moved(speed * age / NS, self._sign * yaw_rate * age / NS)
        return self._as_edge(now, line)

    def _as_edge(self, now: int, line: Line) -> CropEdge:
        sign, steep = self._sign, 1.0 + line.slope**2
        shift = self._canopy_offset.shift(self._crop)
        return CropEdge(
            t=now,
            offset=sign * (line.offset + shift * float(np.sqrt(steep))),
            heading=sign * atan(line.slope),
            curvature=sign * float(line.bend / steep**1.5),
            reference_x=line.x0,
            confidence=self._track.confidence(),
            crop_height=self._crop,
            stubble_height=self._stubble,
        )


def footprint(setup: ControlSetup) -> float:
    """x [m] where the scanner's middle beam meets a canopy 0.8 m high, between the knife and 20 m ahead."""
    knife = setup.machine.knife_x
    ahead, _, up = setup.mounting.turn([1.0, 0.0, 0.0])
    drop = float(setup.mounting.position[2]) - 0.8
    if up >= -1e-3 or drop <= 0.0:
        return knife + 5.0
    return float(np.clip(setup.mounting.position[0] - drop * ahead / up, knife + 1.0, 20.0))
