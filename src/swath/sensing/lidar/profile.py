"""LiDAR level `profile`: the beams of `empirical` over the field as profiles along the edge.

Table, draws and the way of a beam through crop are those of `empirical`, in the same native code with the
same random numbers. What it looks at is `field/profile.py`: the ground and the stand once a metre along the
edge, the standing crop every 5 cm, cut by the header of the same level. It is for many runs at once.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from swath.compiled import Compiled
from swath.core.component import Outputs, State
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.rows import Room, row_of
from swath.core.together import InWorlds, Samples
from swath.field.profile import refused
from swath.field.site_setup import SiteSetup
from swath.field.solids import solid_count
from swath.kernels import Repeated, of_worlds, repeatable, shared
from swath.kernels import filled as made
from swath.rays.bodies import pack_canopy
from swath.rays.single.buffers import CLAMPED, MISPLACED
from swath.sensing.lidar.empirical import CHECKED, Params, TableLidar
from swath.sensing.sweep import ROOM
from swath.signals import F64, MachineState, Scan, ScanTruth

AHEAD = 48.0  # ground is laid so much farther than beams reach, half of it for where the scanner sits [m]


class ProfileLidar(InWorlds, TableLidar):
    """Scans profiles with a moving scanner. swept: (1,) sweeps so far."""

    level = "profile"

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.swept = np.zeros(1, np.int64)
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

    @property
    def ray_count(self) -> int:
        """Since the start."""
        return int(self.swept[0]) * len(self.azimuth)

    @ray_count.setter
    def ray_count(self, value: int) -> None:
        self.swept[0] = value // max(len(self.azimuth), 1)

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


class Scanners(Compiled):
    """The scanners of many worlds."""

    hears: ClassVar = {"state": MachineState}

    def __init__(self, parts: Sequence[ProfileLidar]) -> None:
        n, first = len(parts), parts[0]
        count, self._room = len(first.azimuth), len(first.rays.beams.distance)
        echoes, places = Room((count, 1), self._room), Room((count, 3), self._room)
        alike = {"beam_t": first.scanner.beam_t, "azimuth": first.azimuth, "elevation": first.elevation}
        rooms = {"ranges": echoes, "intensity": echoes}
        points = {"points": Room((count, 1, 3), self._room), "sensor_position": places}
        scan, truth = row_of(Scan, n, rooms=rooms, alike=alike), row_of(ScanTruth, n, rooms=points)
        super().__init__(n, {"scan": scan, "truth": truth})
        self._parts = parts
        self._arrays = {
            name: row.roomy(name, self._room)
            for row, names in ((scan, rooms), (truth, points))
            for name in names
        }
        self._words = np.zeros((n, 3), np.uint64)
        self._states, self._last = np.zeros((n, ROOM, 13)), np.zeros((n, 13))
        self._counts, self._stations, self._looked_at = (np.zeros(n, np.int32) for _ in range(3))
        self._reach = AHEAD + max(part.scanner.reach for part in parts)
        self._laid_at = np.full((n, 2), np.nan)  # around where the ground was laid [m]
        self._flags, self._swept = np.zeros((n, 1), np.int32), np.zeros(n, np.int64)
        self._swinging = [part for part in parts if part.scanner.noise.angle != 0.0]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Empty scans."""
        self._last[:, 0], self._looked_at[:], self._stations[:] = -1.0, 1, 0
        first = self._parts[0].rays
        own = [self._arrays[name] for name in ("ranges", "intensity", "points", "sensor_position")]
        for world, (part, stream) in enumerate(zip(self._parts, streams, strict=True)):
            part.rays.lie_in(
                *(array[world] for array in own),
                words=self._words[world],
                flags=self._flags[world],
                first=first,
            )
            part.swept = self._swept[world : world + 1]
            part.begin(stream)
            part.rays.aims_as(first)
        self._launches = None  # which know the bias of the instances
        self._laid_at[:] = np.nan
        for array in own:
            array[:] = np.nan
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """The states of the machines, then the sweeps."""
        from swath.field.profile_kernel import Profile
        from swath.rays.single.kernel import Beams, Canopy
        from swath.sensing.native import profile_kernel as kernel
        from swath.sensing.native.kernel import Aiming, Electronics

        packed: dict[Any, Any] = {}
        alike: dict[bytes, Any] = {}  # arrays that are the same in many worlds
        held: list[list[Any]] = [[] for _ in range(6)]
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
                origins=self._arrays["sensor_position"][world].reshape(-1),
                rotations=part.rays.rotations.reshape(-1),
            )
            rays = part.rays
            each = sweep, rays.aiming(), part.profile.struct(), packed[about], rays.beams.struct()
            for structs, struct in zip(held, (*each, rays.electronics()), strict=True):
                structs.append(struct)
        kinds = kernel.Sweep, Aiming, Profile, Canopy, Beams, Electronics
        sweeps, *more = (of_worlds(kind, own) for kind, own in zip(kinds, held, strict=True))
        self._held = held, sweeps, more
        trail, asked = self.heard["state"], [shared(self.clock), shared(self.needs)]
        heard = map(shared, (trail.head, trail.stamps, trail.memory["pose"], self._last))
        between = [shared(self._states.reshape(self.worlds, -1)), shared(self._counts)]
        sums = shared(self._words), shared(self._swept)
        ground = shared(self._laid_at), 0.5 * AHEAD, int(bool(self._swinging))
        seen = shared(self._stations), shared(self._looked_at)
        taken = [*asked, *heard, *between, *sums, *ground]
        return [
            repeatable(kernel.take_states, taken, threads=self.worlds),
            repeatable(kernel.scan_profiles, [*asked, sweeps, *between, *more, *seen], threads=self.worlds),
        ]

    def supply(self, stage: int) -> None:
        """The ground that beams can reach and how they swing; after a sweep, what is to be said of it."""
        end = int(self.clock[1])
        if stage == 0:
            self._lay()
            for part in self._swinging:
                part.rays.swing(end)
            return
        scan, truth = self.sent["scan"].arrays, self.sent["truth"].arrays
        for world in np.flatnonzero(self._looked_at).tolist():
            scanner, ranges = self._parts[world].scanner, scan["ranges"][world]
            if (lost := scanner.seen(end, ranges)) is not None:
                for array in (ranges, scan["intensity"][world], truth["points"][world]):
                    array[lost] = np.nan
            self._looked_at[world] = scanner.looks
        for world in np.flatnonzero(self._flags[:, 0]).tolist():
            found = self._parts[world].rays.beams.take_flags()
            if found & MISPLACED:
                self.errors[world] = InputError("origin", None, "expected a scanner above the ground")
            self._parts[world].note(found >> CLAMPED)

    def save(self, world: int) -> State:
        """Where a scanner was last, and what it noted."""
        last, station = self._last[world].copy(), int(self._stations[world])
        return {**TableLidar.save(self._parts[world]), "last": last, "station": station}

    def load(self, world: int, state: State) -> None:
        """Back to it."""
        TableLidar.load(self._parts[world], state)
        self._stations[world], self._looked_at[:] = state["station"], 1
        self._last[world] = state["last"]

    def _lay(self) -> None:
        """The ground in reach of the scanners that have left what was laid, from states of the machines."""
        for world, count in enumerate(self._counts.tolist()):
            x, y = self._states[world, :count, 1:3].T
            gone = np.hypot(x - self._laid_at[world, 0], y - self._laid_at[world, 1])
            if (gone < 0.5 * AHEAD).all():
                continue
            for place in ((x[0], y[0]), (x[-1], y[-1])):
                self._parts[world].profile.lay_around(*place, self._reach)
            self._laid_at[world] = x[-1], y[-1]


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
