"""What stands between an antenna and the satellites: the scene, the other machines and the own body."""

from math import hypot

import numpy as np

from swath.field.memory_layout import Solids
from swath.field.site_setup import Body, SiteSetup
from swath.field.solids import merge
from swath.rays.single.buffers import BeamBuffer
from swath.signals import F64

FOLIAGE = ("tree", "hedge")
REACH = 150.0  # farther bodies shade nothing above 5 deg up to a height of 13 m
FAR = 400.0  # of a ray [m]
SKIN = 0.05  # above the antenna's place, so that its foot does not shade it [m]


class Shading:
    """Casts a ray to every satellite against the solids of all bodies, those in leaf by themselves."""

    def __init__(self, setup: SiteSetup, count: int) -> None:
        self._setup = setup
        self._hard, self._leaves = BeamBuffer(count), BeamBuffer(count)

    def look(self, antenna: F64, up: F64) -> tuple[F64, F64]:
        """(is blocked, is behind leaves), boolean (n,) each. antenna (3,) [m], up: directions (n, 3)"""
        bodies = [b for b in self._setup.bodies.around() if _is_near(b, antenna)]
        leaves = [b.solids for b in bodies if b.kind in FOLIAGE]
        hard = [b.solids for b in bodies if b.kind not in FOLIAGE]
        return self._met(self._hard, hard, antenna, up), self._met(self._leaves, leaves, antenna, up)

    def _met(self, beams: BeamBuffer, solids: list[Solids], antenna: F64, up: F64) -> F64:
        count = beams.count
        if not solids:
            return np.zeros(count, dtype=bool)
        beams.origins[:count] = antenna + np.array([0.0, 0.0, SKIN])
        beams.directions[:count] = up
        beams.distance[:count] = FAR
        if not beams.meet(merge(*solids), FAR):
            return np.zeros(count, dtype=bool)
        return np.asarray(beams.distance[:count] < 0.999 * FAR)


def _is_near(body: Body, antenna: F64) -> bool:
    middle = body.pose.apply(body.middle)
    away = hypot(*(middle[:2] - antenna[:2]).tolist())
    return away < REACH + hypot(*body.half.tolist())
