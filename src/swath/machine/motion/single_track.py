"""Motion level `single_track`: side slip, tyre lag and side slopes.

One tyre per axle; lateral speed of the centre of gravity and yaw rate as in the textbooks; forward speed from
the drive's closed loop. Equations, signs and validation: docs/explanation/machine.md.
"""

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from math import ceil
from typing import Annotated, Any

from annotated_types import Ge, Le

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG_PER_G, KMH, MS
from swath.field.footprint import Footprint
from swath.field.site_setup import SiteSetup
from swath.kernels import Row, repeatable
from swath.machine.attitude import TerrainFollower
from swath.machine.loops import SpeedLoop, within_drive
from swath.machine.machine_sheet import Dynamics, MachineSheet, dynamics_of, loaded
from swath.machine.motion import CHECKED
from swath.machine.towing import ports_of, tow, towed_by, with_trailer
from swath.machine.traction import DrivenWheels, check_wheel_slip, pull, traction_of, wheels_of
from swath.machine.tyre import GRAVITY, axle_stiffness
from swath.signals import (
    EngineState,
    HeapState,
    MachineLoad,
    MachineState,
    SpeedCommand,
    SteerState,
    WheelState,
)

GRAIN_STEP = 1.0  # the mass follows the tank in steps of this [kg]


@dataclass(frozen=True)
class Params:
    """What is left out comes from the machine's sheet.

    stiffness_per_rad: cornering stiffness over load; understeer_deg_per_g: front axle more compliant than the
    rear one (> 0) or less; friction: largest side force over load;
    rolling_resistance: over load; start_speed_kmh: speed at t = 0; substep_ms: longest integration step
    wheel_slip: say what the driven wheels pull and slip, for odometry; the machine itself drives as without
    """

    stiffness_per_rad: Annotated[float, Ge(0.5), Le(20)] | None = None
    understeer_deg_per_g: Annotated[float, Ge(-20), Le(20)] | None = None
    friction: Annotated[float, Ge(0.05), Le(1.5)] | None = None
    rolling_resistance: Annotated[float, Ge(0), Le(0.3)] | None = None
    start_speed_kmh: Annotated[float, Ge(0), Le(40)] = 0.0
    wheel_slip: bool = False
    substep_ms: Annotated[float, Ge(0.01), Le(20)] = 20.0


