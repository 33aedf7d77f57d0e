"""Plants of a crop as capsules (stalks, ears, pods) and ribbons (leaves): arrays of plants, no plant objects.

Every stem stands with its foot at the origin; z up. The library moves them to their places. Each file
that defines `HABIT` is a habit: what the data sheet of such a crop says and how its plants are drawn.
"""

import numpy as np

from swath.field.crop import Crop
from swath.field.plants.drawing import Detail, Drawing
from swath.field.plants.parts import CUTOFF, Plants

__all__ = ["CUTOFF", "Drawing", "Plants", "leaf_parts_of", "make_plants"]


def leaf_parts_of(crop: Crop, detail: Detail) -> int:
    """Ribbons per leaf.

    `reduced` is for cereals alone: broad leaves make up what is seen of maize, and there it moves heights by
    centimetres. In cereals it moves them by a millimetre.
    """
    return crop.habit.reduced_leaf_parts if detail == "reduced" else Drawing.leaf_parts


def make_plants(crop: Crop, count: int, rng: np.random.Generator, how: Drawing | None = None) -> Plants:
    """Draw `count` stems with their organs, as the crop's habit does.

    The mean grain and straw mass are the crop's exactly; they are shared out by the size of what carries
    them, see the file of the habit.
    """
    plants: Plants = crop.habit.make(crop, count, rng, how or Drawing())
    return plants
