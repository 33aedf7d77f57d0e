"""What lies around a place of a field, as surfaces: ground, plants, straw, and the bodies on it."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.field.field import Field
from swath.field.field_setup import HasExtent
from swath.field.maps.projection import Origin
from swath.field.memory_layout import Organ, Shape, Solids
from swath.field.site_setup import Sighted
from swath.field.solid.contact import frames_along
from swath.machine.body import triangles
from swath.report.field_plot import ground_colours
from swath.report.plots import STRAW
from swath.report.scan_sampler import straw_depth
from swath.runtime.world import World
from swath.signals import F64, I64, U8, Mask
from swath.tools.scan.stand3d import COLOURS, NAMES, Organs, organs_near

NODES = 257  # heights along a side of the ground: 2^8 + 1, as Gazebo wants them
PIXELS = 1024  # of the picture of the ground along a side
SHOWN_STRAW = 0.01  # depth from which straw is drawn [m]
ROD_SIDES = 4
ROD_WIDTH = pi / (2 * sqrt(2))  # corner of a square rod over the radius of a round one of the same mean width
BODY = "#8A9BA8"  # colour of what has none of its own
LIFT = 0.005  # of the surface of straw above what it lies on [m]


@dataclass(frozen=True)
class Surface:
    """Triangles of one colour in the world. vertices: (n, 3) [m]; faces: (m, 3); colour: `#RRGGBB`."""

    name: str
    colour: str
    vertices: F64
    faces: I64

    @property
    def corners(self) -> F64:
        """(m, 3, 3) [m]."""
        return np.asarray(self.vertices[self.faces])


@dataclass(frozen=True)
class Ground:
    """A square of ground.

    x, y: of its columns and rows [m]
    heights: (rows, columns) [m], the first row in the south, nan beyond the map of the terrain
    colours: sRGB (rows, columns, 3), the first row in the north: crop, stubble, straw, bare ground
    """

    x: F64
    y: F64
    heights: F64
    colours: U8

    @property
    def low(self) -> float:
        """The lowest height of the ground [m]."""
        return float(np.nanmin(self.heights))

    @property
    def filled(self) -> F64:
        """Heights, the lowest where there is none."""
        return np.where(np.isnan(self.heights), self.low, self.heights)

    @property
    def unknown_share(self) -> float:
        """How much of it lies beyond the map of the terrain."""
        return float(np.isnan(self.heights).mean())


@dataclass(frozen=True)
class FieldScene:
    """Everything. place: its middle in the world, (2,) [m]; bodies: obstacles and machines as sensors see
    them;
    plants, straw: surfaces; origin: where on Earth the world's zero lies, if that is known.
    """

    place: F64
    ground: Ground
    plants: tuple[Surface, ...]
    straw: tuple[Surface, ...]
    bodies: tuple[Sighted, ...]
    machines: tuple[str, ...]
    origin: Origin | None

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """Plants and straw."""
        return (*self.plants, *self.straw)


def make_scene(world: World, place: F64, *, ground_m: float, plants_m: float) -> FieldScene:
    """The scene as the world stands.

    place: (2,) [m]
    ground_m: side of the square of ground
    plants_m: radius in which plants are drawn, 0 = none. InputError where the ground is not known at all
    """
    origin = next((m.origin for m in world.machines.values()), None)
    plants = plants_near(world.field, place, plants_m) if plants_m > 0.0 else ()
    ground = ground_around(world.field, place, ground_m)
    bodies = tuple(body for body in world.bodies.in_sight("") if _is_near(body, place, ground_m))
    names = tuple(own for name in world.machines for own in world.bodies.own(name))
    return FieldScene(
        place, ground, plants, straw_around(world.field, place, ground_m), bodies, names, origin
    )


def ground_around(field: Field, place: F64, side: float) -> Ground:
    """A square of ground. InputError where the terrain's map does not reach."""
    steps, pixels = (np.linspace(-0.5, 0.5, NODES), (np.arange(PIXELS) + 0.5) / PIXELS - 0.5)
    x, y = place[0] + side * steps, place[1] + side * steps
    xy = np.meshgrid(x, y)
    heights = np.where(known_ground(field, *xy), np.asarray(field.terrain.height(*xy), dtype=float), np.nan)
    at = np.meshgrid(place[0] + side * pixels, place[1] - side * pixels)
    return Ground(x, y, heights, ground_colours(field, *at))


