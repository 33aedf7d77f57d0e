"""The level `otsu` as a kernel over worlds: scan and odometry in, crop edge out.

Profile of a scan, height step, track over several scans, overhang of the canopy.
`tests/control/otsu_in_numpy.py` has the same functions in numpy.

**Step.** Heights in lateral order from the edge as known so far, so that an error of heading does not smear
it; the lateral slope of the stubble is the roll against the ground and is taken off. A ray says one thing: it
was stopped in the upper half of the crop, or not. Where beside the edge it says so must not depend on which
of both it was, or rays that cross the edge at an angle, in a bend, would show it elsewhere than rays along
it: stopped only after a mean free path, or free in the shadow of the stand.

**Track.** It coasts over short gaps with a falling confidence, gives up after `lost_s`, and takes a new edge
only after it was seen for a while: longer when that lies beside the one it remembers (a notch, a tramline).
"""

import warp as wp

from swath.control import inclination
from swath.control.edge import canopy_classes, profile
from swath.control.edge.feet import canopy_offset
from swath.control.edge.feet.canopy_offset_kernel import Offset, Rays, count_rays, fitted_shift
from swath.control.inertial_kernel import incline
from swath.core import schedule
from swath.kernels import constants

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

real = wp.float64
Numbers = wp.array(dtype=wp.float64)
Table = wp.array2d(dtype=wp.float64)
ZERO, HALF, ONE, NS, INF = constants(0.0, 0.5, 1.0, schedule.NS, float("inf"))
X, U, VARIANCE, QUALITY, AGE, IS_USED, SLOPE, COLUMNS = (
    wp.constant(i) for i in range(8)
)  # of a track's rows
# Places in scratch: echoes of a scan; those about the edge in lateral order, as they came first and as they
# count; keys, heights, scores of splits; points of a fit and their weights
ECHO_X, ECHO_U, ECHO_Z, RAW_X, RAW_LEVEL, RAW_UPPER, RAW_LOWER = (wp.constant(i) for i in range(7))
AHEAD, LATERAL, LEVEL, UPPER, LOWER, VALUES, SCORE, MET = (wp.constant(7 + i) for i in range(8))
FIT_X, FIT_U, FIT_VARIANCE, ROBUST, SCRATCH = (wp.constant(15 + i) for i in range(5))
MIN_POINTS = wp.constant(5)  # fewest on each side of a step
NEAR, FAR = constants(canopy_classes.NEAR, canopy_classes.FAR)
LOWEST, HIGHEST = constants(-1.5, 2.2)  # m: heights of the echoes that count
HEADROOM, ROOM = constants(canopy_classes.HEADROOM, canopy_classes.ROOM)
FIRST_TOP, SECOND_TOP = constants(1.5, 1.15)  # m, tried while the crop's height is unknown: dust hides edges
CLEARER = constants(1.3)[0]  # times the separation that a lower top must reach to count
# of a ray's way through the upper half of the crop, from its end nearer to the crop: there it counts. 0.36
# for 4 to 10 mean free paths of crop and a way across three times the overhang, 0.5 for one along the edge
INNER = constants(0.35)[0]
MAX_GROUND, RESOLUTION = constants(0.6, 0.02)  # m: stubble off the machine's plane, least sd of a point
SLOPE_SD, BEND_SD = constants(0.07, 0.02)  # [1], 1/m: of how far an edge is from straight ahead
# 95 % efficiency on normal errors (Beaton & Tukey 1974, doi:10.1080/00401706.1974.10489171); sd / median
TUKEY, MAD = constants(profile.TUKEY, profile.MAD)
TINY, SMALL = constants(1e-9, 1e-6)  # in the place of nothing, to divide by; s, m2
LATE, TOP, LEAST_SURE = constants(0.1, 0.9, profile.LEAST_SURE)  # shares: newest scan, echoes of crop
ERROR_ODDS = constants(3.0)[0]  # nat: odds of an echo on its side of a threshold between heights, 95 %
WINDOW_S, FORGET_S, MIN_SHARE = constants(6.0, 4.0, 0.6)  # s, s, [1]: greatest age, memory of the lost, scans
PER_SAMPLE, LEVER = constants(8.0, 1.2)  # scans see the same stems; m, a point's place in its scan
CRAB, GRAVITY = constants(inclination.CRAB, inclination.GRAVITY)
OFTEN = constants(canopy_offset.OFTEN)[0]
CLOSE = constants(0.12)[0]  # m: scans whose edge point is further from the line show a notch, not the edge


