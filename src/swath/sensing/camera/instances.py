"""Which thing a ray met, and what colour it has there.

The ray engine gives the reflectance of the solid that a ray met. A camera casts with solids that carry their
number there instead: 1, 2 ... in the order of `Bodies.in_sight`, so no other search is needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose
from swath.field.memory_layout import Organ, Solids
from swath.field.site_setup import Sighted
from swath.field.solid.obstacles import Warm
from swath.field.solid.solids import GRAIN, merge
from swath.rays.hits import Hits
from swath.sensing.camera.shading import linear
from swath.signals import F64

SHAPES = ("box", "capsule", "ellipsoid", "mesh")  # in the order in which rays meet them
Colour = tuple[int, int, int]
PLAIN: Colour = (140, 146, 154)
WHEAT: Colour = (206, 166, 104)  # grain in an open box
SKIN, TYRE, BARK, STEEL = (204, 158, 132), (40, 40, 42), (96, 78, 60), (150, 150, 152)
# Of the parts of each shape, the last for all further ones; several rows: one is drawn by the thing's name.
# sRGB, own choice by eye: nothing was measured.
PAINTS: dict[str, list[dict[str, tuple[Colour, ...]]]] = {
    "person": [
        {"ellipsoid": (coat, SKIN), "capsule": (legs, legs, coat)}
        for coat, legs in (
            ((232, 110, 32), (52, 56, 70)),
            ((206, 214, 40), (60, 62, 60)),
            ((58, 84, 140), (44, 48, 60)),
            ((150, 42, 40), (70, 66, 60)),
            ((86, 88, 84), (46, 62, 96)),
        )
    ],
    "animal": [{"ellipsoid": ((150, 98, 62),), "capsule": ((132, 86, 54),)}],
    "vehicle": [
        {"box": (hull, (52, 58, 64)), "capsule": (TYRE,)}
        for hull in ((176, 34, 30), (40, 74, 128), (226, 228, 226), (58, 84, 62))
    ],
    "tree": [{"ellipsoid": ((66, 98, 46),), "capsule": (BARK,)}],
    "hedge": [{"box": ((60, 90, 44),)}],
    "building": [{"box": ((170, 152, 132),)}, {"box": ((128, 62, 48),)}],
    "machine": [{"box": ((88, 150, 46),)}, {"box": ((178, 30, 32),)}, {"box": ((220, 176, 32),)}],
    "post": [{"capsule": ((128, 104, 78),)}],
    "stone": [{"ellipsoid": ((136, 130, 122),)}],
    "unknown": [{}],
}


@dataclass(frozen=True)
class Instances:
    """Things in sight. solids: of all, each with the number of its part for a reflectance.

    each, velocities: the same solids thing by thing, and how each goes (3,) [m/s]
    poses: pose_world_body of each
    is_grain: whether a part is the surface of grain, (parts + 1,)
    names, kinds: of instance 1, 2 ...
    owner: instance of each part, (parts + 1,), 0 = none
    colours: linear light of each part, (parts + 1, 3)
    warm: what keeps each warm, None where nothing does
    """

    solids: Solids
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    owner: NDArray[np.uint16]
    colours: F64
    each: tuple[Solids, ...] = ()
    velocities: tuple[F64, ...] = ()
    poses: tuple[Pose, ...] = ()
    is_grain: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(1, dtype=bool))
    warm: tuple[Warm | None, ...] = ()

    @property
    def moving(self) -> list[tuple[Solids, F64]]:
        """Instances that move."""
        both = zip(self.each, self.velocities, strict=True)
        return [(solids, velocity) for solids, velocity in both if velocity.any()]

    @property
    def standing(self) -> Solids:
        """Instances that stand."""
        both = zip(self.each, self.velocities, strict=True)
        return merge(*(solids for solids, velocity in both if not velocity.any()))

    def part(self, hits: Hits) -> NDArray[np.int64]:
        """Part that each ray met, 0 = no thing."""
        found = np.zeros(hits.organ.shape, np.int64)
        found[hits.organ == Organ.SOLID] = hits.reflectance[hits.organ == Organ.SOLID]
        return found

    def owners(self, hits: Hits) -> NDArray[np.uint16]:
        """Instance that each ray met, 0 = none."""
        return self.owner[self.part(hits)]


def instances_of(seen: Sequence[Sighted]) -> Instances:
    """The things in sight, numbered."""
    owner, colours, parts, is_grain = [0], [(0, 0, 0)], [], [False]
    for number, thing in enumerate(seen, start=1):
        paint = _paint(thing)
        arrays: dict[str, Any] = {}
        for shape in SHAPES:
            count = len(getattr(thing.solids, f"{shape}_reflectance"))
            arrays[f"{shape}_reflectance"] = np.arange(len(owner), len(owner) + count, dtype=float)
            owner += [number] * count
            row = paint.get(shape, (PLAIN,))
            grain = _grain(thing, shape)
            colours += [WHEAT if grain[k] else row[min(k, len(row) - 1)] for k in range(count)]
            is_grain += grain
        parts.append(replace(thing.solids, **arrays))
    return Instances(
        merge(*parts),
        tuple(thing.name for thing in seen),
        tuple(thing.kind for thing in seen),
        np.array(owner, np.uint16),
        linear(np.array(colours)),
        tuple(parts),
        tuple(thing.velocity for thing in seen),
        tuple(thing.pose for thing in seen),
        np.array(is_grain, dtype=bool),
        tuple(thing.warm for thing in seen),
    )


def _grain(thing: Sighted, shape: str) -> list[bool]:
    """Which of its parts are grain in an open box: surfaces that reflect as grain."""
    values: list[float] = getattr(thing.solids, f"{shape}_reflectance").tolist()
    return [thing.kind == "machine" and shape == "mesh" and value == GRAIN for value in values]


def _paint(thing: Sighted) -> dict[str, tuple[Colour, ...]]:
    rows = PAINTS.get(thing.kind, PAINTS["unknown"])
    return rows[crc32(thing.name.encode()) % len(rows)]
