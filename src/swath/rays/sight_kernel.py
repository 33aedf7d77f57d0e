"""Which pages beams can get to, compiled."""

from pathlib import Path

import warp as wp

from swath.rays.kernel.scene import Scene
from swath.rays.kernel.tops import top_of

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.func_native((Path(__file__).parent / "single" / "sight.cpp").read_text(encoding="utf-8"))
def walk_pages(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)): ...


@wp.kernel
def find_missing(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)):
    """One thread for all beams; see sight.cpp."""
    walk_pages(whole, real)


@wp.struct
class Looking:
    """What a scanner looks at.

    whole, real: as in sight.cpp
    counters: of the pages, see `memory_layout.REVISION`
    shown: as in `LiveScene`; growth: as in `top_of`
    bodies: (1,) changes of what else there is
    known: (1,) how often these had changed when they were taken over
    """

    whole: wp.array(dtype=wp.int64)
    real: wp.array(dtype=wp.float64)
    counters: wp.array(dtype=wp.int64)
    shown: wp.array(dtype=wp.int64)
    bodies: wp.array(dtype=wp.int64)
    growth: float
    known: wp.array(dtype=wp.int64)


@wp.kernel
def look(
    needs: wp.array(dtype=wp.int32),
    active: wp.array(dtype=wp.bool),
    looking: wp.array(dtype=Looking),
    scenes: wp.array(dtype=Scene),
    asks: wp.array(dtype=wp.int32),
):
    """One world a thread. asks: worlds where something is not in memory, or not where it was; all others see
    the field as it is now.
    """
    w = wp.tid()
    asks[w] = 0
    if not active[w]:
        return
    its = looking[w]
    if its.counters[1] != its.shown[1] or its.bodies[0] != its.known[0]:
        asks[w] = 1
    else:
        walk_pages(its.whole, its.real)
        if its.whole[17] != wp.int64(0):
            asks[w] = 1
    if asks[w] != 0:
        needs[0] = 1
    elif its.counters[0] != its.shown[0]:
        scene = scenes[w]
        for slot in range(scene.page_top.shape[0]):
            scene.page_top[slot] = top_of(scene, slot, its.growth)
        its.shown[0] = its.counters[0]
