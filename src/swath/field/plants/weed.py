"""A weed: a green stem with broad leaves all around. Everything of it is `Organ.WEED`."""

import numpy as np

from swath.field.crop import BareYield, Crop, Habit
from swath.field.memory_layout import Organ
from swath.field.plants.drawing import Drawing
from swath.field.plants.parts import (
    LeafFacts,
    Leafing,
    Plants,
    assemble,
    blades,
    heights_of,
    shared,
    stalk_capsules,
    stalks_of,
)

TAPER = (0.6, 1.2, 0.8)  # width of a leaf from its foot to its tip, relative


def make(crop: Crop, count: int, rng: np.random.Generator, how: Drawing) -> Plants:
    """No grain; the mass is shared out by stem volume."""
    height = heights_of(crop, rng, count)
    stalks = stalks_of(crop, rng, height)
    parts = [stalk_capsules(crop.stem, stalks, how.stalk_parts, Organ.WEED)]
    if how.leaves:
        leafing = Leafing(taper=TAPER, organ=Organ.WEED)
        parts.append(blades(crop.organs[LeafFacts], stalks, how.leaf_parts, rng, leafing))
    mass = shared(height * stalks.scale**2, crop.yields.straw_mass)
    return assemble(height, np.zeros(count), mass, parts)


HABIT = Habit(make, yields=BareYield, organs={"leaf": LeafFacts})
