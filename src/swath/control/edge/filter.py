"""One Bayes filter for the edge. The equations are below; `filter.cpp` carries them out.

The edge is cut into nodes, one every 0.4 m of a reference path in the frame of dead reckoning, from some
metres behind the reported place to the farthest seen. The path goes on where the edge is believed to go.

**Line.** At each node (y, theta, kappa, tooth): offset, direction and bend of a line that a machine can
follow, and how far the wall of the crop stands off that line there,

    y' = y + a theta + a^2 kappa / 2,  theta' = theta + a kappa + N(0, turn^2 a),  kappa' = kappa + N(0, q a)
    tooth' = r tooth + N(0, s^2 (1 - r^2)),  r = exp(-a / tooth_m)

a linear Gaussian chain. s is learned from the smoothed teeth; q after Student, each step's own from the step
itself: straight for long, then a bend. Teeth, wind and ragged stands widen what is told and leave the line.

**Rays.** The canopy is layers of height. A ray that travels x metres through a layer is stopped there at a
rate mu per metre, p(stopped at x) = mu exp(-mu x). With N stops and X metres in cell c of layer l at a node,
feet of the outermost crop at e have the log-likelihood

    L(e) = 1 / over  sum over c, l of  N log mu_l(c - e) - X mu_l(c - e)
    mu_l(d) = out_l + (in_l - out_l) Phi((d - lean z_l) / width)

over: how much more stops scatter than those of a Poisson process (looks at the same stems are alike), learned
from blocks of the crop. in_l, out_l: (stops + prior) / (metres + prior) on both sides of the wall as it is
believed, so that density, stubble, weeds and low crop are learned; layers that are hidden are taken as dense
as the one above. Rays without an echo count by how many of them there are on either side, beams that never
answer not at all.
The echo is that of half the spot: it needs a way into the crop until it can be, the longer the thinner and
the more even the crop, `delay` / over of the mean free path, and counts that much before. A ray's likelihood
stands in one place: `take` and `score_of`. Because rays are followed through the crop to where they stop, the
angle at which they cross the edge needs no correction.

**Shape** of the edge, one for all of it, a slow state: lean of the crop's side, one of ten values, and the
width over which plants spread about their feet, one of four. Their posteriors are those of the rays, of the
height against the usual one (z = h cos of the whole lean, across and along the edge) and of a prior of leans
with long tails. Rays of many nodes tell shapes apart no better than `shape_alike` of them would. L is taken
with the mean profile, and what the shapes put the feet at differently is a deviation common to all nodes,
which does not average out; so is `misfit` of how far the side leans, as none is a plane.

**Rows.** The edge is half a row spacing outside the outermost row. Rows that stand apart show in the stops
per metre by place between them, of which the first harmonic says where they are; others are taken to stand at
the wall. Where the line turns across the rows, as first seen along it, their ends are the edge.

**Edge or hole.** A node has an edge, wall e = y + tooth, or a hole, where the wall is further inside or there
is none near, and goes on by a chain of its own. The two are a Markov chain along the way: holes begin with a
chance `hole` per node and end with `hole_ends`. Given what all other nodes say, e ~ N(m, v),

    p(rays | edge) = integral of N(e; m, v) exp L(e),  p(rays | hole) = sum over walls w > e + apart

and the moments of N(e; m, v) (pi exp L(e) + (1 - pi) hole(e)) are those that the node's Gaussian site has to
give (expectation propagation: Minka 2001, UAI). Sites are renewed while rays reach their nodes; smoothing is
by Bryson and Frazier (1963), the modes by forward and backward recursion.

**Told** is the smoothed line at the reference, interpolated or extrapolated, with its deviation, to which
come what no scatter shows: the shape, drift of dead reckoning from where the edge was seen. P(|error| <= 0.1
m) is the confidence; what looks like a hole may as well be the edge that goes on aside, and halves it. Before
an edge is known, the rays of the last metres are split at the place that gains most over no edge; from there
on the chain has it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.control.edge.profile import crop_sign, finite, no_edge
from swath.control.edge.silent_beams import SilentBeams
from swath.control.inclination import CRAB, Inclination
from swath.control.yaw_rate import YawRate
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.kernels import repeatable, shared, start_warp
from swath.signals import CropEdge, Inertial, Odometry, Scan, beam_directions
from swath.signals.setup import ControlSetup

# Counts as in filter.cpp, and numbers of a node, of all before the nodes, of the state and of the grids
LAYERS, CELLS, HALF, NODES, WIDE, SHAPES, BINS, TABLE = 10, 90, 16, 48, 80, 14, 24, 512
NODE, HEAD = 56, 42 + 2 * BINS + 2 * (2 * LAYERS + 2) + 2 * LAYERS + 2 + 3 * SHAPES
STATE = HEAD + NODES * NODE
ROW = CELLS + 2 * HALF
GRIDS = NODES * (2 * LAYERS * ROW + 2 * ROW + 3 * (CELLS + 1)) + (2 * LAYERS + 2) * WIDE + TABLE
USUAL = 0.85  # m: height of a crop that nobody named, that of wheat
TOP, LOWEST = 1.25, 0.05  # of the usual height [1] and [m]: where the layers end and begin; estimates
LATE = 0.4  # s: age of the newest scan from which on there is no edge


@dataclass(frozen=True)
class Params:
    """Of the filter; where no source is given, estimates, checked on drawn cases (benchmarks/edge_pairs.py).

    search_m: standard deviation of where the edge is expected beside the header end, at the start
    begin_nat: gain of two sides over one from which on there is an edge; denser: and so many times more
    stops per metre on the crop's side; begin_m: travel that they are summed over
    bend_noise: of the line's bend [1/m per sqrt(m)]; turn_noise: of its direction [rad per sqrt(m)]
    bend_sd, turn_sd: at the start [1/m], [rad]
    tooth_m: length over which teeth are alike; tooth_sd_m, tooth_first_m: their least standard deviation, the
    first; memory_m: travel over which densities, teeth and scatter are learned
    hole, hole_ends: chance per 0.4 m that a hole begins, that it ends; apart_m: least distance of its wall
    wall_stays, wall_none: chances that a hole's wall goes on from the node before, that there is none;
    wall_step_m: scale of its steps
    prior_m: way through the canopy that the prior rates are worth; least: rate of stray stops [1/m]
    bend_tail: degrees of freedom of the bend's steps; over_first: `over` at the start
    clear_m: greatest standard deviation of a node that is learned from; drift: of dead reckoning [rad]
    lost_m: standard deviation from which on there is no edge
    hold_m: how far beyond the last place seen the edge is held
    lean_sd: scale of the prior of leans, aside per height [1]; shape_alike: nodes that show a lean alike
    misfit: deviation of the feet of a side that leans, per metre that its top is aside of them [1], as no
    side is a plane (0.2 on drawn cases); height_sd: scale of an upright crop's height, of the usual [1]
    row_seen: amplitude of the rows' first harmonic at which they count half [1]
    delay: way into the crop until half a spot is covered, of the mean free path, where stops scatter as those
    of a Poisson process [1]
    reference_m: where ahead of the knife the edge is told
    slip_percent: by which the wheels turn faster than the ground passes; crab: side slip per side slope
    """

    search_m: Annotated[float, Gt(0.1), Le(10)] = 1.5
    begin_nat: Annotated[float, Ge(0)] = 20.0
    denser: Annotated[float, Ge(1)] = 2.0
    begin_m: Annotated[float, Gt(0)] = 1.2
    bend_noise: Annotated[float, Gt(0)] = 0.006
    turn_noise: Annotated[float, Gt(0)] = 0.004
    bend_sd: Annotated[float, Gt(0)] = 0.02
    turn_sd: Annotated[float, Gt(0)] = 0.1
    tooth_m: Annotated[float, Gt(0)] = 1.0
    tooth_sd_m: Annotated[float, Gt(0)] = 0.012
    tooth_first_m: Annotated[float, Gt(0)] = 0.12
    memory_m: Annotated[float, Gt(0)] = 8.0
    hole: Annotated[float, Gt(0), Le(1)] = 0.01
    hole_ends: Annotated[float, Gt(0), Le(1)] = 0.1
    apart_m: Annotated[float, Gt(0)] = 0.18
    wall_stays: Annotated[float, Gt(0), Le(1)] = 0.88
    wall_none: Annotated[float, Gt(0), Le(1)] = 0.02
    wall_step_m: Annotated[float, Gt(0)] = 0.05
    prior_m: Annotated[float, Gt(0)] = 0.3
    least: Annotated[float, Gt(0)] = 0.03
    bend_tail: Annotated[float, Gt(0)] = 4.0
    over_first: Annotated[float, Ge(1)] = 16.0
    clear_m: Annotated[float, Gt(0)] = 0.5
    drift: Annotated[float, Ge(0)] = 0.003
    lost_m: Annotated[float, Gt(0)] = 0.6
    hold_m: Annotated[float, Ge(0), Le(20)] = 5.0
    lean_sd: Annotated[float, Gt(0)] = 0.1
    shape_alike: Annotated[float, Gt(0)] = 10.0
    height_sd: Annotated[float, Gt(0)] = 0.05
    row_seen: Annotated[float, Gt(0)] = 0.25
    delay: Annotated[float, Ge(0)] = 1.5
    misfit: Annotated[float, Ge(0)] = 0.2
    reference_m: Annotated[float, Ge(0), Le(20)] = 1.5
    slip_percent: Annotated[float, Ge(0), Le(50)] = 3.0
    crab: Annotated[float, Ge(0), Le(1)] = CRAB


OTHERS = ("reference_m", "slip_percent", "crab")  # parameters that are none of the `Numbers` of filter.cpp


class EdgeFilter(KeepsState):
    """Scan, odometry and, where there is one, an inertial unit in; crop edge out."""

    kept = ("_time", "_saved", "_inclination", "_yaw_rate", "_silent")
    inputs = (
        Port("scan", Scan, unit="m", shape=(None,)),
        Port("odometry", Odometry),
        Port("inertial", Inertial, history=True, optional=True),
    )
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._p, self._sign, self._mount = params, crop_sign(setup.edge_side), setup.mounting
        knife, end_y = setup.machine.header_end(setup.edge_side)
        self._reference = knife + params.reference_m
        usual = setup.crop_height or USUAL
        x, y, z = self._mount.position.tolist()
        self._setup = np.array(
            [x, self._sign * y, z, self._reference, self._sign * end_y, usual, float(setup.crop_height > 0.0),
             (TOP * usual - LOWEST) / LAYERS, LOWEST, setup.row_spacing]
        )  # fmt: skip
        self._numbers = np.array([getattr(params, f.name) for f in fields(params) if f.name not in OTHERS])
        self._inclination = Inclination(setup.mountings.get("inertial"))
        self._yaw_rate = YawRate(setup.machine.wheelbase, setup.mountings.get("inertial"))
        self._silent = SilentBeams()
        self._state, self._grids = np.zeros((1, STATE)), np.zeros((1, GRIDS), np.float32)
        self._given, self._told = np.zeros((1, 8)), np.zeros((1, 10))
        self._room = -1
        self._beams: tuple[Any, ...] = ()
        self._count = 0
        self._launch: Any = None
        self._forget()

    def _forget(self) -> None:
        self._time = 0
        self._state[:] = 0.0
        self._grids[:] = 0.0
        self._inclination.clear()
        self._yaw_rate.clear()
        self._silent.clear()

    @property
    def _saved(self) -> Any:
        return self._state.copy(), self._grids.copy()

    @_saved.setter
    def _saved(self, saved: Any) -> None:
        self._state[:], self._grids[:] = saved
        self._beams = ()

    def reset(self, stream: Stream) -> Outputs:
        """No edge at t = 0: nothing was seen yet."""
        self._forget()
        return {"edge": no_edge(0, self._reference)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take a new scan, if there is one, and tell the edge in the machine frame of t + dt."""
        scan, odometry, inertial = inputs["scan"], inputs["odometry"], inputs.get("inertial")
        speed = finite(odometry.speed) / (1.0 + PERCENT * self._p.slip_percent)
        rate = self._sign * finite(self._yaw_rate.of(odometry, inertial, dt / NS))
        self._inclination.take(inertial, speed)
        seconds, is_new = 0.0, scan is not None and scan.t > self._time
        if is_new:
            seconds, self._time = min((scan.t - self._time) / NS, 1.0), scan.t
            self._point(scan)
        age = (t + dt - self._time) / NS
        if age > LATE or self._launch is None:
            return {"edge": no_edge(t + dt, self._reference)}
        # both per side of the machine: > 0 toward the crop
        crab = self._sign * self._inclination.crab(self._p.crab, self._sign * speed * rate)
        rise = self._sign * self._inclination.rise[1] if self._inclination.is_known else 0.0
        self._given[0] = seconds, age, speed, rate, crab, rise, self._count, float(is_new)
        self._launch()
        return {"edge": self._as_edge(t + dt, self._told[0].tolist())}

    def _point(self, scan: Scan) -> None:
        """Directions and times of the beams that answer, where they are not those before, and the ranges."""
        beams = scan.azimuth, scan.elevation, scan.beam_t
        if scan.ranges.size and self._silent.take(scan.ranges[:, 0] > 0.0):
            self._beams = ()
        if len(self._beams) != 3 or not all(a is b for a, b in zip(beams, self._beams, strict=True)):
            self._beams = beams
            self._good = np.isfinite(scan.azimuth) & np.isfinite(scan.elevation)
            if len(self._silent.is_dead) == len(self._good):
                self._good &= ~self._silent.is_dead
            self._count = int(np.count_nonzero(self._good))
            if self._count > self._room:
                self._compile(self._count)
            aim = self._mount.turn(beam_directions(scan.azimuth[self._good], scan.elevation[self._good]))
            self._aim[0, : 3 * self._count] = (aim * [1.0, self._sign, 1.0]).ravel()
            self._ago[0, : self._count] = np.clip(np.nan_to_num(scan.beam_t[self._good]), -0.5, 0.0)
        self._ranges[0, : self._count] = scan.ranges[self._good, 0] if scan.ranges.size else np.nan

    def _compile(self, room: int) -> None:
        from swath.control.edge import filter_kernel as kernel

        wp = start_warp()
        self._room = room
        self._aim, self._ago, self._ranges = np.zeros((1, 3 * room)), np.zeros((1, room)), np.zeros((1, room))
        arrays = (
            self._given, self._setup[None], self._numbers[None],
            self._aim, self._ago, self._ranges, self._state,
        )  # fmt: skip
        self._inputs = [
            *(shared(np.ascontiguousarray(a), wp.float64) for a in arrays), shared(self._grids, wp.float32),
            shared(self._told, wp.float64),
        ]  # fmt: skip
        self._launch = repeatable(kernel.filter_edges, self._inputs).launch

    def _as_edge(self, now: int, told: Sequence[float]) -> CropEdge:
        is_found, offset, heading, bend, sure, height, sd, heading_sd, seen_to, is_held = told
        if not is_found:
            return no_edge(now, self._reference)
        sign = self._sign
        return CropEdge(
            now, sign * offset, sign * heading, sign * bend, self._reference, min(max(sure, 0.01), 1.0),
            height, float("nan"), offset_sd=sd, heading_sd=heading_sd, seen_to=seen_to, is_held=is_held > 0.0,
        )  # fmt: skip


LEVEL = Level(
    EdgeFilter,
    Params,
    summary="one Bayes filter: line, teeth and holes along the way, densities learned per height",
    cost="0.1 ms per scan",
    tolerance="offset within 0.08 m RMS of the true edge at 500 stems/m2",
)
