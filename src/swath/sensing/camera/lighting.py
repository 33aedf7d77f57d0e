"""The light that comes along the rays of a camera: surfaces in sun and sky, the sky itself, what is between.

Dust, rain and haze follow Koschmieder (1924): of what a surface sends exp(-b d) is left, and the air itself
adds (1 - exp(-b d)) of the light of the sky at the horizon. b is the extinction of `field/weather.py`,
of rain that of its drops.

Soil and straw are not of one colour, nor are plants: the colour of what is seen is multiplied by noise that
hangs on the place in the world alone, so that it stays there while the camera moves: clods of 2.5 cm to 3 m
on soil, stalks of 15 x 0.7 cm across each other on straw, kernels, chaff and ripples of 8 mm to 0.3 m on
grain in a box (there the place is that in the box), plants a little different from each other and from patch
to patch. What is finer than a pixel is left out, as the mean of many would. Sizes and strengths are our own
choice, by eye: nothing was measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.field.field import Field
from swath.field.memory_layout import Organ, Solids
from swath.field.wetness import darkened
from swath.rays.device import ThreadPool, start_warp
from swath.rays.engine import RayCaster
from swath.rays.hits import CastOptions, Hits
from swath.sensing.camera.instances import Instances
from swath.sensing.camera.lamps import Lamp
from swath.sensing.camera.orthophoto import Orthophoto
from swath.sensing.camera.shading import Daylight, linear, organ_colours
from swath.sensing.haze import haze_along
from swath.signals import F64

GRAIN = 64  # what a point is made of, beside the organs: grain in an open box
CHUNK_MIN = 4096  # fewer points than this are not worth another thread


def brightness(
    points: F64, organ: NDArray[np.uint8], pixel: NDArray[np.float32], seed: int, pool: ThreadPool
) -> NDArray[np.float32]:
    """Factor on the colour at points (n, 3) of the world with organs (n,), or GRAIN.

    pixel: its size there [m]
    """
    wp = start_warp()
    from swath.sensing.camera.texture_kernel import brightness as kernel

    wp.load_module(kernel.module, device="cpu")  # once, before threads would each do it
    factor = np.empty(len(points), np.float32)
    arrays = [
        _shared(wp, np.ascontiguousarray(a), kind)
        for a, kind in ((points, wp.vec3d), (organ, wp.uint8), (pixel, wp.float32), (factor, wp.float32))
    ]

    def run(first: int, count: int) -> None:
        inputs = [*arrays[:3], wp.uint32(seed & 0x7FFFFFFF), first, arrays[3]]
        wp.launch(kernel, dim=count, inputs=inputs, device="cpu")

    pool.split(len(points), CHUNK_MIN, run)
    return factor


def _shared(wp: Any, array: NDArray[Any], kind: Any) -> Any:
    return wp.array(array, dtype=kind, device="cpu", copy=False)


SHADOW_REACH = 8.0  # nothing further from a surface than this throws a shadow on it [m]
SAME_PLACE = 5e-4  # a ray from the sun that meets nothing before this gets to the surface seen [m]
THIN = Organ.LEAF, Organ.WEED  # lit by the sun from behind as from before: own choice
CANOPY = (164, 149, 96)  # mean colour of crop too far away for rays, in the sun, own choice
CANOPY_COSINE = 0.6  # of its parts to the sun, on average, shadows counted as 0; own choice
CLEAR_AIR = 2e-4  # extinction of clear air, visibility 20 km [1/m]: for what is beyond the reach of rays
DUST_LAYER = 10.0  # dust and rain are looked through so high above the camera [m], own choice
DUST_APART = 8  # samples between two rays along which dust is looked through
DUST_REACH, DUST_STEP = 120.0, 1.5  # how far dust of machines is looked for, and in what steps [m]
FAR = 2000.0  # the ground beyond the reach ends here [m]


@dataclass(frozen=True)
class LightSetup:
    """day: light of sun and sky; green: share of unripe colour.

    per_side: samples across a pixel
    shared: so many of a pixel's samples have one ray towards the sun, and one to each lamp
    shadows, texture: whether there are any
    extinction: of the air [1/m]
    pixel_angle [rad]: of a pixel in the middle
    seed: of the texture
    photo: laid onto the ground
    film: share of the plants that water covers
    """

    day: Daylight
    green: float
    shadows: bool
    per_side: int
    shared: int
    texture: bool
    extinction: float
    pixel_angle: float
    seed: int
    photo: Orthophoto | None = None
    film: float = 0.0


@dataclass(frozen=True)
class Surfaces:
    """What samples (rows, columns) hit, n of them.

    seen: which hit something, (rows, columns)
    distance: along the ray [m], (n,)
    points, normals: (n, 3), world
    is_thin: whether the sun shines through, (n,)
    """

    seen: NDArray[np.bool_]
    distance: F64
    points: F64
    normals: NDArray[np.float32]
    is_thin: NDArray[np.bool_]


def surfaces_of(hits: Hits, origins: F64, directions: F64) -> Surfaces:
    """What rays hit; origins: (3,) or as directions (rows, columns, 3)."""
    at = np.flatnonzero(hits.is_hit)
    distance = hits.distance.ravel()[at].astype(np.float64)
    points = distance[:, None] * directions.reshape(-1, 3)[at]
    points += origins if origins.ndim == 1 else origins.reshape(-1, 3)[at]
    thin = _IS_THIN[hits.organ.ravel()[at]]
    return Surfaces(hits.is_hit, distance, points, hits.normal.reshape(-1, 3)[at], thin)


class Lighting:
    """Makes light of hits. ray_count: rays towards sun and lamps so far."""

    def __init__(self, setup: LightSetup, field: Field, pool: ThreadPool) -> None:
        self.setup, self._field = setup, field
        self._colours = organ_colours(setup.green)
        self.ray_count, self._pool = 0, pool

    def light(
        self,
        hits: Hits,
        origins: F64,
        directions: F64,
        things: Instances,
        caster: RayCaster,
        t: int,
        lamps: Sequence[Lamp] = (),
    ) -> F64:
        """Linear light (rows, columns, 3) along rays; origins: (3,) or as directions (rows, columns, 3)."""
        day, on = self.setup.day, surfaces_of(hits, origins, directions)
        light, seen = np.empty(directions.shape), on.seen
        starts = np.broadcast_to(origins, directions.shape)
        far, sky = ~seen & (directions[..., 2] < 0.0), ~seen & (directions[..., 2] >= 0.0)
        light[sky] = day.sky_at(directions[sky])
        if far.any():
            light[far] = self._backdrop(starts[far], directions[far])
        colours = self._surface(hits, seen, on.points, on.distance, things)
        lit = day.on(on.normals, self._cosine(on, things.solids, caster, t))
        for lamp, pose in lamps:
            cosine = self._cosine(on, things.solids, caster, t, pose.position)
            away = np.linalg.norm(on.points - pose.position, axis=1)
            lux = lamp.lux(pose, on.points) * cosine * portable.exp(-self.setup.extinction * away)
            lit += lux[:, None] * day.lux
        lit *= colours
        light[seen] = lit
        if self.setup.extinction > 0.0 or self._is_dusty:
            self._through_air(light, hits, starts, directions)
        return light

    def cosines(
        self, hits: Hits, origins: F64, directions: F64, things: Instances, caster: RayCaster, t: int
    ) -> F64:
        """Cosines (n,) of the angle to the sun of what was hit, 0 in shadow."""
        return self._cosine(surfaces_of(hits, origins, directions), things.solids, caster, t)

    def _surface(
        self, hits: Hits, seen: NDArray[np.bool_], points: F64, distance: F64, things: Instances
    ) -> F64:
        """Linear colour of what was hit (n, 3)."""
        organ = hits.organ[seen]
        colours = self._colours[organ]
        if self.setup.film > 0.0:
            plants = (organ != Organ.GROUND) & (organ != Organ.SOLID)
            colours[plants] = darkened(colours[plants], self.setup.film)
        is_solid = organ == Organ.SOLID
        if is_solid.any():
            colours[is_solid] = things.colours[things.part(hits)[seen][is_solid]]
        if self.setup.photo is not None:
            ground = np.flatnonzero(organ == Organ.GROUND)
            photo = self.setup.photo.colours(points[ground, 0], points[ground, 1])
            known = ~np.isnan(photo[:, 0])
            colours[ground[known]] = photo[known]
        if self.setup.texture:
            pixel = (distance * self.setup.pixel_angle).astype(np.float32)
            material, places = organ, points
            if things.is_grain.any():
                material, places = self._grain(hits, seen, points, things)
            colours *= brightness(places, material, pixel, self.setup.seed, self._pool)[:, None]
        return colours

    def _grain(
        self, hits: Hits, seen: NDArray[np.bool_], points: F64, things: Instances
    ) -> tuple[NDArray[np.uint8], F64]:
        """What was hit, with GRAIN for grain, and where (n, 3): on grain in the frame of what carries it."""
        part = things.part(hits)[seen]
        found = things.is_grain[part]
        material = np.where(found, np.uint8(GRAIN), hits.organ[seen])
        places = points.copy()
        for number in np.unique(things.owner[part[found]]).tolist():
            own = np.flatnonzero(found & (things.owner[part] == number))
            places[own] = things.poses[number - 1].inverse().apply(points[own])
        return material, places

    def _backdrop(self, starts: F64, directions: F64) -> F64:
        """Light of the ground beyond the reach of rays (n, 3): crop, or the photo, in clear air."""
        s = self.setup
        eye = starts[0]
        height = max(float(eye[2]) - float(self._field.ground_height(eye[0], eye[1])), 0.1)
        distance = np.minimum(height / np.maximum(-directions[:, 2], 1e-6), FAR)
        colours = np.repeat(
            ((1.0 - s.green) * linear(CANOPY) + s.green * self._colours[Organ.LEAF])[None], len(starts), 0
        )
        if s.photo is not None:
            at = starts + distance[:, None] * directions
            photo = s.photo.colours(at[:, 0], at[:, 1])
            colours = np.where(np.isnan(photo), colours, photo)
        light = colours * (s.day.sky + CANOPY_COSINE * max(float(s.day.toward[2]), 0.0) ** 0.5 * s.day.sun)
        clear = portable.exp(-CLEAR_AIR * distance)[:, None]
        return np.asarray(clear * light + (1.0 - clear) * s.day.sky_at(directions))

    def _through_air(self, light: F64, hits: Hits, starts: F64, directions: F64) -> None:
        """Koschmieder's law, in place."""
        level = np.concatenate([directions[..., :2], np.zeros_like(directions[..., 2:])], axis=-1)
        up = np.maximum(directions[..., 2], 1e-6)
        path = np.where(hits.is_hit, hits.distance, np.minimum(DUST_LAYER / up, FAR)).astype(np.float64)
        depth = self.setup.extinction * path
        if self._is_dusty:
            depth += self._plumes(starts, directions, np.minimum(path, DUST_REACH))
        clear = portable.exp(-depth)[..., None]
        light *= clear
        light += (1.0 - clear) * self.setup.day.sky_at(level)

    @property
    def _is_dusty(self) -> bool:
        return any(len(puffs.rows) for puffs in self._field.plumes.values())

    def _plumes(self, starts: F64, directions: F64, path: F64) -> F64:
        """Optical depth of the dust of machines on paths (rows, columns) [m]: along every DUST_APART-th ray,
        linear between them.
        """
        kept, before, share = [], [], []
        for size in path.shape:
            at = np.unique(np.append(np.arange(0, size, DUST_APART), size - 1))
            k = np.clip(np.searchsorted(at, np.arange(size), "right") - 1, 0, max(len(at) - 2, 0))
            kept.append(at)
            before.append(k)
            apart = at[np.minimum(k + 1, len(at) - 1)] - at[k]
            share.append((np.arange(size) - at[k]) / np.maximum(apart, 1))
        i, j = np.ix_(*kept)
        rays = starts[i, j].reshape(-1, 3), directions[i, j].reshape(-1, 3)
        haze = haze_along(self._field, *rays, 0.0, DUST_REACH, DUST_STEP)
        (rows, columns), (down, right) = np.ix_(*before), np.ix_(*share)
        depth, across = np.zeros(path.shape), len(kept[1])
        for more_down, weight_down in ((0, 1.0 - down), (1, down)):
            for more_right, weight_right in ((0, 1.0 - right), (1, right)):
                row = np.minimum(rows + more_down, len(kept[0]) - 1)
                column = np.minimum(columns + more_right, across - 1)
                depth += weight_down * weight_right * haze.depth(path, row * across + column)
        return depth

    def _cosine(
        self, on: Surfaces, solids: Solids, caster: RayCaster, t: int, lamp: F64 | None = None
    ) -> F64:
        """Cosines (n,) of the angle between surfaces and a lamp at (3,), none = the sun, 0 in shadow."""
        count, day = len(on.points), self.setup.day
        if lamp is None and not day.sun.any():
            return np.zeros(count)
        away = day.toward[None] if lamp is None else lamp - on.points
        far = np.linalg.norm(away, axis=1)
        toward = away / np.maximum(far, SAME_PLACE)[:, None]
        cosine: F64 = np.einsum("ij,ij->i", on.normals, np.broadcast_to(toward, on.points.shape))
        cosine = np.maximum(np.where(on.is_thin, np.abs(cosine), cosine), 0.0)
        if not self.setup.shadows:
            return cosine
        asking, answer = self._sharing(on.seen, cosine > 0.0)
        length = np.full(1, SHADOW_REACH)
        if lamp is not None:
            toward, length = toward[asking], np.minimum(far[asking], SHADOW_REACH)
        is_lit = np.append(self._is_lit(on.points[asking], toward, length, caster, solids, t), False)
        return np.asarray(np.where(is_lit[answer], cosine, 0.0))

    def _sharing(
        self, seen: NDArray[np.bool_], faces: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Which of the n samples seen (rows, columns) ask for a ray to a lamp, of those that face it (n,).

        And whose answer each takes, (n,), as a place in these, -1 = none.
        """
        if self.setup.shared == 1:
            asking = np.flatnonzero(faces)
            answer = np.full(len(faces), -1)
            answer[asking] = np.arange(len(asking))
            return asking, answer
        number = np.full(seen.shape, len(faces))
        number[seen] = np.where(faces, np.arange(len(faces)), len(faces))
        side, (rows, columns) = self.setup.per_side, seen.shape
        pixels = number.reshape(rows // side, side, columns // side, side).swapaxes(1, 2)
        groups = pixels.reshape(-1, self.setup.shared)
        first = groups.min(axis=1)
        asks = first < len(faces)
        answer = np.full(len(faces) + 1, -1)
        answer[groups.ravel()] = np.repeat(np.where(asks, np.cumsum(asks) - 1, -1), self.setup.shared)
        return first[asks], answer[:-1]

    def _is_lit(
        self, points: F64, toward: F64, length: F64, caster: RayCaster, solids: Solids, t: int
    ) -> NDArray[np.bool_]:
        """Whether nothing stands on the ways from points (n, 3) along toward, (n, 3) or (1, 3) for all, of a
        length (n,) or (1,) [m]; what begins under the ground is dark.
        """
        starts, is_free = points + length[:, None] * toward, np.ones(len(points), dtype=bool)
        low = np.flatnonzero(starts[:, 2] <= self._field.pages.ground.max())
        is_free[low] = starts[low, 2] >= self._field.ground_height(starts[low, 0], starts[low, 1])
        if not is_free.all():
            starts = starts[is_free]
            toward, length = (a if len(a) == 1 else a[is_free] for a in (toward, length))
        if len(starts):
            self.ray_count += len(starts)
            options: CastOptions = {"range_max": float(length.max()), "solids": solids, "t": t}
            if len(toward) == 1:
                found = caster.cast_parallel(starts, -toward[0], **options)
            else:
                found = caster.cast(starts, -toward, **options)
            is_free[is_free] = ~(found.distance < (length - SAME_PLACE).astype(np.float32))
        return is_free


_IS_THIN = np.isin(np.arange(len(Organ)), THIN)
