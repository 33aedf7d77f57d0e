"""Ray packet traversal as a Warp kernel: its body is native code, `native/`.

How: docs/explanation/lidar.md.
"""

from pathlib import Path

import warp as wp

from swath.rays.kernel.scene import Scene

# Multiply-adds are fused only where the source says so: else a result could depend on what was inlined.
wp.set_module_options({"fuse_fp": False})
_PARTS = ("vectors", "rays", "tiles", "crop", "traversal")  # each built on those before it
_TRAVERSAL = "\n".join(
    (Path(__file__).parent / "native" / f"{part}.cpp").read_text(encoding="utf-8") for part in _PARTS
)


@wp.struct
class Index:
    """`index.PacketIndex` for the kernel."""

    columns: int
    bins: int
    side: float
    bin_height: float
    halo: int
    step: float
    extent: wp.vec3
    start: wp.array(dtype=int)
    primitive: wp.array(dtype=int)
    coarse: wp.array2d(dtype=wp.int16)


@wp.func_native(_TRAVERSAL)
def traverse_groups(scene: Scene, index: Index, job_bytes: wp.array(dtype=wp.uint8)): ...


@wp.kernel(enable_backward=False)
def traverse(scene: Scene, index: Index, job: wp.array(dtype=wp.uint8)):
    """Casts groups of packets of a job (`traversal.JOB`) until none is left: launched once on each thread."""
    traverse_groups(scene, index, job)
