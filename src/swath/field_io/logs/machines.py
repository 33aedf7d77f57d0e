"""Telling machines apart in a log that interleaves their records without saying which is which."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TOP_SPEED = 5.0  # m/s, of a combine between two records
SLACK = 6.0  # m
LONGEST_HOLD = 20.0  # s a machine out of sight may have driven on
FORGET = 60.0  # s after which a track is closed
FEWEST = 200  # records of a machine of its own
ALTERNATING = 0.3  # of the records of a machine while it works that lie between two of another one


def separate_machines(time: Array, east: Array, north: Array) -> NDArray[np.int64]:
    """Index of the machine of each record, shape (n,), in the order of the input; 0 is the one seen most.

    time [s], east, north [m], shape (n,). Records join the track whose head they can have come from, the
    nearest first; tracks that overlap in time belong to different machines, the others are chained to the
    machine that stopped nearest. A machine with under 200 records is folded into the first, and so is one
    whose records do not alternate with those of another: one receiver jumps, two machines log side by side.
    """
    order = np.argsort(time, kind="stable")
    track = _tracks(time[order], east[order], north[order])
    first = np.flatnonzero(np.r_[True, np.diff(np.sort(track)) != 0])
    by_track = np.argsort(track, kind="stable")
    members = np.split(by_track, first[1:])
    sorted_time, sorted_position = time[order], np.stack([east[order], north[order]], axis=1)
    owner = _chain(members, sorted_time, sorted_position)
    owner = np.where(_alternating(owner)[owner], owner, np.bincount(owner).argmax())
    counts = np.bincount(owner)
    rank = np.argsort(-counts, kind="stable")
    renamed = np.zeros(len(counts), dtype=np.int64)
    big = [k for k in rank if counts[k] >= FEWEST] or [rank[0]]
    for i, k in enumerate(big):
        renamed[k] = i
    machine = np.empty(len(time), dtype=np.int64)
    machine[order] = renamed[owner]
    return machine


def _tracks(time: Array, east: Array, north: Array) -> NDArray[np.int64]:
    """Track number of each record of a sorted log."""
    track = np.empty(len(time), dtype=np.int64)
    heads: list[list[float]] = []  # time, east, north, track number
    count = 0
    for i, (t, x, y) in enumerate(zip(time.tolist(), east.tolist(), north.tolist(), strict=True)):
        best, best_distance = None, np.inf
        for head in heads:
            distance = ((x - head[1]) ** 2 + (y - head[2]) ** 2) ** 0.5
            reach = TOP_SPEED * min(max(t - head[0], 1.0), LONGEST_HOLD) + SLACK
            if distance <= reach and distance < best_distance:
                best, best_distance = head, distance
        if best is None:
            heads = [head for head in heads if t - head[0] <= FORGET]
            best = [t, x, y, count]
            heads.append(best)
            count += 1
        best[:3] = t, x, y
        track[i] = int(best[3])
    return track


def _chain(members: list[NDArray[np.int64]], time: Array, position: Array) -> NDArray[np.int64]:
    """Machine of each record: tracks strung together in time, large ones first where they compete.

    A machine can take a track while which it has next to no records of its own.
    """
    owner = np.full(len(time), -1, dtype=np.int64)
    machines: list[list[NDArray[np.int64]]] = []
    for records in sorted(members, key=lambda r: -len(r)):
        inside = owner[records[0] : records[-1] + 1]
        busy = np.bincount(inside[inside >= 0], minlength=len(machines))
        free = np.flatnonzero(busy <= 3 + 0.05 * len(records)).tolist()
        if not free and (len(records) < FEWEST and machines):
            free = [int(np.argmin(busy))]
        if not free:
            machines.append([])
            free = [len(machines) - 1]
        chosen = min(free, key=lambda m: _distance(machines[m], records, time, position))
        machines[chosen].append(records)
        owner[records] = chosen
    return owner


def _alternating(owner: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which machines have records that mostly lie between those of others, of records in time."""
    between = np.r_[False, (owner[1:-1] != owner[:-2]) & (owner[1:-1] != owner[2:]), False]
    alone = np.bincount(owner, between, minlength=owner.max() + 1)
    return np.asarray(alone > ALTERNATING * np.bincount(owner))


def _distance(
    pieces: list[NDArray[np.int64]], records: NDArray[np.int64], time: Array, position: Array
) -> float:
    """How far a machine stood from a track when it was seen nearest in time, inf = never."""
    pairs = [(p[-1], records[0]) if time[p[-1]] <= time[records[0]] else (records[-1], p[0]) for p in pieces]
    if not pairs:
        return np.inf
    a, b = min(pairs, key=lambda pair: abs(time[pair[1]] - time[pair[0]]))
    return float(np.hypot(*(position[b] - position[a])))
