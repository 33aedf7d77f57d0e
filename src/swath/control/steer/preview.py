"""Preview steering of a rear-steered machine: the header end follows the crop edge.

The reference point O is the middle of the fixed axle, kappa = psi' / v there. The header end E lies at (a, b)
in the machine frame, a = knife ahead of the axle, b = +-half the header. E moves with
v (1 - b kappa, a kappa): its direction deviates from the heading by beta = atan2(a kappa, 1 - b kappa).

Let e be the lateral distance from E to its target line (the edge, moved out of the crop by the overlap) and
theta the direction of that line abreast of E. The law aims E at the point of the target's tangent that lies
the preview distance d ahead of it,

    beta = theta + atan(e / d) + slip,   kappa = tan(beta) / (a + b tan(beta)).

Then de/ds = -sin(atan(e / d)): the error dies out over the distance d without overshoot, and the heading
settles over the length a by itself (a point ahead of the fixed axle is minimum phase). In a bend of any
curvature e = 0 is an equilibrium, because theta grows until beta equals it: the curvature of the edge is
needed only to look across the time the steering takes. Pure pursuit from the axle,
kappa = 2 (e + d theta) / d^2, is the same law with other weights; it overshoots by a fifth when a = d and
cuts bends by kappa d^2 / 2 (docs/explanation/steering.md).

All this holds in the frame in which the machine will stand when the command has taken hold (dead time and
lag), and the slip of the machine on slopes is observed. The law itself is `preview_kernel.steer`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import tan
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.compiled import Compiled
from swath.control.inclination import CRAB, Inclination
from swath.control.inertial_memory import AllInertial
from swath.control.steer.plant_model import PREVIEW, SLIP_LIMIT, ActuatorModel, Learns, SlipObserver
from swath.control.yaw_rate import no_bias
from swath.core.component import Port
from swath.core.random import Stream
from swath.core.registry import Checked, Level
from swath.core.rows import row_of
from swath.core.together import InWorlds, KeepsRows, Samples
from swath.core.units import CM, DEG
from swath.kernels import Repeated, Rows, shared
from swath.signals import CropEdge, Inertial, Odometry, SteerCommand
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params(Learns):
    """The preview law.

    overlap_m: how far the header end is kept outside the crop
    lookahead_m: least preview distance d, which is the greater of lookahead_m and lookahead_s times speed
    lookahead_s: preview distance over speed
    approach_deg: steepest angle at which a far edge is approached
    crab: side slip that is expected, per side slope or lateral acceleration in g [1]
    hold_s: time for which the last curvature is held after the edge is lost; then the law lets go, the wheels
        stay where they are and a person must steer
    engage_s: time to blend in when an edge is found
    """

    overlap_m: Annotated[float, Ge(-1), Le(3)] = 0.10
    lookahead_m: Annotated[float, Gt(0.5), Le(30)] = 4.0
    lookahead_s: Annotated[float, Ge(0), Le(10)] = 2.0
    approach_deg: Annotated[float, Gt(0), Le(45)] = 12.0
    crab: Annotated[float, Ge(0), Le(1)] = CRAB
    hold_s: Annotated[float, Ge(0), Le(10)] = 1.0
    engage_s: Annotated[float, Ge(0), Le(10)] = 0.5


class Preview(InWorlds):
    """The header end is aimed along the edge, with prediction over the delay and a slip observer.

    law: which of the kernel's laws aims it
    """

    law: ClassVar[int] = PREVIEW

    inputs = (
        Port("edge", CropEdge),
        Port("odometry", Odometry),
        Port("inertial", Inertial, history=True, optional=True),
    )
    outputs = (Port("command", SteerCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        machine, mounting, p = setup.machine, setup.mountings.get("inertial"), params
        self.overlap = p.overlap_m
        self._end = machine.header_end(setup.edge_side)
        self._outward = p.overlap_m if setup.edge_side == "left" else -p.overlap_m
        limit = tan(p.share_of_lock * machine.max_steer) / machine.wheelbase
        rate = p.rate_deg_s * DEG / machine.wheelbase
        self.numbers = (
            *(float(self.law), *self._end, self._outward, machine.wheelbase, limit, rate),
            *(p.lookahead_m, p.lookahead_s, p.approach_deg * DEG, p.crab, p.hold_s, p.engage_s),
            *ActuatorModel(p.dead_time_s, p.lag_s, setup.period, p.trim_m).numbers,
            *SlipObserver(p.slip_m, p.slip_step_cm * CM, SLIP_LIMIT).numbers,
        )  # in the order of `preview_kernel.Law`
        self.memories = Inclination(mounting).numbers, no_bias(machine.wheelbase, mounting)

    @classmethod
    def together(cls, parts: Sequence["Preview"]) -> "Steerers":
        """Make one object that steps these parts of many worlds together."""
        return Steerers(parts)

    def beside(self, edge: CropEdge) -> float:
        """How far to the left the machine is led [m] by the edge where it is reported."""
        return edge.offset + self._outward - self._end[1]

    def was_commanded(self, curvature: float) -> None:
        """What really went out last [1/m], where another law may have had its way."""
        steerers: Any = self.alone
        steerers.commanded(0, curvature)


class Steerers(KeepsRows, Compiled):
    """The parts of many worlds, stepped together."""

    kept = ("_states", "_pending", "_upward", "_turning")

    reads: ClassVar = {"edge": CropEdge, "odometry": Odometry}
    hears: ClassVar = {"inertial": Inertial}

    def __init__(self, parts: Sequence[Preview]) -> None:
        from swath.control.steer import preview_kernel as kernel

        n = len(parts)
        super().__init__(n, {"command": row_of(SteerCommand, n)})
        self._parts, self._laws = parts, Rows(kernel.Law, n, [part.numbers for part in parts])
        self._states, self._edges = Rows(kernel.State, n), Rows(kernel.Edge, n)
        self._asked, self._odometry = np.zeros(3), np.zeros((n, 3))
        self._upward, self._turning = AllInertial(n), AllInertial(n)
        self._pending = np.zeros((n, int(self._laws.of["pending"].max())))

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Straight ahead, not engaged, until an edge is seen."""
        self._states.clear()
        self._states.of["lost"][:], self._states.of["error"][:] = np.inf, np.nan
        self._pending[:] = 0.0
        for world, part in enumerate(self._parts):
            for memory, own in zip((self._upward, self._turning), part.memories, strict=True):
                memory.load(world, own)
        self.sent["command"].memory[:] = 0
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """What is read into the memories, then the law."""
        from swath.control.steer import preview_kernel as kernel

        edges = (
            [self.column("edge", name) for name in EDGE]
            if "edge" in self.given
            else [shared(np.zeros(1))] * 6
        )
        measured = [self.column("odometry", name) for name in ("speed", "yaw_rate", "steer_angle")]
        stamp = self.given["edge"].stamp if "edge" in self.given else np.full(1, NEVER)
        own = [shared(self._asked), shared(self._odometry), self._edges.array]
        gather = [shared(self.clock), shared(stamp), *edges, *measured, *own]
        trail = self.heard.get("inertial")
        memories = [] if trail is None else [memory.launch(trail) for memory in (self._upward, self._turning)]
        rows = map(shared, (self._upward.rows, self._turning.rows, self._pending))
        command = map(shared, self.sent["command"].arrays.values())
        law = [self._laws.array, *own, *rows, self._states.array, *command]
        return [
            self.launch(kernel.gather, *gather),
            *memories,
            self.launch(kernel.steer, *law),
        ]

    def commanded(self, world: int, curvature: float) -> None:
        """As `Preview.was_commanded`."""
        self._states.of["command"][world] = curvature


EDGE = (
    "offset",
    "heading",
    "curvature",
    "reference_x",
    "confidence",
    "offset_sd",
)  # as `preview_kernel.Edge` has them
NEVER = -1  # time of an edge where there is none


BENCH = "tests/control/test_preview.py"  # of a kinematic machine, against the line
LEVEL = Level(
    Preview,
    Params,
    summary="the header end is aimed along the edge: preview, prediction, slip observer",
    cost="about 20 us per step",
    tolerance="2 cm RMS at 7 km/h on a straight edge known to 3 cm",
    checked=(
        Checked("ground_speed_kmh", 0.18, 12.6, BENCH, "truth"),
        Checked("yaw_rate_deg_s", -5.0, 5.0, BENCH, "truth"),
        Checked("slope_across_percent", -9.0, 9.0, BENCH, "truth"),
    ),
)
