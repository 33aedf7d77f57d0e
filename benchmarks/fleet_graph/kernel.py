"""Ways over the graph of a job in C++: a Warp kernel of one thread."""

from pathlib import Path

import warp as wp

from swath.fleet.ground_kernel import source

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.struct
class Plans:
    """Graph, conflicts and what is reserved; see plans.cpp."""

    numbers: wp.array(dtype=wp.float64)
    given: wp.array(dtype=wp.float64)
    found: wp.array(dtype=wp.float64)
    succ_at: wp.array(dtype=wp.int32)
    succ: wp.array(dtype=wp.int32)
    pred_at: wp.array(dtype=wp.int32)
    pred: wp.array(dtype=wp.int32)
    edge_from: wp.array(dtype=wp.int32)
    edge_to: wp.array(dtype=wp.int32)
    conf_at: wp.array(dtype=wp.int32)
    conf: wp.array(dtype=wp.int32)
    need_at: wp.array(dtype=wp.int32)
    need: wp.array(dtype=wp.int32)
    spent: wp.array(dtype=wp.float64)
    cut: wp.array(dtype=wp.float64)
    exempt: wp.array(dtype=wp.uint8)
    dead: wp.array(dtype=wp.uint8)
    head: wp.array(dtype=wp.int32)
    next: wp.array(dtype=wp.int32)
    who: wp.array(dtype=wp.int32)
    grant: wp.array(dtype=wp.int32)
    begin: wp.array(dtype=wp.float64)
    until: wp.array(dtype=wp.float64)
    counts: wp.array(dtype=wp.float64)
    parked: wp.array(dtype=wp.float64)
    since: wp.array(dtype=wp.float64)
    stamp: wp.array(dtype=wp.int32)
    iv_at: wp.array(dtype=wp.int32)
    iv_count: wp.array(dtype=wp.int32)
    iv: wp.array(dtype=wp.float64)
    labels: wp.array(dtype=wp.float64)
    first: wp.array(dtype=wp.int32)
    heap_key: wp.array(dtype=wp.float64)
    heap_node: wp.array(dtype=wp.int32)
    h: wp.array(dtype=wp.float64)
    goal: wp.array(dtype=wp.float64)


def _source(name: str) -> str:
    return (Path(__file__).parent / f"{name}.cpp").read_text(encoding="utf-8")


@wp.func_native(_source("plans"))
def plans(its: Plans): ...  # noqa: ANN201


@wp.kernel
def ask(its: Plans):  # noqa: ANN201
    """See plans.cpp."""
    plans(its)


@wp.struct
class Met:
    """Resources that sweep the same ground; see met.cpp."""

    numbers: wp.array(dtype=wp.float64)
    points: wp.array(dtype=wp.float64)
    starts: wp.array(dtype=wp.int32)
    first: wp.array(dtype=wp.int32)
    boxes: wp.array(dtype=wp.float64)
    parts: wp.array(dtype=wp.float64)
    found: wp.array(dtype=wp.int32)


@wp.func_native(source("convex") + _source("met"))
def met(its: Met): ...  # noqa: ANN201


@wp.kernel
def meet(its: Met):  # noqa: ANN201
    """See met.cpp."""
    met(its)
