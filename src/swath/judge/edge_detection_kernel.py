"""Edges of the crop on a line across each machine, as a kernel over worlds: `present_edge` on profiles."""

import warp as wp

from swath.field.profile_kernel import Profile, crop_along

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

MOST = wp.constant(16)  # edges on a line that are told: they are more than `half` steps apart
ROOM = wp.constant(32)  # places that may be one
Places = wp.types.vector(length=32, dtype=wp.int32)


@wp.func_native("""
const bool* crop = (const bool*)line.data;
for (int i = first; i <= last && i < (int)line.shape[0]; ++i)
  if (crop[i] & !crop[i - 1]) return i;
return -1;
""")
def next_edge(line: wp.array(dtype=wp.bool), first: int, last: int) -> int:
    """The first place from `first` to `last` where crop begins, -1 = none."""


@wp.func_native("""
const bool* crop = (const bool*)line.data;
int count = 0;
for (int i = first; i < after; ++i) count += crop[i];
return count;
""")
def standing_among(line: wp.array(dtype=wp.bool), first: int, after: int) -> int:
    """Steps with crop."""


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
    i = next_edge(line, half, n - half)
    while i >= 0 and found < ROOM:
        inside = standing_among(line, i, i + half)
        outside = half - standing_among(line, i - half, i)
        if 2 * inside > half and 2 * outside > half:
            at[found] = i
            score[found] = inside + outside
            found += 1
        i = next_edge(line, i + 1, n - half)
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
