"""Plants that are the user's own meshes: every triangle a primitive, variants drawn evenly."""

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.documents.data_sheets import Sheet
from swath.documents.sheet_fields import Quantity
from swath.field.crop import Crop, Habit, Organs, StandFacts, YieldSection
from swath.field.memory_layout import Organ, Shape, ranked
from swath.field.mesh_crop import HEIGHT, MeshFacts, MeshSection, mesh_facts, triangle_area
from swath.field.plants.drawing import Drawing
from swath.field.plants.parts import Array, Plants, shared, sizes

FRUIT = (Organ.EAR, Organ.POD, Organ.COB)
GROWTH = 3.0  # mass goes with this power of a plant's size


@dataclass(frozen=True, kw_only=True)
class MeshStand(StandFacts):
    """As `StandFacts`; without a height it is that of the meshes."""

    height: Annotated[float, Quantity("cm", 100 * HEIGHT[0], 100 * HEIGHT[1])] = 0.0


@dataclass(frozen=True, kw_only=True)
class PlantYield(YieldSection):
    """grain_mass, straw_mass: of a mean plant [kg]."""

    grain_mass: Annotated[float, Quantity("g", 0, 10_000)]
    straw_mass: Annotated[float, Quantity("g", 1e-3, 10_000)]

    def masses(self, organs: Organs) -> tuple[float, float, float]:
        """See `YieldSection`."""
        per_grain = self.straw_mass / self.grain_mass if self.grain_mass > 0.0 else 0.0
        return self.grain_mass, per_grain, self.straw_mass


def complete(crop: Crop, sheet: Sheet) -> Crop:
    """The crop with its meshes: their height and reflectance are the crop's."""
    mesh = mesh_facts(sheet, crop.organs[MeshSection])
    return replace(
        crop,
        stand=replace(crop.stand, height=mesh.height),
        reflectance=crop.reflectance | mesh.reflectances(),
        organs=Organs((mesh,)),
    )


def pieces(crop: Crop) -> float:
    """Mean number of triangles of a plant."""
    return float(np.mean([len(v.organ) for v in crop.organs[MeshFacts].variants]))


def make(crop: Crop, count: int, rng: np.random.Generator, how: Drawing) -> Plants:
    """Grain is shared out by the area of ears, pods and cobs, straw by that of all else, and both by the
    third power of the plant's size. Each plant is a variant, evenly scaled (height_cv) and turned.
    """
    mesh = crop.organs[MeshFacts]
    variants = mesh.variants
    which = rng.integers(0, len(variants), count)
    size = sizes(rng, 1.0, crop.stand.height_cv, count)
    turn = rng.uniform(-np.pi, np.pi, count)
    if not mesh.turns:
        turn[:] = 0.0
    organ = np.concatenate([v.organ for v in variants])
    of = np.repeat(np.arange(len(variants)), [len(v.organ) for v in variants])
    a, b, width = corners_to_piece(np.concatenate([v.corners for v in variants]))
    owner, piece = _pieces(which, np.bincount(of, minlength=len(variants)))
    keep = np.ones(len(organ), dtype=bool)
    if not how.leaves:
        keep &= organ != Organ.LEAF
    if not how.ears:
        keep &= ~np.isin(organ, FRUIT)
    owner, piece = owner[keep[piece]], piece[keep[piece]]
    area = np.concatenate([triangle_area(v.corners) for v in variants])
    fruit, rest = (np.bincount(of, area * m, len(variants)) for m in _fruit_or_not(organ))
    heights = np.array([v.height for v in variants])
    reflectance = np.concatenate([v.reflectance for v in variants])
    if all(np.ptp(reflectance[organ == o]) == 0.0 for o in np.unique(organ)):
        reflectance = np.zeros(len(organ))  # that of the organ

    def placed(vector: Array) -> Array:
        v = vector[piece] * size[owner, None]
        c, s = np.cos(turn)[owner], np.sin(turn)[owner]
        return np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]], axis=-1)

    return Plants(
        heights[which] * size,
        shared(_weight(fruit, which, size), crop.yields.grain_mass),
        shared(_weight(rest, which, size), crop.yields.straw_mass),
        np.full(len(piece), Shape.TRIANGLE, np.uint8),
        organ[piece],
        placed(a),
        placed(b),
        np.zeros(len(piece)),
        placed(width),
        owner.astype(np.int32),
        reflectance[piece],
    )


def corners_to_piece(corners: Array) -> tuple[Array, Array, Array]:
    """a, b, width (n, 3) of triangles (n, 3, 3): a - width, a + width, b, the shortest side between the first
    two, so that their boxes are tight.
    """
    side = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    order = (side.argmin(axis=1)[:, None] + np.arange(3)) % 3
    p, q, b = np.moveaxis(np.take_along_axis(corners, order[..., None], axis=1), 1, 0)
    return 0.5 * (p + q), b, 0.5 * (q - p)


def _pieces(
    which: NDArray[np.int64], number: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Owner and triangle of every piece, plant by plant. number: triangles of each variant."""
    first = np.cumsum(number) - number
    owner, step = ranked(number[which])
    return owner, first[which][owner] + step


def _fruit_or_not(organ: NDArray[np.uint8]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    is_fruit = np.isin(organ, FRUIT)
    return is_fruit, ~is_fruit


def _weight(area: NDArray[Any], which: NDArray[np.int64], size: Array) -> Array:
    """What a mass is shared out by; evenly among variants when none of them has such an organ."""
    share = area if area.sum() > 0.0 else np.ones_like(area)
    return np.asarray(share[which] * portable.power(size, GROWTH))


HABIT = Habit(
    make,
    yields=PlantYield,
    organs={"": MeshSection},
    reflective=(),
    has_stem=False,
    stand=MeshStand,
    complete=complete,
    pieces=pieces,
)
