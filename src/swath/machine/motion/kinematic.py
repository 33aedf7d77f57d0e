"""Motion level `kinematic`: wheels roll where they point. Exact circular arcs.

With the fixed axle as reference and the steered axle a distance L behind it: yaw rate = v tan(steer) / L
(steer > 0 turns left; the rear wheel itself then points right). Turning costs no side slip: see
docs/explanation/machine.md for what that hides. On a slope the wheels slip as in the other levels, along and
across, behind by the relaxation lengths: both axles drift alike, so it crabs downhill and keeps its heading.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Port, State
from swath.core.errors import InputError, SwathError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Given, InWorlds, Samples
from swath.core.units import KMH
from swath.field.site_setup import SiteSetup
from swath.kernels import Rows, filled, of_worlds, repeatable, shared
from swath.machine.attitude import TerrainFollower
from swath.machine.machine_sheet import dynamics_of
from swath.machine.motion import CHECKED
from swath.machine.towing import ports_of, refuse_reverse, towed_by
from swath.machine.traction import Traction, across_of, traction_of
from swath.signals import EngineState, HeapState, MachineState, SpeedCommand, SteerState
from swath.signals.setup import MachineGeometry


@dataclass(frozen=True)
class Params:
    """start_speed_kmh: speed at t = 0."""

    start_speed_kmh: Annotated[float, Ge(0), Le(40)] = 0.0


class Kinematic(InWorlds):
    """A vehicle, its trailer behind it. The steering angle is held over a step."""

    inputs = (
        Port("steering", SteerState),
        Port("speed", SpeedCommand),
        Port("drive", EngineState, optional=True),
        Port("cargo", HeapState, optional=True),
    )

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.machine, start = setup.machine, setup.start
        self.follower = TerrainFollower(setup.field, setup.machine)
        self.start = float(start.position[0]), float(start.position[1]), start.euler()[2]
        self.start_speed = params.start_speed_kmh * KMH
        self.towed = towed_by(setup)
        self.outputs = ports_of(self.towed)

    @classmethod
    def together(cls, parts: Sequence["Kinematic"]) -> "Vehicles":
        """All of them."""
        return Vehicles(parts)


class Vehicles:
    """The machines of many worlds."""

    def __init__(self, parts: Sequence[Kinematic]) -> None:
        from swath.machine.motion import kinematic_kernel as kernel
        from swath.machine.motion.single_track_kernel import Track
        from swath.machine.motion.single_track_step_kernel import Stand

        n = len(parts)
        self._parts, self.errors = parts, dict[int, SwathError]()
        self._towing = [(world, part.towed) for world, part in enumerate(parts) if part.towed is not None]
        self._tracks, self._stands = Rows(Track, n), Rows(Stand, n)
        self._asked, self._states = np.zeros((n, 3)), np.zeros((n, 17))
        self._vehicles = of_worlds(kernel.Vehicle, [_vehicle(kernel, part.machine) for part in parts])
        grounds = [_ground(kernel.Ground, part) for part in parts]
        self._held, self._grounds = grounds, of_worlds(kernel.Ground, grounds)
        self._rows = self._grounds.numpy()
        asked, moving = shared(self._asked), [self._tracks.array, self._stands.array]
        self._keeps = asked, shared(self._states)
        names = ("speed", "lateral_speed", "yaw_rate", "steer_angle", "distance")
        arrays = {"pose": self._states[:, :12]} | {n: self._states[:, 12 + k] for k, n in enumerate(names)}
        self._sent = Samples(MachineState, 0, arrays, memory=self._states)
        self._drive = repeatable(kernel.drive_arcs, [self._vehicles, asked, *moving], threads=n)
        inputs = [self._grounds, self._vehicles, asked, *moving, self._keeps[1]]
        self._stand = repeatable(kernel.stand_on, inputs, threads=n)

    def reset(self, streams: Sequence[Stream]) -> dict[str, Samples]:
        """Stand at the start pose."""
        self._tracks.clear()
        self._stands.clear()
        self._asked[:] = 0.0
        for name, values in zip(
            ("x", "y", "yaw"), zip(*(p.start for p in self._parts), strict=True), strict=True
        ):
            self._tracks.of[name][:] = values
        speed = [part.start_speed for part in self._parts]
        self._stands.of["speed"][:] = self._stands.of["rim"][:] = speed
        for part in self._parts:
            if part.towed is not None:
                part.towed.place(*part.start)
        return self._samples(0)

    def step(self, t: int, dt: int, inputs: Given) -> dict[str, Samples]:
        """Drive one arc."""
        steer, wanted, drive = inputs["steering"], inputs["speed"].arrays["speed"], inputs.get("drive")
        if drive is not None:
            limit = drive.arrays["speed_limit"]
            wanted = np.minimum(np.maximum(wanted, -limit), limit)
        is_finite = np.isfinite(wanted)
        for world in () if is_finite.all() else np.flatnonzero(~is_finite).tolist():
            self.errors[world] = InputError("speed command", float(wanted[world]), "expected a finite speed")
        self._asked[:, 0], self._asked[:, 1], self._asked[:, 2] = steer.arrays["angle"], wanted, dt / NS
        self._drive.launch()
        for world, towed in self._towing:
            refuse_reverse(float(wanted[world]))
            cargo = inputs.get("cargo")
            towed.carry(None if cargo is None else cargo.of(world))
            towed.follow(*self._place(world))
        return self._samples(t + dt)

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        towed = self._parts[world].towed
        return {
            "track": self._tracks.save(world),
            "stand": self._stands.save(world),
            "towed": None if towed is None else towed.save(),
        }

    def load(self, world: int, state: State) -> None:
        """Back to a saved moment."""
        self._tracks.load(world, state["track"])
        self._stands.load(world, state["stand"])
        towed = self._parts[world].towed
        if towed is not None:
            towed.load(state["towed"])

    def _place(self, world: int) -> tuple[float, float, float]:
        of = self._tracks.of
        return float(of["x"][world]), float(of["y"][world]), float(of["yaw"][world])

    def _samples(self, t: int) -> dict[str, Samples]:
        self._stand.launch()
        done = self._stands.of["is_done"]
        missing = [] if done.all() else np.flatnonzero(done == 0.0).tolist()
        for world in missing:
            try:
                self._parts[world].follower.footprint.take(*self._place(world))
            except SwathError as error:
                self.errors[world] = error
                continue
            self._held[world] = _ground(self._ground_of(), self._parts[world])
            self._rows[world] = self._held[world].numpy_value()
        if missing:
            self._stand.launch()
        self._sent.t = t
        found = {"state": self._sent}
        trailers = [
            towed.state(t, Pose.of_numbers(*_numbers(self._states[world])), self._place(world)[2])
            for world, towed in self._towing
        ]
        if trailers:
            found["trailer"] = Samples.joined(trailers)
        return found

    @staticmethod
    def _ground_of() -> Any:
        from swath.machine.motion.kinematic_kernel import Ground

        return Ground


def _ground(struct: Any, part: Kinematic) -> Any:
    nodes, first, points, span = part.follower.footprint.arguments()
    return filled(struct, nodes=nodes, first=first, points=points, span=span)


def _vehicle(kernel: Any, machine: MachineGeometry) -> Any:
    d = dynamics_of(machine)
    loop = filled(
        kernel.Loop,
        lag=d.speed_lag,
        accel=d.accel,
        decel=d.decel,
        fastest=d.max_speed,
        wheelbase=-machine.steered_x,
        front_track=machine.front_track,
        rear_track=machine.rear_track,
        sense=1.0,
    )
    along, across = (filled(kernel.Car, **_wheels(of(machine))) for of in (traction_of, across_of))
    return filled(
        kernel.Vehicle,
        along=along,
        across=across,
        loop=loop,
        wheelbase=machine.wheelbase,
        rear_share=d.cg_behind / abs(machine.wheelbase),
    )


def _wheels(of: Traction) -> dict[str, float]:
    return {
        "along_stiffness": of.stiffness,
        "along_friction": of.friction,
        "along_relaxation": of.relaxation,
        "thrust": of.thrust,
        "level_share": of.level_share,
        "grade_share": of.grade_share,
    }


def _numbers(row: Any) -> tuple[list[float], list[list[float]]]:
    x, y, z, a, b, c, d, e, f, g, h, i = row[:12].tolist()
    return [x, y, z], [[a, b, c], [d, e, f], [g, h, i]]


LEVEL = Level(
    Kinematic,
    Params,
    summary="rolls where the wheels point, slips on slopes, on the terrain",
    cost="about 20 us per step, 8 us in a batch of worlds",
    tolerance="against multibody up to 2.5 m/s: yaw gain 1.8 to 4 % high, offset after 30 deg -3 to +21 %",
    checked=CHECKED,
)
