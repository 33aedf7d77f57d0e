"""First returns from vertical stems with ears and no leaves: the closed form, and rays to hold against it.

A ray of depression b gets down to the height z when no plant part shadows its foot there. With n stems/m2 at
random places S(z) = exp(-n A(z)), A the mean shadow on the plane z of what one plant has above z. The plain
form takes A = cot(b) * integral (d + w) dz: d the silhouette's width at each height, w the width of a spot
that reports the nearest thing any part of it touches. It leaves out that stems and ears are round: seen from
above an ear is a disc as well, which counts at steep angles. `round_ends` adds that, exactly for capsules.

A spot of width w is a row of parallel rays across the view. Parts no narrower than the gap between two rays
cannot slip through, so w / (narrowest part) + 1 rays stand for the whole width: `ray_count`.
"""

from dataclasses import dataclass, replace
from functools import cache
from math import ceil

import numpy as np
from numpy.typing import NDArray

from swath.core.random import Stream
from swath.field.crop import Crop
from swath.field.crop_sheet import load_crop
from swath.field.edges.edge import StraightEdge, make_edge
from swath.field.field import make_field
from swath.field.field_setup import FieldSetup
from swath.field.memory_layout import Organ
from swath.field.plants.cereal import EarFacts
from swath.field.prototypes import make_library
from swath.field.stand import uniform
from swath.field.terrain import plane
from swath.rays.engine import RayCaster

F64 = NDArray[np.float64]
CUTOFF = 3.0  # heights are cut at this many standard deviations, as in field/plants.py
STEP = 0.001  # of the closed form over the height [m]
HALF_AREA = 16.0  # rays enter the crop within this of the middle of the stand [m]


@dataclass(frozen=True)
class Stems:
    """n: stems/m2; tip: mean height [m], cv of it; stem, ear: widths, ear_length [m]."""

    density: float
    tip: float = 0.85
    tip_cv: float = 0.08
    stem: float = 0.0035
    ear: float = 0.012
    ear_length: float = 0.09

    def tips(self) -> tuple[F64, F64]:
        """Heights of tips [m] and how often each occurs."""
        score = np.linspace(-CUTOFF, CUTOFF, 61)
        share = np.exp(-0.5 * score**2)
        return self.tip * (1.0 + self.tip_cv * score), share / share.sum()


@dataclass(frozen=True)
class Moments:
    """mean and std of the height of returns from crop [m]; ground: share of all that reach the ground."""

    mean: float
    std: float
    ground: float


@cache
def closed_form(stems: Stems, depression: float, width: float = 0.0, *, round_ends: bool = False) -> Moments:
    """Moments of first returns. depression [rad]; width of the spot [m], 0 = one thin ray."""
    z: F64 = np.asarray(
        STEP * np.arange(round(stems.tip * (1.0 + CUTOFF * stems.tip_cv) / STEP) + 2), np.float64
    )
    area = np.zeros_like(z)
    shadow = _round_shadow if round_ends else _plain_shadow
    tips, weight = stems.tips()
    for tip, part in zip(tips.tolist(), weight.tolist(), strict=True):
        area = area + part * shadow(stems, z, tip, depression, width)
    reach = np.exp(-stems.density * area)  # S(z), rises with z
    share, middle = np.diff(reach), 0.5 * (z[1:] + z[:-1])
    mean = float((share * middle).sum() / share.sum())
    std = float(np.sqrt((share * (middle - mean) ** 2).sum() / share.sum()))
    return Moments(mean, std, float(reach[0]))


def _plain_shadow(stems: Stems, z: F64, tip: float, depression: float, width: float) -> F64:
    ear = np.clip(tip - z, 0.0, stems.ear_length)
    stem = np.clip(tip - stems.ear_length - z, 0.0, None)
    return np.asarray(((stems.ear + width) * ear + (stems.stem + width) * stem) / np.tan(depression))


