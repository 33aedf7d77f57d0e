"""Cereals: a stalk, an ear that may nod on a bent neck, awns, dried leaves. Also stubble: the stalk alone."""

from dataclasses import dataclass

import numpy as np

from swath.field.crop import Crop, EarFacts
from swath.field.memory_layout import Organ, Shape
from swath.field.organs import AwnFacts
from swath.field.plants.parts import (
    Array,
    Leafing,
    Part,
    Plants,
    Stalks,
    apart,
    arc,
    assemble,
    blades,
    normal,
    pointing,
    rods,
    shared,
    stalk_capsules,
)

NECK_PARTS = 3  # capsules of the bend below a nodding ear


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


def make(
    crop: Crop,
    count: int,
    rng: np.random.Generator,
    *,
    leaves: bool,
    ears: bool,
    upright: bool,
    stalk_parts: int,
    leaf_parts: int,
) -> Plants:
    """Grain is shared out by ear length, straw by stalk volume. See `make_plants`."""
    facts = crop.ear
    height = normal(rng, crop.stand.height, crop.stand.height * crop.stand.height_cv, count)
    ear_length = np.zeros(count)
    if facts is not None:
        ear_length = normal(rng, facts.length, facts.length * facts.length_cv, count)
    scale = normal(rng, 1.0, crop.stem.diameter_cv, count)
    lean = np.maximum(normal(rng, crop.stem.lean_mean, crop.stem.lean_sd, count), 0.0)
    tilt = np.zeros(count)
    if facts is not None:
        tilt = np.maximum(normal(rng, facts.inclination_mean, facts.inclination_sd, count), 0.0)
    heading, nod = rng.uniform(-np.pi, np.pi, (2, count))
    neck = np.zeros(count)
    if crop.neck is not None:
        neck = normal(rng, crop.neck.length, crop.neck.length * crop.neck.length_cv, count)
    if upright:
        lean, tilt, neck = np.zeros(count), np.zeros(count), np.zeros(count)
    heads = None
    if ears and facts is not None:
        heads = _Ears(ear_length, _radius(facts, ear_length), tilt, nod, neck)
    length = np.maximum(height - (heads.rise() if heads is not None else 0.0), 0.1 * height)
    stalks = Stalks(length, np.tan(lean) * length, heading, scale)
    parts = [stalk_capsules(crop.stem, stalks, stalk_parts)]
    if heads is not None:
        parts += _heads(crop, stalks, heads, rng, awns=not upright)
    if leaves and crop.leaf is not None:
        parts.append(blades(crop.leaf, stalks, leaf_parts, rng, Leafing()))
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
    if crop.awn is not None and awns:
        parts.append(_awns(crop.awn, a, b, direction, ears, rng))
    return parts


def _awns(facts: AwnFacts, a: Array, b: Array, axis: Array, ears: _Ears, rng: np.random.Generator) -> Part:
    """Thin rods from all along the ear, forwards and outwards."""
    count = len(ears.length) * facts.drawn
    owner, number = np.divmod(np.arange(count), facts.drawn)
    along = (number + rng.random(count)) / facts.drawn
    length = normal(rng, facts.length, facts.length * facts.length_cv, count)
    direction = apart(axis[owner], np.full(count, facts.spread), rng.uniform(-np.pi, np.pi, count))
    start = a[owner] + along[:, None] * (b - a)[owner] + 0.5 * ears.radius[owner, None] * direction
    radius = np.full(count, 0.5 * facts.diameter * facts.per_ear / facts.drawn)
    return rods(Organ.AWN, start, start + length[:, None] * direction, radius, owner)
