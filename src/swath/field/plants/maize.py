"""Maize: a thick stalk, broad leaves in one plane, a tassel on top, one cob at its node."""

import numpy as np

from swath.field.crop import Crop
from swath.field.memory_layout import Organ
from swath.field.organs import CobFacts, TasselFacts
from swath.field.plants.parts import (
    Array,
    Leafing,
    Part,
    Plants,
    Stalks,
    apart,
    assemble,
    blades,
    normal,
    pointing,
    rods,
    shared,
    stalk_capsules,
)

TAPER = (0.9, 1.1, 1.0, 0.4)  # width of a blade from its foot to its tip, relative
PLANE_SD = 0.6  # of the leaves' plane about the direction across the rows [rad]


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
    """Grain is shared out by cob volume, straw by stalk volume."""
    assert crop.leaf is not None
    assert crop.tassel is not None
    assert crop.cob is not None
    height = normal(rng, crop.stand.height, crop.stand.height * crop.stand.height_cv, count)
    scale = normal(rng, 1.0, crop.stem.diameter_cv, count)
    lean = np.maximum(normal(rng, crop.stem.lean_mean, crop.stem.lean_sd, count), 0.0)
    if upright:
        lean = np.zeros(count)
    length = np.maximum(height - crop.tassel.length, 0.1 * height)
    stalks = Stalks(length, np.tan(lean) * length, rng.uniform(-np.pi, np.pi, count), scale)
    plane = 0.5 * np.pi + normal(rng, 0.0, PLANE_SD, count)
    cobs, volume = _cobs(crop.cob, stalks, plane, rng)
    parts = [stalk_capsules(crop.stem, stalks, stalk_parts), _tassels(crop.tassel, stalks, rng)]
    if ears:
        parts.append(cobs)
    if leaves:
        how = Leafing(plane=plane, taper=TAPER)
        parts.append(blades(crop.leaf, stalks, leaf_parts + 1, rng, how))
    grain = shared(volume, crop.yields.grain_mass)
    straw = shared(length * scale**2, crop.yields.straw_mass)
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
    length = normal(rng, facts.length, facts.length * facts.length_cv, stems)
    radius = 0.5 * facts.diameter * np.sqrt(length / facts.length)
    beside = pointing(np.full(stems, 0.5 * np.pi), azimuth)
    foot = stalks.point(share, owner) + radius[:, None] * beside
    direction = pointing(tilt, azimuth)
    a, b = foot + radius[:, None] * direction, foot + (length - radius)[:, None] * direction
    return rods(Organ.COB, a, b, radius, owner), length * radius**2
