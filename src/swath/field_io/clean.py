"""Which records of a log say something about the crop, and why the others do not.

The order of the reasons matters: a record is counted under the first that holds.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swath.field_io.delay import Delay, estimate_delays, shifted_flow
from swath.field_io.logs.log import Log

Array = NDArray[np.float64]
STANDING_SPEED = 0.3  # m/s
SPEED_SPREAD = 2.0  # times the machine's median speed: faster is driving, not cutting
LEAST_WIDTH = 0.75  # of the machine's header: narrower is a partial swath
LEAST_FLOW = 0.1  # of the machine's median flow: below, the header is out of the crop
TURN_RADIUS = 20.0  # m: a track curved more tightly is a headland turn
TURN_REACH = 8.0  # m before and after, over which the curvature is taken
RAMP = 3.0  # s at each end of a pass while the machine fills and empties
OUTLIER_SIGMA = 5.0  # robust standard deviations
LOCAL_RECORDS = 21  # of the running median a record is held against
STRIP_RECORDS = 41  # of the running median that shows a strip narrower than the header
STRIP_SHARE = 0.6  # of the yield of the passes beside it: less means that the header was not full
STRIP_REACH = 1.6  # header widths to the passes beside
MOSTLY = 0.5  # of the records of a stretch with a working header: it is in the crop in all of it
# estimated: stretches of a log that pauses out of work, and most of its records in turns
SEVERAL, FEW_TURNS = 4, 0.01
BACKWARD = 0.7  # cosine of what two courses that are opposite to each other differ by at most from 180 deg
LONGEST_HOLE = 5  # records without crop that do not end a pass
SHORTEST_PASS = 30.0  # m

REASONS = (
    "outside_boundary", "standing", "speed_out_of_range", "header_up", "partial_width", "headland_turn",
    "flow_not_arrived", "not_harvesting", "pass_start", "pass_end", "no_pass",
    "narrow_strip", "yield_outlier",
)  # fmt: skip


@dataclass(frozen=True)
class Cleaned:
    """A log with the verdict on each record, shape (n,).

    cutting: header in the crop, in turns too
    reason: index into REASONS, -1 = kept
    flow: delay removed [kg/s], nan = unknown
    grain: yield as harvested [kg/m2], nan = unknown
    pass_id: -1 = not in a pass, else 0.. in driven order
    course: of travel, counter-clockwise from east [rad]
    distance: along the track from its start [m]
    """

    log: Log
    cutting: NDArray[np.bool_]
    delays: tuple[Delay, ...]
    reason: NDArray[np.int64]
    flow: Array
    grain: Array
    pass_id: NDArray[np.int64]
    course: Array
    distance: Array

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Shape (n,): the record counts."""
        return np.asarray(self.reason < 0)

    @property
    def driven(self) -> NDArray[np.bool_]:
        """Shape (n,): the record is of a pass, with the header at work, whether it counts or not."""
        beside = [
            REASONS.index(name) for name in ("outside_boundary", "standing", "header_up", "headland_turn")
        ]
        return self.kept | (self.log.working & ~np.isin(self.reason, beside))

    @property
    def counts(self) -> dict[str, int]:
        """Reason -> records removed, every reason named."""
        return {name: int((self.reason == i).sum()) for i, name in enumerate(REASONS)}


