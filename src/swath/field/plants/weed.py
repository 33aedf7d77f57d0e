"""A weed: a green stem with broad leaves all around. Everything of it is `Organ.WEED`."""

import numpy as np

from swath.field.crop import Crop
from swath.field.memory_layout import Organ
from swath.field.plants.parts import (
    Leafing,
    Plants,
    Stalks,
    assemble,
    blades,
    normal,
    shared,
    stalk_capsules,
)

TAPER = (0.6, 1.2, 0.8)  # width of a leaf from its foot to its tip, relative


def make(
    crop: Crop, count: int, rng: np.random.Generator, *, leaves: bool, stalk_parts: int, leaf_parts: int
) -> Plants:
    """No grain; the mass is shared out by stem volume."""
    assert crop.leaf is not None
    height = normal(rng, crop.stand.height, crop.stand.height * crop.stand.height_cv, count)
    scale = normal(rng, 1.0, crop.stem.diameter_cv, count)
    lean = np.maximum(normal(rng, crop.stem.lean_mean, crop.stem.lean_sd, count), 0.0)
    stalks = Stalks(height, np.tan(lean) * height, rng.uniform(-np.pi, np.pi, count), scale)
    parts = [stalk_capsules(crop.stem, stalks, stalk_parts, Organ.WEED)]
    if leaves:
        parts.append(blades(crop.leaf, stalks, leaf_parts, rng, Leafing(taper=TAPER, organ=Organ.WEED)))
    mass = shared(height * scale**2, crop.yields.straw_mass)
    return assemble(height, np.zeros(count), mass, parts)
