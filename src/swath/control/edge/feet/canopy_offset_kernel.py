"""The likelihood of shifts of the feet behind the canopy's edge, compiled: see `canopy_offset._fit`."""

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

real = wp.float64
ONE = wp.constant(real(1.0))
SPREADS = wp.constant(8)
Spreads = wp.types.vector(length=8, dtype=real)


@wp.func
def score_of_shifts(
    depth: real,
    stray: real,
    met: wp.array(dtype=real),
    chance: wp.array(dtype=real),
    there: wp.array(dtype=real),
    which: wp.array3d(dtype=int),
    seen: wp.array2d(dtype=real),
    logs: wp.array2d(dtype=real),
    score: wp.array2d(dtype=real),
):
    """Log-likelihood [nat] of the rays seen, for every spread of the stand's border and every shift.

    depth: pieces that a ray meets within the stand; stray: share of rays on the wrong side
    met, chance: the table of `stopped`, met in equal steps from 0 on
    there: shares of the stand that occur; which: [shift, place, spread] -> place in `there`
    seen: rays that went on and that were stopped, by place
    logs: scratch, (2, as long as there); score: (SPREADS, shifts), written
    """
    last, step = met.shape[0] - 1, met[1] - met[0]
    for i in range(there.shape[0]):
        x = depth * there[i]
        stopped = chance[last]
        if x < met[last]:
            k = wp.clamp(int(x / step), 0, last - 1)
            if met[k] > x:
                k -= 1
            if met[k + 1] <= x:
                k += 1
            slope = (chance[k + 1] - chance[k]) / (met[k + 1] - met[k])
            stopped = slope * (x - met[k]) + chance[k]
        high = stray + (ONE - stray) * stopped
        logs[0, i] = wp.log(ONE - high)
        logs[1, i] = wp.log(high)
    for shift in range(which.shape[0]):
        total = Spreads()
        for place in range(which.shape[1]):
            held, passed = seen[1, place], seen[0, place]
            for spread in range(SPREADS):
                share = which[shift, place, spread]
                total[spread] += held * logs[1, share] + passed * logs[0, share]
        for spread in range(SPREADS):
            score[spread, shift] = total[spread]


@wp.kernel
def score_shifts(
    depth: wp.array(dtype=real),
    stray: wp.array(dtype=real),
    met: wp.array(dtype=real),
    chance: wp.array(dtype=real),
    there: wp.array(dtype=real),
    which: wp.array3d(dtype=int),
    seen: wp.array2d(dtype=real),
    logs: wp.array2d(dtype=real),
    score: wp.array2d(dtype=real),
):
    """`score_of_shifts` of one detector; depth, stray: (1,); one thread."""
    score_of_shifts(depth[0], stray[0], met, chance, there, which, seen, logs, score)
