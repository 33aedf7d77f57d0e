"""Obstacles and machine bodies: boxes, posts and stones that a ray can hit."""

from collections import Counter
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from numpy.typing import NDArray
from pydantic import Field as PydanticField

from swath.core.errors import InputError
from swath.core.frames import Pose, rotation_matrix
from swath.core.portable import product
from swath.core.units import DEG
from swath.field.memory_layout import SolidMesh, Solids
from swath.field.mesh_file import UNITS, UP, base_middle, file_up, read_mesh
from swath.signals.setup import Hitch, MachineGeometry, OpenBox

Array = NDArray[np.float64]
PLACE = 1e5  # farthest coordinate of an obstacle [m]
WOOD, PAINT, STONE, GRAIN = 0.4, 0.3, 0.3, 0.45  # reflectance at 905 nm, assumed; a user can set each
MESH_SIZE = (0.01, 200.0)  # of a mesh [m]
KNIFE_CLEARANCE = 0.1  # of the header's body above ground [m], assumed

Metres = Annotated[float, Ge(-PLACE), Le(PLACE)]
Size = Annotated[float, Gt(0.0), Le(100.0)]
Heading = Annotated[float, Ge(-360.0), Le(360.0)]
Share = Annotated[float, Ge(0.0), Le(1.0)]
ObstacleName = Annotated[str, MinLen(1), MaxLen(40)]


@dataclass(frozen=True, kw_only=True)
class Placed:
    """x_m, y_m: where it stands; name: in reports, none = its kind and number."""

    x_m: Metres
    y_m: Metres
    name: ObstacleName | None = None


@dataclass(frozen=True, kw_only=True)
class PostObstacle(Placed):
    """An upright round post. x_m, y_m: its foot on the ground; name: in reports, none = kind and number."""

    kind: Literal["post"] = "post"
    height_m: Size = 2.0
    diameter_m: Size = 0.15
    reflectance: Share = WOOD


@dataclass(frozen=True, kw_only=True)
class BoxObstacle(Placed):
    """A box on the ground. x_m, y_m: its middle; heading_deg: of its length, from east to the left
    name: in reports, none = its kind and number
    """

    kind: Literal["box"] = "box"
    length_m: Size = 2.0
    width_m: Size = 2.0
    height_m: Size = 2.0
    heading_deg: Heading = 0.0
    reflectance: Share = PAINT


@dataclass(frozen=True, kw_only=True)
class StoneObstacle(Placed):
    """An ellipsoid, half of its height above ground. x_m, y_m: its middle
    name: in reports, none = its kind and number
    """

    kind: Literal["stone"] = "stone"
    length_m: Size = 0.5
    width_m: Size = 0.4
    height_m: Size = 0.5
    heading_deg: Heading = 0.0
    reflectance: Share = STONE


@dataclass(frozen=True, kw_only=True)
class MeshObstacle(Placed):
    """A thing from a mesh file (OBJ, PLY, GLB; extra `mesh`). x_m, y_m: its foot.

    file: the mesh; unit: of its coordinates; up: its axis that points up, none = y in GLB, else z
    scale: on top of the unit; foot: what stands at x_m, y_m: the middle of the mesh's `base` or its `origin`
    z_m: of the foot above ground; heading_deg, pitch_deg, roll_deg: of its x axis from east to the left, nose
    down, right side down, about the foot
    name: in reports, none = its kind and number
    """

    file: str
    kind: Literal["mesh"] = "mesh"
    unit: Literal["m", "cm", "mm", "inch"] = "m"
    up: Literal["x", "y", "z"] | None = None
    scale: Annotated[float, Gt(0.0), Le(1000.0)] = 1.0
    foot: Literal["base", "origin"] = "base"
    z_m: Annotated[float, Ge(-100.0), Le(100.0)] = 0.0
    heading_deg: Heading = 0.0
    pitch_deg: Annotated[float, Ge(-90.0), Le(90.0)] = 0.0
    roll_deg: Annotated[float, Ge(-180.0), Le(180.0)] = 0.0
    reflectance: Share = PAINT


Obstacle = Annotated[
    PostObstacle | BoxObstacle | StoneObstacle | MeshObstacle, PydanticField(discriminator="kind")
]


def make_obstacles(obstacles: Any, field: Any) -> Solids:
    """Solids of obstacle parameters, see `named_obstacles`, together."""
    return merge(*named_obstacles(obstacles, field).values())


def named_obstacles(obstacles: Any, field: Any) -> dict[str, Solids]:
    """Solids of obstacle parameters by name, each standing on the ground of a field (its `ground_height` is
    asked). One without a name has its kind and its number among all of that kind, such as `post 1`.

    Raises InputError for an obstacle outside the boundary of the field, whose mesh cannot be used, or whose
    name another one has.
    """
    made: dict[str, Solids] = {}
    counts: Counter[str] = Counter()
    for index, o in enumerate(obstacles):
        key = f"field.obstacles.{index}"
        region = getattr(field, "boundary", None)
        if region is not None and not bool(region.contains(o.x_m, o.y_m)):
            raise InputError(key, f"[{o.x_m:g}, {o.y_m:g}]", "expected a place inside the boundary")
        counts[o.kind] += 1
        name = o.name or f"{o.kind} {counts[o.kind]}"
        if name in made:
            raise InputError(f"{key}.name", name, "expected a name that no other obstacle has")
        made[name] = _obstacle(o, np.array([o.x_m, o.y_m, float(field.ground_height(o.x_m, o.y_m))]), key)
    return made


def _obstacle(o: Any, foot: Array, key: str) -> Solids:
    if isinstance(o, PostObstacle):
        return post(foot, o.height_m, o.diameter_m, o.reflectance)
    if isinstance(o, MeshObstacle):
        return _mesh_obstacle(o, foot, f"{key}.file")
    shape = box_on_ground if isinstance(o, BoxObstacle) else stone
    return shape(foot, (o.length_m, o.width_m, o.height_m), o.heading_deg * DEG, o.reflectance)


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


def _mesh_obstacle(o: MeshObstacle, ground: Array, key: str) -> Solids:
    path = Path(o.file)
    parts = read_mesh(path, key=key)
    corners = product(np.concatenate([p.corners for p in parts]), UP[o.up or file_up(path)].T)
    corners = corners * (UNITS[o.unit] * o.scale)
    if o.foot == "base":
        corners = corners - base_middle(corners)
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    if not MESH_SIZE[0] <= size <= MESH_SIZE[1]:
        expected = (
            f"expected a thing of {MESH_SIZE[0]:g} to {MESH_SIZE[1]:g} m, it is {size:.3g} m: unit, scale?"
        )
        raise InputError(key, path.name, expected)
    foot = ground + np.array([0.0, 0.0, o.z_m])
    turn = Pose.from_euler(foot, roll=o.roll_deg * DEG, pitch=o.pitch_deg * DEG, yaw=o.heading_deg * DEG)
    return mesh(corners, turn, o.reflectance)


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
