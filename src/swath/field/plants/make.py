"""From a crop to its plants: which module draws them."""

import numpy as np

from swath.field.crop import Crop
from swath.field.field_setup import Detail
from swath.field.plants.branched import make as make_branched
from swath.field.plants.cereal import make as make_cereal
from swath.field.plants.maize import make as make_maize
from swath.field.plants.mesh import make as make_mesh
from swath.field.plants.parts import Plants
from swath.field.plants.weed import make as make_weed


def leaf_parts_of(crop: Crop, detail: Detail) -> int:
    """Ribbons per leaf. `reduced` is for cereals alone: broad leaves make up what is seen of maize, and there
    it moves heights by centimetres. What it moves in cereals is in docs/crops.md.
    """
    return 2 if detail == "reduced" and crop.habit == "cereal" else 3


def make_plants(
    crop: Crop,
    count: int,
    rng: np.random.Generator,
    *,
    leaves: bool = True,
    ears: bool = True,
    upright: bool = False,
    stalk_parts: int = 2,
    leaf_parts: int = 3,
) -> Plants:
    """Draw `count` stems with their organs.

    leaves; ears: with what carries the grain (ears, pods, cobs); upright: stalks and ears vertical (for
    closed-form checks). stalk_parts: capsules per stalk, twice as many where branches hang on it; leaf_parts:
    ribbons per leaf, maize has one more; they change no random number.

    The mean grain and straw mass are the crop's exactly; they are shared out by the size of
    what carries them, see the module of the habit.
    """
    if crop.habit == "branched":
        return make_branched(crop, count, rng, ears=ears, upright=upright, stalk_parts=2 * stalk_parts)
    if crop.habit == "mesh":
        return make_mesh(crop, count, rng, leaves=leaves, ears=ears)
    if crop.habit == "weed":
        return make_weed(crop, count, rng, leaves=leaves, stalk_parts=stalk_parts, leaf_parts=leaf_parts)
    make = make_maize if crop.habit == "maize" else make_cereal
    return make(
        crop,
        count,
        rng,
        leaves=leaves,
        ears=ears,
        upright=upright,
        stalk_parts=stalk_parts,
        leaf_parts=leaf_parts,
    )
