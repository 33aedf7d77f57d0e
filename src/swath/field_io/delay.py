"""How late the logged grain flow is: the time from the knife to the sensor, less what the monitor took off.

Two things show it. Neighbouring passes see the same soil: a flow that is late by d shifts its yield along
the way, so that two passes agree best at the right delays, in a fine band of the yield as in a coarse one.
Driven in opposite directions they show the mean of both delays, that of one machine where both are its own;
driven in one direction, by two machines, half of the difference. And at the headland the crop ends at one
line for the pass that comes and the pass that goes: at the right d the flow begins and ends on it. The delay
counts where these agree with each other and within themselves; else it is not known.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import Extra
from swath.core.number_text import num
from swath.documents.witness import Estimate, agreed
from swath.field_io.logs.log import Log

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
TRIES, FINE = np.arange(-10.0, 30.5, 1.0), np.arange(-10.0, 30.1, 0.25)  # s
NEIGHBOUR = 1.35  # header widths to the next pass at most
FEWEST_PAIRS, FEWEST_SHOWN = 300, 50  # of a machine, and at a delay that is tried
LEAST_FLOW = 0.2  # of the median flow: below, the header is not full
LEAST_AGREEMENT = 0.15  # correlation of neighbouring passes; below, the peak is chance
# s: the yield is smoothed over the first, freed of trends over the second
BANDS = (5.0, 41.0), (9.0, 81.0), (15.0, 161.0)
FEWEST_PASSES = 4  # in pairs: the spread of fewer says nothing
PARTS = 40  # of the passes, of which one each is left out for the standard error
CLEAR = 2.0  # standard errors by which a peak stands above the agreement at any other delay
APART = 3.0  # s from a peak on: another delay
FILLING = 6.0  # s before and after which a flow that rises or falls is that of a full header, or none
SHORTEST = 15.0  # s of a flow between a rise and a fall
FEWEST_TURNS = 2  # at each end of the field
# passes, and share of them, at whose begin or end the log shows the flow begin or end
FEWEST_STARTS, LEAST_STARTS = 4, 0.5
LEAD, LEAD_ERROR = 0.5, 0.3  # s, before the crop, at which a header is set down and records begin; estimated
LEAST_ERROR, LEAST_TOLD = (
    0.1,
    0.2,
)  # s, of an estimate, and of the delay: 2 % of 60 drawn logs are off by twice it
# of the time by which a fall lasts longer than a rise: an exponential one takes ln 9 time constants, and is
# late by one, its turns by half
DYING = 0.5 / np.log(9.0)
NOISY = 3.0  # records by which a fall may last longer than a rise by chance
HALF = 1.0  # s shown by the turns: below, half and whole delay are the same within what is told
STEEP = "turns that begin or end at once"  # which may show half of the delay: no witness of their own
# of the begins or ends of a flow, from a tenth to this share of it in one record: a lag of 0.3 to 2.5 s, the
# usual ones, lasts longer at a record each 2 s or less
AT_ONCE, FULL = 0.5, 0.8
SLACK = 1.5  # s: what a ramp of the flow, and a line of a headland, are off in the mean


@dataclass(frozen=True)
class Delay:
    """Delay of a machine's flow.

    seconds: the delay [s], nan = not known
    method: what it was found by
    agreement: correlation of the yields of neighbouring passes at this delay, nan = they say nothing
    pair_count: pairs of records that were compared
    error: standard error of the delay [s], nan = not known
    doubt: what shows a delay that is not known, '' = nothing
    is_cut_off: the monitor shows no flow while the header is out, whatever comes through then
    """

    machine: str
    seconds: float
    method: str
    agreement: float
    pair_count: int
    error: float = float("nan")
    doubt: str = ""
    is_cut_off: bool = False


def estimate_delays(log: Log) -> list[Delay]:
    """The delay of each machine, from passes beside each other and its own turns."""
    first, second, is_opposite = neighbour_pairs(log)
    bands = _of_passes(log, first, second, is_opposite)
    delays = []
    for index, name in enumerate(log.machine_names):
        own = (log.machine[first] == index) | (log.machine[second] == index)
        edges, is_cut_off = _of_turns(log, np.flatnonzero(log.machine == index))
        made = _joined(name, bands[index], edges, int(own.sum()))
        delays.append(replace(made, is_cut_off=is_cut_off))
    return delays


def shifted_flow(log: Log, delays: list[Delay]) -> Array:
    """Grain flow [kg/s] at the place it was cut, shape (n,), nan where the log ends before it arrived, or it
    arrived behind the end of a flow that is cut off.

    That of a machine whose delay is not known stays where it is.
    """
    flow = _later(log, log.flow, np.nan_to_num([d.seconds for d in delays])[log.machine])
    is_cut_off = np.array([d.is_cut_off for d in delays])[log.machine]
    low = LEAST_FLOW * _usual(log.flow)
    return np.where(is_cut_off & (flow < low) & (log.flow >= low), np.nan, flow)


def _later(log: Log, values: Array, seconds: Array | float) -> Array:
    """Values of the log some seconds after each record, shape (n,), nan beyond the stretch it is in."""
    clock, first, last = _clock(log)
    wanted = clock + seconds
    known = (wanted >= clock[first] - 1e-6) & (wanted <= clock[last] + 1e-6)
    return np.where(known, np.interp(wanted, clock, values), np.nan)


def _clock(log: Log) -> tuple[Array, Indices, Indices]:
    """A clock [s] on which stretches lie far apart, and of each record the first and last of its stretch."""
    gap = log.gap
    block = np.cumsum(gap) - 1
    first = np.flatnonzero(gap)
    last = np.r_[first[1:], len(log)] - 1
    since = log.time - log.time.min()
    return since + block * (float(since.max()) + 1000.0), first[block], last[block]


def neighbour_pairs(log: Log) -> tuple[Indices, Indices, NDArray[np.bool_]]:
    """Indices of records that lie side by side on neighbouring passes, each pair once, and whether their
    directions are opposite; of passes in one direction only those of two machines.
    """
    with Extra("geo", "cleaning a yield log"):
        from scipy.spatial import cKDTree
    none = np.zeros(0, dtype=np.int64)
    nothing = none, none, none.astype(bool)
    width = float(np.median(log.width[log.width > 0.0])) if (log.width > 0.0).any() else 0.0
    forward = direction(log)
    cutting = (log.speed > 0.8) & (log.width > 0.9 * width) & log.working
    index = np.flatnonzero(cutting & np.isfinite(forward[:, 0]))
    if len(index) < FEWEST_PAIRS or width <= 0.0:
        return nothing
    tree = cKDTree(log.position[index])
    count = min(60, len(index))
    distance, near = tree.query(log.position[index], k=count, distance_upper_bound=NEIGHBOUR * width)
    here, rank = np.nonzero(np.isfinite(distance) & (distance > 0.5 * width))
    i, j = index[here], index[near[here, rank]]
    offset = log.position[j] - log.position[i]
    beside = np.abs((offset * forward[i]).sum(axis=1)) < 1.5
    along = (forward[i] * forward[j]).sum(axis=1)
    order = log.machine[j] - log.machine[i]
    once = (order > 0) | ((order == 0) & (i < j))
    shown = beside & once & ((along < -0.95) | ((along > 0.95) & (log.machine[i] != log.machine[j])))
    return i[shown], j[shown], along[shown] < 0.0


def direction(log: Log) -> Array:
    """Unit vector of travel from the records before and after, shape (n, 2), nan at the ends of a track."""
    p, block = log.position, np.cumsum(log.gap)
    step = np.full((len(log), 2), np.nan)
    if len(log) > 2:
        whole = block[2:] == block[:-2]
        step[1:-1][whole] = (p[2:] - p[:-2])[whole]
    length = np.hypot(step[:, 0], step[:, 1])
    unit: Array = step / np.where(length > 0.2, length, np.nan)[:, None]
    return unit


def _joined(
    name: str, bands: list[tuple[Estimate, float]], turns: list[tuple[Estimate, str]], count: int
) -> Delay:
    """The delay of one machine where all that shows it agrees.

    Turns show it at both ends of the field, so that they count alone; a single band and the ends of records
    do not.
    """
    agreement = max((r for _, r in bands), default=float("nan"))
    turns = [(part, what) for part, what in turns if part.error <= SLACK]
    parts, by = [part for part, _ in turns], [what for _, what in turns]
    passes = agreed([part for part, _ in bands], SLACK)
    if passes is not None:  # bands are of one flow: more of them are no surer
        parts.append(Estimate(passes.value, max(passes.error, min(part.error for part, _ in bands))))
    by += ["neighbour passes"] * bool(bands)
    found = agreed(parts, SLACK)
    is_enough = len(by) > 1 or len(bands) > 1 or by == ["its turns"]
    is_split = found is None or (passes is None and bool(bands))
    if found is None or is_split or found.error > SLACK or not is_enough:
        why = f"only {by[0]} show it" if len(by) == 1 else "its parts disagree" if by else "nothing shows it"
        late = [p.value for p in (*parts, *(p for p, _ in bands)) if abs(p.value) > SLACK + 3.0 * p.error]
        doubt = (
            f"of the flow not known, not taken off: {why}: {num(min(late))} to {num(max(late))} s"
            if late
            else ""
        )
        return Delay(name, np.nan, f"not known, flow not shifted: {why}", agreement, count, doubt=doubt)
    return Delay(
        name,
        round(found.value, 2),
        f"agreement of {' and '.join(by)}",
        agreement,
        count,
        round(max(found.error, LEAST_TOLD), 2),
    )


def _of_passes(
    log: Log, first: Indices, second: Indices, is_opposite: NDArray[np.bool_]
) -> list[list[tuple[Estimate, float]]]:
    """For each machine: its delay and the correlation of its passes at it, from each band that shows them."""
    count = len(log.machine_names)
    found: list[list[tuple[Estimate, float]]] = [[] for _ in range(count)]
    kinds = np.stack([log.machine[first], log.machine[second], is_opposite.astype(np.int64)], axis=1)
    kind, number = np.unique(kinds, axis=0, return_inverse=True)
    number = number.ravel()
    kept = [k for k in range(len(kind)) if (number == k).sum() >= FEWEST_PAIRS]
    if not kept:
        return found
    steady = _steady(log)
    flows = [_later(log, steady, float(seconds)) for seconds in TRIES]
    steps = np.diff(log.time)[~log.gap[1:]]
    if not (steps > 0.0).any():
        return found
    between = float(np.median(steps[steps > 0.0]))  # s from record to record
    for band in BANDS:
        short, long = (2 * round(0.5 * s / between) + 1 for s in band)
        local = [_local(log, flow, short, long) for flow in flows]
        rows, shown, agreements = [], list[Estimate](), []
        for k in kept:
            a, b = first[number == k], second[number == k]
            i, j, opposite = kind[k]
            peak = _shown(log, local, a, b, band[0], is_opposite=bool(opposite))
            if peak is not None:
                fast = [
                    float(np.median(log.speed[of])) / (1.0 if opposite or of is a else -1.0) for of in (a, b)
                ]
                row = np.zeros(count)
                np.add.at(row, [i, j], np.array(fast) / np.abs(fast).sum())
                rows.append(row)
                shown.append(peak[0])
                agreements.append(peak[1])
        for index, part in enumerate(_solved(np.array(rows), shown) if rows else []):
            if part is not None:
                found[index].append(
                    (part, max(r for r, row in zip(agreements, rows, strict=True) if row[index]))
                )
    return found


def _solved(rows: Array, shown: list[Estimate]) -> list[Estimate | None]:
    """The delays that solve `rows @ delays = shown` best, rows (shown, delays).

    None for a delay that the rows leave open, and for all where what is shown disagrees.
    """
    value, error = (np.array([getattr(part, key) for part in shown]) for key in ("value", "error"))
    inverse = np.linalg.pinv(rows / error[:, None])
    delay, known = inverse @ (value / error), np.diag(inverse @ (rows / error[:, None]))
    agrees = (np.abs(rows @ delay - value) <= 3.0 * error + SLACK).all()
    return [
        Estimate(float(d), float(np.hypot.reduce(part))) if agrees and k > 1.0 - 1e-6 else None
        for d, part, k in zip(delay, inverse, known, strict=True)
    ]


def _shown(
    log: Log, local: list[Array], first: Indices, second: Indices, short: float, *, is_opposite: bool
) -> tuple[Estimate, float] | None:
    """The shift at which the yields of pairs agree best, and their correlation there.

    The first of a pair is shifted forwards; the second likewise where the two passes run in opposite
    directions, else backwards. None without a clear peak, or of few passes.
    """
    part = _passes(log)[first]
    passes, part = np.unique(part, return_inverse=True)
    if len(passes) < FEWEST_PASSES:
        return None
    back = range(len(TRIES)) if is_opposite else [int(np.argmin(np.abs(TRIES + s))) for s in TRIES]
    tries = [k for k, b in enumerate(back) if is_opposite or TRIES[b] == -TRIES[k]]
    shift = TRIES[tries]
    part = part * PARTS // len(passes)
    sums = np.array([_sums(local[k][first], local[back[k]][second], part) for k in tries])
    r, likely = _agreement(sums.sum(axis=2))
    peak = _peak(shift, r, likely, short)
    if peak is None or not (agreement := float(np.interp(peak, shift, r))) >= LEAST_AGREEMENT:
        return None
    without = [_agreement(sums.sum(axis=2) - own) for own in np.moveaxis(sums, 2, 0)]
    others = np.array([peak if (at := _peak(shift, *curves, short)) is None else at for curves in without])
    away = np.abs(shift - peak) > APART
    above = np.array([np.interp(peak, shift, curve) - curve[away].max() for curve, _ in without])
    if above.mean() <= CLEAR * _left_out_error(above):
        return None
    return Estimate(peak, max(_left_out_error(others), LEAST_ERROR)), agreement


def _left_out_error(values: Array) -> float:
    """Standard error of an estimate by its values with one part left out each (jackknife)."""
    return float(np.sqrt((len(values) - 1) / len(values) * ((values - values.mean()) ** 2).sum()))


def _agreement(sums: Array) -> tuple[Array, Array]:
    """Correlation at each delay of sums, shape (tries, 4), and how likely it makes each (log, of a pair)."""
    both, a, b, count = sums.T
    known = (a > 1e-9) & (b > 1e-9) & (count >= FEWEST_SHOWN)
    r = np.where(known, both / np.sqrt(np.where(known, a * b, 1.0)), 0.0)
    return r, -0.5 * np.sign(r) * count / max(count.max(), 1.0) * np.log1p(-np.minimum(r * r, 0.9999))


def _peak(shift: Array, r: Array, likely: Array, short: float) -> float | None:
    """Shift [s] of the best correlation around the most likely one, which many pairs make so; None where that
    is at an end of those that the log shows. short: over which the yield is smoothed [s].
    """
    peak, reach = int(likely.argmax()), max(int(short / 3.0), 2)
    while 0 < peak < len(r) - 1 and (step := int(r[peak - 1 : peak + 2].argmax()) - 1):
        peak += step
    if 0.0 in np.pad(r, 2)[peak : peak + 5]:
        return None
    near = np.arange(max(peak - reach, 0), min(peak + reach + 1, len(r)))
    curve, slope, _ = np.polyfit(near - peak, r[near], 2)
    offset = -0.5 * slope / curve if curve < 0.0 else 0.0
    return float(shift[peak] + np.clip(offset, -0.5 * reach, 0.5 * reach))


def _passes(log: Log) -> Indices:
    """Number of the pass of each record, shape (n,): it ends where the machine goes back, and at a gap."""
    forward = np.nan_to_num(direction(log))
    known = np.flatnonzero(forward.any(axis=1))
    back = np.zeros(len(log), dtype=bool)
    back[known[1:]] = (forward[known[1:]] * forward[known[:-1]]).sum(axis=1) < 0.0
    return np.cumsum(log.gap | back)


def _local(log: Log, flow: Array, short: int, long: int) -> Array:
    """Logarithm of the yield over the mean yield around it, shape (n,).

    short, long: records over which the yield and the mean around it are smoothed
    """
    known = np.isfinite(flow)
    area_rate = np.maximum(log.speed, 0.5) * np.maximum(log.width, 1.0)
    value = np.where(known, np.log(np.clip(np.where(known, flow, 1.0) / area_rate, 0.01, 5.0)), 0.0)
    local = _smooth(value, known, short) - _smooth(value, known, long)
    return np.clip(np.where(known, local, np.nan), -0.5, 0.5)


def _sums(a: Array, b: Array, part: Indices) -> Array:
    """Sums of a b, a a, b b and the number of pairs in each of PARTS parts of the pairs, shape (4, PARTS)."""
    both = np.isfinite(a) & np.isfinite(b)
    a, b = np.where(both, a, 0.0), np.where(both, b, 0.0)
    return np.array([np.bincount(part, v, minlength=PARTS) for v in (a * b, a * a, b * b, both)])


def _steady(log: Log) -> Array:
    """Flow [kg/s] of a header that has been full for a while, else nan; shape (n,)."""
    clock = _clock(log)[0]
    low = np.flatnonzero(~(log.flow > LEAST_FLOW * _usual(log.flow)))
    at = np.searchsorted(low, np.arange(len(log)))
    ends = np.r_[-np.inf, clock[low], np.inf]
    is_full = (clock - ends[at] > FILLING) & (ends[np.minimum(at + 1, len(ends) - 1)] - clock > FILLING)
    is_full[low] = False
    return np.where(is_full, log.flow, np.nan)


def _usual(flow: Array) -> float:
    return float(np.median(flow[flow > 0.0])) if (flow > 0.0).any() else 0.0


@dataclass(frozen=True)
class _Stretch:
    """Consecutive records with flow, with records without flow before and after.

    rise, fall: when it begins and ends [s], nan = the log does not show it; rise_lasts, fall_lasts: how long
        each takes [s]
    forward: of the machine, in the middle [s], shape (2,)
    """

    middle: float
    rise: float
    fall: float
    rise_lasts: float
    fall_lasts: float
    forward: Array


def _of_turns(log: Log, own: Indices) -> tuple[list[tuple[Estimate, str]], bool]:
    """Delay of a machine by its turns and by what the log says of its header, and whether that cuts off its
    flow.

    At each end of the field the flow ends and begins on one line; the delay is what brings both onto it.
    A header that is set down, or a log without records of the turns, begins a stretch of records: the time
    from it to the begin of its flow, and from its end to the end of the flow. A monitor may show no flow
    while the header is out: then one of begin and end is that of the header, and the turns show half of the
    delay. A log that says when the header is out shows that; ends that no sensor is quick enough for make it
    likely: of a late flow its ends, of an early one its begins.
    """
    clock = _clock(log)[0]
    position, clock = log.position[own], clock[own]
    stretches = _stretches(clock, log.flow[own], position)
    if not stretches:
        return [], False
    found: tuple[list[float], list[float]] = ([], [])
    for before, after in pairwise(stretches):
        if not before.forward @ after.forward < -0.9:
            continue
        off = _at(clock, position, after.rise - FINE) - _at(clock, position, before.fall - FINE)
        off = off @ after.forward
        crossed = np.flatnonzero((off[:-1] > 0.0) & (off[1:] <= 0.0))
        if len(crossed) == 1:
            i = crossed[0]
            seconds = FINE[i] + (FINE[1] - FINE[0]) * off[i] / (off[i] - off[i + 1])
            found[int(after.forward @ stretches[0].forward > 0.0)].append(float(seconds))
    shown = []
    is_shown = min(map(len, found)) >= FEWEST_TURNS
    needs_header = not is_shown or not log.working[own].all()
    sides = _header_sides(log, own, clock, stretches) if needs_header else []
    values = [side.value for side in sides]
    is_cut_off, far = False, max(values, key=abs, default=0.0)
    if len(sides) == 2 and float(np.ptp(values)) > SLACK:
        is_cut_off = far == values[int(far < 0.0)] and min(map(abs, values)) < SLACK
        if not is_cut_off and np.ptp(values) > 3.0 * np.hypot(sides[0].error, sides[1].error):
            return [], False  # held or let die away while the header is out: neither side is the crop's
    if is_shown:
        ends = [_middle(np.array(end)) for end in found]
        error = max(0.5 * float(np.hypot(ends[0].error, ends[1].error)), LEAST_ERROR)
        value = 0.5 * sum(end.value for end in ends)
        is_near = abs(value) < HALF
        both = np.array([(s.rise_lasts, s.fall_lasts) for s in stretches]).T
        lasts = [side[np.isfinite(side)] for side in both]
        longer = float(np.median(lasts[1]) - np.median(lasts[0]) - NOISY * np.median(np.diff(clock)))
        is_steep = len(sides) < 2 and not is_near and float((lasts[int(value > 0.0)] == 0.0).mean()) > AT_ONCE
        is_cut_off &= not is_near
        of_it = 2.0 if is_cut_off else 1.0
        error = of_it * float(np.hypot(error, DYING * max(longer, 0.0)))
        shown.append((Estimate(of_it * value, error), STEEP if is_steep else "its turns"))
    if sides:
        value = far if is_cut_off else float(np.mean(values))
        apart = 0.0 if is_cut_off else 0.5 * float(np.ptp(values))
        error = max(float(np.mean([side.error for side in sides])), LEAD_ERROR, apart)
        shown.append((Estimate(value, error), "the ends of its records"))
    return shown, is_cut_off


def _header_sides(log: Log, own: Indices, clock: Array, stretches: list[_Stretch]) -> list[Estimate]:
    """How late the flow of a machine begins behind the begin of a stretch of records with the header in the
    crop, and how late it ends behind its end, where the log shows that of enough stretches.
    """
    working, between = log.working[own], 0.5 * float(np.median(np.diff(clock)))  # to the crop, in the mean
    edge = np.flatnonzero(np.diff(np.r_[False, working, False]) | np.r_[log.gap[own], True])
    runs = [(clock[a], clock[b - 1]) for a, b in pairwise(edge) if working[a]]
    if len(runs) <= FEWEST_STARTS:
        return []
    begun, ended = np.array(runs).T
    middle = 0.5 * (begun + ended)  # of each run: a stretch belongs to the nearest
    here = np.searchsorted(0.5 * (middle[1:] + middle[:-1]), [s.middle for s in stretches])
    late = np.array([s.rise for s in stretches]) - begun[here] + between - LEAD
    early = np.array([s.fall for s in stretches]) - ended[here] - between + LEAD
    fewest = max(FEWEST_STARTS, LEAST_STARTS * len(stretches))
    known = [side[np.isfinite(side)] for side in (late, early)]
    return [_middle(side) for side in known if len(side) > fewest]


def _at(clock: Array, position: Array, time: Array) -> Array:
    return np.stack([np.interp(time, clock, p) for p in position.T], axis=-1)


def _middle(values: Array) -> Estimate:
    """Median, and its standard error from the spread about it, corrected for few values."""
    middle = float(np.median(values))
    spread = 1.4826 * float(np.median(np.abs(values - middle)))
    return Estimate(middle, 1.2533 * spread / np.sqrt(max(len(values) - 1, 1)))


def _stretches(clock: Array, flow: Array, position: Array) -> list[_Stretch]:
    """Parts of one machine's log in the order of time."""
    usual = _usual(flow)
    is_up = flow > 0.5 * usual
    edges = np.flatnonzero(np.diff(is_up)) + 1
    runs = [(a, b) for a, b in pairwise([0, *edges, len(flow)]) if is_up[a] and b - a > 5]
    runs = [(a, b) for a, b in runs if clock[b - 1] - clock[a] > SHORTEST]
    made = []
    for a, b in runs:
        m = (a + b) // 2
        across = position[min(m + 2, b - 1)] - position[max(m - 2, a)]
        size = float(np.hypot(*across))
        if size > 0.0:
            fall, fell = _ramp(-clock[::-1], flow[::-1], len(clock) - b, len(clock) - 1 - a)
            rise, rose = _ramp(clock, flow, a, b - 1)
            made.append(_Stretch(clock[m], rise, -fall, rose, fell, across / size))
    return made


