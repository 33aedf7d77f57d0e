"""The card's walk as the card compiles it, its 32 lanes run by `warp_of_fibers.cpp` on the CPU."""

import warp as wp

from swath.rays.groups.kernel import Index
from swath.rays.kernel.scene import Scene
from swath.rays.warps.kernel import _WALK

# What a card has, by the functions at the addresses in `hooks`
_CARD = """
#define __CUDA_ARCH__ 900
#define __shared__ static
typedef void Work(void*);
typedef void RunLanes(Work*, void*);
typedef unsigned LaneNow();
typedef void WaitForAll(signed);
typedef unsigned FromLane(unsigned, signed);
typedef unsigned Ballot(unsigned);
auto run_lanes = (RunLanes*)hooks.data[0];
auto lane_now = (LaneNow*)hooks.data[1];
auto wait_for_all = (WaitForAll*)hooks.data[2];
auto from_lane = (FromLane*)hooks.data[3];
auto ballot = (Ballot*)hooks.data[4];
auto work = [&]() {
struct { unsigned x; } threadIdx = {lane_now()};
auto __syncwarp = [&]() { wait_for_all(5); };
auto exchange = [&](auto x, int lane) {
  static_assert(sizeof x == 4, "");
  unsigned u;
  __builtin_memcpy(&u, &x, 4);
  u = from_lane(u, lane);
  __builtin_memcpy(&x, &u, 4);
  return x;
};
auto __shfl_xor_sync = [&](unsigned, auto x, int d) { return exchange(x, (int)threadIdx.x ^ d); };
auto __shfl_sync = [&](unsigned, auto x, int lane) { return exchange(x, lane); };
auto __shfl_up_sync = [&](unsigned, auto x, int d) {
  const int me = (int)threadIdx.x;
  return exchange(x, me >= d ? me - d : me);
};
auto __ballot_sync = [&](unsigned, bool x) { return ballot(x); };
auto __popc = [](unsigned x) { return __builtin_popcount(x); };
auto __ffs = [](unsigned x) { return __builtin_ffs(x); };
auto __float_as_int = [](float x) { int i; __builtin_memcpy(&i, &x, 4); return i; };
auto __int_as_float = [](int x) { float f; __builtin_memcpy(&f, &x, 4); return f; };
auto __fdividef = [](float a, float b) { return a / b; };
auto rsqrtf = [](float x) { return 1.0f / ::sqrtf(x); };
auto fminf = [](float a, float b) { return b < a || a != a ? b : a; };
auto fmaxf = [](float a, float b) { return b > a || a != a ? b : a; };
auto atomicMin = [](auto* at, auto x) { const auto was = *at; if (x < was) *at = x; return was; };
"""
_END = """
};
run_lanes([](void* p) { (*(decltype(work)*)p)(); }, &work);
#undef __CUDA_ARCH__
#undef __shared__
"""


@wp.func_native(_CARD + _WALK + _END)
def walk_fibers(
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
    hooks: wp.array(dtype=wp.uint64),
): ...


@wp.kernel(enable_backward=False)
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
    hooks: wp.array(dtype=wp.uint64),
):
    g = first + wp.tid()
    walk_fibers(
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
        hooks,
    )