@wp.struct
class Settings:
    """What stays: numbers of `Params` in SI, and where the detector looks from.

    sign: +1 where u is y, -1 where it is -y
    centre: u of the header end; mounting: pose_machine_sensor, its position, then rows of the rotation
    lost: after so long without an edge none is reported [ns]
    reference: where ahead the offset holds
    lean, spot, memory: as in `CanopyOffset`
    """

    sign: wp.float64
    centre: wp.float64
    reference: wp.float64
    lost: wp.float64
    min_step: wp.float64
    min_gain: wp.float64
    min_separation: wp.float64
    window: wp.float64
    search: wp.float64
    track: wp.float64
    gate: wp.float64
    lost_s: wp.float64
    acquire_s: wp.float64
    jump_s: wp.float64
    lean: wp.float64
    spot: wp.float64
    memory: wp.float64


@wp.struct
class Line:
    """u(x) = offset + slope (x - x0) + bend (x - x0)^2 / 2. is_there: 0 = none."""

    x0: wp.float64
    offset: wp.float64
    slope: wp.float64
    bend: wp.float64
    is_there: wp.float64


@wp.struct
class State:
    """What a detector knows. time: of its last scan [ns]; rows: of its track."""

    time: wp.int64
    rows: wp.int64
    line: Line
    is_found: wp.float64
    unseen: wp.float64
    crop: wp.float64
    stubble: wp.float64
    ground: wp.float64
    since: wp.float64
    shift: wp.float64


@wp.struct
class Split:
    """first: index of the first crop point."""

    gain: wp.float64
    first: int


@wp.struct
class Step:
    """An edge point of a scan and its rays; is_there: 0 = no edge in this profile."""

    is_there: int
    count: int
    x: wp.float64
    u: wp.float64
    variance: wp.float64
    quality: wp.float64
    crop: wp.float64
    stubble: wp.float64
    ground: wp.float64
    separation: wp.float64
    top: wp.float64
    limit: wp.float64


@wp.func
def at(line: Line, x: wp.float64) -> wp.float64:
    ahead = x - line.x0
    return line.offset + ahead * (line.slope + HALF * line.bend * ahead)


@wp.func
def later(before: wp.float64, now: wp.float64) -> wp.float64:
    return (ONE - LATE) * before + LATE * now


@wp.func
def moved(line: Line, distance: wp.float64, turn: wp.float64) -> Line:
    offset = line.offset + distance * (line.slope + HALF * line.bend * distance)
    slope = line.slope + line.bend * distance
    found = line
    found.offset = offset - line.x0 * turn + slope * offset * turn
    found.slope = slope - turn * (ONE + slope * slope)
    return found


@wp.func_native("""
double* a = (double*)v.data;
for (int low = 0, high = n - 1; low < high;) {
  const double pivot = a[k];
  int i = low, j = high;
  while (i <= j) {
    while (a[i] < pivot) ++i;
    while (pivot < a[j]) --j;
    if (i <= j) {
      const double kept = a[i];
      a[i++] = a[j];
      a[j--] = kept;
    }
  }
  if (j < k) low = i;
  if (k < i) high = j;
}
return a[k];
""")
def chosen(v: Numbers, n: int, k: int) -> wp.float64:
    """The k-th smallest of n numbers, with none greater before it (Hoare's selection, in place)."""


