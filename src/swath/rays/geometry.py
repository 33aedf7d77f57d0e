"""Solids of all kinds as one list of boxes, capsules, ellipsoids and meshes with a frame each."""

from dataclasses import dataclass, fields
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import SolidMesh, Solids
from swath.field.solid.contact import frames_along
from swath.kernels import filled

BOX, CAPSULE, ELLIPSOID, MESH = 0, 1, 2, 3
_TREES: WeakKeyDictionary[SolidMesh, dict[str, Any]] = WeakKeyDictionary()  # search tree on each device


@dataclass(frozen=True)
class SolidList:
    """k solids in the world frame.

    kind: (k,)
    centre: (k, 3) [m]
    axes: (k, 3, 3), columns are the axes
    half: (k, 3) half sizes [m], of a capsule radius, radius, half length of its axis, of a mesh its box
    bound: (k,) radius of a ball around it [m]; reflectance
    mesh: (k,), None for all other kinds
    """

    kind: NDArray[np.int32]
    centre: NDArray[np.float64]
    axes: NDArray[np.float32]
    half: NDArray[np.float32]
    bound: NDArray[np.float32]
    reflectance: NDArray[np.float32]
    mesh: tuple[SolidMesh | None, ...]


def pack_solids(solids: Solids) -> SolidList:
    """One list: boxes, then capsules, ellipsoids and meshes."""
    along = solids.capsule_b - solids.capsule_a
    length = np.linalg.norm(along, axis=1)
    radius = solids.capsule_radius
    centre = np.concatenate(
        [
            solids.box_centre,
            0.5 * (solids.capsule_a + solids.capsule_b),
            solids.ellipsoid_centre,
            solids.mesh_centre,
        ]
    )
    axes = np.concatenate([solids.box_axes, frames_along(along), solids.ellipsoid_axes, solids.mesh_axes])
    rods = np.stack([radius, radius, 0.5 * length], axis=-1)
    shells = [np.abs(m.corners).max(axis=(0, 1)) for m in solids.mesh_shape]
    half = np.concatenate([solids.box_half, rods, solids.ellipsoid_half, np.reshape(shells, (-1, 3))])
    bound = np.concatenate(
        [
            np.linalg.norm(solids.box_half, axis=1),
            radius + 0.5 * length,
            solids.ellipsoid_half.max(axis=1, initial=0.0),
            np.linalg.norm(np.reshape(shells, (-1, 3)), axis=1),
        ]
    )
    sizes = [len(solids.box_half), len(radius), len(solids.ellipsoid_half), len(shells)]
    reflectance = [
        solids.box_reflectance,
        solids.capsule_reflectance,
        solids.ellipsoid_reflectance,
        solids.mesh_reflectance,
    ]
    return SolidList(
        np.repeat([BOX, CAPSULE, ELLIPSOID, MESH], sizes).astype(np.int32),
        np.ascontiguousarray(centre, np.float64),
        np.ascontiguousarray(axes, np.float32),
        np.ascontiguousarray(half, np.float32),
        (bound * 1.0001 + 1e-4).astype(np.float32),
        np.concatenate(reflectance).astype(np.float32),
        (*(None,) * sum(sizes[:3]), *solids.mesh_shape),
    )


def make_solid_arrays(wp: Any, solids: Solids, device: str) -> Any:
    """Solids as the kernels read them; on the CPU the arrays are those of the list, elsewhere copies."""
    from swath.rays.kernel.scene import SolidArrays

    packed = pack_solids(solids)
    if len(packed.kind) == 0:
        return SolidArrays()
    tree = np.array([0 if m is None else _tree(wp, m, device).id for m in packed.mesh], np.uint64)
    members = {f.name: getattr(packed, f.name) for f in fields(packed) if f.name != "mesh"}
    middle = packed.centre.mean(axis=0)
    reach = float((np.linalg.norm(packed.centre - middle, axis=1) + packed.bound).max()) * 1.0001
    ball = {"middle": wp.vec3d(*middle), "reach": reach}
    return filled(SolidArrays, device, count=len(packed.kind), tree=tree, **ball, **members)


def _tree(wp: Any, mesh: SolidMesh, device: str) -> Any:
    """The mesh with a search tree on a device, made once."""
    trees = _TREES.setdefault(mesh, {})
    if device not in trees:
        points = wp.array(mesh.corners.reshape(-1, 3), dtype=wp.vec3, device=device)
        trees[device] = wp.Mesh(
            points, wp.array(np.arange(3 * len(mesh.corners)), dtype=wp.int32, device=device)
        )
    return trees[device]
