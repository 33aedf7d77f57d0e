"""Plants of a crop as capsules (stalk, ear) and ribbons (dried leaves): arrays of plants, no plant objects.

Every stem stands with its foot at the origin; z up. The library moves them to their places.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.field.crop import Crop
from swath.field.layout import Organ, Shape

Array = NDArray[np.float64]
CUTOFF = 3.0  # normal distributions are cut at this many standard deviations


@dataclass(frozen=True)
class Plants:
    """n stems and their m primitives.

    height: (n,) ground to the tip [m]; grain_kg, straw_kg: (n,) masses
    shape, organ: (m,); a, b, width: (m, 3) [m]; radius: (m,) [m], as in `layout.PlantLibrary`; owner: (m,)
    """

    height: Array
    grain_kg: Array
    straw_kg: Array
    shape: NDArray[np.uint8]
    organ: NDArray[np.uint8]
    a: Array
    b: Array
    radius: Array
    width: Array
    owner: NDArray[np.int32]


@dataclass(frozen=True)
class _Part:
    """Primitives of one kind. a, b, width: (..., 3); radius: (...); owner: (...)."""

    shape: Shape
    organ: Organ
    a: Array
    b: Array
    radius: Array
    width: Array
    owner: NDArray[np.int64]


@dataclass(frozen=True)
class _Stalks:
    """Centre lines of n stalks: foot at the origin, top at (reach * heading, length), parabola between."""

    length: Array
    reach: Array
    heading: Array
    scale: Array

    def point(self, share: Array, index: NDArray[np.int64]) -> Array:
        """Point at a share of the length, of the stalks `index`, (..., 3)."""
        out = self.reach[index] * share**2
        x, y = out * np.cos(self.heading[index]), out * np.sin(self.heading[index])
        return np.stack([x, y, share * self.length[index]], axis=-1)


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

    upright: stalks and ears vertical (for closed-form checks). stalk_parts: capsules per stalk; leaf_parts:
    ribbons per leaf. The mean grain mass is the crop's exactly, shared out by ear length; the mean straw mass
    follows from the crop's straw to grain ratio, shared out by stalk volume.
    """
    height = _normal(rng, crop.stand.height, crop.stand.height * crop.stand.height_cv, count)
    ear_length = _normal(rng, crop.ear.length, crop.ear.length * crop.ear.length_cv, count)
    scale = _normal(rng, 1.0, crop.stem.diameter_cv, count)
    lean = np.maximum(_normal(rng, crop.stem.lean_mean, crop.stem.lean_sd, count), 0.0)
    tilt = np.maximum(_normal(rng, crop.ear.inclination_mean, crop.ear.inclination_sd, count), 0.0)
    heading, nod = rng.uniform(-np.pi, np.pi, (2, count))
    if upright:
        lean, tilt = np.zeros(count), np.zeros(count)
    radius = 0.5 * crop.ear.diameter * np.sqrt(ear_length / crop.ear.length)
    rise = np.maximum((ear_length - radius) * np.cos(tilt) + radius, 0.0) if ears else np.zeros(count)
    length = np.maximum(height - rise, 0.1 * height)
    stalks = _Stalks(length, np.tan(lean) * length, heading, scale)
    parts = [_stalk_capsules(crop, stalks, stalk_parts)]
    if ears:
        parts.append(_ear_capsules(stalks, ear_length, radius, tilt, nod))
    if leaves:
        parts.append(_leaf_ribbons(crop, stalks, leaf_parts, rng))
    grain = _shared(ear_length, crop.yields.grain_mass)
    straw = _shared(length * scale**2, crop.yields.grain_mass * crop.yields.straw_to_grain)
    return _assemble(height, grain, straw, parts)


def silhouette_area(plants: Plants) -> dict[Organ, float]:
    """Summed side silhouette of each organ [m2]: capsule length times diameter; half the face of a ribbon."""
    span = np.linalg.norm(plants.b - plants.a, axis=1)
    capsule = plants.shape == Shape.CAPSULE
    face = 0.5 * span * 2.0 * np.linalg.norm(plants.width, axis=1)
    rod = 2.0 * plants.radius * span + np.where(plants.organ == Organ.EAR, np.pi * plants.radius**2, 0.0)
    area = np.where(capsule, rod, face)
    return {o: float(area[plants.organ == o].sum()) for o in (Organ.STEM, Organ.EAR, Organ.LEAF)}


