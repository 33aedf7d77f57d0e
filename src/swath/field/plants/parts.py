"""What plants are made of: stalks, rods along a line, blades; drawn for all stems at once."""

from dataclasses import dataclass, fields, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.documents.sheet_fields import Quantity
from swath.field.crop import CV, Crop, StemFacts
from swath.field.memory_layout import Organ, Shape, ranked

Array = NDArray[np.float64]
CUTOFF = 3.0  # normal distributions are cut at this many standard deviations
LEAST_SIZE = 0.1  # of the mean: a normal distribution with a large coefficient of variation is cut there


@dataclass(frozen=True, kw_only=True)
class LeafFacts:
    """Leaves: count_min, count_max; node_top: foot of the highest, node_step: down to the next [share of the
    stem's length]; length, width [m] with cv; elevation_start, elevation_end [rad] of the blade above
    horizontal at its foot and its tip, elevation_sd [rad].
    """

    count_min: Annotated[int, Quantity("", 0, 20)]
    count_max: Annotated[int, Quantity("", 0, 20)]
    node_top: Annotated[float, Quantity("percent", 5, 100)]
    node_step: Annotated[float, Quantity("percent", 0, 50)]
    length: Annotated[float, Quantity("mm", 5, 1000)]
    length_cv: Annotated[float, CV]
    width: Annotated[float, Quantity("mm", 0.2, 200)]
    width_cv: Annotated[float, CV]
    elevation_start: Annotated[float, Quantity("deg", -90, 90)]
    elevation_end: Annotated[float, Quantity("deg", -90, 90)]
    elevation_sd: Annotated[float, Quantity("deg", 0, 60)]