def clean(log: Log, delay_s: float | None = None, inside: NDArray[np.bool_] | None = None) -> Cleaned:
    """Judge every record.

    delay_s: of the flow for all machines [s]; None = estimate it per machine. inside: records within the
    boundary, shape (n,), None = all.
    """
    if delay_s is None:
        delays = estimate_delays(log)
    else:
        delays = [Delay(name, delay_s, "given", float("nan"), 0) for name in log.machine_names]
    flow = np.where(log.working, shifted_flow(log, delays), 0.0)
    course, curvature, distance = geometry(log)
    header = _per_machine(log, log.width, lambda v: float(np.percentile(v, 95)))
    usual_speed = _per_machine(log, np.where(log.speed > 0.5, log.speed, np.nan), _median)
    full = np.where(log.working & (log.flow > 0.2), log.flow, np.nan)
    usual_flow = _per_machine(log, full, _median)
    area_rate = log.speed * log.width
    grain = np.where(area_rate > 0.1, flow / np.where(area_rate > 0.1, area_rate, 1.0), np.nan)

    standing = log.speed < STANDING_SPEED
    turn = np.abs(curvature) * TURN_RADIUS > 1.0
    empty = ~(flow >= LEAST_FLOW * usual_flow)
    pass_id = find_passes(log, ~standing & ~turn & ~empty & (log.width > 0.0), distance, course)
    from_start, to_end = _time_in_pass(log, pass_id)
    tests = {
        "outside_boundary": np.zeros(len(log), dtype=bool) if inside is None else ~inside,
        "standing": standing,
        "speed_out_of_range": log.speed > SPEED_SPREAD * usual_speed,
        "header_up": log.width <= 0.0,
        "partial_width": log.width < LEAST_WIDTH * header,
        "headland_turn": turn,
        "flow_not_arrived": ~np.isfinite(flow),
        "not_harvesting": empty,
        "pass_start": from_start < RAMP,
        "pass_end": to_end < RAMP,
        "no_pass": pass_id < 0,
    }
    reason = np.full(len(log), -1, dtype=np.int64)
    for name, failed in tests.items():
        reason[(reason < 0) & failed] = REASONS.index(name)
    narrow = _narrow_strips(log, grain, pass_id, np.flatnonzero(reason < 0))
    reason[narrow] = REASONS.index("narrow_strip")
    reason[_outliers(log, grain, reason < 0)] = REASONS.index("yield_outlier")
    is_cut_off = np.array([d.is_cut_off for d in delays])[log.machine] & (log.flow >= LEAST_FLOW * usual_flow)
    cutting = ~standing & (_in_crop(log, empty, turn, course) | is_cut_off) & (log.width > 0.0) & log.working
    return Cleaned(log, cutting, tuple(delays), reason, flow, grain, pass_id, course, distance)


def _in_crop(log: Log, empty: NDArray[np.bool_], turn: NDArray[np.bool_], course: Array) -> NDArray[np.bool_]:
    """Whether the header is in the crop, shape (n,).

    Where the log says that it works, in the whole of a stretch of which most records have grain. A log of
    many stretches and no turns says it by its pauses: it holds what was recorded with a lowered header, as
    most monitors do. Of a machine that does not say it, where there is grain, but for turns from a pass to
    the one beside it, over which the last flow may be held.
    """
    several = np.bincount(log.machine[log.gap], minlength=len(log.machine_names)) >= SEVERAL
    turns = np.bincount(log.machine, turn) / np.maximum(np.bincount(log.machine), 1)
    pauses = np.flatnonzero(several & (turns < FEW_TURNS))
    says = np.isin(log.machine, [*np.unique(log.machine[~log.working]), *pauses])
    stretch = np.cumsum(log.gap | np.r_[True, np.diff(log.working)])
    share = np.bincount(stretch, ~empty) / np.maximum(np.bincount(stretch), 1)
    grain = ~empty & ~_turned_back(log, turn, course)
    return np.where(says & (share[stretch] > MOSTLY), log.working, grain)


def _turned_back(log: Log, turn: NDArray[np.bool_], course: Array) -> NDArray[np.bool_]:
    """Records of turns after which the machine drives the other way, shape (n,)."""
    found = np.zeros(len(log), dtype=bool)
    edge = np.flatnonzero(np.diff(np.r_[False, turn, False]) | np.r_[log.gap, True])
    runs = [(int(a), int(b)) for a, b in pairwise(edge) if turn[a]]
    joined: list[tuple[int, int]] = []
    for a, b in runs:
        if joined and a - joined[-1][1] <= LONGEST_HOLE and not log.gap[joined[-1][1] : a + 1].any():
            joined[-1] = joined[-1][0], b
        else:
            joined.append((a, b))
    for a, b in joined:
        before, after = course[max(a - 1, 0)], course[min(b, len(log) - 1)]
        found[a:b] = np.cos(after - before) < -BACKWARD
    return found


