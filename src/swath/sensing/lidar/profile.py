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
from swath.kernels import Repeated, of_worlds
from swath.sensing import RECEIVED
from swath.sensing.lidar.empirical import CHECKED, Params, TableLidar
from swath.sensing.lidar.sweeps import Sweeps
from swath.signals import F64

AHEAD = 48.0  # ground is laid so much farther than beams reach, half of it for where the scanner sits [m]


class ProfileLidar(TableLidar):
    """Scans profiles with a moving scanner."""

    level, gains = "profile", True

    def __init__(self, params: Params, setup: SiteSetup) -> None:
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

    def begin(self, stream: Stream) -> None:
        """Nothing seen yet. InputError where something stands in sight."""
        if solid_count(self.setup.solids()):
            raise refused("thing in sight of its own scanner: obstacles, other machines, a body from a file")
        super().begin(stream)

    def rise(self, places: tuple[F64, F64], steps: tuple[F64, F64]) -> F64:
        """Rise of the ground that beams meet here."""
        return self.profile.rise(places, steps)

    def check_origins(self) -> None:
        """InputError, where a beam starts under the ground."""
        raise InputError("origin", None, "expected a scanner above the ground")

    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A sweep is made from the states of the machine alone."""
        raise refused("scan from a place of its own")


class Scanners(Sweeps):
    """The scanners of many worlds, over profiles."""

    near = 0.5 * AHEAD

    def __init__(self, parts: Sequence[ProfileLidar]) -> None:
        super().__init__(parts)
        self._stations = np.zeros(self.worlds, np.int32)
        self._reach = AHEAD + max(part.scanner.reach for part in parts)

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Empty scans."""
        self._stations[:], self.laid_at[:] = 0, np.nan  # around where ground was laid
        return super().reset(streams)

    def casts(self, *scanners: Any) -> Sequence[Repeated]:
        """All beams at once."""
        from swath.field.edges.profile_kernel import Profile
        from swath.rays.single.profile_kernel import cast_profiles

        self._profiles = [part.profile.struct() for part in self.parts]
        of_fields = of_worlds(Profile, self._profiles)
        return [self.launch(cast_profiles, self.needs, self.active, *scanners, of_fields, self._stations)]

    def supply(self, stage: int) -> None:
        """The ground that beams can reach, too."""
        if stage == 0:
            self._lay()
        super().supply(stage)

    def save(self, world: int) -> State:
        """Where a scanner was last, and what it noted."""
        return {**super().save(world), "station": int(self._stations[world])}

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        super().load(world, state)
        self._stations[world] = state["station"]

    def _lay(self) -> None:
        """The ground in reach of the scanners that have left what was laid, from states of the machines."""
        for world in np.flatnonzero(np.isnan(self.laid_at[:, 0])).tolist():
            states = self.states[world, : self.counts[world], 1:3]
            for x, y in states[[0, -1]].tolist() if len(states) else ():
                self.parts[world].profile.lay_around(x, y, self._reach)
                self.laid_at[world] = x, y


LEVEL = Level(
    ProfileLidar,
    Params,
    "the beams of empirical over profiles along the edge, for many runs at once",
    cost="1/2 of empirical in one run; for batches see docs/explanation/kernels.md",
    tolerance="heights against empirical: Wasserstein-1 1.5 cm at crop, edge and stubble",
    checked=(*CHECKED, RECEIVED),
)
