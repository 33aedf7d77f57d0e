"""Weeds under a crop: how many, how tall, and the plants for it from a weed's sheet."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.errors import InputError
from swath.field.crop import Crop
from swath.field.crop_sheet import load_crop
from swath.field.plants.parts import LeafFacts


@dataclass(frozen=True, kw_only=True)
class Weeds:
    """Weeds wherever the crop was sown, its stubble included. plants_per_m2; height_m: mean, ground to the
    highest leaf; crop: name of the weed's sheet.
    """

    plants_per_m2: Annotated[float, Ge(0.0), Le(1000.0)] = 20.0
    height_m: Annotated[float, Gt(0.02), Le(2.0)] = 0.4
    crop: str = "weed"


def weed_crop(weeds: Weeds, folder: Path | None = None) -> Crop:
    """The weed's sheet, its plants grown to the wanted height: widths and leaves with the square root of it,
    so that mass goes with the square (length times width squared).
    """
    crop = load_crop(weeds.crop, folder)
    if not crop.habit.has_stem:
        raise InputError("weeds.crop", weeds.crop, "expected a crop whose plants have a stem")
    ratio = weeds.height_m / crop.stand.height
    wide = ratio**0.5
    stem = replace(
        crop.stem,
        diameter_base=crop.stem.diameter_base * wide,
        diameter_top=crop.stem.diameter_top * wide,
    )
    organs, leaf = crop.organs, crop.organs.of(LeafFacts)
    if leaf is not None:
        organs = organs.replaced(replace(leaf, length=leaf.length * wide, width=leaf.width * wide))
    return replace(
        crop,
        stand=replace(crop.stand, density=weeds.plants_per_m2, height=weeds.height_m),
        stem=stem,
        organs=organs,
        yields=replace(crop.yields, bare_mass=crop.yields.bare_mass * ratio**2),
    )