def clean_map(log: Log, inside: NDArray[np.bool_] | None = None) -> Cleaned:
    """Judge records whose order says nothing: by their own yield alone. All of them are one pass."""
    count, zeros = len(log), np.zeros(len(log))
    area_rate = log.speed * log.width
    flow = np.where(log.working, log.flow, 0.0)
    grain = np.where(area_rate > 0.0, flow / np.where(area_rate > 0.0, area_rate, 1.0), np.nan)
    known = grain[grain > 0.0]
    usual = float(np.median(np.log(known))) if len(known) else 0.0
    sigma = 1.4826 * float(np.median(np.abs(np.log(known) - usual))) if len(known) else 0.0
    away = np.abs(np.log(np.where(grain > 0.0, grain, 1.0)) - usual)
    tests = {
        "outside_boundary": zeros > 0.0 if inside is None else ~inside,
        "header_up": log.width <= 0.0,
        "partial_width": log.width < LEAST_WIDTH * float(np.percentile(log.width, 95)),
        "not_harvesting": ~(grain > 0.0),
        "yield_outlier": away > OUTLIER_SIGMA * max(sigma, 0.01),
    }
    reason = np.full(count, -1, dtype=np.int64)
    for name, failed in tests.items():
        reason[(reason < 0) & failed] = REASONS.index(name)
    delays = tuple(Delay(name, 0.0, "none: a map", float("nan"), 0) for name in log.machine_names)
    kept = reason < 0
    return Cleaned(log, kept, delays, reason, flow, grain, np.where(kept, 0, -1), zeros, zeros)


def geometry(log: Log) -> tuple[Array, Array, Array]:
    """Course [rad], curvature [1/m] and distance along the track [m] of each record, shape (n,).

    Course is the chord over half TURN_REACH before and after, so noise of centimetres does not matter.
    """
    course, curvature, distance = np.zeros(len(log)), np.zeros(len(log)), np.zeros(len(log))
    start, position = np.flatnonzero(log.gap), log.position
    for a, b in zip(start, np.r_[start[1:], len(log)], strict=True):
        p = position[a:b]
        s = np.r_[0.0, np.cumsum(np.hypot(*np.diff(p, axis=0).T))]
        distance[a:b] = s
        if s[-1] < 1.0:
            continue
        course[a:b] = _chord(p, s, s, 0.5 * TURN_REACH)
        before = _chord(p, s, s - 0.5 * TURN_REACH, 0.5 * TURN_REACH)
        after = _chord(p, s, s + 0.5 * TURN_REACH, 0.5 * TURN_REACH)
        turn = np.angle(np.exp(1j * (after - before)))
        span = np.minimum(s + 0.5 * TURN_REACH, s[-1]) - np.maximum(s - 0.5 * TURN_REACH, 0.0)
        curvature[a:b] = turn / np.maximum(span, 2.0)
    return course, curvature, distance


def _chord(p: Array, s: Array, at: Array, reach: float) -> Array:
    """Direction [rad] from reach before to reach after the distances `at`, on a track p at distances s."""
    ahead, behind = np.minimum(at + reach, s[-1]), np.maximum(at - reach, 0.0)
    ahead, behind = np.maximum(ahead, behind + 0.01), np.minimum(behind, s[-1] - 0.01)
    dx = np.interp(ahead, s, p[:, 0]) - np.interp(behind, s, p[:, 0])
    dy = np.interp(ahead, s, p[:, 1]) - np.interp(behind, s, p[:, 1])
    angle: Array = np.arctan2(dy, dx)
    return angle


