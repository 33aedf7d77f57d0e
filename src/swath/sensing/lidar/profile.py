"""LiDAR level `profile`: the beams of `empirical` over the field as profiles along the edge.

Table, draws and the way of a beam through crop are those of `empirical`, in the same native code with the
same random numbers. What it looks at is `field/profile.py`: the ground and the stand once a metre along the
edge, the standing crop every 5 cm, cut by the header of the same level. It is for many runs at once.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swath.core.component import Outputs, State
from swath.core.errors import InputError, SwathError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.together import Given, InWorlds, Samples
from swath.field.profile import refused
from swath.field.site_setup import SiteSetup
from swath.field.solids import solid_count
from swath.kernels import filled as made
from swath.kernels import of_worlds, repeatable, shared
from swath.rays.bodies import pack_canopy
from swath.rays.single.buffers import CLAMPED, MISPLACED
from swath.sensing.lidar.empirical import CHECKED, Params, TableLidar
from swath.sensing.sweep import ROOM
from swath.signals import F64, Scan, ScanTruth

AHEAD = 48.0  # ground is laid so much farther than beams reach, half of it for where the scanner sits [m]


class ProfileLidar(InWorlds, TableLidar):
    """Scans profiles with a moving scanner."""

    level = "profile"

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        if not params.weather.is_clear:
            raise refused("weather")
        if setup.edge is None:
            raise refused("field without an edge")
        self.profile = setup.field.profiled(setup.edge)

    @classmethod
    def together(cls, parts: Sequence["ProfileLidar"]) -> "Scanners":
        """All of them."""
        return Scanners(parts)

    @property
    def goes_with(self) -> tuple[bytes, ...]:
        """The times and directions of its beams."""
        return tuple(np.asarray(a).tobytes() for a in (self.scanner.beam_t, self.azimuth, self.elevation))

    def begin(self, stream: Stream) -> Outputs:
        """An empty scan. InputError where something stands in sight."""
        if solid_count(self.setup.solids()):
            raise refused("thing in sight of its own scanner: obstacles, other machines, a body from a file")
        return TableLidar.reset(self, stream)

    def rise(self, places: tuple[F64, F64], steps: tuple[F64, F64]) -> F64:
        """Of the ground that beams meet here."""
        return self.profile.rise(places, steps)

    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A sweep is made from the states of the machine alone."""
        raise refused("scan from a place of its own")


