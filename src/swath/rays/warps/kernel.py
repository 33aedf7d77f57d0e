"""The group walk on a card as a Warp kernel: its body is native code, `*.cu`, explained in docs/rays.md.

The same text runs on the CPU, lane after lane; that is slow and only for tests.
"""

from inspect import signature
from pathlib import Path

import warp as wp

from swath.rays.groups.kernel import Index
from swath.rays.kernel.cast import hit_things
from swath.rays.kernel.scene import Scene, Things, floor_div, no_hit, page_slot, to_stand
from swath.rays.kernel.shapes import MISS

PARTS = ("lane", "store", "shapes", "batch", "pieces", "columns", "tile", "walk")
_WALK = "".join((Path(__file__).parent / f"{part}.cu").read_text(encoding="utf-8") for part in PARTS)

# Room for 11 groups on each processor of a card: so many fit into its shared memory. Older Warp does not ask.
_BOUNDS = {"launch_bounds": (32, 11)} if "launch_bounds" in signature(wp.kernel).parameters else {}


@wp.func_native(_WALK)
def walk_warp(
    g: int,
    scene: Scene,
    index: Index,
    lanes: wp.array2d(dtype=int),
    first_pack: wp.array(dtype=int),
    first: int,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    need: int,
    order: int,
    memory: wp.array(dtype=wp.vec4),
    distance: wp.array(dtype=float),
    organ: wp.array(dtype=wp.uint8),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
): ...


@wp.kernel(enable_backward=False, **_BOUNDS)
def walk_warps(
    scene: Scene,
    index: Index,
    lanes: wp.array2d(dtype=int),
    first_pack: wp.array(dtype=int),
    first: int,
    threads: int,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    need: int,
    order: int,
    memory: wp.array(dtype=wp.vec4),
    distance: wp.array(dtype=float),
    organ: wp.array(dtype=wp.uint8),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
):
    """threads: of each group, 32 on a card, else 1; first: first group; order: of lanes, where there is 1."""
    g = first + wp.tid() / threads
    walk_warp(
        g,
        scene,
        index,
        lanes,
        first_pack,
        first,
        origins,
        directions,
        need,
        order,
        memory,
        distance,
        organ,
        cosine,
        reflectance,
    )


@wp.kernel(enable_backward=False)
def meet_things(
    scene: Scene,
    things: Things,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3d),
    range_max: float,
    distance: wp.array(dtype=float),
    organ: wp.array(dtype=wp.uint8),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
    doubts: wp.array(dtype=int),
):
    """Nearest solid of each ray, range_max and organ 0 without one: what the walk starts with.

    doubts: [0] some rays are none, theirs get distance -1; [1] some start low or where no page is known
    """
    i = wp.tid()
    o = origins[i]
    v = directions[i]
    most = wp.float64(1.0e8)
    is_near = wp.abs(o[0]) < most and wp.abs(o[1]) < most and wp.abs(o[2]) < most  # False for nan
    if not (is_near and wp.abs(wp.dot(v, v) - wp.float64(1.0)) < wp.float64(0.99e-3)):
        doubts[0] = 1
        distance[i] = -1.0
        organ[i] = wp.uint8(0)
        return
    ray = to_stand(scene, o, v)
    slot = page_slot(scene, floor_div(ray.tile_x, 8), floor_div(ray.tile_y, 8))
    if slot < 0:
        doubts[1] = 1
    elif o[2] <= wp.float64(scene.page_top[slot]):
        doubts[1] = 1
    hit = hit_things(things, o, wp.vec3(v), no_hit(range_max))
    distance[i] = hit.t
    organ[i] = wp.uint8(hit.organ)
    cosine[i] = hit.cosine
    reflectance[i] = hit.reflectance


@wp.func
def or_far(t: float, organ: wp.uint8) -> float:
    if organ == wp.uint8(0):
        return float(MISS)
    return t


@wp.kernel(enable_backward=False)
def pick(
    sub_rays: int,
    need: int,
    only: int,
    distance: wp.array(dtype=float),
    organ: wp.array(dtype=wp.uint8),
    cosine: wp.array(dtype=float),
    reflectance: wp.array(dtype=float),
    picked_distance: wp.array(dtype=float),
    picked_organ: wp.array(dtype=wp.uint8),
    picked_cosine: wp.array(dtype=float),
    picked_reflectance: wp.array(dtype=float),
):
    """The `need` nearest hits of each bundle, or only the last of these; ties by number."""
    i = wp.tid()
    bundle = i / sub_rays
    mine = or_far(distance[i], organ[i])
    place = int(0)
    for j in range(bundle * sub_rays, (bundle + 1) * sub_rays):
        other = or_far(distance[j], organ[j])
        if other < mine or (other == mine and j < i):
            place += 1
    to = int(-1)
    if only != 0 and place == need - 1:
        to = bundle
    elif only == 0 and place < need:
        to = bundle * need + place
    if to >= 0:
        picked_distance[to] = distance[i]
        picked_organ[to] = organ[i]
        picked_cosine[to] = cosine[i]
        picked_reflectance[to] = reflectance[i]