class SingleTrack:
    """Single-track model on terrain, steered behind or ahead of the fixed axle; it does not feel its trailer.

    Steering angle and slopes are held over a step. Lengths behind the fixed axle are below 0 where the
    steered axle is ahead of it; the equations are the same.
    """

    inputs = (
        Port("steering", SteerState),
        Port("speed", SpeedCommand),
        Port("drive", EngineState, optional=True),
        Port("load", MachineLoad, optional=True),
        Port("cargo", HeapState, optional=True),
    )

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        d = dynamics_of(setup.machine)
        if params.wheel_slip:
            check_wheel_slip(setup.machine)
        self._params, self._start = params, setup.start
        self._wheelbase, self._track = -setup.machine.steered_x, setup.machine.front_track
        self._sense = -1.0 if setup.machine.steers_ahead else 1.0
        self._machine, self._grain = setup.machine, 0.0
        self._carried: MachineLoad | None = None  # the newest that was looked at
        given = params.understeer_deg_per_g
        self._stiffness = axle_stiffness(
            _either(params.stiffness_per_rad, d.stiffness),
            d.understeer if given is None else given * DEG_PER_G,
            steers_ahead=setup.machine.steers_ahead,
        )
        self._friction = _either(params.friction, d.friction)
        self._rolling = _either(params.rolling_resistance, d.rolling_resistance)
        self._follower = TerrainFollower(setup.field, setup.machine)
        self._wheels = DrivenWheels(SpeedLoop(d))
        self._compile()
        self._weigh(d)
        self._dt, self._count, self._h = 0, 1, 0.0  # of the last step [ns], its substeps, their length [s]
        self._towed = towed_by(setup)
        wheels = (Port("wheels", WheelState),) if params.wheel_slip else ()
        self.outputs = (*ports_of(self._towed), *wheels)
        self._tells_more = len(self.outputs) > 1

    def reset(self, stream: Stream) -> Outputs:
        """Stand (or roll straight) at the start pose, tyres without slip."""
        self._carried = None
        self._fill(0.0)
        x, y, yaw = float(self._start.position[0]), float(self._start.position[1]), self._start.euler()[2]
        self._go_to(x, y, yaw, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._wheels.reset(self._params.start_speed_kmh * KMH)
        if self._towed is not None:
            self._towed.place(x, y, yaw)
        self._stand_there()
        state = MachineState(0, self._follower.pose(), self._wheels.speed, 0.0, 0.0, 0.0, 0.0)
        return self._outputs(state, yaw, 0.0) if self._tells_more else {"state": state}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Integrate over dt in equal substeps."""
        load = inputs.get("load")
        if load is not None and load is not self._carried:
            self._carry(load)
        steer: float = inputs["steering"].angle
        wanted = within_drive(inputs["speed"].speed, inputs.get("drive"))
        if dt != self._dt:
            self._dt = dt
            self._count = max(1, ceil(dt / NS / (self._params.substep_ms * MS) - 1e-9))
            self._h = dt / NS / self._count
        before = self._wheels.speed
        state = self._drive_on(t + dt, steer, wanted) or self._drive_in_python(t + dt, steer, wanted)
        if not self._tells_more:
            return {"state": state}
        x, y, yaw, *_ = self._q.read()
        tow(self._towed, inputs, x, y, yaw)
        return self._outputs(state, yaw, (self._wheels.speed - before) / (dt / NS))

    def _drive_on(self, t: int, steer: float, wanted: float) -> MachineState | None:
        """The state at t, after all substeps in one launch; None where that cannot be done."""
        if self._whole is None:
            return None
        self._asked.write(self._count, self._h, steer, wanted)
        self._whole()
        is_done, *speeds, z, _, _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz, x, y, lateral, turn, distance = (
            self._stand.read()
        )
        if not is_done:
            return None
        w = self._wheels
        w.speed, w.rim, w.slip = speeds
        pose = Pose.of_numbers([x, y, z], [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]])
        return MachineState(t, pose, w.speed, lateral, turn, steer, distance)

    def _drive_in_python(self, t: int, steer: float, wanted: float) -> MachineState:
        """The same substeps one by one, where the ground is no lattice in memory, or not yet."""
        h, read = self._h, self._q.read
        self._follower.at(*read()[:3])
        for _ in range(self._count):
            start = self._wheels.speed
            middle, _ = self._wheels.advance(wanted, h, self._follower.stance.pitch, self._traction)
            end = self._wheels.speed
            self._drive.write(h, start, middle, end, self._sense * steer, *self._follower.stance[1:])
            self._advance()
            self._follower.at(*read()[:3])
        self._stand_there()
        _, _, _, side, turn, _, _, distance = read()
        lateral = side + self._ahead * turn
        return MachineState(t, self._follower.pose(), self._wheels.speed, lateral, turn, steer, distance)

    @property
    def axle_loads(self) -> tuple[float, float]:
        """Loads of the fixed and the steered axle in the last step [N]."""
        _, _, fixed, steered, _, _ = self._moment.read()
        return fixed, steered

    def save(self) -> State:
        """Place, heading, lateral speed of the centre of gravity, yaw rate, slips, way, speeds, grain."""
        state = dict(zip(self._q.names, self._q.read(), strict=True))
        towed = None if self._towed is None else self._towed.save()
        return {**state, "wheels": self._wheels.save(), "grain": self._grain, "towed": towed}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._carried = None
        self._wheels.load(state["wheels"])
        self._fill(state["grain"])
        self._go_to(*(state[name] for name in self._q.names))
        self._stand_there()
        if self._towed is not None:
            self._towed.load(state["towed"])

    def _compile(self) -> None:
        """Memory that is shared with the compiled step: the state `_q`, what is held, what stays."""
        from swath.machine.motion.single_track_kernel import Car, Drive, Moment, Track, advance
        from swath.machine.motion.single_track_step_kernel import Asked, Stand

        self._car, self._drive, self._moment, self._q = (Row(s) for s in (Car, Drive, Moment, Track))
        rows = self._car, self._drive, self._moment, self._q
        self._advance = repeatable(advance, [row.array for row in rows]).launch
        self._asked, self._stand = Row(Asked), Row(Stand)
        self._whole: Callable[[], Any] | None = None

    def _compile_whole(self, footprint: Footprint) -> None:
        """The launch of a whole step."""
        from swath.machine.motion.single_track_step_kernel import Loop, drive

        d, machine = dynamics_of(self._machine), self._machine
        self._loop_row = loop = Row(Loop)
        tracks = machine.front_track, machine.rear_track
        loop.write(d.speed_lag, d.accel, d.decel, d.max_speed, self._wheelbase, *tracks, self._sense)
        rows = self._car, loop, self._asked, self._moment, self._q, self._stand
        launch = repeatable(drive, [*footprint.arguments(), *(row.array for row in rows)])
        footprint.serve(launch, 0)
        self._whole = lambda: launch.launch()

    def _stand_there(self) -> None:
        """Tell the compiled step how fast the machine is, and how it stands."""
        if self._whole is None and isinstance(self._follower.footprint, Footprint):
            self._compile_whole(self._follower.footprint)
        w = self._wheels
        self._stand.write(0.0, w.speed, w.rim, w.slip, *self._follower.stance, *[0.0] * 14)

    def _go_to(self, x: float, y: float, yaw: float, *rest: float) -> None:
        self._q.write(x, y, yaw, *rest)
        self._follower.at(x, y, yaw)

    def _weigh(self, d: Dynamics) -> None:
        """Take over mass, inertia and centre of gravity."""
        self._ahead = self._sense * d.cg_behind
        self._behind = self._wheelbase - self._ahead
        wheels = d.front.radius, d.rear.radius, d.front.relaxation, d.rear.relaxation
        tyres = *self._stiffness, self._friction, self._rolling
        body = self._ahead, self._behind, d.mass, d.yaw_inertia, d.cg_height, self._track
        self._traction = traction_of(self._machine, d)
        self._car.write(*body, *wheels, *tyres, *astuple(self._traction))

    def _carry(self, load: MachineLoad) -> None:
        """Follow the tank in steps of GRAIN_STEP; the speed of the fixed axle and the turn rate go on."""
        self._carried = load
        grain = max(load.tank_grain, 0.0)
        if abs(grain - self._grain) >= GRAIN_STEP:
            before = self._ahead
            self._fill(grain)
            x, y, yaw, side, turn, *rest = self._q.read()
            self._q.write(x, y, yaw, side + (before - self._ahead) * turn, turn, *rest)

    def _fill(self, grain: float) -> None:
        """Grain [kg] in the tank, for a sheet that has one."""
        machine = self._machine
        if grain != self._grain and isinstance(machine, MachineSheet) and machine.masses is not None:
            d = dynamics_of(machine)
            self._weigh(loaded(d, machine.masses.tank, grain) if grain > 0.0 else d)
        self._grain = grain

    def _outputs(self, state: MachineState, yaw: float, accel: float) -> Outputs:
        """With the trailer and the wheels. yaw: of the machine [rad]; accel: mean of the step [m/s2]"""
        found = with_trailer(self._towed, state, yaw)
        if not self._params.wheel_slip:
            return found
        dynamics = replace(dynamics_of(self._machine), rolling_resistance=self._rolling)
        force, t = pull(state, accel, self._grain, dynamics), state.t
        load = self.axle_loads[0] if t > 0 else GRAVITY * dynamics.mass * self._behind / self._wheelbase
        return {**found, "wheels": wheels_of(t, state.speed, force, load, self._traction)}


def _either(given: float | None, sheet: float) -> float:
    return sheet if given is None else given


LEVEL = Level(
    SingleTrack,
    Params,
    summary="side slip, tyre relaxation, rolling resistance, side slopes, on the terrain",
    cost="about 18 us per step",
    tolerance="against multibody up to 2.5 m/s: yaw gain within 0.2 %, offset after 30 deg within 2.8 %",
    checked=CHECKED,
)
