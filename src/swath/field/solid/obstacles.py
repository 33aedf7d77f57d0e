"""Obstacles of a scenario: their kinds, where they stand, and the way that some of them go.

Their data sheets, `data/obstacles/*.yaml`, are bodies of simple solids and what they reflect.
"""

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal, get_args, get_type_hints

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from numpy.typing import NDArray
from pydantic import Field as PydanticField

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.portable import power, product
from swath.core.units import DEG, KMH
from swath.documents.data_sheets import read_sheet
from swath.documents.sheet_fields import Key, Quantity, Section
from swath.field.edges.track import Way
from swath.field.memory_layout import Solids
from swath.field.mesh_file import UNITS, UP, base_middle, file_up, read_mesh
from swath.field.solid.solids import PAINT, STONE, WOOD, box_on_ground, mesh, moved, post, stone

Six = tuple[float, float, float, float, float, float]
Seven = tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Warm:
    """What keeps a living thing warm.

    skin: temperature of the skin [deg C]
    insulation: of fur or clothes on it [m2 K/W]
    emissivity: of their outside at 8 to 14 um
    """

    skin: Annotated[float, Quantity("", 0, 45, key="skin_c")]
    insulation: Annotated[float, Quantity("", 0.001, 5, key="insulation_m2k_w")]
    emissivity: Annotated[float, Quantity("", 0.1, 1)]


@dataclass(frozen=True, kw_only=True)
class ObstacleSheet:
    """A thing with its foot at the origin, x forward, y left, z up.

    length, width, height: of the whole [m]
    reflectance: at 905 nm
    rcs_24, rcs_77: radar cross section at 24 and 77 GHz [dBsm]
    boxes, ellipsoids: rows of middle x, y, z and length, width, height [m]
    capsules: rows of two ends x, y, z each and the radius [m]
    warm: None for what is as warm as air and sun make it
    """

    format: str
    kind: Literal["obstacle"] = "obstacle"
    name: str
    note: str = ""
    length: Annotated[float, Quantity("m", 0.01, 200)]
    width: Annotated[float, Quantity("m", 0.01, 200)]
    height: Annotated[float, Quantity("m", 0.01, 100)]
    reflectance: Annotated[float, Quantity("", 0, 1)]
    rcs_24: Annotated[float, Quantity("", -60, 60, key="rcs_24_ghz_dbsm")]
    rcs_77: Annotated[float, Quantity("", -60, 60, key="rcs_77_ghz_dbsm")]
    boxes: Annotated[list[Six], Key("body.boxes_m")] = field(default_factory=list)
    ellipsoids: Annotated[list[Six], Key("body.ellipsoids_m")] = field(default_factory=list)
    capsules: Annotated[list[Seven], Key("body.capsules_m")] = field(default_factory=list)
    warm: Annotated[Warm | None, Section("warm.", when="warm")] = None

    def solids(self, size: tuple[float, float, float], reflectance: float) -> Solids:
        """The body stretched to a length, width and height [m]; a radius goes with the mean of x and y."""
        scale = np.array(size) / np.array([self.length, self.width, self.height])
        boxes, round_ = (np.array(rows, dtype=float).reshape(-1, 6) for rows in (self.boxes, self.ellipsoids))
        rods = np.array(self.capsules, dtype=float).reshape(-1, 7)
        sides = np.tile(np.eye(3), (len(boxes), 1, 1)), np.tile(np.eye(3), (len(round_), 1, 1))
        return Solids(
            box_centre=scale * boxes[:, :3],
            box_axes=sides[0],
            box_half=0.5 * scale * boxes[:, 3:],
            box_reflectance=np.full(len(boxes), reflectance),
            ellipsoid_centre=scale * round_[:, :3],
            ellipsoid_axes=sides[1],
            ellipsoid_half=0.5 * scale * round_[:, 3:],
            ellipsoid_reflectance=np.full(len(round_), reflectance),
            capsule_a=scale * rods[:, :3],
            capsule_b=scale * rods[:, 3:6],
            capsule_radius=float(power(scale[0] * scale[1], 0.5)) * rods[:, 6],
            capsule_reflectance=np.full(len(rods), reflectance),
        )


def load_obstacle(kind: str) -> ObstacleSheet:
    """The sheet of a kind of obstacle."""
    return read_sheet("obstacles", kind).read(ObstacleSheet)


Array = NDArray[np.float64]
PLACE = 1e5  # farthest coordinate of an obstacle [m]
MESH_SIZE = (0.01, 200.0)  # of a mesh [m]

Metres = Annotated[float, Ge(-PLACE), Le(PLACE)]
Size = Annotated[float, Gt(0.0), Le(100.0)]
Heading = Annotated[float, Ge(-360.0), Le(360.0)]
Share = Annotated[float, Ge(0.0), Le(1.0)]
ObstacleName = Annotated[str, MinLen(1), MaxLen(40)]
SheetKind = Literal["person", "animal", "vehicle", "tree", "hedge", "building"]
POSTURES = (("person", "lying"), ("animal", "fawn"), ("animal", "hare"))


