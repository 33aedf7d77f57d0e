"""Boxes, posts, stones and meshes that a ray can hit, and the bodies of machines."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose, rotation_matrix
from swath.core.portable import product
from swath.field.memory_layout import SolidMesh, Solids
from swath.signals.setup import Hitch, MachineGeometry, OpenBox

Array = NDArray[np.float64]
WOOD, PAINT, STONE, GRAIN = 0.4, 0.3, 0.3, 0.45  # reflectance at 905 nm, assumed; a user can set each
KNIFE_CLEARANCE = 0.1  # of the header's body above ground [m], assumed


def post(foot: Any, height: float, diameter: float, reflectance: float = WOOD) -> Solids:
    """Upright capsule from its foot (3,) [m]; its round top ends at the height."""
    foot = np.asarray(foot, dtype=float)
    radius = 0.5 * diameter
    top = foot + np.array([0.0, 0.0, max(height - radius, 0.0)])
    return Solids(
        capsule_a=foot[None],
        capsule_b=top[None],
        capsule_radius=np.array([radius]),
        capsule_reflectance=np.array([reflectance]),
    )


def box_on_ground(foot: Any, size: Any, heading: float = 0.0, reflectance: float = PAINT) -> Solids:
    """Box of size (length, width, height) [m] whose lower face has its middle at foot (3,)."""
    half = 0.5 * np.asarray(size, dtype=float)
    centre = np.asarray(foot, dtype=float) + np.array([0.0, 0.0, half[2]])
    return Solids(
        box_centre=centre[None],
        box_axes=rotation_matrix(0.0, 0.0, heading)[None],
        box_half=half[None],
        box_reflectance=np.array([reflectance]),
    )


def stone(foot: Any, size: Any, heading: float = 0.0, reflectance: float = STONE) -> Solids:
    """Ellipsoid of size (length, width, height) [m] around foot (3,): its lower half is in the soil."""
    return Solids(
        ellipsoid_centre=np.asarray(foot, dtype=float)[None],
        ellipsoid_axes=rotation_matrix(0.0, 0.0, heading)[None],
        ellipsoid_half=0.5 * np.asarray(size, dtype=float)[None],
        ellipsoid_reflectance=np.array([reflectance]),
    )


def mesh(corners: Any, pose: Pose, reflectance: float = PAINT) -> Solids:
    """A thing with a surface of triangles (n, 3, 3) [m] given in the frame of a pose."""
    corners = np.asarray(corners, dtype=float)
    flat = corners.reshape(-1, 3)
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    return Solids(
        mesh_shape=(SolidMesh((corners - middle).astype(np.float32)),),
        mesh_centre=pose.apply(middle)[None],
        mesh_axes=pose.rotation[None],
        mesh_reflectance=np.array([reflectance]),
    )


def machine_body(machine: MachineGeometry, reflectance: float = PAINT) -> Solids:
    """Chassis of a machine, and its header if it has one, as boxes in the machine frame."""
    rear, front, half_width, bottom, top = machine.body
    chassis = box_on_ground(
        [0.5 * (rear + front), 0.0, bottom],
        [front - rear, 2.0 * half_width, top - bottom],
        reflectance=reflectance,
    )
    if not machine.has_header:
        return chassis
    header = box_on_ground(
        [machine.knife_x - 0.5 * machine.header_depth, machine.header_y, KNIFE_CLEARANCE],
        [machine.header_depth, machine.header_width, machine.header_height],
        reflectance=reflectance,
    )
    return merge(chassis, header)


def trailer_body(hitch: Hitch, width: float, box: OpenBox | None, reflectance: float = PAINT) -> Solids:
    """A trailer as boxes in the frame of its axle: wheels and frame, drawbar, and the box for grain."""
    frame = box_on_ground([0.0, 0.0, 0.1], [2.2, width, 1.6], reflectance=reflectance)
    bar = box_on_ground([0.5 * hitch.drawbar, 0.0, 0.4], [hitch.drawbar, 0.3, 0.3], reflectance=reflectance)
    if box is None:
        return merge(frame, bar)
    size = [box.length, box.width + 0.1, box.depth + 0.3]
    return merge(frame, bar, box_on_ground([box.x, 0.0, box.floor - 0.3], size, reflectance=reflectance))


def box_walls(box: OpenBox, reflectance: float = PAINT) -> Solids:
    """Four walls of a box for grain, 5 cm thick, from 0.3 m below its floor to its rim."""
    high, low, thick = box.depth + 0.3, box.floor - 0.3, 0.05
    ends = [
        box_on_ground(
            [box.x + s * 0.5 * (box.length + thick), 0.0, low],
            [thick, box.width + 2 * thick, high],
            reflectance=reflectance,
        )
        for s in (-1.0, 1.0)
    ]
    sides = [
        box_on_ground(
            [box.x, s * 0.5 * (box.width + thick), low], [box.length, thick, high], reflectance=reflectance
        )
        for s in (-1.0, 1.0)
    ]
    return merge(*ends, *sides)


def height_surface(x: Array, y: Array, heights: Array, reflectance: float = GRAIN) -> Solids:
    """A surface of triangles through heights [m], shape (len(x), len(y))."""
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), heights], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    triangles = np.stack([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)])
    return mesh(triangles.reshape(-1, 3, 3), Pose.identity(), reflectance)


NOTHING = Solids()


def solid_count(solids: Solids) -> int:
    """Boxes, capsules, ellipsoids and meshes."""
    round_ = len(solids.capsule_radius) + len(solids.ellipsoid_half)
    return len(solids.box_half) + round_ + len(solids.mesh_shape)


def merge(*solids: Solids) -> Solids:
    """All of them together. A single one that is not empty is returned itself."""
    some = [s for s in solids if solid_count(s)]
    if len(some) < 2:
        return some[0] if some else NOTHING
    names = [f.name for f in fields(Solids) if f.name != "mesh_shape"]
    arrays = {name: np.concatenate([getattr(s, name) for s in some]) for name in names}
    return Solids(mesh_shape=tuple(m for s in some for m in s.mesh_shape), **arrays)


def moved(solids: Solids, pose: Pose) -> Solids:
    """Solids of an inner frame in the outer frame of a pose."""
    places = ("box_centre", "capsule_a", "capsule_b", "ellipsoid_centre", "mesh_centre")
    axes = ("box_axes", "ellipsoid_axes", "mesh_axes")
    there: dict[str, Any] = {name: pose.apply(getattr(solids, name)) for name in places}
    return replace(solids, **there | {name: product(pose.rotation, getattr(solids, name)) for name in axes})
