"""How far the feet stand behind the canopy's edge, compiled: see `canopy_offset`."""

from pathlib import Path

import warp as wp

from swath.kernels import constants, exact_code

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

_NUMBERS = exact_code(Path(__file__).parents[1] / "numbers.cpp")
real = wp.float64
Numbers = wp.array(dtype=wp.float64)
Table = wp.array2d(dtype=wp.float64)
ZERO, HALF, ONE, TINY, INF = constants(0.0, 0.5, 1.0, 1e-9, float("inf"))
SPREADS = wp.constant(8)
Spreads = wp.types.vector(length=8, dtype=real)
REACHED = constants(0.9)[0]  # share of the rays within the stand that are stopped above the height watched
INSIDE_FROM, INSIDE_TO = constants(0.4, 1.5)  # m behind the step: the stand within
FEWEST = constants(60.0)[0]  # echoes within, before their heights count
STRAY = constants(0.02)[0]  # share of rays on the wrong side whatever the edge
COUNT = constants(1.0 / 4.0)[0]  # scans see the same stems: independent samples per ray
GUESS = constants(0.05)[0]  # m, standard deviation of the shift about the guess


@wp.struct
class Offset:
    """Tables of `CanopyOffset`. met, chance: the table of `stopped`, met in equal steps from 0 on.

    middle: of places [m]; first, bin: where they begin, how wide they are [m]; layer: of heights [m]
    there: shares of the stand that occur; which: [shift, place, spread] -> place in `there`
    """

    middle: wp.array(dtype=wp.float64)
    shifts: wp.array(dtype=wp.float64)
    met: wp.array(dtype=wp.float64)
    chance: wp.array(dtype=wp.float64)
    there: wp.array(dtype=wp.float64)
    which: wp.array3d(dtype=int)
    first: wp.float64
    bin: wp.float64
    layer: wp.float64


@wp.struct
class Rays:
    """As `canopy_offset.Rays`; count: of them; level: heights over `ground` [m] are those that count."""

    upper: wp.array(dtype=wp.float64)
    lower: wp.array(dtype=wp.float64)
    level: wp.array(dtype=wp.float64)
    ground: wp.float64
    top: wp.float64
    limit: wp.float64
    count: int


@wp.func_native(_NUMBERS + "return sum(values.data, count);")
def sum_of(values: Numbers, count: int) -> wp.float64:
    """Sum in the order in which numpy adds: of halves, down to 128 numbers, these in eight rows."""


@wp.func
def height_at(heights: Numbers, total: real, share: real, layer: real) -> wp.float64:
    """Height [m] below which a share of a histogram lies: counts in layers from 0 up, their sum."""
    n = heights.shape[0]
    reached = heights[0]
    if share < reached / total:
        return layer
    for i in range(1, n):
        before = reached / total
        reached += heights[i]
        after = reached / total
        if share < after:
            slope = (layer * real(i + 1) - layer * real(i)) / (after - before)
            return slope * (share - before) + layer * real(i)
    return layer * real(n)


@wp.func
def stopped_depth(o: Offset, most: wp.float64) -> wp.float64:
    """Pieces that a ray meets where a share of them is stopped."""
    low = int(0)
    high = int(o.chance.shape[0] - 1)
    if most < o.chance[0]:
        return o.met[0]
    if most >= o.chance[high]:
        return o.met[high]
    while high - low > 1:
        k = (low + high) // 2
        if o.chance[k] <= most:
            low = k
        else:
            high = k
    slope = (o.met[high] - o.met[low]) / (o.chance[high] - o.chance[low])
    return slope * (most - o.chance[low]) + o.met[low]


@wp.func
def score_of_shifts(o: Offset, depth: real, seen: Table, logs: Table, score: Table):
    """Log-likelihood [nat] of the rays seen, for every spread of the stand's border and every shift.

    depth: pieces that a ray meets within the stand; seen: rays that went on and that were stopped, by place
    logs: scratch, (2, as long as there); score: (SPREADS, shifts), written
    """
    last, step = o.met.shape[0] - 1, o.met[1] - o.met[0]
    for i in range(o.there.shape[0]):
        x = depth * o.there[i]
        stopped = o.chance[last]
        if x < o.met[last]:
            k = wp.clamp(int(x / step), 0, last - 1)
            if o.met[k] > x:
                k -= 1
            if o.met[k + 1] <= x:
                k += 1
            slope = (o.chance[k + 1] - o.chance[k]) / (o.met[k + 1] - o.met[k])
            stopped = slope * (x - o.met[k]) + o.chance[k]
        high = STRAY + (ONE - STRAY) * stopped
        logs[0, i] = wp.log(ONE - high)
        logs[1, i] = wp.log(high)
    for shift in range(o.which.shape[0]):
        total = Spreads()
        for place in range(o.which.shape[1]):
            held, passed = seen[1, place], seen[0, place]
            for spread in range(SPREADS):
                share = o.which[shift, place, spread]
                total[spread] += held * logs[1, share] + passed * logs[0, share]
        for spread in range(SPREADS):
            score[spread, shift] = total[spread]


@wp.func
def fitted_shift(o: Offset, guess: real, seen: Table, logs: Table, score: Table) -> wp.float64:
    """Mean shift under the likelihood of the counts and the guess [m]."""
    passed = ZERO
    held = ZERO
    for i in range(o.middle.shape[0]):
        if o.middle[i] > INSIDE_FROM:
            passed += seen[0, i]
            held += seen[1, i]
    most = wp.min(wp.max(held / wp.max(passed + held, TINY), real(0.3)), ONE - STRAY)
    score_of_shifts(o, stopped_depth(o, most), seen, logs, score)
    best = -INF
    for k in range(o.shifts.shape[0]):
        away = (o.shifts[k] - guess) / GUESS
        for spread in range(SPREADS):
            score[spread, k] = score[spread, k] - HALF * (away * away)
            best = wp.max(best, score[spread, k])
    count = int(0)
    for spread in range(SPREADS):
        for k in range(o.shifts.shape[0]):
            chance = wp.exp(score[spread, k] - best)
            logs[0, count] = chance
            logs[1, count] = chance * o.shifts[k]
            count += 1
    return sum_of(logs[1], count) / sum_of(logs[0], count)


@wp.func
def count_rays(o: Offset, r: Rays, seen: Table, heights: Numbers) -> bool:
    """Count rays that show the edge; whether enough heights within are known for that.

    Each counts once, at the lateral place where it crosses the middle height of the echoes within.
    """
    over = wp.max(r.top - r.limit, real(0.01))
    share = (HALF * (r.limit + r.top) - r.limit) / over
    layers = heights.shape[0]
    for i in range(r.count):
        place = r.lower[i] + share * (r.upper[i] - r.lower[i])
        if place > INSIDE_FROM and place < INSIDE_TO:
            heights[wp.clamp(int((r.level[i] - r.ground) / o.layer), 0, layers - 1)] += ONE
    total = sum_of(heights, layers)
    if total < FEWEST:
        return False
    least = wp.max(height_at(heights, total, ONE - REACHED, o.layer), r.limit)
    share = (height_at(heights, total, HALF, o.layer) - r.limit) / over
    for i in range(r.count):
        place = r.lower[i] + share * (r.upper[i] - r.lower[i])
        k = int(wp.floor((place - o.first) / o.bin))
        if k >= 0 and k < seen.shape[1]:
            if r.level[i] - r.ground > least:
                seen[1, k] += COUNT
            else:
                seen[0, k] += COUNT
    return True