def _round_shadow(stems: Stems, z: F64, tip: float, depression: float, width: float) -> F64:
    """Shadow of a capsule on a cylinder [m2], slice by slice: y across the view, lengths along it.

    A slice of the ear is a capsule of radius rho = sqrt(r^2 - y^2); its shadow ends rho / sin(b) beyond that
    of its axis. Slices near the axis hold those further out, so a spot adds its width times the middle one.
    """
    r, s = 0.5 * stems.ear, 0.5 * stems.stem
    cot, sin = 1.0 / np.tan(depression), np.sin(depression)
    edges = np.concatenate([np.linspace(0.0, s, 9), np.linspace(s, r, 25)[1:]])
    y, dy = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    y, dy = np.concatenate([[0.0], y]), np.concatenate([[0.5 * width], dy])  # the middle slice and the spot
    rho, stalk = np.sqrt(r * r - y * y), np.sqrt(np.maximum(s * s - y * y, 0.0))
    top, bottom, foot = tip - r, tip - stems.ear_length + r, tip - stems.ear_length
    up = z[:, None] - top  # above the axis of the ear
    disc = np.sqrt(np.maximum(rho**2 - np.clip(up, 0.0, None) ** 2, 0.0))  # half length at height z
    far = np.where(up < rho * np.cos(depression), rho / sin - up * cot, disc)
    near = np.where(z[:, None] >= bottom, -disc, (bottom - z[:, None]) * cot - rho / sin)
    near = np.where((z[:, None] < foot) & (y < s), -stalk, near)
    near = np.where((z[:, None] >= foot) & (z[:, None] < bottom), np.maximum(near, -rho), near)
    length = np.where(up < rho, far - near, 0.0)
    return np.asarray(2.0 * (length * dy).sum(axis=1))


def ray_count(width: float, narrowest: float) -> int:
    """Fewest rays across a spot that no part of at least this width slips through."""
    return ceil(width / narrowest - 1e-9) + 1 if width > 0.0 else 1


class UprightStand:
    """Stems at random places that rays can be sent into, of a library of `tile_count` square metres."""

    def __init__(self, stems: Stems, seed: int = 1, *, tile_count: int = 48) -> None:
        self.stems = stems
        stream = Stream(seed, "first_returns")
        crop = _crop(stems)
        library = make_library(
            crop,
            density_max=stems.density,
            row_spacing=0.0,
            seed=stream,
            tile_count=tile_count,
            leaves=False,
            upright=True,
        )
        stand = uniform.Uniform(uniform.Params(stems_per_m2=stems.density, row_spacing_m=0.0), FieldSetup())
        ground = plane.Plane(plane.Params(), FieldSetup())
        edge = make_edge(
            StraightEdge(x_m=-200.0, y_m=-200.0, length_m=400.0, crop_begins_m=None), FieldSetup()
        )
        field = make_field(ground, stand, edge, crop=crop, library=library, stream=stream)
        field.ensure(0.0, 0.0, 1.5 * HALF_AREA + 8.0)
        self.stream, self.top, self.caster = stream, library.height_max, RayCaster(field)

    def look(self, depression: float, width: float, count: int, *, rays: int | None = None) -> Moments:
        """First returns of `count` spots at random places, seen from random sides.

        rays: parallel ones across a spot, None = as many as it takes; the nearest hit of a spot counts.
        """
        across = ray_count(width, self.stems.stem) if rays is None else rays
        rng = self.stream.child(f"{depression:.6f}/{width:.6f}").at()
        azimuth = rng.uniform(-np.pi, np.pi, count)
        start = rng.uniform(-HALF_AREA, HALF_AREA, (count, 2))
        side = np.stack([-np.sin(azimuth), np.cos(azimuth)], axis=1)
        offset = np.linspace(-0.5 * width, 0.5 * width, across) if across > 1 else np.zeros(1)
        origins = np.empty((count, across, 3))
        origins[..., :2] = start[:, None] + offset[None, :, None] * side[:, None]
        origins[..., 2] = self.top + 0.02
        c, s = np.cos(depression), np.sin(depression)
        forward = np.stack([c * np.cos(azimuth), c * np.sin(azimuth), np.full(count, -s)], axis=1)
        directions = np.repeat(forward, across, axis=0)
        hits = self.caster.cast(origins.reshape(-1, 3), directions, range_max=2.0 * self.top / s + 1.0)
        distance = np.where(hits.organ == Organ.GROUND, np.inf, hits.distance.astype(np.float64))
        nearest = distance.reshape(count, across).min(axis=1)
        height = self.top + 0.02 - nearest[np.isfinite(nearest)] * s
        return Moments(float(height.mean()), float(height.std()), float(np.mean(np.isinf(nearest))))


def _crop(stems: Stems) -> Crop:
    wheat = load_crop("wheat")
    ear = replace(
        wheat.organs[EarFacts], length=stems.ear_length, length_cv=0.0, width=stems.ear, thickness=stems.ear
    )
    return replace(
        wheat,
        stand=replace(wheat.stand, height=stems.tip, height_cv=stems.tip_cv),
        stem=replace(wheat.stem, diameter_base=stems.stem, diameter_top=stems.stem, diameter_cv=0.0),
        organs=wheat.organs.replaced(ear),
    )
