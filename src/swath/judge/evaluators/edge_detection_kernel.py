"""Edges of the crop on a line across each machine, as a kernel over worlds: `present_edge` on profiles."""

import warp as wp

from swath.field.profile_kernel import Profile, crop_along

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

MOST = wp.constant(16)  # edges on a line that are told: they are more than `half` steps apart
ROOM = wp.constant(32)  # places that may be one
Places = wp.types.vector(length=32, dtype=wp.int32)


@wp.kernel
def edges_across(
    profiles: wp.array(dtype=Profile),
    starts: wp.array2d(dtype=wp.float64),
    steps: wp.array2d(dtype=wp.float64),
    half: int,
    crop: wp.array2d(dtype=wp.bool),
    stations: wp.array(dtype=int),
    counts: wp.array(dtype=int),
    edges: wp.array2d(dtype=int),
):
    """As `present_edge.edges_of`: places in steps from the begin of each line, as many as `counts`.

    half: of the steps that are looked at on both sides
    """
    w = wp.tid()
    line = crop[w]
    n = line.shape[0]
    stations[w] = crop_along(
        profiles[w], starts[w, 0], starts[w, 1], steps[w, 0], steps[w, 1], line, stations[w]
    )
    at = Places()
    score = Places()
    found = int(0)
    for i in range(half, n - half + 1):
        if i < n and line[i] and not line[i - 1]:
            inside = int(0)
            outside = int(0)
            for k in range(half):
                if line[i + k]:
                    inside += 1
                if not line[i - 1 - k]:
                    outside += 1
            if 2 * inside > half and 2 * outside > half and found < ROOM:
                at[found] = i
                score[found] = inside + outside
                found += 1
    told = int(0)
    for i in range(found):
        is_best = int(1)
        for k in range(found):
            is_better = score[k] > score[i] or (score[k] == score[i] and at[k] < at[i])
            if k != i and wp.abs(at[i] - at[k]) <= half and is_better:
                is_best = 0
        if is_best == 1 and told < MOST:
            edges[w, told] = at[i]
            told += 1
    counts[w] = told
