"""What the kernel reads, and what it carries along a ray."""

import warp as wp

from swath.field.cutting.land_kernel import floor_div, slot_at
from swath.rays.kernel.shapes import MISS


@wp.struct
class Scene:
    """Library and pages, see `field/memory_layout.py`.

    prims: four vectors per primitive, one cache line: (a, radius; 0 = ribbon, -1 = triangle), (b, rank of the
        owner), (width of a ribbon or triangle, organ), (foot of the owner, its own reflectance or 0, 0)
    page_top: highest thing in a page [m]
    sways: 1 = wind moves the stand (`field/wind.py`)
    toward: where to
    slopes: steady, of the first wave, of the second
    wave, gust: cycles per tile in x and y, cycles at the middle of tile 0, 0
    """

    tile_size: wp.float64
    side: float
    columns: int
    bins: int
    bin_height: float
    prims: wp.array(dtype=wp.vec4)
    cell_start: wp.array(dtype=int)
    cell_items: wp.array(dtype=int)
    reflectance: wp.array(dtype=float)
    table: wp.array2d(dtype=int)
    table_x: int
    table_y: int
    ground: wp.array3d(dtype=float)
    straw: wp.array3d(dtype=float)
    tile_plane: wp.array3d(dtype=wp.vec3)
    tile_stand: wp.array3d(dtype=wp.vec4)
    tile_top: wp.array3d(dtype=float)
    tile_bump: wp.array3d(dtype=float)
    tile_prototype: wp.array3d(dtype=int)
    page_top: wp.array(dtype=float)
    cut_slot: wp.array(dtype=int)
    cut: wp.array3d(dtype=wp.uint8)
    turn: wp.vec2d  # cos, sin of the stand's yaw
    sways: int
    toward: wp.vec2
    slopes: wp.vec3
    wave: wp.vec3d
    gust: wp.vec3d


@wp.struct
class SolidArrays:
    """Solids of all kinds in one list, world frame.

    kind: 0 box, 1 capsule along its z axis, 2 ellipsoid, 3 mesh
    axes: columns are the axes
    half: half sizes [m], of a capsule radius, radius, half axis
    bound: radius of a ball around it [m]
    tree: Warp's of a mesh
    middle, reach: ball around all of them [m]
    """

    count: int
    middle: wp.vec3d
    reach: float
    kind: wp.array(dtype=int)
    centre: wp.array(dtype=wp.vec3d)
    axes: wp.array(dtype=wp.mat33)
    half: wp.array(dtype=wp.vec3)
    bound: wp.array(dtype=float)
    reflectance: wp.array(dtype=float)
    tree: wp.array(dtype=wp.uint64)


@wp.struct
class Ray:
    """A ray in the stand frame, seen from the lower corner of the tile that it starts over.

    o, d: origin [m] and unit direction
    inv, off: t of a plane x = c is c * inv + off, MISS if parallel
    tile_x, tile_y: that tile
    z0: world height of o.z = 0 [m]
    """

    o: wp.vec3
    d: wp.vec3
    inv: wp.vec3
    off: wp.vec3
    tile_x: int
    tile_y: int
    z0: float


@wp.struct
class Hit:
    """Nearest hit so far. t [m]; organ; cosine of the incidence angle; reflectance.

    normal: of any length, of solids in the world, else in the stand frame
    """

    t: float
    organ: int
    cosine: float
    reflectance: float
    normal: wp.vec3


@wp.func
def wave_height(wave: wp.vec3d, x: int, y: int) -> float:
    """Sine of a wave at the middle of a tile. In double precision: the same float on every machine."""
    cycles = wave[0] * wp.float64(x) + wave[1] * wp.float64(y) + wave[2]
    cycles = cycles - wp.floor(cycles)
    return float(wp.sin(cycles * wp.float64(6.283185307179586)))


@wp.func
def swayed(scene: Scene, stand: wp.vec4, x: int, y: int) -> wp.vec4:
    """The stand of a tile (x, y) of the stand frame with the wind's lean added."""
    slope = (
        scene.slopes[0]
        + scene.slopes[1] * wave_height(scene.wave, x, y)
        + scene.slopes[2] * wave_height(scene.gust, x, y)
    )
    aside = slope * stand[0]
    return wp.vec4(stand[0], stand[1] + aside * scene.toward[0], stand[2] + aside * scene.toward[1], stand[3])


@wp.func
def plane_slope(d: float) -> float:
    """1 / d, or 0 for a direction that never crosses planes of this axis."""
    if wp.abs(d) < 1.0e-12:
        return 0.0
    return 1.0 / d


@wp.func
def plane_offset(o: float, d: float) -> float:
    """Ray parameter t at which the ray crosses coordinate 0, MISS when it never does."""
    if wp.abs(d) < 1.0e-12:
        return MISS
    return -o / d


@wp.func
def cut_code(scene: Scene, cell_x: int, cell_y: int) -> int:
    """Cut code of a cell by its number from the origin of the stand frame; 255 where nothing is known."""
    page_x = floor_div(cell_x, 512)
    page_y = floor_div(cell_y, 512)
    slot = slot_at(scene, page_x, page_y)
    if slot < 0:
        return 255
    row = scene.cut_slot[slot]
    if row < 0:
        return -1 - row
    return int(scene.cut[row, cell_y - page_y * 512, cell_x - page_x * 512])


@wp.func
def no_hit(range_max: float) -> Hit:
    """Nothing hit up to range_max [m]."""
    hit = Hit()
    hit.t = range_max
    hit.organ = 0
    hit.cosine = 0.0
    hit.reflectance = 0.0
    return hit


@wp.func
def to_stand(scene: Scene, o: wp.vec3d, v: wp.vec3d) -> Ray:
    """A world ray in the stand frame, from the corner of the tile below it; float64 until there."""
    c = scene.turn[0]
    s = scene.turn[1]
    x = c * o[0] + s * o[1]
    y = c * o[1] - s * o[0]
    ray = Ray()
    ray.tile_x = int(wp.floor(x / scene.tile_size))
    ray.tile_y = int(wp.floor(y / scene.tile_size))
    z0 = wp.floor(o[2])
    ray.z0 = float(z0)
    ray.o = wp.vec3(
        float(x - wp.float64(ray.tile_x) * scene.tile_size),
        float(y - wp.float64(ray.tile_y) * scene.tile_size),
        float(o[2] - z0),
    )
    ray.d = wp.vec3(float(c * v[0] + s * v[1]), float(c * v[1] - s * v[0]), float(v[2]))
    ray.inv = wp.vec3(plane_slope(ray.d[0]), plane_slope(ray.d[1]), plane_slope(ray.d[2]))
    ray.off = wp.vec3(
        plane_offset(ray.o[0], ray.d[0]), plane_offset(ray.o[1], ray.d[1]), plane_offset(ray.o[2], ray.d[2])
    )
    return ray


@wp.func
def facing(n: wp.vec3, d: wp.vec3) -> wp.vec3:
    """A normal of unit length against a direction; none of no length."""
    side = wp.normalize(n)
    if wp.dot(side, d) > 0.0:
        return -side
    return side