class Scanners:
    """The scanners of many worlds."""

    def __init__(self, parts: Sequence[ProfileLidar]) -> None:
        self._parts, self.errors = parts, dict[int, SwathError]()
        n, room = len(parts), len(parts[0].rays.beams.distance)
        self._count = len(parts[0].azimuth)
        self._ranges, self._intensity = (np.zeros((n, room, 1), np.float32) for _ in range(2))
        self._points, self._origins = np.zeros((n, room, 1, 3)), np.zeros((n, room, 3))
        self._words = np.zeros((n, 3), np.uint64)
        self._states, self._asked = np.zeros((n, ROOM, 13)), np.zeros(2)
        self._stations = np.zeros(n, np.int32)
        self._reach = AHEAD + max(part.scanner.reach for part in parts)
        self._laid_at = np.full((n, 2), np.nan)  # around where the ground was laid [m]
        self._flags = np.zeros((n, 1), np.int32)
        self._last: Samples | None = None
        self._launch: Any = None
        self._swinging = [part for part in parts if part.scanner.noise.angle != 0.0]
        self._looked_at: list[int] = []  # worlds whose ranges their scanner looks at

    def reset(self, streams: Sequence[Stream]) -> dict[str, Samples]:
        """Empty scans."""
        self._last, self._looked_at = None, list(range(len(self._parts)))
        self._stations[:] = 0
        first = self._parts[0].rays
        for world, (part, stream) in enumerate(zip(self._parts, streams, strict=True)):
            part.rays.lie_in(
                *(a[world] for a in (self._ranges, self._intensity, self._points, self._origins)),
                words=self._words[world],
                flags=self._flags[world],
                first=first,
            )
            part.begin(stream)
            part.rays.aims_as(first)
        self._prepare()
        self._laid_at[:] = np.nan
        for array in (self._ranges, self._intensity, self._points, self._origins):
            array[:] = np.nan
        found = self._samples(0)
        return found

    def step(self, t: int, dt: int, inputs: Given) -> dict[str, Samples]:
        """The sweeps that end at t + dt, every beam from where the sensor was at its own time."""
        new: tuple[Samples, ...] = inputs["state"]
        states = new if self._last is None else (self._last, *new)
        if new:
            self._last = new[-1]
        if len(states) > ROOM:
            states = tuple(states[round(k)] for k in np.linspace(0, len(states) - 1, ROOM))
        for k, state in enumerate(states):
            self._states[:, k, 0] = state.t
            self._states[:, k, 1:] = state.arrays["pose"]
        self._lay(len(states))
        end = t + dt
        self._asked[:] = end, len(states)
        self._words[:, 2] = end
        for part in self._parts:
            part.ray_count += self._count
        for part in self._swinging:
            part.rays.swing(end)
        self._launch.launch()
        for world in np.flatnonzero(self._flags[:, 0]).tolist():
            found = self._parts[world].rays.beams.take_flags()
            if found & MISPLACED:
                self.errors[world] = InputError("origin", None, "expected a scanner above the ground")
            self._parts[world].note(found >> CLAMPED)
        return self._samples(end)

    def save(self, world: int) -> State:
        """Where a scanner was last, and what it noted."""
        last = None if self._last is None else self._last.of(world)
        part = self._parts[world]
        return {**TableLidar.save(part), "last": last, "station": int(self._stations[world])}

    def load(self, world: int, state: State) -> None:
        """Back to it."""
        TableLidar.load(self._parts[world], state)
        self._stations[world], self._looked_at = state["station"], list(range(len(self._parts)))
        if state["last"] is None:
            self._last = None
        elif self._last is None or len(self._parts) == 1:
            self._last = Samples.joined([state["last"]] * len(self._parts))
        else:
            self._last = self._last.copy()
            for name, array in Samples.joined([state["last"]]).arrays.items():
                self._last.arrays[name][world] = array[0]

    def _lay(self, states: int) -> None:
        """The ground in reach of all scanners, from these states of the machines."""
        x, y = self._states[:, :states, 1:3].transpose(2, 0, 1)
        gone = np.hypot(x - self._laid_at[:, :1], y - self._laid_at[:, 1:]).max(axis=1, initial=0.0)
        for world in np.flatnonzero(~(gone < 0.5 * AHEAD)).tolist():
            for place in ((x[world, 0], y[world, 0]), (x[world, -1], y[world, -1])):
                self._parts[world].profile.lay_around(*place, self._reach)
            self._laid_at[world] = x[world, -1], y[world, -1]

    def _prepare(self) -> None:
        """One launch for all, over memory that stays."""
        from swath.field.profile_kernel import Profile
        from swath.rays.single.kernel import Beams, Canopy
        from swath.sensing.native import profile_kernel as kernel
        from swath.sensing.native.kernel import Aiming, Electronics

        packed: dict[Any, Any] = {}
        alike: dict[bytes, Any] = {}  # arrays that are the same in many worlds
        held: list[list[Any]] = [[] for _ in range(7)]
        for world, part in enumerate(self._parts):
            about = id(part.table), *part.beam.values(), *_of_library(part)
            if about not in packed:
                packed[about] = pack_canopy(part.table, part.setup.field, **part.beam)
            sweep = made(
                kernel.Sweep,
                mounting=np.concatenate([part.mounting.position, part.mounting.rotation.ravel()]),
                beam_t=_of_all(alike, np.array(part.scanner.beam_t)),
                apart=_of_all(alike, _padded(part.apart, len(part.rays.beams.score))),
                lines=part.scanner.line_count,
                reach=part.scanner.reach,
                origins=self._origins[world].reshape(-1),
                rotations=part.rays.rotations.reshape(-1),
            )
            states = made(kernel.States, rows=self._states[world].reshape(-1))
            rays = part.rays
            each = (
                *(sweep, states, rays.aiming(), part.profile.struct(), packed[about], rays.beams.struct()),
                rays.electronics(),
            )
            for structs, struct in zip(held, each, strict=True):
                structs.append(struct)
        kinds = (
            *(kernel.Sweep, kernel.States, Aiming, Profile, Canopy),
            *(Beams, Electronics),
        )
        sweeps, states, *more = (of_worlds(kind, own) for kind, own in zip(kinds, held, strict=True))
        self._held = held, [sweeps, states, shared(self._asked), *more, shared(self._stations)]
        self._launch = repeatable(kernel.scan_profiles, self._held[1], threads=len(self._parts))

    def _samples(self, t: int) -> dict[str, Samples]:
        n = self._count
        ranges, points = self._ranges[:, :n], self._points[:, :n]
        intensity, origins = self._intensity[:, :n], self._origins[:, :n]
        for world in self._looked_at:
            lost = self._parts[world].scanner.seen(t, ranges[world])
            if lost is not None and t > 0:
                ranges[world, lost], intensity[world, lost], points[world, lost] = np.nan, np.nan, np.nan
        self._looked_at = [world for world in self._looked_at if self._parts[world].scanner.looks]
        first = self._parts[0]
        alike = {"beam_t": first.scanner.beam_t, "azimuth": first.azimuth, "elevation": first.elevation}
        return {
            "scan": Samples(Scan, t, {"ranges": ranges, "intensity": intensity}, alike),
            "truth": Samples(ScanTruth, t, {"points": points, "sensor_position": origins}),
        }


def _of_library(part: ProfileLidar) -> tuple[float, float]:
    library = part.setup.field.library
    return library.row_spacing, library.density_max


def _of_all(known: dict[bytes, Any], array: Any) -> Any:
    return known.setdefault(array.tobytes(), array)


def _padded(apart: F64, room: int) -> Any:
    found = np.zeros(room, np.float32)
    found[: len(apart)] = apart
    return found


LEVEL = Level(
    ProfileLidar,
    Params,
    "the beams of empirical over profiles along the edge, for many runs at once",
    cost="1/2 of empirical in one run; for batches see docs/explanation/kernels.md",
    tolerance="heights against empirical: Wasserstein-1 1.5 cm at crop, edge and stubble",
    checked=CHECKED,
)
