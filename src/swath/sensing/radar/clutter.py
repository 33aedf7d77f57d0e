"""What crop and ground throw back at a radar, by azimuth and distance.

Volume scattering of the stand after the water-cloud model (Attema and Ulaby 1978,
doi:10.1029/RS013i002p00357), here along every path through the field as it stands: a volume of extinction k
[1/m] scatters back 2 g k [m2/m3], less what the crop before it takes, and the ground what gets there. Over a
flat, even stand of height h that is g sin(psi) (1 - exp(-2 k h / sin(psi))) + s exp(-2 k h / sin(psi)) per
area of ground at a depression psi, with s = gamma sin(psi). What hills hide is not looked for.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.portable import arcsin, arctan2, exp, product
from swath.field.field import Field
from swath.sensing.radar.stand_loss import BIN, StandLoss
from swath.signals import F64

LAYERS = 4  # of the stand
STEPS = 16  # of the part of a way that may lie in crop
LEAST = 1e-9


@dataclass(frozen=True)
class Echoes:
    """By azimuth and distance, (n, m) each. area: radar cross section [m2] per azimuth [rad] and distance [m]

    way: from the sensor to the ground, unit (n, m, 3); azimuth, elevation: of it in the sensor's frame [rad]
    """

    area: F64
    way: F64
    azimuth: F64
    elevation: F64


class Clutter:
    """Of a field. stand: None = no crop for the radar; wave: extinction of the wave over the geometric one

    crop: g; ground: gamma; both linear
    """

    def __init__(
        self, field: Field, stand: StandLoss | None, *, wave: float, crop: float, ground: float
    ) -> None:
        self._field, self._stand = field, stand
        self._wave, self._crop, self._ground = wave, crop, ground

    def echoes(self, eye: F64, rotation: F64, azimuths: F64, ranges: F64) -> Echoes:
        """From an eye (3,) whose frame has a rotation (3, 3), at azimuths (n,) [rad] and distances (m,) [m],
        both in even steps."""
        ahead = product(np.stack([np.cos(azimuths), np.sin(azimuths), 0.0 * azimuths], axis=1), rotation.T)
        flat = ahead[:, :2] / np.hypot(ahead[:, 0], ahead[:, 1])[:, None]
        high = float(eye[2]) - float(self._field.ground_height(float(eye[0]), float(eye[1])))
        level = np.sqrt(np.maximum(ranges**2 - high**2, 0.0))
        x, y = (eye[k] + flat[:, k, None] * level for k in range(2))
        ground = self._field.ground_height(x, y)
        drop = float(eye[2]) - ground
        way = np.stack([x - eye[0], y - eye[1], -drop], axis=-1)
        length = np.maximum(np.sqrt((way * way).sum(axis=-1)), LEAST)
        step = np.maximum(np.gradient(level), LEAST)
        rise = np.where(step > LEAST, np.gradient(ground, axis=1) / step, 0.0)
        facing = (rise * level + drop) / (length * np.sqrt(1.0 + rise**2))
        echo = self._ground * np.clip(facing, 0.0, 1.0)
        if self._stand is not None and (stands := self._field.standing(x, y)).any():
            paths = _Paths(self._stand, eye, high, flat, ranges, level, x, y, ground, stands)
            echo = paths.echo(self._wave, self._crop, echo)
        way = way / length[..., None]
        own = product(way, rotation)
        return Echoes(
            np.where(ranges > high, echo * ranges, 0.0),
            way,
            arctan2(own[..., 1], own[..., 0]),
            arcsin(np.clip(own[..., 2], -1.0, 1.0)),
        )


class _Paths:
    """Ways from the eye to heights above places (n, m), and the crop on them."""

    def __init__(
        self,
        stand: StandLoss,
        eye: F64,
        high: float,
        flat: F64,
        ranges: F64,
        level: F64,
        x: F64,
        y: F64,
        ground: F64,
        stands: NDArray[np.bool_],
    ) -> None:
        scale, lean_x, lean_y, density = (np.zeros(x.shape) for _ in range(4))
        found = stand.tiles(x[stands], y[stands])
        for table, values in zip((scale, lean_x, lean_y, density), found, strict=True):
            table[stands] = values
        ux, uy = stand.turned(flat)
        over = np.maximum(scale, 0.1)
        self._eye, self._level, self._profile = float(eye[2]), level, stand.profile
        self._top = len(stand.profile) * BIN * scale  # of the stand above the ground, 0 where none stands
        self._ground, self._bins, self._density = ground, 1.0 / (over * BIN), density
        self._lean = (lean_x * ux[:, None] + lean_y * uy[:, None]) / over
        self._stem = (lean_x**2 + lean_y**2) / over**2 + 1.0  # length of a stem per height, squared
        self._high, self._first = high, float(ranges[0])
        self._pitch = float(ranges[1] - ranges[0]) if len(ranges) > 1 else 1.0
        self._row = np.arange(len(x))[:, None, None] * x.shape[1]

    def echo(self, wave: float, crop: float, bare: F64) -> F64:
        """Cross section per area of ground, of crop and of what lies below it (n, m): (n, m)."""
        edges = np.arange(LAYERS + 1) / LAYERS
        depth = wave * np.stack([self._depth(self._ground + s * self._top) for s in edges], axis=-1)
        left = exp(-2.0 * depth)
        across = -2.0 * np.diff(depth, axis=-1)  # deeper below
        thin = np.abs(across) < 1e-3
        gone = np.diff(left, axis=-1) / np.where(thin, 1.0, across)
        mean = np.where(thin, 0.5 * (left[..., 1:] + left[..., :-1]), gone)
        middle = self._ground[..., None] + (edges[:-1] + 0.5 / LAYERS) * self._top[..., None]
        here = np.broadcast_to(np.arange(bare.shape[1])[None, :, None], middle.shape)
        drop = self._eye - middle
        k = self._extinction(here, middle, drop / np.hypot(self._level[:, None], drop))
        volume = 2.0 * crop * wave * (k * mean).sum(axis=-1) * self._top / LAYERS
        return np.asarray(volume + bare * left[..., 0])

    def _depth(self, z: F64) -> F64:
        """Geometric optical depth of the ways to heights (n, m): (n, m)."""
        drop = self._eye - z
        over = self._eye - (self._ground + float(self._top.max()))  # of the eye over the canopy
        enters = np.where((over > 0.0) & (drop > over), over / np.maximum(drop, LEAST), 0.0)
        enters = np.where((over > 0.0) & (drop <= over), 1.0, enters)
        step = (1.0 - enters) / STEPS
        share = enters[..., None] + step[..., None] * (np.arange(STEPS) + 0.5)
        far = np.sqrt((self._level[:, None] * share) ** 2 + self._high**2)
        index = ((far - self._first) / self._pitch + 0.5).astype(np.int64)
        index = np.clip(index, 0, self._ground.shape[1] - 1)
        length = np.hypot(self._level, drop)
        sine = drop / np.maximum(length, LEAST)
        k = self._extinction(index, self._eye - drop[..., None] * share, sine[..., None])
        return np.asarray(k.sum(axis=-1) * step * length)

    def _extinction(self, index: NDArray[np.int64], height: F64, sine: F64) -> F64:
        """Geometric [1/m] at heights (n, m, k) over places number `index`, on ways down by a sine."""
        at = self._row + index
        layer = ((height - self._ground.take(at)) * self._bins.take(at)).astype(np.int64)
        inside = (layer >= 0) & (layer < len(self._profile))
        k = self._density.take(at) * self._profile.take(np.where(inside, layer, 0)) * inside
        along = self._lean.take(at) * np.sqrt(1.0 - sine * sine) - sine
        return np.asarray(k * np.sqrt(np.maximum(self._stem.take(at) - along * along, 0.0)))