def _ramp(clock: Array, flow: Array, first: int, last: int) -> tuple[float, float]:
    """When the flow of the records first to last begins: the middle of its rise, and how long it takes [s], 0
    at once; nan = not recorded.
    """
    begun, full, more = np.searchsorted(clock, clock[first] + FILLING * np.array([-1.0, 1.0, 3.0]))
    level = float(flow[full : min(more, last)].mean()) if full < min(more, last) else 0.0
    low = np.flatnonzero(flow[begun:first] < 0.1 * level)
    if not len(low):
        return np.nan, np.nan
    part = slice(begun + low[-1], full + 1)
    if part.stop - part.start < 2:  # records that share their times
        return np.nan, np.nan
    high = np.flatnonzero(flow[part] > 0.9 * level)
    lasts = float(clock[part][high[0]] - clock[part][0]) if len(high) else np.nan
    lasts = 0.0 if flow[part][1] > FULL * level else lasts
    return float(clock[full] - np.trapezoid(flow[part], clock[part]) / level), lasts


def _smooth(value: Array, known: NDArray[np.bool_], count: int) -> Array:
    """Lines through the known values within `count` records around each, at it: their mean in the middle, not
    drawn to one side at an end.
    """
    offset = np.arange(count, dtype=float) - count // 2  # sums of whole numbers: exact, and quicker as floats
    kernels = (offset**0, -offset, offset**2)
    n, first, second = (np.convolve(known.astype(float), kernel, "same") for kernel in kernels)
    total, moment = (np.convolve(value, kernel, "same") for kernel in (offset**0, -offset))
    spread = n * second - first**2
    line = (second * total - first * moment) / np.where(spread > 0.0, spread, 1.0)
    return np.asarray(np.where(spread > 0.0, line, total / np.maximum(n, 1.0)))