@dataclass(frozen=True, kw_only=True)
class Path:
    """Where a thing goes, straight from its place through the points; it looks where it goes.

    to: points [x, y] of the world in metres
    speed_kmh: 5 is a walk
    start_s: it stands until then
    start_within_m: and until the fixed axle of a machine is no farther from it in the plane; none = it waits
        for no machine
    at_end: `stay` there, or go to and fro
    """

    to: Annotated[tuple[tuple[Metres, Metres], ...], MinLen(1), MaxLen(1000)]
    speed_kmh: Annotated[float, Gt(0.0), Le(100.0)] = 5.0
    start_s: Annotated[float, Ge(0.0), Le(1e6)] = 0.0
    start_within_m: Annotated[float, Gt(0.0), Le(1e4)] | None = None
    at_end: Literal["stay", "return"] = "stay"


@dataclass(frozen=True, kw_only=True)
class Placed:
    """x_m, y_m: where it stands, inside the field's boundary or beside it.

    name: in reports, none = its kind and number
    path: where it goes from there
    rcs_dbsm: radar cross section, at any frequency and from all sides; none = the sheet's, or that of its
        shape
    """

    x_m: Metres
    y_m: Metres
    name: ObstacleName | None = None
    path: Path | None = None
    rcs_dbsm: Annotated[float, Ge(-60.0), Le(60.0)] | None = None


@dataclass(frozen=True, kw_only=True)
class PostObstacle(Placed):
    """An upright round post. x_m, y_m: its foot on the ground."""

    kind: Literal["post"] = "post"
    height_m: Size = 2.0
    diameter_m: Size = 0.15
    reflectance: Share = WOOD


@dataclass(frozen=True, kw_only=True)
class BoxObstacle(Placed):
    """A box on the ground. x_m, y_m: its middle; heading_deg: of its length, from east to the left."""

    kind: Literal["box"] = "box"
    length_m: Size = 2.0
    width_m: Size = 2.0
    height_m: Size = 2.0
    heading_deg: Heading = 0.0
    reflectance: Share = PAINT


@dataclass(frozen=True, kw_only=True)
class StoneObstacle(Placed):
    """An ellipsoid, half of its height above ground. x_m, y_m: its middle."""

    kind: Literal["stone"] = "stone"
    length_m: Size = 0.5
    width_m: Size = 0.4
    height_m: Size = 0.5
    heading_deg: Heading = 0.0
    reflectance: Share = STONE