def known_ground(field: Field, x: F64, y: F64) -> Mask:
    """Where the map of the terrain reaches. InputError where it reaches none of these points."""
    known: Mask = np.isfinite(np.asarray(field.terrain.height(x, y), dtype=float))
    if isinstance(field.terrain, HasExtent):
        known = known & field.terrain.covers(x, y)
    if not known.any():
        place = f"{x.mean():.6g},{y.mean():.6g}"
        raise InputError("--place", place, "expected a place on the map of the terrain")
    return known


def ground_surface(ground: Ground) -> tuple[F64, I64, F64]:
    """Vertices, faces that look up, and where each vertex lies in the picture, from its lower left corner."""
    x, y = np.meshgrid(ground.x, ground.y)
    share = np.linspace(0.0, 1.0, len(ground.x))
    picture = np.stack([a.ravel() for a in np.meshgrid(share, share)], axis=1)
    vertices = np.stack([x, y, ground.filled], axis=-1).reshape(-1, 3)
    return vertices, _grid_faces(~np.isnan(ground.heights)), picture


def straw_around(field: Field, place: F64, side: float) -> tuple[Surface, ...]:
    """The top of straw that lies on the ground; none where there is none."""
    count = int(side / field.maker.node)
    steps = (np.arange(count + 1) - 0.5 * count) * field.maker.node
    x, y = np.meshgrid(place[0] + steps, place[1] + steps)
    depth = straw_depth(field, x, y)
    faces = _grid_faces(depth > SHOWN_STRAW)
    if not len(faces):
        return ()
    used, faces = np.unique(faces, return_inverse=True)
    height = np.asarray(field.terrain.height(x, y), dtype=float) + depth + LIFT
    vertices = np.stack([x, y, height], axis=-1).reshape(-1, 3)[used]
    return (Surface("straw", STRAW, vertices, faces.reshape(-1, 3)),)


def plants_near(field: Field, place: F64, radius: float) -> tuple[Surface, ...]:
    """Plants and stubble whose feet stand within a radius [m], a surface for each organ."""
    field.ensure(float(place[0]), float(place[1]), radius + field.library.reach + field.library.tile_size)
    organs = organs_near(field, float(place[0]), float(place[1]), radius)
    kinds = (Organ(int(kind)) for kind in np.unique(organs.organ))
    return tuple(surface_of(organs.take(organs.organ == kind), kind) for kind in kinds)


def surface_of(organs: Organs, kind: Organ) -> Surface:
    """Pieces of plants: rods of four sides as wide as the round ones on average, blades of both sides."""
    is_rod = organs.radius > 0.0
    parts = [_rods(organs.take(is_rod)), _blades(organs.take(~is_rod))]
    shift = len(parts[0][0])
    vertices = np.concatenate([own for own, _ in parts])
    faces = np.concatenate([parts[0][1], parts[1][1] + shift])
    return Surface(
        NAMES.get(kind, kind.name.lower()).rpartition(": ")[2], COLOURS.get(kind, BODY), vertices, faces
    )


