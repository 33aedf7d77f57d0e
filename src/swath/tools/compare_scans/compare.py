"""What differs between two clouds of a crop, cell by cell across the edge, and how much of it is noise.

A cell is a strip along the path; blocks cut it into lengths. Heights are compared by the Wasserstein-1 and
the Kolmogorov-Smirnov distance. Two kinds of spread stand beside the differences, both over blocks, as echoes
next to each other are alike:

- of a distance its noise: 95 % of the values that come of it when in each block A and B are exchanged by the
  toss of a coin. Both are then alike, so only what lies above is a difference.
- of a difference its interval of 95 %, by the bootstrap: blocks drawn with replacement.

Both clouds are brought into one frame: along a path and to its left, by the poses, by each one's own path,
or by ICP.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import acos, ceil, degrees, floor, isfinite, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swath.core.errors import Extra, InputError, check_within
from swath.core.number_text import num, signed
from swath.core.random import Stream
from swath.signals import F64
from swath.tools.compare_scans.clouds import LOWEST_M, Cloud, axis_track
from swath.tools.distributions import GROUND_BELOW, ks_distance, wasserstein1
from swath.tools.height_map.poses import PoseTrack

TURN_MAX = 0.6 * pi  # of a path, away from its first heading: more is a headland [rad]
STEP_M, SMOOTH_M = 0.5, 2.0  # of a path: between its points; standard deviation of the weights along it
MOVED_M = 0.2  # between points of a path: above the noise of RTK at rest, chosen
COARSE = 8  # steps between the points among which the nearest is looked for
AT_ONCE = 1 << 16  # points that are placed together, to save memory
ICP_POINTS, ICP_STEPS = 20_000, 60  # points that ICP lays on the others; its iterations at most
ICP_REST_M = 0.3  # RMS from the nearest points above which it found another place, chosen
ICP_MOVED_M, ICP_TURNED_DEG = 5.0, 5.0  # poses are not so wrong: another place was found


@dataclass(frozen=True)
class Place:
    """Where echoes lie: s along the path from its start, d to its left, both (n,) [m]."""

    s: F64
    d: F64


class Path:
    """A path, smoothed, straight on beyond its ends."""

    def __init__(self, track: PoseTrack, name: str) -> None:
        flat = _moved(track.position[:, :2])
        distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(flat, axis=0).T))])
        self.length = float(distance[-1])
        if self.length < 2.0 * STEP_M:
            raise InputError("poses", name, f"expected a path, it is {num(self.length)} m long")
        self.s = np.linspace(0.0, self.length, round(self.length / STEP_M) + 1)
        raw = np.stack([np.interp(self.s, distance, flat[:, k]) for k in (0, 1)], axis=1)
        self.xy = _smooth(raw)
        step = np.gradient(self.xy, axis=0)
        self.heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        turned = float(np.abs(self.heading - self.heading[0]).max())
        if turned > TURN_MAX:
            expected = f"expected one pass, its path turns by {num(degrees(turned))} deg: cut the recording"
            raise InputError("poses", name, expected)

    def at(self, s: F64) -> tuple[F64, F64]:
        """Points (n, 2) and headings (n,) [rad]."""
        heading = np.interp(s, self.s, self.heading)
        inside = np.clip(s, self.s[0], self.s[-1])
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        place = np.stack([np.interp(inside, self.s, self.xy[:, k]) for k in (0, 1)], axis=1)
        return place + (s - inside)[:, None] * ahead, heading

    def place(self, points: F64) -> Place:
        """Places of world points (n, >=2) along and across the edge."""
        parts = [self._some(points[i : i + AT_ONCE, :2]) for i in range(0, len(points), AT_ONCE)]
        s, d = (np.concatenate(p) for p in zip(*parts, strict=True))
        return Place(s, d)

    def _some(self, xy: F64) -> tuple[F64, F64]:
        coarse = self.xy[::COARSE]
        far = (xy[:, :1] - coarse[:, 0]) ** 2 + (xy[:, 1:] - coarse[:, 1]) ** 2
        s = self.s[::COARSE][far.argmin(axis=1)]
        d = np.zeros(len(s))
        for _ in range(8):  # along the tangent to the foot of the perpendicular
            foot, heading = self.at(s)
            dx, dy = (xy - foot).T
            d = np.cos(heading) * dy - np.sin(heading) * dx
            s = s + np.cos(heading) * dx + np.sin(heading) * dy
        return s, d


def _moved(xy: F64) -> F64:
    """The points that lie MOVED_M from the last one of them: noise at rest is no way."""
    kept = [0]
    for number, (x, y) in enumerate(xy):
        if (x - xy[kept[-1], 0]) ** 2 + (y - xy[kept[-1], 1]) ** 2 >= MOVED_M**2:
            kept.append(number)
    return np.asarray(xy[kept])


def _smooth(xy: F64) -> F64:
    """Gaussian along the path; mirrored in its ends, which so stay where they are."""
    reach = round(3.0 * SMOOTH_M / STEP_M)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) * STEP_M / SMOOTH_M) ** 2)
    padded = np.pad(xy, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    columns = [np.convolve(padded[:, k], weight / weight.sum(), "valid") for k in (0, 1)]
    return np.stack(columns, axis=1)


def aligned(a: Cloud, b: Cloud, how: str, notes: list[str]) -> tuple[Place, Place]:
    """The places of both clouds along one path, that of A where it has one.

    InputError where they cannot be laid over each other; `notes` gets what was taken for granted.
    """
    if how == "path":
        for cloud in (a, b):
            if cloud.track is None:
                raise InputError("--align", how, f"expected poses in both, {cloud.name} has none")
        one, other = (Path(c.track, c.name).place(c.points) for c in (a, b) if c.track is not None)
        return one, other
    whose = a if a.track is not None or b.track is None else b
    track = whose.track
    if track is None:
        track = axis_track(a.points)
        yaw = degrees(track.angle[0, 2])
        notes.append(f"neither has a path: along is the longer axis of {a.name}, {num(yaw)} deg from east")
    path = Path(track, whose.name)
    _check_overlap(a, b)
    if how == "icp":
        b = replace(b, points=_by_icp(a, b, notes))
    return path.place(a.points), path.place(b.points)


def _check_overlap(a: Cloud, b: Cloud) -> None:
    ends = [np.percentile(c.points[:, :2], [1.0, 99.0], axis=0) for c in (a, b)]
    low, high = np.maximum(ends[0][0], ends[1][0]), np.minimum(ends[0][1], ends[1][1])
    if (high - low > 0.0).all():
        return
    where = [f"x {num(e[0][0])} to {num(e[1][0])}, y {num(e[0][1])} to {num(e[1][1])}" for e in ends]
    expected = (
        f"expected one place: {a.name} lies at {where[0]} m, {b.name} at {where[1]} m; --align path lays "
        "them over each other by their own paths, --field says where local metres begin"
    )
    raise InputError("--align", "pose", expected)


def _by_icp(a: Cloud, b: Cloud, notes: list[str]) -> F64:
    """Points of B moved onto those of A. InputError where the shift or turn found is not plausible."""
    with Extra("mesh", "--align icp"):
        import scipy.spatial  # noqa: F401  that trimesh looks neighbours up with
        from trimesh.registration import icp
    middle = a.points.mean(axis=0)
    low, high = np.percentile(a.points, [0.5, 99.5], axis=0)
    inside = ((b.points >= low - 1.0) & (b.points <= high + 1.0)).all(axis=1)
    some = _sample(b.points[inside] - middle, 1)
    if not len(some):
        raise InputError("--align", "icp", "expected two clouds of one place: they have no point in common")
    among = _sample(a.points - middle, 0, 5 * ICP_POINTS)
    matrix, _, rms = icp(some, among, max_iterations=ICP_STEPS, reflection=False, scale=False)
    moved = np.asarray(matrix[:3, 3] + matrix[:3, :3] @ some.mean(axis=0) - some.mean(axis=0))
    turned = degrees(acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(matrix[:3, :3])) - 1.0)))))
    rms = float(np.sqrt(rms))
    text = (
        f"ICP moves {b.name} by {num(moved[0])}, {num(moved[1])}, {num(moved[2])} m and turns it "
        f"by {num(turned)} deg; its points then lie {num(rms)} m (RMS) from the nearest of {a.name}"
    )
    if np.linalg.norm(moved) > ICP_MOVED_M or turned > ICP_TURNED_DEG or rms > ICP_REST_M:
        raise InputError("--align", "icp", f"expected two clouds of one place: {text}")
    notes.append(text)
    return np.asarray((b.points - middle) @ matrix[:3, :3].T + matrix[:3, 3] + middle)


def _sample(points: F64, number: int, most: int = ICP_POINTS) -> F64:
    if len(points) <= most:
        return points
    rng = Stream(1, "compare scans icp").at(number)
    return np.asarray(points[np.sort(rng.choice(len(points), most, replace=False))])


# Where no source is named: chosen, so that a cell or a spread has echoes enough to be reported from.
FEWEST = 30  # echoes of each cloud in a cell that is compared
IN_BLOCK, ON_MAP = 3, 12  # echoes of each in a block of it that counts; that is drawn
FEWEST_BLOCKS = 6  # with a cell in both, for a spread
DRAWS = 400  # of blocks, for a spread: 10 of them lie beyond each end of 95 %
BIN_M = 0.01  # [m] of the histograms that spreads come from, and of KS
TOP = 95.0  # percent of the heights that lie below what counts as the top
SHIFT_MAX_M, SHIFT_GAIN = 1.5, 0.6  # across; told where it leaves less than this share of what differs
FEET = 0.3048  # [m], international yard and pound agreement of 1959
NEAR = 0.04  # relative: two clouds whose tops differ by the factor of feet may be in feet
BINS_MAX = 4000  # of a histogram: 40 m of heights

DIFFERENCES = ("mean_m", "top_m", "ground_share", "penetration_m", "returns_per_m2", "intensity")
DISTANCES = ("w1_m", "ks", "intensity_w1")


@dataclass(frozen=True)
class Grid:
    """cell_m: width of a cell across; block_m: length of a block along."""

    cell_m: float = 0.25
    block_m: float = 2.0

    def __post_init__(self) -> None:
        """InputError for a value that cannot be used."""
        for key, low, high in (("cell_m", 0.02, 10.0), ("block_m", 0.2, 100.0)):
            check_within("--" + key.replace("_", "-"), getattr(self, key), low, high)


@dataclass(frozen=True)
class Number:
    """A quantity of both, as means over the cells in which both have it.

    spread: interval of b - a, or (noise,) of a distance; () where there are too few blocks
    """

    name: str
    a: float
    b: float
    difference: float
    spread: tuple[float, ...]


@dataclass(frozen=True)
class Comparison:
    """Two clouds compared.

    names: of A and B
    numbers: over all cells that were compared
    cells: a row of numbers for each of them
    blocks: where along the path each block begins [m]
    map_w1, map_mean: of each cell and block (cells, blocks) [m], nan = too few echoes
    heights: all heights in the compared cells, of A and of B [m]
    """

    names: tuple[str, str]
    grid: Grid
    align: str
    numbers: list[Number]
    cells: list[dict[str, Any]]
    blocks: F64
    map_w1: F64
    map_mean: F64
    heights: tuple[F64, F64]
    facts: dict[str, tuple[Any, Any]]
    notes: list[str]

    def number(self, name: str) -> Number:
        """The number of a name."""
        return next(n for n in self.numbers if n.name == name)

    def to_dict(self) -> dict[str, Any]:
        """All but the series."""
        numbers: dict[str, dict[str, Any]] = {}
        for n in self.numbers:
            if n.name in DISTANCES:
                entry: dict[str, Any] = {"value": n.difference}
                spread: dict[str, Any] = {"noise_95": n.spread[0]} if n.spread else {}
            else:
                entry = {"a": n.a, "b": n.b, "difference": n.difference}
                spread = {"interval_95": list(n.spread)} if n.spread else {}
            numbers[n.name] = {**entry, **spread}
        return {
            "a": self.names[0],
            "b": self.names[1],
            "align": self.align,
            "cell_m": self.grid.cell_m,
            "block_m": self.grid.block_m,
            "numbers": numbers,
            "facts": {name: list(pair) for name, pair in self.facts.items()},
            "cells": self.cells,
            "notes": self.notes,
        }


@dataclass(frozen=True)
class _Binned:
    """A cloud in the cells. cell, block: numbers (n,); height [m]; bright: intensity, nan = unknown."""

    cell: Any
    block: Any
    height: F64
    bright: F64


def compare_clouds(
    a: Cloud,
    b: Cloud,
    *,
    grid: Grid = Grid(),
    align: str = "pose",
    white: tuple[float, float] | None = None,
    seed: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> Comparison:
    """Compare A with B. white: intensity of a white target in each, None = as the files say or show.

    InputError where they cannot be laid over each other, or have nothing in common.
    """
    notes = [f"{c.name}: {note}" for c in (a, b) for note in c.notes]
    places = aligned(a, b, align, notes)
    bright = _brightness(a, b, white, notes)
    low, count, first, blocks = _extent(places, grid)
    binned = []
    for cloud, place, light in zip((a, b), places, bright, strict=True):
        cell = np.floor(place.d / grid.cell_m).astype(np.int64) - low
        block = np.floor(place.s / grid.block_m).astype(np.int64) - first
        keep = (cell >= 0) & (cell < count) & (block >= 0) & (block < blocks) & (cloud.height > LOWEST_M)
        binned.append(_Binned(cell[keep], block[keep], cloud.height[keep], light[keep]))
    here, map_w1, map_mean = _compared(binned, count, blocks)
    if not here.any():
        where = [
            f"{num(f(p.d))} m to the left and {num(f(p.s))} m along" for p in places for f in (np.min, np.max)
        ]
        expected = (
            f"expected cells with {FEWEST} echoes of both, there is none: {a.name} lies {where[0]} to "
            f"{where[1]} of the path, {b.name} {where[2]} to {where[3]}"
        )
        raise InputError("--align", align, expected)
    binned = [_only(part, here) for part in binned]
    numbers, rows = _numbers(binned, here, grid, low, seed, progress)
    _tell_shift(binned, grid, notes)
    _tell_scale(rows, notes)
    low_high = [np.percentile(c.height, [1.0, 99.0]) for c in (a, b)]
    ends = [f"{num(lowest)} to {num(highest)}" for lowest, highest in low_high]
    facts: dict[str, tuple[Any, Any]] = {
        "echoes": (len(a), len(b)),
        "echoes in compared cells": (len(binned[0].height), len(binned[1].height)),
        "scans": (a.scan_count or None, b.scan_count or None),
        "beams without echo": (_silent(a), _silent(b)),
        "beams without crop return": (_no_crop(a, binned[0]), _no_crop(b, binned[1])),
        "98 % of the heights [m]": (ends[0], ends[1]),
    }
    begins = grid.block_m * (first + np.arange(blocks, dtype=np.float64))
    return Comparison(
        (a.name, b.name), grid, align, numbers, rows, begins, map_w1,
        map_mean, (binned[0].height, binned[1].height), facts, notes,
    )  # fmt: skip


def _silent(cloud: Cloud) -> float | None:
    """Share of the beams without echo, None where that is unknown."""
    if cloud.silent_count < 0 or cloud.scan_count == 0:
        return None
    return cloud.silent_count / max(1, cloud.silent_count + len(cloud))


def _no_crop(cloud: Cloud, part: _Binned) -> float | None:
    """Share of the beams without an echo from crop: with none, or one from the ground, as in the cells."""
    silent, ground = _silent(cloud), float(np.mean(part.height < GROUND_BELOW))
    return None if silent is None else silent + (1.0 - silent) * ground


def _extent(places: tuple[Place, Place], grid: Grid) -> tuple[int, int, int, int]:
    """First cell and how many, first block and how many, that both clouds have."""
    found = []
    for axis, step in (("d", grid.cell_m), ("s", grid.block_m)):
        ends = [np.percentile(getattr(place, axis), [0.0, 100.0]) for place in places]
        low = floor(max(e[0] for e in ends) / step)
        found += [low, max(0, ceil(min(e[1] for e in ends) / step) - low)]
    if found[1] * found[3] > 4_000_000:
        raise InputError("--cell-m", grid.cell_m, "expected larger cells or blocks for so large an area")
    return found[0], found[1], found[2], found[3]


def _compared(binned: list[_Binned], count: int, blocks: int) -> tuple[Any, F64, F64]:
    """Which cells (cells, blocks) have echoes enough of both; W1 and the difference of the means."""
    keys = [part.cell * blocks + part.block for part in binned]
    counts = [np.bincount(key, minlength=count * blocks) for key in keys]
    counts = [c.reshape(count, blocks) for c in counts]
    here = (counts[0] >= IN_BLOCK) & (counts[1] >= IN_BLOCK)
    for c in counts:
        here &= (np.where(here, c, 0).sum(axis=1) >= FEWEST)[:, None]
    drawn = here & (counts[0] >= ON_MAP) & (counts[1] >= ON_MAP)
    w1, mean = np.full(count * blocks, np.nan), np.full(count * blocks, np.nan)
    orders = [np.argsort(key, kind="stable") for key in keys]
    starts = [np.concatenate([[0], np.cumsum(c)]) for c in counts]
    for cell in np.flatnonzero(drawn):
        one, other = (
            part.height[order[start[cell] : start[cell + 1]]]
            for part, order, start in zip(binned, orders, starts, strict=True)
        )
        w1[cell], mean[cell] = wasserstein1(one, other), other.mean() - one.mean()
    return here, w1.reshape(here.shape), mean.reshape(here.shape)


def _only(part: _Binned, here: Any) -> _Binned:
    keep = here[part.cell, part.block]
    return _Binned(part.cell[keep], part.block[keep], part.height[keep], part.bright[keep])


def _numbers(
    binned: list[_Binned], here: Any, grid: Grid, low: int, seed: int, progress: Callable[[float], None]
) -> tuple[list[Number], list[dict[str, Any]]]:
    """Numbers over all cells with their spread, and a row for each cell."""
    used = np.flatnonzero(here.any(axis=1))
    area = grid.cell_m * grid.block_m * here.sum(axis=1)[used]
    order = [np.argsort(part.cell, kind="stable") for part in binned]
    ends = [np.searchsorted(p.cell[o], [used, used + 1]) for p, o in zip(binned, order, strict=True)]
    rows = []
    for number, cell in enumerate(used):
        parts = [o[e[0, number] : e[1, number]] for o, e in zip(order, ends, strict=True)]
        heights = [p.height[k] for p, k in zip(binned, parts, strict=True)]
        light = [p.bright[k] for p, k in zip(binned, parts, strict=True)]
        length = grid.block_m * int(here[cell].sum())
        row = {"left_m": (low + int(cell) + 0.5) * grid.cell_m, "length_m": length}
        for letter, height, bright in zip("ab", heights, light, strict=True):
            row |= {f"{name}_{letter}": v for name, v in _about(height, bright, float(area[number])).items()}
        row |= {"w1_m": wasserstein1(*heights), "ks": ks_distance(*(np.floor(h / BIN_M) for h in heights))}
        lit = [v[np.isfinite(v)] for v in light]
        row["intensity_w1"] = wasserstein1(*lit) if min(map(len, lit)) >= FEWEST else float("nan")
        rows.append(row)
    of_both = {n: np.array([(row[f"{n}_a"], row[f"{n}_b"]) for row in rows]) for n in DIFFERENCES}
    known = {name: np.isfinite(values).all(axis=1) for name, values in of_both.items()}
    spread = _Spread(binned, here, used, grid, seed).of_all(known, progress)
    if "w1_cells" in spread:
        for row, noise in zip(rows, spread["w1_cells"], strict=True):
            row["w1_noise_m"] = float(noise)
    made = []
    for name in DISTANCES:
        value = _mean([row[name] for row in rows])
        if isfinite(value):
            made.append(Number(name, value, value, value, tuple(spread.get(name, ()))))
    for name in DIFFERENCES:
        one, other = (_mean(values) for values in of_both[name][known[name]].T)
        if isfinite(one):
            made.append(Number(name, one, other, other - one, tuple(spread.get(name, ()))))
    return made, rows


def _about(height: F64, bright: F64, area: float) -> dict[str, float]:
    """One cloud in one cell, see `DIFFERENCES`.

    penetration: mean depth of the crop's echoes below the top
    """
    p5, p50, top = np.percentile(height, [5.0, 50.0, TOP])
    crop = height[height >= GROUND_BELOW]
    lit = bright[np.isfinite(bright)]
    return {
        "echoes": len(height),
        "mean_m": float(height.mean()),
        "p5_m": float(p5),
        "p50_m": float(p50),
        "top_m": float(top),
        "ground_share": 1.0 - len(crop) / len(height),
        "penetration_m": float(np.mean(top - crop)) if len(crop) >= FEWEST else float("nan"),
        "returns_per_m2": len(height) / area,
        "intensity": float(lit.mean()) if len(lit) >= FEWEST else float("nan"),
    }


class _Spread:
    """Noise and intervals by histograms over blocks. counts: (2, blocks, cells, bins)."""

    def __init__(self, binned: list[_Binned], here: Any, used: Any, grid: Grid, seed: int) -> None:
        blocks = np.flatnonzero(here.any(axis=0))
        low = min(float(p.height.min()) for p in binned)
        high = max(float(np.percentile(p.height, 99.9)) for p in binned)
        self.low = floor(low / BIN_M) * BIN_M
        bins = min(BINS_MAX, ceil((high - self.low) / BIN_M) + 1)
        self.middle = self.low + BIN_M * (np.arange(bins) + 0.5)
        shape = len(blocks), len(used), bins
        to_cell, to_block = (np.full(n, -1, np.int64) for n in here.shape)
        to_cell[used], to_block[blocks] = np.arange(len(used)), np.arange(len(blocks))
        counts, light = [], []
        for part in binned:
            at = np.clip(((part.height - self.low) / BIN_M).astype(np.int64), 0, bins - 1)
            place = to_block[part.block] * len(used) + to_cell[part.cell]
            size = len(blocks) * len(used)
            counts.append(np.bincount(place * bins + at, minlength=size * bins).reshape(shape))
            lit = np.isfinite(part.bright)
            sums = np.bincount(place[lit], part.bright[lit], minlength=size)
            light.append(np.stack([sums, np.bincount(place[lit], minlength=size)]).reshape(2, *shape[:2]))
        self.counts, self.light = np.stack(counts).astype(np.float32), np.stack(light)
        self.area = grid.cell_m * grid.block_m * here[np.ix_(used, blocks)].T.astype(float)
        self.ground = int(np.clip(round((GROUND_BELOW - self.low) / BIN_M), 0, bins))
        self.rng = Stream(seed, "compare scans").at()

    def of_all(self, known: dict[str, Any], progress: Callable[[float], None]) -> dict[str, Any]:
        """Noise of each distance (1,), interval of each difference (2,), and `w1_cells`, the noise by cell.

        known: cells that count for a difference. {} where there are too few blocks.
        """
        blocks = self.counts.shape[1]
        if blocks < FEWEST_BLOCKS:
            return {}
        drawn: dict[str, list[Any]] = {}
        one, other = self.counts
        for number in range(DRAWS):
            coin = self.rng.integers(0, 2, blocks).astype(np.float32)
            a, b = (
                np.einsum("k,kcb->cb", own, one) + np.einsum("k,kcb->cb", 1.0 - own, other)
                for own in (coin, 1.0 - coin)
            )
            gap = np.abs(_cdf(a) - _cdf(b))
            by_cell = gap.sum(axis=1) * BIN_M
            for name, value in (("w1_m", np.nanmean(by_cell)), ("ks", np.nanmean(gap.max(axis=1)))):
                drawn.setdefault(name, []).append(value)
            drawn.setdefault("w1_cells", []).append(by_cell)
            weight = np.bincount(self.rng.integers(0, blocks, blocks), minlength=blocks).astype(np.float32)
            means = [self._means(k, weight) for k in (0, 1)]
            for name in DIFFERENCES:
                drawn.setdefault(name, []).append(_mean((means[1][name] - means[0][name])[known[name]]))
            progress((number + 1) / DRAWS)
        found: dict[str, Any] = {n: (float(np.percentile(drawn[n], 95.0)),) for n in ("w1_m", "ks")}
        found["w1_cells"] = np.nanpercentile(np.array(drawn["w1_cells"]), 95.0, axis=0)
        for name in DIFFERENCES:
            values = np.array(drawn[name])
            if np.isfinite(values).all():
                found[name] = tuple(float(v) for v in np.percentile(values, [2.5, 97.5]))
        return found

    def _means(self, cloud: int, weight: Any) -> dict[str, F64]:
        """The numbers of `_about` by cell, with a weight for each block."""
        counts = np.einsum("k,kcb->cb", weight, self.counts[cloud]).astype(float)
        total = counts.sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = counts / total[:, None]
            cdf = np.cumsum(share, axis=1)
            crop = counts[:, self.ground :]
            top = self.middle[np.minimum((cdf < 0.01 * TOP).sum(axis=1), len(self.middle) - 1)]
            mean_crop = (crop * self.middle[self.ground :]).sum(axis=1) / crop.sum(axis=1)
            light = np.einsum("k,jkc->jc", weight, self.light[cloud])
            return {
                "mean_m": (share * self.middle).sum(axis=1),
                "top_m": np.where(total > 0, top, np.nan),
                "ground_share": share[:, : self.ground].sum(axis=1),
                "penetration_m": top - mean_crop,
                "returns_per_m2": total / (weight @ self.area),
                "intensity": light[0] / light[1],
            }


def _cdf(counts: Any) -> F64:
    counts = counts.astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.cumsum(counts, axis=1) / counts.sum(axis=1, keepdims=True))


def _mean(values: ArrayLike) -> float:
    """Mean of the finite values, nan where there is none."""
    found = np.asarray(values, dtype=float)
    found = found[np.isfinite(found)]
    return float(found.mean()) if len(found) else float("nan")


def _brightness(a: Cloud, b: Cloud, white: tuple[float, float] | None, notes: list[str]) -> tuple[F64, F64]:
    """Intensities of both on one scale, all nan where there is none."""
    none = np.full(len(a), np.nan), np.full(len(b), np.nan)
    lit = [c.intensity[np.isfinite(c.intensity)] for c in (a, b)]
    if white is not None:
        return a.intensity / white[0], b.intensity / white[1]
    if min(map(len, lit)) == 0:
        dark = [c.name for c, light in zip((a, b), lit, strict=True) if not len(light)]
        notes.append(f"no intensity in {' and '.join(dark)}: it is not compared")
        return none
    scale = [_white(c, light) for c, light in zip((a, b), lit, strict=True)]
    ends = [float(np.percentile(light, 99.9)) for light in lit]
    note = f"{a.name} goes up to {num(ends[0])}, {b.name} to {num(ends[1])}"
    if all(scale):
        if scale != [1.0, 1.0]:
            notes.append(f"intensity: {note}; white is taken as {num(scale[0])} and {num(scale[1])}")
        return a.intensity / scale[0], b.intensity / scale[1]
    if not any(scale) and max(ends) < 3.0 * min(ends):
        notes.append(f"intensity: {note}, on what scale is not known; compared as recorded")
        return a.intensity, b.intensity
    notes.append(f"intensity: {note}, on scales not known; not compared: --white A,B says what white is")
    return none


def _white(cloud: Cloud, light: F64) -> float:
    """Intensity of a white target by what the file and its values say, 0 = not known."""
    end = float(np.percentile(light, 99.9))
    if isfinite(cloud.white):
        return cloud.white if 0.05 * cloud.white < end <= cloud.white else 0.0  # 8 or 12 bit in a file for 16
    return 1.0 if end <= 1.5 else 0.0


def _tell_shift(binned: list[_Binned], grid: Grid, notes: list[str]) -> None:
    """A note where the tops of B, moved across, fit those of A much better."""
    tops = [_tops(part) for part in binned]
    at = np.flatnonzero(np.isfinite(tops[0]) & np.isfinite(tops[1]))
    if len(at) < 8:
        return
    center = (at + 0.5) * grid.cell_m
    shifts = np.arange(-SHIFT_MAX_M, SHIFT_MAX_M + 1e-9, 0.2 * grid.cell_m)
    left = []
    for shift in shifts:
        inside = (center + shift >= center[0]) & (center + shift <= center[-1])
        moved = np.interp(center + shift, center, tops[1][at])
        left.append(float(np.abs(tops[0][at] - moved)[inside].mean()) if inside.mean() > 0.6 else np.inf)
    best, now = int(np.argmin(left)), left[int(np.argmin(np.abs(shifts)))]
    if left[best] < SHIFT_GAIN * now and now > 0.02 and abs(shifts[best]) >= 0.5 * grid.cell_m:
        notes.append(
            f"B moved {signed(-shifts[best])} m to the left fits better: its tops are then "
            f"{num(100 * left[best])} instead of {num(now, 'm')} from those of A: does the edge, do the "
            "poses differ?"
        )


def _tops(part: _Binned) -> F64:
    order = np.lexsort((part.height, part.cell))
    cell, height = part.cell[order], part.height[order]
    out = np.full(int(cell.max()) + 1 if len(cell) else 1, np.nan)
    first = np.flatnonzero(np.diff(cell, prepend=-1))
    count = np.diff(first, append=len(cell))
    out[cell[first]] = height[first + np.minimum((0.01 * TOP * count).astype(int), count - 1)]
    return out


def _tell_scale(rows: list[dict[str, Any]], notes: list[str]) -> None:
    """A note where one of the two may be in feet."""
    tops = [float(np.percentile([row[f"top_m_{letter}"] for row in rows], 90.0)) for letter in "ab"]
    if min(tops) <= GROUND_BELOW:
        return
    for factor, which in ((FEET, "B"), (1.0 / FEET, "A")):
        if abs(tops[0] / tops[1] / factor - 1.0) < NEAR:
            tall = f"tops are {num(tops[0])} and {num(tops[1])} m"
            notes.append(f"{tall}, the factor of feet: is {which} in feet?")