@wp.func
def median(v: Numbers, n: int) -> wp.float64:
    """Median of n > 0 numbers, whose order changes."""
    upper = chosen(v, n, n // 2)
    if n % 2 == 1:
        return upper
    lower = v[0]
    for i in range(1, n // 2):
        lower = wp.max(lower, v[i])
    return HALF * (lower + upper)


@wp.func_native("""
constexpr int PLACES = 256;
const double* from = (const double*)v.data;
double *to = (double*)ordered.data, low = from[0], high = from[0];
for (int i = 1; i < n; ++i) low = from[i] < low ? from[i] : low, high = from[i] > high ? from[i] : high;
const double per = high - low > 1.0e-9 ? (PLACES - 1) / (high - low) : 0.0;
int next[PLACES + 1] = {};
for (int i = 0; i < n; ++i) ++next[1 + (int)((from[i] - low) * per)];
for (int i = 0; i < PLACES; ++i) next[i + 1] += next[i];
for (int i = 0; i < n; ++i) to[next[(int)((from[i] - low) * per)]++] = from[i];
for (int i = 1; i < n; ++i) {
  const double kept = to[i];
  int j = i;
  for (; j > 0 && to[j - 1] > kept; --j) to[j] = to[j - 1];
  to[j] = kept;
}
""")
def order(v: Numbers, n: int, ordered: Numbers):
    """Sort n > 0 numbers: into bins first, then by insertion."""


@wp.func
def mean_of(v: Numbers, first: int, last: int) -> wp.float64:
    total = real(0.0)
    for i in range(first, last):
        total += v[i]
    return total / real(last - first)


@wp.func
def variance_of(v: Numbers, first: int, last: int, mean: wp.float64) -> wp.float64:
    total = real(0.0)
    for i in range(first, last):
        total += (v[i] - mean) * (v[i] - mean)
    return total / real(last - first)


@wp.func
def coin(count: int, n: int) -> wp.float64:
    """Entropy [nat] of n draws of which `count` fell on one side."""
    share = wp.min(wp.max(real(count) / real(n), TINY), ONE - TINY)
    return -real(n) * (share * wp.log(share) + (ONE - share) * wp.log(ONE - share))


@wp.func
def otsu_threshold(z: Numbers, n: int, v: Numbers) -> wp.float64:
    """Threshold of n > 1 heights with the largest variance between both classes. v: gets them in order."""
    order(z, n, v)
    mean = mean_of(v, 0, n)
    centred = real(0.0)
    most = real(-1.0)
    best = int(0)
    for i in range(n - 1):
        centred += v[i] - mean
        low = real(i + 1)
        between = centred * centred / (low * (real(n) - low))
        if between > most:
            most = between
            best = i
    return HALF * (v[best] + v[best + 1])


@wp.func
def split_by_otsu(z: Numbers, n: int, values: Numbers, score: Numbers) -> Split:
    """Score of a split before each of the points 1..n-1, its gain, the best."""
    high = int(0)
    threshold = otsu_threshold(z, n, values)
    for i in range(n):
        if z[i] > threshold:
            high += 1
    before = int(0)
    best = int(0)
    fewest = int(n + 1)
    for k in range(1, n):
        if z[k - 1] > threshold:
            before += 1
        wrong = before + (n - high) - (k - before)
        score[k - 1] = -INF
        if k >= MIN_POINTS and n - k >= MIN_POINTS:
            score[k - 1] = -ERROR_ODDS * real(wrong)
            if wrong < fewest:
                fewest = wrong
                best = k
    found = Split()
    found.first = best
    found.gain = wp.max(coin(high, n) - coin(fewest, n), ZERO)
    return found


@wp.func
def ground_slope(lateral: Numbers, z: Numbers, n: int, values: Numbers) -> wp.float64:
    """Lateral slope of n points on the stubble side, least squares shrunk toward 0 by 2 deg of roll."""
    for i in range(n):
        values[i] = z[i]
    middle = median(values, n)
    total = real(0.0)
    across = real(0.0)
    up = real(0.0)
    for i in range(n):
        away = (z[i] - middle) / real(0.1)
        weight = ONE / (ONE + away * away)
        values[i] = weight
        total += weight
        across += weight * lateral[i]
        up += weight * z[i]
    across = across / total
    up = up / total
    noise = real(0.0)
    both = real(0.0)
    wide = real(0.0)
    for i in range(n):
        dw = lateral[i] - across
        dh = z[i] - up
        noise += values[i] * dh * dh
        both += values[i] * dw * dh
        wide += values[i] * dw * dw
    return both / (wide + noise / total / (real(0.035) * real(0.035)) + TINY)


@wp.func_native("""
double* k = (double*)key.data;
int* at = (int*)index.data;
for (int i = 0; i < n; ++i) {
  const double kept = k[i];
  int j = i;
  for (; j > 0 && k[j - 1] > kept; --j) k[j] = k[j - 1], at[j] = at[j - 1];
  k[j] = kept;
  at[j] = i;
}
""")
def sort_by(key: Numbers, index: wp.array(dtype=int), n: int):
    """Stable, for keys that are nearly in order."""


@wp.func
def abreast(x: Numbers, lateral: Numbers, edge: wp.float64, first: int, n: int, v: Numbers) -> wp.float64:
    """Place x at which the edge point holds: midway between crop and stubble within 1 m of it."""
    total = real(0.0)
    sides = int(0)
    for side in range(2):
        begin = int(0)
        end = int(first)
        if side == 1:
            begin = first
            end = n
        count = int(0)
        for i in range(begin, end):
            if wp.abs(lateral[i] - edge) < ONE:
                v[count] = x[i]
                count += 1
        if count > 0:
            total += median(v, count)
            sides += 1
    if sides > 0:
        return total / real(sides)
    for i in range(n):
        v[i] = x[i]
    return median(v, n)


@wp.func
def find_step(
    s: Settings,
    expected: Line,
    echoes: int,
    top_of_all: wp.float64,
    is_known: int,
    rise_known: wp.float64,
    sensor: wp.vec3d,
    scratch: Table,
    index: wp.array(dtype=int),
) -> Step:
    """The edge point of the echoes below a top."""
    step = Step()
    half = s.window
    line = expected
    if line.is_there == ZERO:
        half = s.search
        line.offset = s.centre
        line.x0 = ZERO
        line.slope = ZERO
        line.bend = ZERO
    x = scratch[RAW_X]
    z = scratch[RAW_LEVEL]
    lateral = scratch[LATERAL]
    n = int(0)
    first_lateral = real(0.0)
    last_lateral = real(0.0)
    for i in range(echoes):
        if scratch[ECHO_Z, i] < top_of_all:
            beside = scratch[ECHO_U, i] - at(line, scratch[ECHO_X, i])
            if wp.abs(beside) < half:
                if n == 0:
                    first_lateral = beside
                last_lateral = beside
                n += 1
    if n < 2 * MIN_POINTS:
        return step
    place = int(0)
    way = int(1)
    if first_lateral > last_lateral:  # such scans come from the other side
        place = n - 1
        way = -1
    values = scratch[VALUES]
    for i in range(echoes):
        if scratch[ECHO_Z, i] < top_of_all:
            beside = scratch[ECHO_U, i] - at(line, scratch[ECHO_X, i])
            if wp.abs(beside) < half:
                values[place] = scratch[ECHO_X, i]
                scratch[MET, place] = scratch[ECHO_Z, i]
                lateral[place] = beside
                place += way
    sort_by(lateral, index, n)
    for i in range(n):
        x[i] = values[index[i]]
        z[i] = scratch[MET, index[i]]
    score = scratch[SCORE]
    split = split_by_otsu(z, n, values, score)
    if not (split.gain > ZERO):
        return step
    first = split.first
    slope = ground_slope(lateral, z, first, values)
    for i in range(n):
        z[i] = z[i] - slope * lateral[i]
    low = mean_of(z, 0, first)
    limit = HALF * (low + mean_of(z, first, n))
    for i in range(first, n):
        values[i - first] = z[i]
    top = wp.min(chosen(values, n - first, int(TOP * real(n - first))), sensor[2] - real(0.3))
    top = wp.max(top, limit)
    aside = -slope
    if is_known == 1:
        aside = rise_known
    for i in range(n):
        down = wp.max(sensor[2] - z[i], real(0.1))
        u = lateral[i] + at(line, x[i])
        share = wp.min(wp.max((sensor[2] - top) / down, ZERO), real(2.0))
        upper_x = sensor[0] + share * (x[i] - sensor[0])
        upper = sensor[1] + share * (u - sensor[1]) - at(line, upper_x) - aside * (top - low)
        share = wp.min(wp.max((sensor[2] - limit) / down, ZERO), real(2.0))
        lower_x = sensor[0] + share * (x[i] - sensor[0])
        lower = sensor[1] + share * (u - sensor[1]) - at(line, lower_x) - aside * (limit - low)
        share = INNER
        if upper > lower:
            share = ONE - INNER
        x[i] = share * upper_x + (ONE - share) * lower_x
        lateral[i] = share * upper + (ONE - share) * lower
        scratch[RAW_UPPER, i] = upper
        scratch[RAW_LOWER, i] = lower
    sort_by(lateral, index, n)
    level = scratch[LEVEL]
    met = scratch[MET]
    for i in range(n):
        k = index[i]
        scratch[AHEAD, i] = x[k]
        level[i] = z[k]
        scratch[UPPER, i] = scratch[RAW_UPPER, k]
        scratch[LOWER, i] = scratch[RAW_LOWER, k]
        met[i] = z[k]
        if z[k] < limit:
            met[i] = wp.min(z[k], low)
    split = split_by_otsu(met, n, values, score)
    if not (split.gain > s.min_gain):
        return step
    first = split.first
    below = mean_of(level, 0, first)
    above = mean_of(level, first, n)
    spread = variance_of(level, 0, first, below) + variance_of(level, first, n, above)
    separation = (above - below) / wp.sqrt(spread + SMALL)
    if above - below < s.min_step or separation < s.min_separation or wp.abs(below) > MAX_GROUND:
        return step
    most = score[first - 1]
    sure = real(0.0)
    middle = real(0.0)
    for i in range(n - 1):
        gap = lateral[i + 1] - lateral[i]
        values[i] = wp.exp(score[i] - most) * wp.min(wp.max(gap, real(1e-3)), real(0.3))
        sure += values[i]
        middle += values[i] * (HALF * (lateral[i + 1] + lateral[i]))
    middle = middle / sure
    variance = real(0.0)
    for i in range(n - 1):
        gap = lateral[i + 1] - lateral[i]
        off = HALF * (lateral[i + 1] + lateral[i]) - middle
        variance += values[i] / sure * (off * off + gap * gap / real(12.0))
    step.x = abreast(scratch[AHEAD], lateral, middle, first, n, values)
    step.u = at(line, step.x) + middle
    step.variance = variance + RESOLUTION * RESOLUTION
    step.quality = wp.min(wp.max((separation - HALF * s.min_separation) / s.min_separation, real(0.2)), ONE)
    for i in range(first):
        values[i] = level[i]
    step.ground = chosen(values, first, int(real(0.1) * real(first)))
    step.stubble = chosen(values, first, int(TOP * real(first))) - step.ground
    for i in range(first, n):
        values[i - first] = level[i]
    step.crop = chosen(values, n - first, int(TOP * real(n - first))) - step.ground
    step.separation = separation
    step.top = top - step.ground
    step.limit = limit - step.ground
    step.count = n
    step.is_there = 1
    return step


@wp.func
def fit_line(scratch: Table, n: int, start: Line, x0: wp.float64) -> Line:
    """Parabola through n points in scratch by reweighted least squares; leaves the weights there."""
    x = scratch[FIT_X]
    u = scratch[FIT_U]
    variance = scratch[FIT_VARIANCE]
    robust = scratch[ROBUST]
    values = scratch[VALUES]
    line = start
    if start.is_there == ZERO:
        for i in range(n):
            values[i] = u[i]
        line.offset = median(values, n)
        line.slope = ZERO
        line.bend = ZERO
    line.x0 = x0
    line.is_there = ONE
    for _ in range(4):
        for i in range(n):
            values[i] = wp.abs(u[i] - at(line, x[i]))
        spread = MAD * median(values, n)
        spread = spread * spread
        total = real(0.0)
        for i in range(n):
            away = u[i] - at(line, x[i])
            rest = wp.max(ONE - away * away / (TUKEY * TUKEY * (variance[i] + spread)), ZERO)
            robust[i] = rest * rest
            total += robust[i]
        if total < HALF:
            for i in range(n):
                robust[i] = ONE
        a = real(0.0)
        b = real(0.0)
        c = real(0.0)
        d = real(0.0)
        e = real(0.0)
        p = real(0.0)
        q = real(0.0)
        r = real(0.0)
        for i in range(n):  # the normal matrix (a b c; b d e; c e g) with g = sum of (half square) squares
            w = robust[i] / variance[i]
            ahead = x[i] - x0
            square = HALF * ahead * ahead
            a += w
            b += w * ahead
            c += w * square
            e += w * ahead * square
            d += w * square * square
            p += w * u[i]
            q += w * ahead * u[i]
            r += w * square * u[i]
        m = real(2.0) * c + ONE / (SLOPE_SD * SLOPE_SD)  # squares of ahead are twice `square`
        g = d + ONE / (BEND_SD * BEND_SD)
        share = b / a
        m = m - share * b
        mixed = e - share * c
        q = q - share * p
        share = c / a
        g = g - share * c
        r = r - share * p
        share = mixed / m
        line.bend = (r - share * q) / (g - share * mixed)
        line.slope = (q - mixed * line.bend) / m
        line.offset = (p - b * line.slope - c * line.bend) / a
    return line


@wp.func
def fit_used(rows: Table, scratch: Table, state: State, s: Settings) -> Line:
    """Through the points of the track that count."""
    n = int(0)
    for i in range(int(state.rows)):
        if rows[i, IS_USED] > ZERO:
            x = rows[i, X]
            slope = real(0.0)
            if state.line.is_there > ZERO:
                slope = state.line.slope + state.line.bend * (x - state.line.x0)
            lean = LEVER * (rows[i, SLOPE] - slope)
            scratch[FIT_X, n] = x
            scratch[FIT_U, n] = rows[i, U]
            scratch[FIT_VARIANCE, n] = PER_SAMPLE * rows[i, VARIANCE] + lean * lean
            n += 1
    return fit_line(scratch, n, state.line, s.reference)


@wp.func
def tried(rows: Table, scratch: Table, state: State, span: wp.float64, near: Line, s: Settings) -> State:
    """Found when enough scans of the last `span` agree on one line, near one if that is there."""
    if state.unseen < span - SMALL and near.is_there == ZERO:
        return state
    asked = int(0)
    n = int(0)
    oldest = real(0.0)
    for i in range(int(state.rows)):
        oldest = wp.max(oldest, rows[i, AGE])
        if rows[i, AGE] <= span + SMALL:
            asked += 1
            if wp.isfinite(rows[i, X]):
                scratch[FIT_X, n] = rows[i, X]
                scratch[FIT_U, n] = rows[i, U]
                scratch[FIT_VARIANCE, n] = rows[i, VARIANCE]
                n += 1
    fewest = wp.max(real(3.0), MIN_SHARE * real(asked))
    if oldest < span - SMALL or real(n) < fewest:
        return state
    line = fit_line(scratch, n, near, s.reference)
    reference = near
    if near.is_there == ZERO:
        reference = line
    agree = int(0)
    for i in range(n):
        is_close = wp.abs(scratch[FIT_U, i] - at(reference, scratch[FIT_X, i])) < s.gate
        if scratch[ROBUST, i] > ZERO and is_close:
            agree += 1
        else:
            scratch[ROBUST, i] = ZERO
    if real(agree) < fewest:
        return state
    point = int(0)
    for i in range(int(state.rows)):
        rows[i, IS_USED] = ZERO
        if rows[i, AGE] <= span + SMALL and wp.isfinite(rows[i, X]):
            if scratch[ROBUST, point] > ZERO:
                rows[i, IS_USED] = ONE
            point += 1
    state.is_found = ONE
    state.unseen = ZERO
    state.line = line
    state.line = fit_used(rows, scratch, state, s)
    return state


@wp.func
def move_track(
    rows: Table,
    state: State,
    distance: wp.float64,
    turn: wp.float64,
    dt: wp.float64,
    crab: wp.float64,
    s: Settings,
) -> State:
    """The points and the line, seen from where the machine is now."""
    course = HALF * turn + crab
    dx = distance * wp.cos(course)
    du = distance * wp.sin(course)
    c = wp.cos(turn)
    t = wp.sin(turn)
    front = -INF
    for i in range(int(state.rows)):
        x = rows[i, X] - dx
        u = rows[i, U] - du
        rows[i, X] = c * x + t * u
        rows[i, U] = c * u - t * x
        rows[i, AGE] = rows[i, AGE] + dt
        rows[i, SLOPE] = rows[i, SLOPE] - turn
        if rows[i, X] > front:
            front = rows[i, X]
    if front == -INF:
        front = ZERO
    n = int(0)
    for i in range(int(state.rows)):
        if rows[i, AGE] <= WINDOW_S and not (rows[i, X] < front - s.track):
            if n < i:
                for k in range(COLUMNS):
                    rows[n, k] = rows[i, k]
            n += 1
    state.rows = wp.int64(n)
    state.unseen = state.unseen + dt
    if state.line.is_there > ZERO:
        state.line = moved(state.line, distance, turn)
        state.line.offset = state.line.offset - distance * crab
        if state.unseen > FORGET_S:
            state.line.is_there = ZERO
            state.is_found = ZERO
    return state


@wp.func
def update_track(rows: Table, scratch: Table, state: State, step: Step, s: Settings) -> State:
    """Take the edge point of a scan, or that it showed none."""
    n = int(state.rows)
    if n == rows.shape[0]:
        for i in range(1, n):
            for k in range(COLUMNS):
                rows[i - 1, k] = rows[i, k]
        n -= 1
    for k in range(COLUMNS):
        rows[n, k] = real(wp.nan)
    rows[n, AGE] = ZERO
    rows[n, IS_USED] = ZERO
    if step.is_there == 1:
        rows[n, X] = step.x
        rows[n, U] = step.u
        rows[n, VARIANCE] = step.variance
        rows[n, QUALITY] = step.quality
        rows[n, SLOPE] = ZERO
        if state.line.is_there > ZERO:
            rows[n, SLOPE] = state.line.slope + state.line.bend * (step.x - state.line.x0)
            if state.is_found > ZERO and wp.abs(step.u - at(state.line, step.x)) < s.gate:
                rows[n, IS_USED] = ONE
    state.rows = wp.int64(n + 1)
    if rows[n, IS_USED] > ZERO:
        state.unseen = ZERO
        state.line = fit_used(rows, scratch, state, s)
    elif state.is_found > ZERO and state.unseen > s.lost_s:
        state.is_found = ZERO
        for i in range(n + 1):
            rows[i, IS_USED] = ZERO
    if state.is_found == ZERO:
        near = state.line
        state = tried(rows, scratch, state, s.acquire_s, near, s)
        if state.is_found == ZERO and near.is_there > ZERO:
            near.is_there = ZERO
            state = tried(rows, scratch, state, s.jump_s, near, s)
    return state


@wp.func
def confidence_of(rows: Table, state: State, s: Settings) -> wp.float64:
    """Share of the last half second of scans that show the edge, times their quality."""
    recent = int(0)
    used = int(0)
    quality = real(0.0)
    for i in range(int(state.rows)):
        if rows[i, AGE] <= HALF:
            recent += 1
            if rows[i, IS_USED] > ZERO:
                used += 1
                quality += rows[i, QUALITY]
    if used == 0:
        return ZERO
    fading = wp.max(ZERO, ONE - state.unseen / (s.lost_s + TINY))
    share = real(used) / real(recent) * (quality / real(used)) * fading
    return wp.min(wp.max(share, LEAST_SURE), ONE)


@wp.func
def guess_of(s: Settings, height: wp.float64) -> wp.float64:
    """How far the feet are behind the canopy's edge before anything is learned [m]."""
    return s.lean * wp.max(height, ZERO) + s.spot


@wp.func
def learn_offset(
    o: Offset,
    s: Settings,
    state: State,
    step: Step,
    lateral: wp.float64,
    scratch: Table,
    seen: Table,
    heights: Numbers,
    logs: Table,
    score: Table,
) -> State:
    """Count the rays of a step, and fit the shift now and then."""
    if s.memory <= ZERO or wp.abs(lateral) > CLOSE:
        return state
    r = Rays()
    r.upper = scratch[UPPER]
    r.lower = scratch[LOWER]
    r.level = scratch[LEVEL]
    r.ground = step.ground
    r.top = step.top
    r.limit = step.limit
    r.count = step.count
    if count_rays(o, r, seen, heights) and state.since >= OFTEN and state.crop > ZERO:
        state.since = ZERO
        state.shift = fitted_shift(o, guess_of(s, state.crop), seen, logs, score)
    return state


@wp.kernel
def detect(
    settings: wp.array(dtype=Settings),
    offsets: wp.array(dtype=Offset),
    mountings: wp.array2d(dtype=wp.float64),
    clock: wp.array(dtype=wp.int64),
    scanned: wp.array(dtype=wp.int64),
    speeds: Numbers,
    yaw_rates: Numbers,
    inertial: wp.array2d(dtype=wp.float64),
    ranges: wp.array2d(dtype=float),
    directions: wp.array2d(dtype=wp.vec3d),
    ago: wp.array2d(dtype=wp.float64),
    states: wp.array(dtype=State),
    tracks: wp.array3d(dtype=wp.float64),
    seen: wp.array3d(dtype=wp.float64),
    heights: wp.array2d(dtype=wp.float64),
    all_scratch: wp.array3d(dtype=wp.float64),
    all_logs: wp.array3d(dtype=wp.float64),
    all_scores: wp.array3d(dtype=wp.float64),
    indices: wp.array2d(dtype=int),
    edges: wp.array2d(dtype=wp.float64),
):
    """clock: begin and end of the step [ns]; scanned: time of the scan [ns]
    directions, ago: of each world or of all
    all_scratch to indices: of one world, used by one after the other
    edges: offset, heading, curvature, confidence, height of crop and stubble, and one that stays.
    """
    w = wp.tid()
    s = settings[w]
    state = states[w]
    rows = tracks[w]
    scratch = all_scratch[0]
    speed = real(0.0)
    if wp.isfinite(speeds[w]):
        speed = speeds[w]
    yaw_rate = real(0.0)
    if wp.isfinite(yaw_rates[w]):
        yaw_rate = yaw_rates[w]
    if inertial[w, 0] > ZERO:
        inertial[w, 1] = speed
        incline(inertial[w])
    rise = inertial[w, 3] / wp.max(inertial[w, 4], HALF)
    is_known = int(0)
    if inertial[w, 8] != ZERO:
        is_known = 1
    if scanned[0] > state.time:
        elapsed = real(scanned[0] - state.time) / NS
        state.time = scanned[0]
        crab = -s.sign * (CRAB * (rise + speed * yaw_rate / GRAVITY))
        state = move_track(rows, state, speed * elapsed, s.sign * yaw_rate * elapsed, elapsed, crab, s)
        if s.memory > ZERO and speed * elapsed > ZERO:
            keep = wp.exp(-(speed * elapsed) / s.memory)
            for i in range(seen.shape[2]):
                seen[w, 0, i] = seen[w, 0, i] * keep
                seen[w, 1, i] = seen[w, 1, i] * keep
            for i in range(heights.shape[1]):
                heights[w, i] = heights[w, i] * keep
            state.since = state.since + speed * elapsed
        m = mountings[w]
        of = wp.min(w, directions.shape[0] - 1)
        n = int(0)
        for i in range(ranges.shape[1]):
            far = real(ranges[w, i])
            if far > NEAR and far < FAR:
                d = directions[of, i]
                px = m[0] + far * (m[3] * d[0] + m[4] * d[1] + m[5] * d[2])
                py = m[1] + far * (m[6] * d[0] + m[7] * d[1] + m[8] * d[2])
                pz = m[2] + far * (m[9] * d[0] + m[10] * d[1] + m[11] * d[2])
                if pz > LOWEST and pz < HIGHEST:
                    back = ago[of, i]
                    turn = yaw_rate * back
                    z = turn * turn
                    c = ONE - HALF * z * (ONE - z / real(12.0) * (ONE - z / real(30.0)))  # 1e-16 up to 0.01
                    t = turn * (ONE - z / real(6.0) * (ONE - z / real(20.0) * (ONE - z / real(42.0))))
                    if wp.abs(turn) > real(0.01):
                        c = wp.cos(turn)
                        t = wp.sin(turn)
                    scratch[ECHO_X, n] = speed * back + c * px - t * py
                    scratch[ECHO_U, n] = s.sign * (HALF * speed * back * turn + t * px + c * py)
                    scratch[ECHO_Z, n] = pz
                    n += 1
        sensor = wp.vec3d(m[0], s.sign * m[1], m[2])
        before = state.line
        was_found = state.is_found
        aside = s.sign * rise
        top = HIGHEST
        tops = int(3)
        if was_found > ZERO and wp.isfinite(state.crop):
            top = state.ground + HEADROOM * wp.max(state.crop, ZERO) + ROOM
            tops = 1
        best = Step()
        for k in range(tops):
            step = find_step(s, state.line, n, top, is_known, aside, sensor, scratch, indices[0])
            if step.is_there == 1 and (best.is_there == 0 or step.separation > CLEARER * best.separation):
                best = step
            if k == 0:
                top = FIRST_TOP
            else:
                top = SECOND_TOP
        state = update_track(rows, scratch, state, best, s)
        if best.is_there == 1:
            if wp.isfinite(state.crop):
                state.crop = later(state.crop, best.crop)
                state.stubble = later(state.stubble, best.stubble)
                state.ground = later(state.ground, best.ground)
            else:
                state.crop = best.crop
                state.stubble = best.stubble
                state.ground = best.ground
            if was_found > ZERO and before.is_there > ZERO:
                lateral = best.u - at(before, best.x)
                state = learn_offset(
                    offsets[w],
                    s,
                    state,
                    best,
                    lateral,
                    scratch,
                    seen[w],
                    heights[w],
                    all_logs[0],
                    all_scores[0],
                )
    age = clock[1] - state.time
    for k in range(6):
        edges[w, k] = real(wp.nan)
    edges[w, 2] = ZERO
    edges[w, 3] = ZERO
    if state.line.is_there > ZERO and state.is_found > ZERO and real(age) <= s.lost:
        line = moved(state.line, speed * real(age) / NS, s.sign * yaw_rate * real(age) / NS)
        steep = ONE + line.slope * line.slope
        shift = guess_of(s, state.crop)
        if wp.isfinite(state.shift):
            shift = state.shift
        edges[w, 0] = s.sign * (line.offset + shift * wp.sqrt(steep))
        edges[w, 1] = s.sign * wp.atan(line.slope)
        edges[w, 2] = s.sign * (line.bend / (steep * wp.sqrt(steep)))
        edges[w, 3] = confidence_of(rows, state, s)
        edges[w, 4] = state.crop
        edges[w, 5] = state.stubble
    states[w] = state
