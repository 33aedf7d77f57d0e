"""From a crop to its plants."""

import numpy as np

from swath.field.crop import Crop
from swath.field.plants.drawing import Detail, Drawing
from swath.field.plants.parts import Plants


def leaf_parts_of(crop: Crop, detail: Detail) -> int:
    """Ribbons per leaf. `reduced` is for cereals alone: broad leaves make up what is seen of maize, and there
    it moves heights by centimetres. What it moves in cereals is in docs/crops.md.
    """
    return crop.habit.reduced_leaf_parts if detail == "reduced" else Drawing.leaf_parts


def make_plants(crop: Crop, count: int, rng: np.random.Generator, how: Drawing | None = None) -> Plants:
    """Draw `count` stems with their organs, as the crop's habit does.

    The mean grain and straw mass are the crop's exactly; they are shared out by the size of what carries
    them, see the file of the habit.
    """
    plants: Plants = crop.habit.make(crop, count, rng, how or Drawing())
    return plants
