"""The parts of a log: a log may hold several harvests or fields, which are separated before it is judged.

Rows that are there twice count once; sections side by side are one header. A log with two harvests of one
ground, or with two fields, is refused unless one part is asked for.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.field_io.logs.log import Log

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
PAUSE = 6 * 3600.0  # s: a longer one, or a clock that goes back so far, begins another part
MOST_BLOCKS = 50  # between such pauses in the order of the rows; with more that order says nothing
APART = 200.0  # m between two fields; less is a road, a creek, trees
LEAST_PART = 0.1  # of the ground of the largest: with less it is no field or harvest of its own
SAME_GROUND = 0.5  # of a part, covered before: it is a second harvest


def one_part(log: Log, chosen: int | None, path: Path) -> Log:
    """The part of a log that is meant. Raises InputError where it has several and none is chosen."""
    cutting = (log.flow > 0.0) & (log.width > 0.0) & log.working
    width = float(np.median(log.width[cutting])) if cutting.any() else 1.0
    cell = _ground(log.position, width)
    harvest, field = _harvests(log, cell, cutting), _fields(log.position, cutting)
    part = np.unique(harvest * (field.max() + 1) + field, return_inverse=True)[1].ravel()
    sizes = np.array([len(np.unique(cell[part == k])) for k in range(part.max() + 1)])
    large = [int(k) for k in np.argsort(-sizes, kind="stable") if sizes[k] >= LEAST_PART * sizes.max()]
    if len(large) < 2 or len(sizes) < 2:
        return log
    if chosen is not None:
        if not 1 <= chosen <= len(large):
            raise InputError("part", chosen, f"expected 1 to {len(large)}", file=path)
        return log.keep(part == large[chosen - 1])
    shown = []
    for number, k in enumerate(large[:4], start=1):
        own = log.keep(part == k)
        grown = own.flow[own.flow > 0.0] / np.maximum(own.width * own.speed, 0.5)[own.flow > 0.0]
        since = float(own.time.min()) / 86400.0
        shown.append(
            f"{number}: {num(len(own))} records, {num(10 * np.median(grown))} t/ha, from day {num(since)} on"
        )
    kind = "harvests of one ground" if len(np.unique(harvest[np.isin(part, large)])) > 1 else "fields"
    raise InputError(
        "mixed", f"{len(large)} {kind} ({'; '.join(shown)})", "expected one; --part N takes one", file=path
    )


def _ground(position: Array, width: float) -> Indices:
    """Cells under the header of each record, (n, 9): three by three, each a quarter of the width wide.

    They cover three quarters of the width, so that passes beside each other share no cell, and a pass between
    two of them shares most of its cells with them.
    """
    own = np.floor(position / (0.25 * width)).astype(np.int64)
    own -= own.min(axis=0) - 1
    x, y = (own[:, axis, None] + beside.ravel() for axis, beside in enumerate(np.mgrid[-1:2, -1:2]))
    return np.asarray(x * (int(y.max()) + 1) + y)


def _harvests(log: Log, cell: Indices, cutting: NDArray[np.bool_]) -> Indices:
    """Number of the harvest of each record, shape (n,): a part that cuts ground again is another."""
    for order in (np.argsort(log.row_number, kind="stable"), np.lexsort((log.time, log.machine))):
        far = (np.abs(np.diff(log.time[order])) > PAUSE) & (np.diff(log.machine[order]) == 0)
        if far.sum() < MOST_BLOCKS:
            break
    number = np.zeros(len(log), dtype=np.int64)
    harvests: list[set[int]] = [set()]
    for own in np.split(order, np.flatnonzero(far) + 1):
        ground = set(cell[own[cutting[own]]].ravel().tolist())
        shared = [len(held & ground) <= SAME_GROUND * len(ground) for held in harvests]
        at = shared.index(True) if True in shared else len(harvests)
        harvests[at:] = harvests[at:] or [set()]
        harvests[at] |= ground
        number[own] = at
    return number


def _fields(position: Array, cutting: NDArray[np.bool_]) -> Indices:
    """Number of the field of each record, shape (n,): of the nearest that is cut."""
    from scipy.ndimage import distance_transform_edt, label

    cell = np.floor(position / (0.5 * APART)).astype(np.int64)
    cell -= cell.min(axis=0)
    is_cut = np.zeros(cell.max(axis=0) + 1, dtype=bool)
    is_cut[tuple(cell[cutting].T)] = True
    if not is_cut.any():
        return np.zeros(len(cell), dtype=np.int64)
    nearest = distance_transform_edt(~is_cut, return_distances=False, return_indices=True)
    return np.asarray(label(is_cut, np.ones((3, 3)))[0][tuple(nearest)][tuple(cell.T)], dtype=np.int64)
