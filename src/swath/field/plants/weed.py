"""A weed: a green stem with broad leaves all around. Everything of it is `Organ.WEED`."""

import numpy as np

from swath.field.crop import BareYield, Crop, Habit
from swath.field.memory_layout import Organ
from swath.field.plants.drawing import Drawing
from swath.field.plants.parts import (
    LeafFacts,
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


def make(crop: Crop, count: int, rng: np.random.Generator, how: Drawing) -> Plants:
    """No grain; the mass is shared out by stem volume."""
    height = normal(rng, crop.stand.height, crop.stand.height * crop.stand.height_cv, count)
    scale = normal(rng, 1.0, crop.stem.diameter_cv, count)
    lean = np.maximum(normal(rng, crop.stem.lean_mean, crop.stem.lean_sd, count), 0.0)
    stalks = Stalks(height, np.tan(lean) * height, rng.uniform(-np.pi, np.pi, count), scale)
    parts = [stalk_capsules(crop.stem, stalks, how.stalk_parts, Organ.WEED)]
    if how.leaves:
        leafing = Leafing(taper=TAPER, organ=Organ.WEED)
        parts.append(blades(crop.organs[LeafFacts], stalks, how.leaf_parts, rng, leafing))
    mass = shared(height * scale**2, crop.yields.straw_mass)
    return assemble(height, np.zeros(count), mass, parts)


HABIT = Habit(make, yields=BareYield, organs={"leaf": LeafFacts})