@dataclass(frozen=True)
class Plants:
    """n stems and their m primitives.

    height: (n,) ground to the tip [m]
    grain_kg, straw_kg: (n,) masses
    shape, organ: (m,)
    a, b, width: (m, 3) [m]
    radius: (m,) [m], as in `layout.PlantLibrary`
    owner: (m,)
    reflectance: (m,) of the primitive itself, 0 = that of its organ; None = so for all
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
    reflectance: Array | None = None

    def own_reflectance(self) -> Array:
        """`reflectance` as numbers."""
        return np.zeros(len(self.owner)) if self.reflectance is None else self.reflectance


@dataclass(frozen=True)
class Part:
    """Primitives of one kind. a, b, width: (..., 3); radius: (...); owner: (...)."""

    shape: Shape
    organ: Organ
    a: Array
    b: Array
    radius: Array
    width: Array
    owner: NDArray[np.int64]


@dataclass(frozen=True)
class Stalks:
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

    def top(self) -> Array:
        """Tops of all stalks, (n, 3)."""
        count = len(self.length)
        return self.point(np.ones(count), np.arange(count))


def stalk_capsules(stem: StemFacts, stalks: Stalks, parts: int, organ: Organ = Organ.STEM) -> Part:
    """Each stalk as `parts` capsules, the diameter falling from base to top."""
    count = len(stalks.length)
    owner, part = np.divmod(np.arange(count * parts), parts)
    a, b = stalks.point(part / parts, owner), stalks.point((part + 1) / parts, owner)
    taper = stem.diameter_top - stem.diameter_base
    radius = 0.5 * (stem.diameter_base + taper * (part + 0.5) / parts) * stalks.scale[owner]
    return Part(Shape.CAPSULE, organ, a, b, radius, np.zeros_like(a), owner)


def rods(organ: Organ, a: Array, b: Array, radius: Array, owner: NDArray[np.int64]) -> Part:
    """Capsules from a to b (..., 3)."""
    return Part(Shape.CAPSULE, organ, a, b, radius, np.zeros_like(a), owner)


def pointing(inclination: Array, azimuth: Array) -> Array:
    """Unit vectors (..., 3) at an angle from the vertical."""
    out = np.sin(inclination)
    return np.stack([out * np.cos(azimuth), out * np.sin(azimuth), np.cos(inclination)], axis=-1)


def apart(axis: Array, angle: Array, turn: Array) -> Array:
    """Unit vectors (n, 3) at an angle from the unit vectors `axis`, turned about them."""
    side = np.cross(axis, np.where(np.abs(axis[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    side /= np.linalg.norm(side, axis=1)[:, None]
    third = np.cross(axis, side)
    round_it = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * third
    return np.asarray(np.cos(angle)[:, None] * axis + np.sin(angle)[:, None] * round_it)


def arc(start: Array, length: Array, first: Array, last: Array, azimuth: Array, parts: int) -> Array:
    """Points of curves in vertical planes, (n, parts + 1, 3): the inclination goes evenly from first to last.

    start: (n, 3); length [m], first, last: inclination [rad] from vertical, azimuth: (n,)
    """
    along = (np.arange(parts) + 0.5) / parts
    step = pointing(first[:, None] + (last - first)[:, None] * along, azimuth[:, None] + 0.0 * along)
    steps = np.cumsum(step * (length / parts)[:, None, None], axis=1)
    return np.asarray(start[:, None, :] + np.concatenate([np.zeros_like(steps[:, :1]), steps], axis=1))


@dataclass(frozen=True)
class Leafing:
    """How leaves sit.

    plane: azimuth of the plane that each stem's leaves stand in, to either side by turns [rad], (stems,),
        None = anywhere
    scatter: half range about it [rad]
    taper: width of each ribbon of a blade relative to the blade's; organ
    """

    plane: Array | None = None
    scatter: float = 0.35
    taper: tuple[float, ...] = ()
    organ: Organ = Organ.LEAF


def blades(facts: LeafFacts, stalks: Stalks, parts: int, rng: np.random.Generator, how: Leafing) -> Part:
    """Leaves of all stalks, each a chain of ribbons that bends downwards."""
    count_of = rng.integers(facts.count_min, facts.count_max + 1, len(stalks.length))
    owner, rank = ranked(count_of)
    count = len(owner)
    share = facts.node_top - facts.node_step * (rank + rng.uniform(-0.25, 0.25, count))
    foot = stalks.point(np.clip(share, 0.02, 0.98), owner)
    length = sizes(rng, facts.length, facts.length_cv, count)
    width = sizes(rng, facts.width, facts.width_cv, count)
    azimuth = rng.uniform(-np.pi, np.pi, count)
    if how.plane is not None:
        azimuth = how.plane[owner] + np.pi * rank + how.scatter / np.pi * azimuth
    start = normal(rng, facts.elevation_start, facts.elevation_sd, count)
    end = normal(rng, facts.elevation_end, facts.elevation_sd, count)
    limit = 0.5 * np.pi - 0.01
    along = (np.arange(parts) + 0.5) / parts
    elevation = np.clip(start[:, None] + (end - start)[:, None] * along, -limit, limit)
    step = (length / parts)[:, None]
    out, up = np.cumsum(step * np.cos(elevation), axis=1), np.cumsum(step * np.sin(elevation), axis=1)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    ends = np.empty((count, parts + 1, 3))
    ends[:, 0] = foot
    for k, shift in enumerate((out * cos[:, None], out * sin[:, None], up)):
        np.add(foot[:, k, None], shift, out=ends[:, 1:, k])
    across = np.stack([-sin, cos, np.zeros(count)], axis=-1)
    half = np.broadcast_to(((0.5 * width)[:, None] * across)[:, None, :], (count, parts, 3))
    if how.taper:
        half = half * np.interp(along, np.linspace(0.0, 1.0, len(how.taper)), how.taper)[:, None]
    owners = np.repeat(owner, parts).reshape(count, parts)
    return Part(Shape.RIBBON, how.organ, ends[:, :-1], ends[:, 1:], np.zeros((count, parts)), half, owners)


def assemble(height: Array, grain: Array, straw: Array, parts: list[Part]) -> Plants:
    """Join all parts; those of one stem stand together."""
    sizes = [part.radius.size for part in parts]
    owner = np.concatenate([part.owner.ravel() for part in parts])
    order = np.argsort(owner, kind="stable")
    a, b, width = (
        np.concatenate([getattr(part, name).reshape(-1, 3) for part in parts]).take(order, axis=0)
        for name in ("a", "b", "width")
    )
    radius = np.concatenate([part.radius.ravel() for part in parts])[order]
    shape, organ = (
        np.repeat([int(n) for n in kind], sizes)[order].astype(np.uint8) for kind in _kinds(parts)
    )
    return Plants(height, grain, straw, shape, organ, a, b, radius, width, owner[order].astype(np.int32))


def _kinds(parts: list[Part]) -> tuple[list[int], list[int]]:
    return [part.shape for part in parts], [part.organ for part in parts]


def normal(rng: np.random.Generator, mean: float, sd: float, count: int) -> Array:
    """Normal numbers, none further from the mean than CUTOFF standard deviations."""
    return mean + sd * np.clip(rng.standard_normal(count), -CUTOFF, CUTOFF)


def sizes(rng: np.random.Generator, mean: float, cv: float, count: int) -> Array:
    """Normal numbers with this coefficient of variation, none under LEAST_SIZE of the mean."""
    return np.maximum(normal(rng, mean, mean * cv, count), LEAST_SIZE * mean)


def shared(weight: Array, mean: float) -> Array:
    """A mass for each, in proportion to the weights and with this mean."""
    return mean * weight / weight.mean() if len(weight) else weight


def joined(one: Plants, two: Plants, order: NDArray[np.int64]) -> Plants:
    """The stems of both, in an order of one's stems followed by two's."""
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    owner = place[np.concatenate([one.owner, two.owner + len(one.height)])]
    pieces = np.argsort(owner, kind="stable")

    one, two = (replace(p, reflectance=p.own_reflectance()) for p in (one, two))
    both = {f.name: np.concatenate([getattr(one, f.name), getattr(two, f.name)]) for f in fields(Plants)}
    stems = ("height", "grain_kg", "straw_kg")
    both = {name: values[order if name in stems else pieces] for name, values in both.items()}
    return Plants(**both | {"owner": owner[pieces].astype(np.int32)})


def stalks_of(crop: Crop, rng: np.random.Generator, length: Array, *, upright: bool = False) -> Stalks:
    """Leaning stalks of these lengths [m], (n,)."""
    count, stem = len(length), crop.stem
    scale = sizes(rng, 1.0, stem.diameter_cv, count)
    lean = np.maximum(normal(rng, stem.lean_mean, stem.lean_sd, count), 0.0)
    reach = np.zeros(count) if upright else portable.tan(lean) * length
    return Stalks(length, reach, rng.uniform(-np.pi, np.pi, count), scale)


def heights_of(crop: Crop, rng: np.random.Generator, count: int) -> Array:
    """Heights of plants [m], (count,)."""
    return sizes(rng, crop.stand.height, crop.stand.height_cv, count)