def expected_pieces(field: Field, place: F64, radius: float) -> tuple[float, float]:
    """About how many rods and blades the plants within a radius have, before any is made; stubble is not
    counted.
    """
    library = field.library
    is_own = ((library.base >= 0.0) & (library.base < library.tile_size)).all(axis=1)
    is_rod = library.shape == Shape.CAPSULE
    per_m2 = np.array([is_own & is_rod, is_own & ~is_rod]).sum(axis=1) / (
        library.tile_count * library.tile_size**2
    )
    steps = np.linspace(-radius, radius, 41)
    x, y = np.meshgrid(place[0] + steps, place[1] + steps)
    inside = np.hypot(x - place[0], y - place[1]) <= radius
    x, y = x[inside], y[inside]
    share = np.where(field.standing(x, y), field.maker.stand_at(x, y)[..., 3], 0.0)
    rods, blades = (per_m2 * pi * radius**2 * share.mean()).tolist()
    return rods, blades


def body_corners(solids: Solids) -> F64:
    """Triangles of a body, (n, 3, 3) [m]."""
    return np.concatenate([*_body_parts(solids), np.zeros((0, 3, 3))])


def _body_parts(solids: Solids) -> Iterator[F64]:
    for centre, axes, half in solids.boxes:
        yield triangles.box(2.0 * half) @ axes.T + centre
    for centre, axes, half in solids.ellipsoids:
        yield (triangles.sphere(1.0) * half) @ axes.T + centre
    for a, b, radius, pose in capsules_of(solids):
        length = float(np.linalg.norm(b - a))
        if length > 0.0:
            yield pose.apply(triangles.cylinder(radius, length))
        yield from (triangles.sphere(radius) + end for end in (a, b))
    for mesh, centre, axes in zip(solids.mesh_shape, solids.mesh_centre, solids.mesh_axes, strict=True):
        yield mesh.corners.astype(float) @ axes.T + centre


def capsules_of(solids: Solids) -> Iterator[tuple[F64, F64, float, Pose]]:
    """Ends, radius, and the frame in the middle whose z axis goes along it."""
    along = solids.capsule_b - solids.capsule_a
    for a, b, radius, axes in zip(
        solids.capsule_a, solids.capsule_b, solids.capsule_radius, frames_along(along), strict=True
    ):
        yield a, b, float(radius), Pose(0.5 * (a + b), np.asarray(axes))


def _is_near(body: Sighted, place: F64, side: float) -> bool:
    """Whether any of it lies over the square."""
    flat = np.abs(body_corners(body.solids)[..., :2] - place).reshape(-1, 2)
    return bool((flat.min(axis=0, initial=np.inf) <= 0.5 * side).all())


def _grid_faces(known: Mask) -> I64:
    """Two triangles for each cell of a grid of which all four corners are known, looking up."""
    index = np.arange(known.size).reshape(known.shape)
    whole = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    a, b, c, d = (i[whole] for i in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _rods(organs: Organs) -> tuple[F64, I64]:
    """Square rods without ends."""
    along = organs.b - organs.a
    axes = np.asarray(frames_along(along)) if len(along) else np.zeros((0, 3, 3))
    angle = 2.0 * pi * np.arange(ROD_SIDES) / ROD_SIDES
    out = np.cos(angle)[:, None] * axes[:, None, :, 0] + np.sin(angle)[:, None] * axes[:, None, :, 1]
    out = out * (ROD_WIDTH * organs.radius)[:, None, None]
    vertices = np.concatenate([organs.a[:, None] + out, organs.b[:, None] + out], axis=1)
    i = np.arange(ROD_SIDES)
    j = (i + 1) % ROD_SIDES
    side = np.concatenate(
        [np.stack([i, j, j + ROD_SIDES], axis=1), np.stack([i, j + ROD_SIDES, i + ROD_SIDES], axis=1)]
    )
    faces = side + 2 * ROD_SIDES * np.arange(len(along))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)


def _blades(organs: Organs) -> tuple[F64, I64]:
    """Ribbons, and triangles as ribbons without a width at their end."""
    corners = organs.quads(np.zeros(3))  # flat as they are, from wherever they are seen
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(len(corners))[:, None, None]
    return corners.reshape(-1, 3), faces.reshape(-1, 3)