@dataclass(frozen=True, kw_only=True)
class MeshObstacle(Placed):
    """A thing from a mesh file (OBJ, PLY, GLB; extra `mesh`). x_m, y_m: its foot.

    file: the mesh
    unit: of its coordinates
    up: its axis that points up, none = y in GLB, else z
    scale: on top of the unit
    foot: what stands at x_m, y_m: the middle of the mesh's `base` or its `origin`
    z_m: of the foot above ground
    heading_deg, pitch_deg, roll_deg: of its x axis from east to the left, nose down, right side down, about
        the foot
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


@dataclass(frozen=True, kw_only=True)
class SheetObstacle(Placed):
    """A thing of simple solids, sizes and reflectance as in `data/obstacles/`. x_m, y_m: under its middle.

    length_m, width_m, height_m: none = the sheet's; what one gives stretches the body
    heading_deg: where it looks as long as it stands, from east to the left
    reflectance: at 905 nm, none = the sheet's
    posture: `lying` of a person, `fawn` or `hare`, which lie, of an animal; none = upright
    """

    kind: SheetKind
    posture: Literal["lying", "fawn", "hare"] | None = None
    length_m: Size | None = None
    width_m: Size | None = None
    height_m: Size | None = None
    heading_deg: Heading = 0.0
    reflectance: Share | None = None


Obstacle = Annotated[
    PostObstacle | BoxObstacle | StoneObstacle | MeshObstacle | SheetObstacle,
    PydanticField(discriminator="kind"),
]


KINDS: tuple[str, ...] = tuple(
    name for kind in get_args(get_args(Obstacle)[0]) for name in get_args(get_type_hints(kind)["kind"])
)


@dataclass(frozen=True)
class Thing:
    """An obstacle of a field. solids: in its own frame, its foot at the origin, x forward.

    pose: pose_world_thing at t = 0
    path, way: where it goes, None for what stands
    rcs_dbsm: radar cross section at 24 and 77 GHz, None where it is that of its solids
    warm: what keeps it warm, None where nothing does
    """

    name: str
    kind: str
    solids: Solids
    pose: Pose
    path: Path | None = None
    way: Way | None = None
    rcs_dbsm: tuple[float, float] | None = None
    warm: Warm | None = None

    @property
    def in_world(self) -> Solids:
        """The solids of an obstacle at t = 0."""
        return moved(self.solids, self.pose)


def names_of(obstacles: Any) -> list[str]:
    """One without a name has its kind and its number among all of that kind, such as `post 1`."""
    counts: Counter[str] = Counter()
    names = []
    for o in obstacles:
        counts[o.kind] += 1
        names.append(o.name or f"{o.kind} {counts[o.kind]}")
    return names


def things_of(obstacles: Any, field: Any) -> tuple[Thing, ...]:
    """The things of obstacle parameters, each standing on the ground of a field (its `ground_height` is
    asked).

    Raises InputError for an obstacle whose mesh cannot be used, whose path has two points in one place, or
    whose name another one has.
    """
    made: dict[str, Thing] = {}
    for index, (o, name) in enumerate(zip(obstacles, names_of(obstacles), strict=True)):
        key = f"field.obstacles.{index}"
        if name in made:
            raise InputError(f"{key}.name", name, "expected a name that no other obstacle has")
        foot = np.array([o.x_m, o.y_m, float(field.ground_height(o.x_m, o.y_m))])
        thing = _thing(name, o, foot, key)
        if o.rcs_dbsm is not None:
            thing = replace(thing, rcs_dbsm=(o.rcs_dbsm, o.rcs_dbsm))
        made[name] = thing if o.path is None else _moving(thing, o.path, key)
    return tuple(made.values())


def _moving(thing: Thing, path: Path, key: str) -> Thing:
    """The same thing on its way, looking along it."""
    points = np.array([thing.pose.position[:2].tolist(), *path.to])
    if not np.hypot(*np.diff(points, axis=0).T).all():
        raise InputError(
            f"{key}.path.to", list(path.to), "expected points that lie apart, and apart from x_m, y_m"
        )
    way = Way(points, path.speed_kmh * KMH, returns=path.at_end == "return")
    pose = Pose.from_euler(thing.pose.position, yaw=way.after(0.0)[2])
    return replace(thing, pose=pose, path=path, way=way)


def _thing(name: str, o: Any, foot: Array, key: str) -> Thing:
    zero = np.zeros(3)
    if isinstance(o, PostObstacle):
        solids, pose = post(zero, o.height_m, o.diameter_m, o.reflectance), Pose.from_euler(foot)
        return Thing(name, o.kind, solids, pose)
    if isinstance(o, MeshObstacle):
        pitch, roll = o.pitch_deg * DEG, o.roll_deg * DEG
        pose = Pose.from_euler(
            foot + np.array([0.0, 0.0, o.z_m]), roll=roll, pitch=pitch, yaw=o.heading_deg * DEG
        )
        return Thing(name, o.kind, _mesh_solids(o, f"{key}.file"), pose)
    pose = Pose.from_euler(foot, yaw=o.heading_deg * DEG)
    if isinstance(o, SheetObstacle):
        return _of_sheet(name, o, load_obstacle(_sheet_of(o, key)), pose)
    shape = box_on_ground if isinstance(o, BoxObstacle) else stone
    size = (o.length_m, o.width_m, o.height_m)
    return Thing(name, o.kind, shape(zero, size, reflectance=o.reflectance), pose)


def _sheet_of(o: SheetObstacle, key: str) -> str:
    """Name of its data sheet."""
    if o.posture is None:
        return o.kind
    if (o.kind, o.posture) not in POSTURES:
        known = ", ".join(f"{posture} of {kind}" for kind, posture in POSTURES)
        raise InputError(f"{key}.posture", o.posture, f"expected {known}")
    return f"{o.kind}-{o.posture}"


def _of_sheet(name: str, o: SheetObstacle, sheet: ObstacleSheet, pose: Pose) -> Thing:
    size = (o.length_m or sheet.length, o.width_m or sheet.width, o.height_m or sheet.height)
    reflectance = sheet.reflectance if o.reflectance is None else o.reflectance
    solids, rcs = sheet.solids(size, reflectance), (sheet.rcs_24, sheet.rcs_77)
    return Thing(name, o.kind, solids, pose, rcs_dbsm=rcs, warm=sheet.warm)


def _mesh_solids(o: MeshObstacle, key: str) -> Solids:
    file = FilePath(o.file)
    parts = read_mesh(file, key=key)
    corners = product(np.concatenate([p.corners for p in parts]), UP[o.up or file_up(file)].T)
    corners = corners * (UNITS[o.unit] * o.scale)
    if o.foot == "base":
        corners = corners - base_middle(corners)
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    if not MESH_SIZE[0] <= size <= MESH_SIZE[1]:
        expected = (
            f"expected a thing of {MESH_SIZE[0]:g} to {MESH_SIZE[1]:g} m, it is {size:.3g} m: unit, scale?"
        )
        raise InputError(key, file.name, expected)
    return mesh(corners, Pose.identity(), o.reflectance)
