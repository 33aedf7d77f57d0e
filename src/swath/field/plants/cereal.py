"""Cereals: a stalk, an ear that may nod on a bent neck, awns, dried leaves. Also stubble: the stalk alone."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from swath.core import portable
from swath.core.errors import InputError
from swath.documents.sheet_fields import Quantity
from swath.field.crop import CV, Crop, GrainYield, Habit, Organs
from swath.field.memory_layout import Organ, Shape
from swath.field.plants.drawing import Drawing
from swath.field.plants.parts import (
    Array,
    LeafFacts,
    Leafing,
    Part,
    Plants,
    Stalks,
    apart,
    arc,
    assemble,
    blades,
    heights_of,
    normal,
    pointing,
    rods,
    shared,
    sizes,
    stalk_capsules,
)

NECK_PARTS = 3  # capsules of the bend below a nodding ear


@dataclass(frozen=True, kw_only=True)
class EarFacts:
    """length, width, thickness [m], length_cv; inclination_mean, inclination_sd [rad] from vertical."""

    length: Annotated[float, Quantity("mm", 5, 500)]
    length_cv: Annotated[float, CV]
    width: Annotated[float, Quantity("mm", 1, 200)]
    thickness: Annotated[float, Quantity("mm", 1, 200)]
    inclination_mean: Annotated[float, Quantity("deg", 0, 170)]
    inclination_sd: Annotated[float, Quantity("deg", 0, 90)]

    @property
    def diameter(self) -> float:
        """Mean silhouette width over all view azimuths [m].

        Cauchy: perimeter / pi, of the ellipse width x thickness (Ramanujan's first approximation).
        """
        a, b = 0.5 * self.width, 0.5 * self.thickness
        return 3.0 * (a + b) - math.sqrt((3.0 * a + b) * (a + 3.0 * b))

    def __post_init__(self) -> None:
        if self.length <= self.diameter:
            raise InputError("ear.length_mm", None, "expected longer than wide")


@dataclass(frozen=True, kw_only=True)
class NeckFacts:
    """The bend between an upright stalk and a nodding ear. length [m], length_cv."""

    length: Annotated[float, Quantity("mm", 5, 400)]
    length_cv: Annotated[float, CV]


@dataclass(frozen=True, kw_only=True)
class AwnFacts:
    """per_ear: awns of an ear; drawn: how many thicker ones stand for them, with the same silhouette
    length, diameter [m], length_cv; spread [rad]: between an awn and its ear.
    """

    per_ear: Annotated[int, Quantity("", 1, 200)]
    drawn: Annotated[int, Quantity("", 1, 60)]
    length: Annotated[float, Quantity("mm", 5, 300)]
    length_cv: Annotated[float, CV]
    diameter: Annotated[float, Quantity("mm", 0.05, 3)]
    spread: Annotated[float, Quantity("deg", 0, 90)]


@dataclass(frozen=True, kw_only=True)
class CerealYield(GrainYield):
    """grains_per_ear: of a mean stem."""

    grains_per_ear: Annotated[float, Quantity("", 1, 5000)]

    def grains(self, organs: Organs) -> float:
        """Grains of a mean stem."""
        return self.grains_per_ear


@dataclass(frozen=True)
class _Ears:
    """n ears. length, radius [m]; tilt: from vertical, nod: azimuth [rad]; neck: length of the bend [m]."""

    length: Array
    radius: Array
    tilt: Array
    nod: Array
    neck: Array

    def rise(self) -> Array:
        """Highest point of neck and ear above the top of the stalk [m]."""
        tip = np.maximum((self.length - self.radius) * np.cos(self.tilt) + self.radius, 0.0)
        if not self.neck.any():
            return tip
        bend = self.bend(np.zeros((len(self.tilt), 3)))[..., 2]
        lower = bend[:, -1] + self.radius * (1.0 + np.cos(self.tilt))
        return np.asarray(np.maximum(np.maximum(bend.max(axis=1), lower), bend[:, -1] + tip))

    def bend(self, top: Array) -> Array:
        """Points of the necks from the tops of the stalks, (n, NECK_PARTS + 1, 3)."""
        return arc(top, self.neck, np.zeros_like(self.tilt), self.tilt, self.nod, NECK_PARTS)


def make(crop: Crop, count: int, rng: np.random.Generator, how: Drawing) -> Plants:
    """Grain is shared out by ear length, straw by stalk volume. See `make_plants`."""
    facts, bend, leaf = crop.organs.of(EarFacts), crop.organs.of(NeckFacts), crop.organs.of(LeafFacts)
    height = heights_of(crop, rng, count)
    ear_length = np.zeros(count)
    if facts is not None:
        ear_length = sizes(rng, facts.length, facts.length_cv, count)
    scale = sizes(rng, 1.0, crop.stem.diameter_cv, count)
    lean = np.maximum(normal(rng, crop.stem.lean_mean, crop.stem.lean_sd, count), 0.0)
    tilt = np.zeros(count)
    if facts is not None:
        tilt = np.maximum(normal(rng, facts.inclination_mean, facts.inclination_sd, count), 0.0)
    heading, nod = rng.uniform(-np.pi, np.pi, (2, count))
    neck = np.zeros(count)
    if bend is not None:
        neck = sizes(rng, bend.length, bend.length_cv, count)
    if how.upright:
        lean, tilt, neck = np.zeros(count), np.zeros(count), np.zeros(count)
    heads = None
    if how.ears and facts is not None:
        heads = _Ears(ear_length, _radius(facts, ear_length), tilt, nod, neck)
    is_bare = heads is not None and how.fruit_only
    length = np.maximum(height - (heads.rise() if heads is not None else 0.0), 0.1 * height)
    reach = np.zeros(count) if is_bare else portable.tan(lean) * length
    stalks = Stalks(length, reach, heading, scale)
    parts = [] if is_bare else [stalk_capsules(crop.stem, stalks, how.stalk_parts)]
    if heads is not None:
        parts += _heads(crop, stalks, heads, rng, awns=not (how.upright or is_bare))
    if how.leaves and leaf is not None and not how.fruit_only:
        parts.append(blades(leaf, stalks, how.leaf_parts, rng, Leafing()))
    grain = shared(ear_length, crop.yields.grain_mass) if facts is not None else np.zeros(count)
    straw = shared(length * scale**2, crop.yields.straw_mass)
    return assemble(height, grain, straw, parts)


def _radius(facts: EarFacts, length: Array) -> Array:
    return 0.5 * facts.diameter * np.sqrt(length / facts.length)


def _heads(crop: Crop, stalks: Stalks, ears: _Ears, rng: np.random.Generator, *, awns: bool) -> list[Part]:
    """Ears with their necks and awns."""
    foot, owner = stalks.top(), np.arange(len(ears.length))
    parts = []
    if ears.neck.any():
        points = ears.bend(foot)
        radius = np.repeat(0.5 * crop.stem.diameter_top * stalks.scale[:, None], NECK_PARTS, axis=1)
        owners = np.repeat(owner, NECK_PARTS).reshape(-1, NECK_PARTS)
        parts.append(rods(Organ.STEM, points[:, :-1], points[:, 1:], radius, owners))
        foot = points[:, -1]
    direction = pointing(ears.tilt, ears.nod)
    a = foot + ears.radius[:, None] * direction
    b = foot + (ears.length - ears.radius)[:, None] * direction
    parts.append(Part(Shape.CAPSULE, Organ.EAR, a, b, ears.radius, np.zeros_like(a), owner))
    awn = crop.organs.of(AwnFacts)
    if awn is not None and awns:
        parts.append(_awns(awn, a, b, direction, ears, rng))
    return parts


def _awns(facts: AwnFacts, a: Array, b: Array, axis: Array, ears: _Ears, rng: np.random.Generator) -> Part:
    """Thin rods from all along the ear, forwards and outwards."""
    count = len(ears.length) * facts.drawn
    owner, number = np.divmod(np.arange(count), facts.drawn)
    along = (number + rng.random(count)) / facts.drawn
    length = sizes(rng, facts.length, facts.length_cv, count)
    direction = apart(axis[owner], np.full(count, facts.spread), rng.uniform(-np.pi, np.pi, count))
    start = a[owner] + along[:, None] * (b - a)[owner] + 0.5 * ears.radius[owner, None] * direction
    radius = np.full(count, 0.5 * facts.diameter * facts.per_ear / facts.drawn)
    return rods(Organ.AWN, start, start + length[:, None] * direction, radius, owner)


HABIT = Habit(
    make,
    yields=CerealYield,
    organs={"ear": EarFacts, "leaf": LeafFacts, "neck": NeckFacts, "awn": AwnFacts},
    optional=("neck", "awn"),
    reflective=("stem", "ear", "leaf", "awn"),
    reduced_leaf_parts=2,
    fruit_only=True,
)