def _stalk_capsules(crop: Crop, stalks: _Stalks, parts: int) -> _Part:
    count = len(stalks.length)
    owner, part = np.divmod(np.arange(count * parts), parts)
    a, b = stalks.point(part / parts, owner), stalks.point((part + 1) / parts, owner)
    taper = crop.stem.diameter_top - crop.stem.diameter_base
    radius = 0.5 * (crop.stem.diameter_base + taper * (part + 0.5) / parts) * stalks.scale[owner]
    return _Part(Shape.CAPSULE, Organ.STEM, a, b, radius, np.zeros_like(a), owner)


def _ear_capsules(stalks: _Stalks, length: Array, radius: Array, tilt: Array, nod: Array) -> _Part:
    owner = np.arange(len(length))
    direction = np.stack([np.sin(tilt) * np.cos(nod), np.sin(tilt) * np.sin(nod), np.cos(tilt)], axis=-1)
    foot = stalks.point(np.ones(len(length)), owner)
    a, b = foot + radius[:, None] * direction, foot + (length - radius)[:, None] * direction
    return _Part(Shape.CAPSULE, Organ.EAR, a, b, radius, np.zeros_like(a), owner)


def _leaf_ribbons(crop: Crop, stalks: _Stalks, parts: int, rng: np.random.Generator) -> _Part:
    facts, stems = crop.leaf, len(stalks.length)
    number = rng.integers(facts.count_min, facts.count_max + 1, stems)
    owner = np.repeat(np.arange(stems), number)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(number) - number, number)
    count = len(owner)
    share = facts.node_top - facts.node_step * (rank + rng.uniform(-0.25, 0.25, count))
    foot = stalks.point(np.clip(share, 0.02, 0.98), owner)
    length = _normal(rng, facts.length, facts.length * facts.length_cv, count)
    width = _normal(rng, facts.width, facts.width * facts.width_cv, count)
    azimuth = rng.uniform(-np.pi, np.pi, count)
    start = _normal(rng, facts.elevation_start, facts.elevation_sd, count)
    end = _normal(rng, facts.elevation_end, facts.elevation_sd, count)
    limit = 0.5 * np.pi - 0.01
    along = (np.arange(parts) + 0.5) / parts
    elevation = np.clip(start[:, None] + (end - start)[:, None] * along, -limit, limit)
    step = (length / parts)[:, None]
    out, up = np.cumsum(step * np.cos(elevation), axis=1), np.cumsum(step * np.sin(elevation), axis=1)
    shift = np.stack([out * np.cos(azimuth)[:, None], out * np.sin(azimuth)[:, None], up], axis=-1)
    ends = foot[:, None, :] + np.concatenate([np.zeros((count, 1, 3)), shift], axis=1)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(count)], axis=-1)
    half = np.repeat((0.5 * width)[:, None] * across, parts, axis=0).reshape(count, parts, 3)
    owners = np.repeat(owner, parts).reshape(count, parts)
    return _Part(Shape.RIBBON, Organ.LEAF, ends[:, :-1], ends[:, 1:], np.zeros((count, parts)), half, owners)


def _assemble(height: Array, grain: Array, straw: Array, parts: list[_Part]) -> Plants:
    sizes = [part.radius.size for part in parts]
    order = np.argsort(np.concatenate([part.owner.ravel() for part in parts]), kind="stable")

    def joined(values: list[Array]) -> Array:
        return np.concatenate(values)[order]

    return Plants(
        height,
        grain,
        straw,
        np.repeat([int(part.shape) for part in parts], sizes)[order].astype(np.uint8),
        np.repeat([int(part.organ) for part in parts], sizes)[order].astype(np.uint8),
        joined([part.a.reshape(-1, 3) for part in parts]),
        joined([part.b.reshape(-1, 3) for part in parts]),
        joined([part.radius.ravel() for part in parts]),
        joined([part.width.reshape(-1, 3) for part in parts]),
        np.concatenate([part.owner.ravel() for part in parts])[order].astype(np.int32),
    )


def _normal(rng: np.random.Generator, mean: float, sd: float, count: int) -> Array:
    return mean + sd * np.clip(rng.standard_normal(count), -CUTOFF, CUTOFF)


def _shared(weight: Array, mean: float) -> Array:
    return mean * weight / weight.mean() if len(weight) else weight
