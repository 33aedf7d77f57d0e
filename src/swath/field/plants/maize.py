"""Maize: a thick stalk, broad leaves in one plane, a tassel on top, one cob at its node."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from swath.documents.sheet_fields import Quantity
from swath.field.crop import CV, Crop, GrainYield, Habit, Organs
from swath.field.memory_layout import Organ
from swath.field.plants.drawing import Drawing
from swath.field.plants.parts import (
    Array,
    LeafFacts,
    Leafing,
    Part,
    Plants,
    Stalks,
    apart,
    assemble,
    blades,
    heights_of,
    normal,
    pointing,
    rods,
    shared,
    sizes,
    stalk_capsules,
    stalks_of,
)

TAPER = (0.9, 1.1, 1.0, 0.4)  # width of a blade from its foot to its tip, relative
PLANE_SD = 0.6  # of the leaves' plane about the direction across the rows [rad]


@dataclass(frozen=True, kw_only=True)
class TasselFacts:
    """The top of a maize plant. drawn: its spikes; length, diameter [m]; spread [rad] from the stalk."""

    drawn: Annotated[int, Quantity("", 1, 40)]
    length: Annotated[float, Quantity("mm", 20, 600)]
    diameter: Annotated[float, Quantity("mm", 0.2, 20)]
    spread: Annotated[float, Quantity("deg", 0, 90)]


@dataclass(frozen=True, kw_only=True)
class CobFacts:
    """An ear of maize in its husk.

    height, height_sd: of its foot above ground [m]; length, length_cv, diameter [m]; inclination_mean,
        inclination_sd [rad] from vertical, above 90 deg it hangs
    """

    height: Annotated[float, Quantity("cm", 20, 250)]
    height_sd: Annotated[float, Quantity("cm", 0, 50)]
    length: Annotated[float, Quantity("mm", 50, 500)]
    length_cv: Annotated[float, CV]
    diameter: Annotated[float, Quantity("mm", 10, 120)]
    inclination_mean: Annotated[float, Quantity("deg", 0, 170)]
    inclination_sd: Annotated[float, Quantity("deg", 0, 60)]


@dataclass(frozen=True, kw_only=True)
class CobYield(GrainYield):
    """grains_per_cob: mean."""

    grains_per_cob: Annotated[float, Quantity("", 1, 5000)]

    def grains(self, organs: Organs) -> float:
        """Grains of a mean plant, which has one cob."""
        return self.grains_per_cob


def make(crop: Crop, count: int, rng: np.random.Generator, how: Drawing) -> Plants:
    """Grain is shared out by cob volume, straw by stalk volume."""
    tassel = crop.organs[TasselFacts]
    height = heights_of(crop, rng, count)
    length = np.maximum(height - tassel.length, 0.1 * height)
    stalks = stalks_of(crop, rng, length, upright=how.upright)
    plane = 0.5 * np.pi + normal(rng, 0.0, PLANE_SD, count)
    cobs, volume = _cobs(crop.organs[CobFacts], stalks, plane, rng)
    parts = [stalk_capsules(crop.stem, stalks, how.stalk_parts), _tassels(tassel, stalks, rng)]
    if how.ears:
        parts.append(cobs)
    if how.leaves:
        leafing = Leafing(plane=plane, taper=TAPER)
        parts.append(blades(crop.organs[LeafFacts], stalks, how.leaf_parts + 1, rng, leafing))
    grain = shared(volume, crop.yields.grain_mass)
    straw = shared(stalks.length * stalks.scale**2, crop.yields.straw_mass)
    return assemble(height, grain, straw, parts)


def _tassels(facts: TasselFacts, stalks: Stalks, rng: np.random.Generator) -> Part:
    """A spike straight up and others around it."""
    stems = len(stalks.length)
    owner, number = np.divmod(np.arange(stems * facts.drawn), facts.drawn)
    is_middle = number == 0
    up = np.tile([0.0, 0.0, 1.0], (len(owner), 1))
    angle = np.where(is_middle, 0.0, facts.spread * rng.uniform(0.5, 1.3, len(owner)))
    direction = apart(up, angle, rng.uniform(-np.pi, np.pi, len(owner)))
    length = np.where(is_middle, facts.length, facts.length * rng.uniform(0.5, 0.9, len(owner)))
    radius = np.full(len(owner), 0.5 * facts.diameter)
    start = stalks.top()[owner]
    return rods(Organ.BRANCH, start, start + (length - radius)[:, None] * direction, radius, owner)


def _cobs(facts: CobFacts, stalks: Stalks, plane: Array, rng: np.random.Generator) -> tuple[Part, Array]:
    """One cob per stalk, in the plane of the leaves, and its volume [m3]."""
    stems = len(stalks.length)
    owner = np.arange(stems)
    foot_height = normal(rng, facts.height, facts.height_sd, stems)
    share = np.clip(foot_height / stalks.length, 0.1, 0.9)
    azimuth = plane + np.pi * rng.integers(0, 2, stems)
    tilt = np.maximum(normal(rng, facts.inclination_mean, facts.inclination_sd, stems), 0.0)
    length = sizes(rng, facts.length, facts.length_cv, stems)
    radius = 0.5 * facts.diameter * np.sqrt(length / facts.length)
    beside = pointing(np.full(stems, 0.5 * np.pi), azimuth)
    foot = stalks.point(share, owner) + radius[:, None] * beside
    direction = pointing(tilt, azimuth)
    a, b = foot + radius[:, None] * direction, foot + (length - radius)[:, None] * direction
    return rods(Organ.COB, a, b, radius, owner), length * radius**2


HABIT = Habit(
    make,
    yields=CobYield,
    organs={"leaf": LeafFacts, "tassel": TasselFacts, "cob": CobFacts},
    reflective=("stem", "leaf", "branch", "cob"),
)
