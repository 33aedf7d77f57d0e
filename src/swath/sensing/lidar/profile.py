"""LiDAR level `profile`: the beams of `empirical` over the field as profiles along the edge.

Table, draws and the way of a beam through crop are those of `empirical`, in the same native code with the
same random numbers. What it looks at is `field/edges/profile.py`: the ground and the stand once a metre along
the edge, the standing crop every 5 cm, cut by the header of the same level. It is for many runs at once.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swath.core.component import Outputs, State
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.together import Samples
from swath.field.edges.profile import refused
from swath.field.site_setup import SiteSetup
from swath.field.solid.solids import solid_count
from swath.kernels import Repeated, of_worlds, repeatable, shared
from swath.kernels import filled as made
from swath.rays.bodies import pack_canopy
from swath.rays.single.buffers import CLAMPED, MISPLACED
from swath.sensing import RECEIVED
from swath.sensing.lidar.empirical import CHECKED, Params, TableLidar
from swath.sensing.lidar.sweeps import Sweeps
from swath.signals import F64

AHEAD = 48.0  # ground is laid so much farther than beams reach, half of it for where the scanner sits [m]


class ProfileLidar(TableLidar):
    """Scans profiles with a moving scanner. swept: (1,) sweeps so far."""

    level, gains = "profile", True

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.swept = np.zeros(1, np.int64)
        super().__init__(params, setup)
        weather = setup.field.weather
        if not params.weather.is_clear or (weather is not None and weather.may_be_dim):
            raise refused("weather")
        if params.window is not None:
            raise refused("window that gets dirty")
        if setup.field.plumes:
            raise refused("dust")
        if setup.edge is None:
            raise refused("field without an edge")
        self.profile = setup.field.profiled(setup.edge)

    @classmethod
    def together(cls, parts: Sequence["ProfileLidar"]) -> "Scanners":
        """Make one object that steps these parts of many worlds together."""
        return Scanners(parts)

    @property
    def ray_count(self) -> int:
        """Since the start."""
        return int(self.swept[0]) * len(self.azimuth)

    @ray_count.setter
    def ray_count(self, value: int) -> None:
        self.swept[0] = value // max(len(self.azimuth), 1)

    def begin(self, stream: Stream) -> None:
        """Nothing seen yet. InputError where something stands in sight."""
        if solid_count(self.setup.solids()):
            raise refused("thing in sight of its own scanner: obstacles, other machines, a body from a file")
        super().begin(stream)

    def rise(self, places: tuple[F64, F64], steps: tuple[F64, F64]) -> F64:
        """Rise of the ground that beams meet here."""
        return self.profile.rise(places, steps)

    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A sweep is made from the states of the machine alone."""
        raise refused("scan from a place of its own")


class Scanners(Sweeps):
    """The scanners of many worlds, over profiles."""

    def __init__(self, parts: Sequence[ProfileLidar]) -> None:
        super().__init__(parts, len(parts[0].rays.beams.distance))
        n = self.worlds
        self._stations, self._looked_at = (np.zeros(n, np.int32) for _ in range(2))
        self._reach = AHEAD + max(part.scanner.reach for part in parts)
        self._flags = np.zeros((n, 1), np.int32)
        self._swinging = [part for part in parts if part.scanner.noise.angle != 0.0]
        self._lit = [part.scanner for part in parts if part.scanner.is_lit]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Empty scans."""
        first = self.parts[0].rays
        own = [self.arrays[name] for name in ("ranges", "intensity", "points", "sensor_position")]
        for world, part in enumerate(self.parts):
            part.rays.lie_in(
                *(array[world] for array in own),
                words=self.words[world],
                flags=self._flags[world],
                first=first,
            )
            part.swept = self.swept[world : world + 1]
        found = super().reset(streams)
        for part in self.parts:
            part.rays.aims_as(first)
        self._launches = None  # which know the bias of the instances
        self._looked_at[:], self._stations[:], self.laid_at[:] = 1, 0, np.nan  # around where ground was laid
        return found

    def launches(self) -> Sequence[Repeated]:
        """The states of the machines, then the sweeps."""
        from swath.field.edges.profile_kernel import Profile
        from swath.rays.single.kernel import Beams, Canopy
        from swath.sensing.native import profile_kernel as kernel
        from swath.sensing.native.kernel import Aiming, Electronics

        packed: dict[Any, Any] = {}
        alike: dict[bytes, Any] = {}  # arrays that are the same in many worlds
        held: list[list[Any]] = [[] for _ in range(6)]
        for world, part in enumerate(self.parts):
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
                origins=self.arrays["sensor_position"][world].reshape(-1),
                rotations=part.rays.rotations.reshape(-1),
            )
            rays = part.rays
            each = sweep, rays.aiming(), part.profile.struct(), packed[about], rays.beams.struct()
            for structs, struct in zip(held, (*each, rays.electronics()), strict=True):
                structs.append(struct)
        kinds = kernel.Sweep, Aiming, Profile, Canopy, Beams, Electronics
        sweeps, *more = (of_worlds(kind, own) for kind, own in zip(kinds, held, strict=True))
        self._held = held, sweeps, more
        states, after = self.states.reshape(self.worlds, -1), (self._stations, self._looked_at)
        before = shared(self.clock), shared(self.needs), sweeps, shared(states), shared(self.counts)
        scanned = [*before, *more, *map(shared, after)]
        return [
            self.taking(0.5 * AHEAD, is_asked=bool(self._swinging or self._lit)),
            repeatable(kernel.scan_profiles, scanned, threads=self.worlds),
        ]

    def supply(self, stage: int) -> None:
        """The ground that beams can reach, how they swing, the light; after a sweep, what is said of it."""
        end = int(self.clock[1])
        if stage == 0:
            self._lay()
            for part in self._swinging:
                part.rays.swing(end)
            for scanner in self._lit:
                scanner.see_light(end)
            return
        scan, truth = self.sent["scan"].arrays, self.sent["truth"].arrays
        for world in np.flatnonzero(self._looked_at).tolist():
            scanner, ranges = self.parts[world].scanner, scan["ranges"][world]
            if (lost := scanner.seen(end, ranges)) is not None:
                for array in (ranges, scan["intensity"][world], truth["points"][world]):
                    array[lost] = np.nan
            self._looked_at[world] = scanner.looks
        for world in np.flatnonzero(self._flags[:, 0]).tolist():
            found = self.parts[world].rays.beams.take_flags()
            if found & MISPLACED:
                self.errors[world] = InputError("origin", None, "expected a scanner above the ground")
            self.parts[world].note(found >> CLAMPED)

    def save(self, world: int) -> State:
        """Where a scanner was last, and what it noted."""
        return {**super().save(world), "station": int(self._stations[world])}

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        super().load(world, state)
        self._stations[world], self._looked_at[:] = state["station"], 1

    def _lay(self) -> None:
        """The ground in reach of the scanners that have left what was laid, from states of the machines."""
        for world in np.flatnonzero(np.isnan(self.laid_at[:, 0])).tolist():
            states = self.states[world, : self.counts[world], 1:3]
            for x, y in states[[0, -1]].tolist() if len(states) else ():
                self.parts[world].profile.lay_around(x, y, self._reach)
                self.laid_at[world] = x, y


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
    checked=(*CHECKED, RECEIVED),
)
