"""Crops from their data sheets: `data/crops/*.yaml`, or the user's own.

Their habits are the files of `field/plants` that define `HABIT`, and files of the user. Weeds under a crop:
how many, how tall, and the plants for it from a weed's sheet.
"""

import importlib
import math
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge, Gt, Le

from swath.core.errors import InputError, near_miss
from swath.core.foreign_code import load_python
from swath.documents.data_sheets import Sheet, read_sheet, sheet_names
from swath.documents.sheet_fields import Entry, entries
from swath.field.crop import REFLECTANCE, Crop, Habit, Head, Organs, StemFacts, YieldFacts
from swath.field.plants.parts import LeafFacts

PACKAGE = "swath.field.plants"


def habit_names() -> list[str]:
    """Names of the built-in habits: the files of `field/plants` that define `HABIT`."""
    files = [f"{PACKAGE}.{i.name}" for i in pkgutil.iter_modules(importlib.import_module(PACKAGE).__path__)]
    return [f.rpartition(".")[2] for f in files if "HABIT" in vars(importlib.import_module(f))]


def find_habit(sheet: Sheet) -> Habit:
    """The habit that a crop's sheet names: a built-in one, or a `file.py` beside the sheet with `HABIT`.

    Raises InputError when there is none of this name.
    """
    name = sheet.value("habit") or "cereal"
    if isinstance(name, str) and name.endswith(".py"):
        file = sheet.path.parent / name
        try:
            module: Any = load_python("habit", file)
        except InputError as error:
            raise sheet.error("habit", error.expected) from error
    elif name in habit_names():
        module = importlib.import_module(f"{PACKAGE}.{name}")
    else:
        names = habit_names()
        expected = f"expected one of {', '.join(names)}, or a file.py that defines HABIT"
        raise sheet.error("habit", expected + near_miss(name, names))
    habit = vars(module).get("HABIT")
    if not isinstance(habit, Habit):
        raise sheet.error("habit", f"expected a file that defines HABIT, a {Habit.__name__}")
    return habit


ALIKE = 0.6  # share of equal numbers that makes a data sheet a copy of another; wheat and barley share 0.42


def load_crop(name: str, base: Path | None = None) -> Crop:
    """Crop by bundled name (`wheat`) or from a user's YAML file (relative to `base`).

    Raises InputError that names key, file and line when a number is missing, has no source or lies outside
    what a crop can be.
    """
    is_own = name.endswith((".yaml", ".yml"))  # it may change, and rest on other files
    return _read(read_sheet("crops", name, base)) if is_own else _bundled(name)


@cache
def _bundled(name: str) -> Crop:
    return _read(read_sheet("crops", name))


def _read(sheet: Sheet) -> Crop:
    habit = find_habit(sheet)
    there = {key: kind for key, kind in habit.organs.items() if key not in habit.optional or key in sheet}
    sections: dict[str, type] = {"stand": habit.stand, "yield": habit.yields, **there}
    if habit.has_stem:
        sections["stem"] = StemFacts
    sheet.check(*entries(Head), *_reflectances(habit, there), *_keys(sections))
    organs = Organs(sheet.build(kind, _prefix(key)) for key, kind in there.items())
    crop = Crop(
        name=str(sheet.value("name")),
        habit=habit,
        stand=sheet.build(habit.stand, "stand."),
        stem=sheet.build(StemFacts, "stem."),
        yields=YieldFacts(0.0, 0.0, 1.0, 1.0, 1.0, 0.0),
        reflectance={key: float(value) for key, value in sheet.value("reflectance").items()},
        organs=organs,
    )
    _check_ranges(sheet)
    if habit.complete is not None:
        crop = habit.complete(crop, sheet)
    return _with_yields(crop, sheet)


def copied_from(name: str) -> tuple[str, list[str]] | None:
    """The bundled crop that a user's own data sheet was copied from, and the keys whose numbers differ.

    It is the one of the same habit with most numbers in common, at least ALIKE of them; None where no bundled
    crop is so much alike, or the crop is bundled itself. name: bundled, or path of the sheet
    """
    if name in sheet_names("crops"):
        return None
    own = read_sheet("crops", name)
    best: tuple[float, str, list[str]] | None = None
    for other in sheet_names("crops"):
        sheet = read_sheet("crops", other)
        if sheet.value("habit") != own.value("habit"):
            continue
        keys = own.numbers().keys() | sheet.numbers().keys()
        differing = sorted(key for key in keys if own.value(key) != sheet.value(key))
        share = 1.0 - len(differing) / len(keys)
        if share >= ALIKE and (best is None or share > best[0]):
            best = share, other, differing
    return None if best is None else best[1:]


def _prefix(section: str) -> str:
    return f"{section}." if section else ""


def _keys(sections: Mapping[str, type]) -> list[Entry]:
    """Keys of the sections; those of the stem are all needed, its defaults are for crops without one."""
    found = [e for key, kind in sections.items() for e in entries(kind, prefix=_prefix(key))]
    return [Entry(e.key, e.kind, needed=True) if e.key.startswith("stem.") else e for e in found]


def _reflectances(habit: Habit, there: Mapping[str, type]) -> list[Entry]:
    optional = [key for key in habit.optional if key in habit.reflective and key not in there]
    names = dict.fromkeys(("ground", "straw", *habit.reflective, "stubble", "weed"))
    return [Entry(f"reflectance.{name}", REFLECTANCE) for name in names if name not in optional]


def _check_ranges(sheet: Sheet) -> None:
    """Raise InputError where the `max` of two keys is below its `min`."""
    for key in sheet.numbers():
        least = key.replace("_max", "_min")
        if least != key and (low := sheet.value(least)) is not None and sheet.value(key) < low:
            raise sheet.error(key, f"expected at least {least} = {low:g}")


def _with_yields(crop: Crop, sheet: Sheet) -> Crop:
    y = sheet.build(crop.habit.yields, "yield.")
    below = y.straw_below_height / crop.stand.height
    if not 0.0 < below <= 0.9 * (1.0 + 1e-12):
        highest = 90.0 * crop.stand.height
        raise sheet.error(
            "yield.straw_below_height_cm", f"expected at most {highest:g}, 0.9 of the crop's height"
        )
    grain, straw_to_grain, bare = y.masses(crop.organs)
    exponent = math.log(1.0 - y.straw_below_share) / math.log(1.0 - below)
    facts = YieldFacts(
        grain, straw_to_grain, exponent, y.grain_density, y.swath_density, y.grain_moisture, bare
    )
    return replace(crop, yields=facts)


@dataclass(frozen=True, kw_only=True)
class Weeds:
    """Weeds wherever the crop was sown, its stubble included.

    plants_per_m2: mean density
    height_m: mean height from the ground to the highest leaf
    crop: name of the weed's sheet
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