def find_passes(log: Log, cutting: NDArray[np.bool_], distance: Array, course: Array) -> NDArray[np.int64]:
    """Number of the pass of each record in driven order (by start time), -1 = none; shape (n,).

    A pass is a stretch of cutting records; up to LONGEST_HOLE others inside do not end it, turning back does.
    """
    block = np.cumsum(log.gap)
    index = np.flatnonzero(cutting)
    pass_id = np.full(len(log), -1, dtype=np.int64)
    if not len(index):
        return pass_id
    ends = (np.diff(index) > LONGEST_HOLE) | (np.diff(block[index]) != 0)
    ends |= np.cos(np.diff(course[index])) < 0.0
    pieces = np.split(index, np.flatnonzero(ends) + 1)
    pieces = [p for p in pieces if distance[p[-1]] - distance[p[0]] >= SHORTEST_PASS]
    pieces.sort(key=lambda p: (log.time[p[0]], log.machine[p[0]]))
    for number, piece in enumerate(pieces):
        pass_id[piece[0] : piece[-1] + 1] = number
    return pass_id


def _time_in_pass(log: Log, pass_id: NDArray[np.int64]) -> tuple[Array, Array]:
    """Time since the start and until the end of the pass [s]; inf outside passes."""
    since, until = np.full(len(log), np.inf), np.full(len(log), np.inf)
    inside = np.flatnonzero(pass_id >= 0)
    if len(inside):
        count = int(pass_id.max()) + 1
        first, last = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(first, pass_id[inside], log.time[inside])
        np.maximum.at(last, pass_id[inside], log.time[inside])
        since[inside] = log.time[inside] - first[pass_id[inside]]
        until[inside] = last[pass_id[inside]] - log.time[inside]
    return since, until


def _narrow_strips(
    log: Log, grain: Array, pass_id: NDArray[np.int64], index: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Those of the records `index` that lie on a strip that yields far less than the passes beside it.

    The last strip of a land is seldom as wide as the header, but the monitor takes the full width: over a
    running median of STRIP_RECORDS such a pass lies below STRIP_SHARE of both what lies beside.
    """
    from scipy.spatial import cKDTree

    if len(index) < 2 * STRIP_RECORDS:
        return index[:0]
    usual = _running_median(grain[index], STRIP_RECORDS)
    count = min(48, len(index))
    reach = STRIP_REACH * float(np.median(log.width[index]))
    position = log.position[index]
    distance, near = cKDTree(position).query(position, k=count, distance_upper_bound=reach)
    near = np.where(np.isfinite(distance), near, 0)
    other = np.isfinite(distance) & (pass_id[index][near] != pass_id[index][:, None])
    number = other.sum(axis=1)
    beside = np.where(other, usual[near], np.inf)
    beside.sort(axis=1)
    middle = beside[np.arange(len(index)), np.maximum(number // 2, 0).clip(max=count - 1)]
    narrow: NDArray[np.bool_] = (number >= 5) & (usual < STRIP_SHARE * np.where(number >= 5, middle, 0.0))
    return np.asarray(index[narrow])


def _running_median(values: Array, count: int) -> Array:
    half = count // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, half, mode="edge"), count)
    return np.asarray(np.median(windows, axis=1))


def _outliers(log: Log, grain: Array, candidate: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Records far from the field's median yield, or (log yield) from the running median of their track."""
    bad = np.zeros(len(log), dtype=bool)
    index = np.flatnonzero(candidate & (grain > 0.0))
    if len(index) < LOCAL_RECORDS:
        return bad
    value = np.log(grain[index])
    for deviation in (grain[index] - np.median(grain[index]), value - _running_median(value, LOCAL_RECORDS)):
        sigma = 1.4826 * float(np.median(np.abs(deviation)))
        bad[index[np.abs(deviation) > OUTLIER_SIGMA * max(sigma, 0.01)]] = True
    return bad


def _median(values: Array) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else 0.0


def _per_machine(log: Log, values: Array, summary: Callable[[Array], float]) -> Array:
    """A number of each machine, spread to its records."""
    result = np.zeros(len(log))
    for machine in range(len(log.machine_names)):
        own = log.machine == machine
        if own.any():
            result[own] = summary(values[own])
    return result
