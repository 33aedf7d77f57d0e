"""One axis of time of a log: stamps, intervals, way over speed and the order of the rows, held together."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swath.core.number_text import num
from swath.documents.witness import outside
from swath.field_io.logs.columns import QUANTITIES, UNITS, Column
from swath.field_io.logs.witnesses import AT, CANDIDATES, Drive

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
MOST_RESTARTS = 20  # of a clock; with more its order says nothing
FEWEST_ROWS = 25  # from one to the next
NEAR = 3.0  # usual steps from the last place before to the first one after: the machine goes on
MOST_PARTS = 40  # of a header
LEAST_PARTS = 0.9  # of the rows of a log of parts, in groups of as many
UNEVEN = 1.5  # largest over smallest distance between parts, in their widths
STEADY = 0.3  # m by which a part keeps its place beside the others, in the middle
LEAST_AHEAD = 0.25  # of the usual step: so far ahead of each other lie records that share a coarse stamp


def counted_on(clock: Array, machine: Indices, position: Array) -> tuple[Array, list[str]]:
    """A clock in the order of the rows, counted on where it begins again, and a note.

    It begins again where it goes back to a time that it had, and the machine goes on from its place: from
    elsewhere it may be another machine. position [m], shape (n, 2), nan of rows that do not count
    """
    made, notes = clock.copy(), []
    for one in np.unique(machine):
        rows = np.flatnonzero((machine == one) & np.isfinite(clock) & np.isfinite(position).all(axis=1))
        step = np.diff(clock[rows])
        back = np.flatnonzero(step < 0.0)
        parts = np.split(rows, back + 1)
        if not 0 < len(back) <= MOST_RESTARTS or min(map(len, parts)) < FEWEST_ROWS:
            continue
        usual = float(np.median(step[step > 0.0])) if (step > 0.0).any() else 0.0
        way = np.hypot(*np.diff(position[rows], axis=0).T)
        driven = float(np.median(way[step > 0.0])) if usual else 0.0
        spans = sorted((float(clock[part].min()), float(clock[part].max())) for part in parts)
        overlaps = any(later[0] < earlier[1] for earlier, later in pairwise(spans))
        if overlaps and (way[back] <= NEAR * driven).all():
            for before, after in pairwise(parts):
                made[after] += made[before[-1]] + usual - clock[after[0]]
            notes.append(
                f"timeline: the clock begins again at {len(back)} rows, first at the {parts[1][0] + 1}th: "
                "counted on in the order of the rows"
            )
    return made, notes


def parts_of_header(moment: Array, position: Array, width: Array) -> NDArray[np.str_] | None:
    """Which part of the header each row is of where all parts have a row of one time, else None.

    moment: machine and time, shape (n, 2); position [m], shape (n, 2); width of each in any unit, shape (n,)
    Parts lie beside each other, as far apart as they are wide; rows of a coarse clock lie behind each other,
    or on one place, and machines keep no place beside each other.
    """
    counts = np.flatnonzero(np.isfinite(moment).all(axis=1) & np.isfinite(position).all(axis=1))
    _, group, size = np.unique(moment[counts], axis=0, return_inverse=True, return_counts=True)
    group = group.ravel()
    count = int(np.bincount(size).argmax()) if len(size) else 0
    whole = size[group] == count
    if not 2 <= count <= MOST_PARTS or whole.mean() < LEAST_PARTS:
        return None
    rows = counts[whole][np.argsort(group[whole], kind="stable")]
    of_group = rows[: len(rows) // count * count].reshape(-1, count)
    middle = position[of_group].mean(axis=1)
    way = np.diff(middle, axis=0)
    step = np.hypot(*way.T)
    driven = step > AT.least_step
    if driven.sum() < FEWEST_ROWS:
        return None
    forward = way[driven] / step[driven, None]
    off = (position[of_group] - middle[:, None])[:-1][driven]
    ahead = (off * forward[:, None]).sum(axis=2)
    across = off[:, :, 1] * forward[:, None, 0] - off[:, :, 0] * forward[:, None, 1]
    place = np.median(across, axis=0)
    row = np.argsort(place)
    wide = np.nanmedian(width[of_group], axis=0)[row]
    apart = np.diff(place[row]) / (0.5 * (wide[1:] + wide[:-1]))
    uneven = float(apart.max() / apart.min()) if apart.min() > 0.0 else np.inf
    is_beside = np.ptp(place) <= AT.farthest_pass and np.diff(place[row]).min() > STEADY
    wander = max(float(np.median(np.abs(v - np.median(v, axis=0)))) for v in (ahead, across))
    is_behind = np.ptp(np.median(ahead, axis=0)) > LEAST_AHEAD * float(np.median(step[driven]))
    if wander > STEADY or not is_beside or not uneven <= UNEVEN or is_behind:
        return None
    made = np.full(len(moment), "", dtype="U4")
    made[of_group] = np.arange(count).astype(str)
    return made


def one_pace(
    columns: Mapping[str, Column], raw: Mapping[str, Array], stamps: Array | None, drive: Drive
) -> tuple[str, str]:
    """Which of stamps and intervals does not count, 'time', 'duration' or '', and a note.

    stamps [s]. Two of stamps, intervals, way over speed, and intervals times the way driven over that logged,
    that agree on the time from record to record win; else those by which the machine drives as machines do.
    """
    if "duration" not in raw:
        return "", ""
    size = UNITS["time"][columns["duration"].unit]
    interval = _middle(raw["duration"][drive.after] * size)
    took = np.nan if stamps is None else _middle(stamps[drive.after] - stamps[drive.here])
    step = _middle(drive.step)
    said = {"speed": [step / v for v in _shown(columns, raw, "speed", drive)]}
    said["distance"] = [interval * step / v for v in _shown(columns, raw, "distance", drive)]
    if np.isfinite(took):
        if not outside(took / interval, _ALIKE) > 0.0:
            return "", ""
        votes = {
            key: [what for what, times in said.items() if any(outside(t / v, _ALIKE) == 0.0 for t in times)]
            for key, v in (("time", took), ("duration", interval))
        }
        speeds = {"time": outside(step / took, AT.speed), "duration": outside(step / interval, AT.speed)}
        wins = min(speeds, key=lambda key: (-len(votes[key]), speeds[key] > 0.0))
    else:
        by = [t for times in said.values() for t in times if outside(step / t, AT.speed) == 0.0]
        if not by or not outside(step / interval, AT.speed) > 0.0:
            return "", ""
        votes, wins, took = {"time": [k for k, times in said.items() if times]}, "time", by[0]
    loser = "duration" if wins == "time" else "time"
    text = f"{columns['duration'].column} says {num(interval)} s from record to record, "
    text += f"the {'times say' if stamps is not None else 'way says'} {num(took)} s"
    agree = f", and so {'do' if len(votes[wins]) > 1 else 'does'} {' and '.join(votes[wins])}" * bool(
        votes[wins]
    )
    return loser, f"timeline: {text}{agree}: {'intervals' if loser == 'duration' else 'times'} do not count"


_ALIKE = 1.0 / AT.alike, AT.alike


def _middle(values: Array) -> float:
    known = values[np.isfinite(values) & (values > 0.0)]
    return float(np.median(known)) if len(known) >= AT.fewest else np.nan


def _shown(
    columns: Mapping[str, Column], raw: Mapping[str, Array], key: str, drive: Drive
) -> Iterator[float]:
    """The middle of a quantity of the steps in SI units, in each unit that its column may have."""
    if key in raw and np.isfinite(middle := _middle(raw[key][drive.after])):
        own = columns[key]
        for unit in sum(CANDIDATES[key], ()) if own.is_assumed else (own.unit,):
            yield middle * UNITS[QUANTITIES[key]][unit]
