"""Solids of all kinds as one list of boxes, capsules and ellipsoids with a frame each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.field.layout import Solids

BOX, CAPSULE, ELLIPSOID = 0, 1, 2


@dataclass(frozen=True)
class SolidList:
    """k solids in the world frame.

    kind: (k,); centre: (k, 3) [m]; axes: (k, 3, 3), columns are the axes; half: (k, 3) half sizes [m], of a
    capsule radius, radius, half length of its axis; bound: (k,) radius of a ball around it [m]; reflectance
    """

    kind: NDArray[np.int32]
    centre: NDArray[np.float64]
    axes: NDArray[np.float32]
    half: NDArray[np.float32]
    bound: NDArray[np.float32]
    reflectance: NDArray[np.float32]


def pack_solids(solids: Solids) -> SolidList:
    """One list: boxes, then capsules, then ellipsoids."""
    along = solids.capsule_b - solids.capsule_a
    length = np.linalg.norm(along, axis=1)
    radius = solids.capsule_radius
    centre = np.concatenate(
        [solids.box_centre, 0.5 * (solids.capsule_a + solids.capsule_b), solids.ellipsoid_centre]
    )
    axes = np.concatenate([solids.box_axes, _frames(along), solids.ellipsoid_axes])
    half = np.concatenate(
        [solids.box_half, np.stack([radius, radius, 0.5 * length], axis=-1), solids.ellipsoid_half]
    )
    bound = np.concatenate(
        [
            np.linalg.norm(solids.box_half, axis=1),
            radius + 0.5 * length,
            solids.ellipsoid_half.max(axis=1, initial=0.0),
        ]
    )
    sizes = [len(solids.box_half), len(radius), len(solids.ellipsoid_half)]
    reflectance = [solids.box_reflectance, solids.capsule_reflectance, solids.ellipsoid_reflectance]
    return SolidList(
        np.repeat([BOX, CAPSULE, ELLIPSOID], sizes).astype(np.int32),
        np.ascontiguousarray(centre, np.float64),
        np.ascontiguousarray(axes, np.float32),
        np.ascontiguousarray(half, np.float32),
        (bound * 1.0001 + 1e-4).astype(np.float32),
        np.concatenate(reflectance).astype(np.float32),
    )


def _frames(along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Right-handed frames (n, 3, 3) whose third column points along the vectors (n, 3)."""
    length = np.linalg.norm(along, axis=1, keepdims=True)
    z = np.where(length > 0.0, along / np.maximum(length, 1e-12), [0.0, 0.0, 1.0])
    helper = np.where(np.abs(z[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    x = np.cross(helper, z)
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    return np.stack([x, np.cross(z, x), z], axis=-1)
