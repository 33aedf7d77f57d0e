"""The field from above as pixels, as it is now: crop, stubble, straw, bodies."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import Solids
from swath.report.plots import BLUE, CROP, INK, SOIL, STRAW, STUBBLE
from swath.report.scan_sampler import straw_depth
from swath.runtime.world import World
from swath.signals import F64

SHOWN_STRAW = 0.01  # depth from which straw is drawn [m]
Mask = NDArray[np.bool_]


def ground_colours(field: Any, x: F64, y: F64) -> NDArray[np.uint8]:
    """sRGB of world points (...) [m] by what is there, (..., 3): crop, stubble, bare ground, straw."""
    left = field.left_height(x, y)
    colours = np.empty((*np.shape(x), 3), np.uint8)
    colours[...] = _rgb(SOIL)
    colours[(left > 0.0) & np.isfinite(left)] = _rgb(STUBBLE)
    colours[np.isinf(left)] = _rgb(CROP)
    colours[(straw_depth(field, x, y) > SHOWN_STRAW) & ~np.isinf(left)] = _rgb(STRAW)
    return colours


def top_view(world: World, machine: str, *, size_m: float = 30.0, pixels: int = 300) -> NDArray[np.uint8]:
    """sRGB (pixels, pixels, 3), north up, a machine in the middle: it is blue, other bodies dark."""
    centre = world.bodies.pose_of(machine).position
    middle = (np.arange(pixels) + 0.5) / pixels - 0.5
    x, y = np.meshgrid(centre[0] + size_m * middle, centre[1] - size_m * middle)
    picture = ground_colours(world.field, x, y)
    own = world.bodies.own(machine)
    for body in world.bodies.around():
        picture[_under(body.solids, x, y)] = _rgb(BLUE if body.name in own else INK)
    return picture


def _under(solids: Solids, x: F64, y: F64) -> Mask:
    """Which points lie below or above a body. A mesh is taken as its box."""
    found: Mask = np.zeros(x.shape, bool)
    points = np.stack([x, y], axis=-1)
    for centre, axes, half in zip(solids.box_centre, solids.box_axes, solids.box_half, strict=True):
        found |= (np.abs((points - centre[:2]) @ axes[:2, :2]) <= half[:2]).all(axis=-1)
    for mesh, centre, axes in zip(solids.mesh_shape, solids.mesh_centre, solids.mesh_axes, strict=True):
        reach = np.abs(mesh.corners.reshape(-1, 3)).max(axis=0)
        found |= (np.abs((points - centre[:2]) @ axes[:2, :2]) <= reach[:2]).all(axis=-1)
    for centre, axes, half in zip(
        solids.ellipsoid_centre, solids.ellipsoid_axes, solids.ellipsoid_half, strict=True
    ):
        found |= (((points - centre[:2]) @ axes[:2, :2] / half[:2]) ** 2).sum(axis=-1) <= 1.0
    for a, b, radius in zip(solids.capsule_a, solids.capsule_b, solids.capsule_radius, strict=True):
        along = b[:2] - a[:2]
        share = np.clip((points - a[:2]) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        found |= ((points - a[:2] - share[..., None] * along) ** 2).sum(axis=-1) <= radius**2
    return found


def _rgb(colour: str) -> tuple[int, int, int]:
    """Of `#RRGGBB`."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue
