"""What the numbers of a log say about their own units.

Positions are in degrees or a known system. With them a log shows how far a machine drove, how fast, and how
far apart its passes lie; grain flow and yield show each other. These witnesses decide units that nothing in
the file says, and contradict units that are said wrongly.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import Extra, InputError
from swath.core.number_text import num, percent_of
from swath.documents.witness import Pair, judge, outside
from swath.field.crop_sheet import load_crop
from swath.field_io import trade
from swath.field_io.logs.columns import FLOWS, QUANTITIES, UNITS, Column, ColumnMap

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
US_CUSTOMARY = {"ft", "in", "mph", "ft/s", "lb/s", "lb/ac", "bu/ac"}
_YIELDS: tuple[tuple[str, ...], tuple[str, ...]] = (("kg/ha", "t/ha", "dt/ha", "bu/ac", "lb/ac"), ())
CANDIDATES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "distance": (("m", "ft", "in"), ("cm", "mm", "km")),
    "speed": (("m/s", "km/h", "mph"), ("kn", "ft/s")),
    "header_width": (("m", "ft", "in"), ("cm", "mm")),
    "moisture": (("%", "1"), ()),
    "grain_flow": (("kg/s", "t/h", "lb/s"), ("kg/h", "g/s")),
    "yield": _YIELDS,
    "dry_yield": _YIELDS,
    "elevation": (("m", "ft"), ("cm", "mm")),
}
"""Usual units of each quantity, and rare ones, which count where no usual one fits."""
_NO_SYSTEM = {"%", "1"}
PLACES = "place"  # key of a pair that no unit mends
_DOUBTS = {
    **dict.fromkeys(FLOWS, "yield"),
    "header_width": "width",
    "moisture": "moisture",
}  # of doubts; else plausible
CLOCK_UNITS = ("s", "ms", "us", "ns", "min", "h", "d")


Range = tuple[float, float]


@dataclass(frozen=True)
class Thresholds:
    """Where a witness speaks, agrees and contradicts. A range holds its lowest and highest value.

    Of the drive, tuned on the logs of tests/field/test_log_units.py: Montana, Minnesota, a made harvest in
    many forms:
    ahead: records among which the next one of the same machine is, whichever others are between
    least_step [m]: between two records of a machine that drives
    longest: usual steps, in way or time; a longer one is a pause or a jump
    fewest: steps, gaps or records that say something
    places: at which the distance to the next pass is taken; more take longer and say the same
    farthest_pass, narrowest_pass [m]: to a neighbouring pass; 2.5 of the widest headers, and nearer lies the
    same one
    nearest: records among which a pass on either side is sought, and where none is there
    parallel: cosine between two passes; beside: usual steps along, of what lies beside a record
    regular: about the median of these distances, least_regular: share of them that must lie so near

    Of agreement, derived:
    agrees: two measures of one thing; km/h and ft/s, the nearest of the units, lie 10 % apart
    alike: ratio of two units; where they are nearer, what contradicts one may have another cause
    every_way: the way by the log over the way by positions, largest over smallest of all directions of
    passes, less 1; 0.06 in the logs above
    straight: chord over way of a pass, along farthest_pass; a turn has 0.7 and less, estimated
    header_over_spacing: passes overlap by up to 30 %, and hardly leave anything between

    What can be in the middle of a harvest, estimated:
    speed [m/s]; header [m]: from plot combines to the widest drapers; height [m]: of fields
    moisture: share of the wet mass of grain
    driven: how far outside, as a ratio less 1, the mean of a log may be, stops and turns included
    beside_deg: of a course beside the way, by the grid's convergence and a compass; agrees, contradicts
    level, one_level: ratio less 1 of two levels of one column, and log by which they may miss that of two
    units, and the spreads of their logs each other; most_turns: from one to the other, in the order of the
    rows; with more the levels lie at least `apart`, a ratio that no crop has from pass to pass
    even_moisture: 10th to 90th percentile over the median; 0.1 to 0.2 in the logs above, the
    flow 0.7
    as_flow: the same of the moisture over that of the flow; noted, refused
    american [deg]: west, east, south, north of where acres are usual
    """

    ahead: int = 6
    least_step: float = 0.05
    longest: float = 3.0
    fewest: int = 25
    places: int = 1500
    farthest_pass: float = 45.0
    nearest: tuple[int, int] = (32, 1024)
    narrowest_pass: float = 1.0
    parallel: float = 0.98
    beside: float = 0.75
    regular: float = 0.15
    least_regular: float = 0.6
    agrees: Range = (0.94, 1.065)
    alike: float = 1.25
    every_way: Range = (0.1, 0.15)
    straight: float = 0.85
    header_over_spacing: Range = (0.88, 1.45)
    speed: Range = (0.3, 6.0)
    header: Range = (1.2, 18.5)
    height: Range = (-430.0, 5500.0)
    moisture: Range = (0.05, 0.45)
    driven: float = 1.3
    beside_deg: Range = (25.0, 30.0)
    level: float = 0.5
    one_level: float = 0.15
    most_turns: int = 6
    apart: float = 8.0
    even_moisture: float = 0.35
    as_flow: Range = (1.0, 2.0)
    american: tuple[float, float, float, float] = (-170.0, -50.0, 24.0, 72.0)


AT = Thresholds()


@dataclass(frozen=True)
class Drive:
    """What positions show without any unit.

    middle: lon, lat [deg]
    here, after: records and those that follow them, shape (m,)
    step: way between them [m]
    spacing: between neighbouring parallel passes [m], nan = not regular
    """

    middle: tuple[float, float]
    here: Indices
    after: Indices
    step: Array
    spacing: float = np.nan

    def paced(self, time: Array) -> "Drive":
        """Without the steps across a pause."""
        took = time[self.after] - time[self.here]
        usual = _median(took)
        driven = (took >= 0.0) & (took <= AT.longest * usual)
        return replace(self, here=self.here[driven], after=self.after[driven], step=self.step[driven])

    def speed(self, time: Array) -> float:
        """Way over time [m per unit of time]; nan where it does not show."""
        paced = self.paced(time)
        total = float((time[paced.after] - time[paced.here]).sum())
        return float(paced.step.sum()) / total if len(paced.step) >= AT.fewest and total > 0.0 else np.nan


def drive_of(
    position: Array, lon_lat: Array, order: Indices, machine: Indices, cutting: Mask, season: Indices
) -> Drive:
    """What the positions show.

    position [m], lon_lat [deg], shape (n, 2); order: the records that count, as driven; machine, season: of
    each record, cutting: whether grain flows, shape (n,)
    """
    x, y = position[order].T
    best, follows = np.full(len(order), np.inf), np.zeros(len(order), dtype=np.int64)
    for ahead in range(1, min(AT.ahead, len(order) - 1) + 1):
        driven = np.hypot(x[ahead:] - x[:-ahead], y[ahead:] - y[:-ahead])
        driven[(machine[order[ahead:]] != machine[order[:-ahead]]) | (driven < AT.least_step)] = np.inf
        nearer = np.flatnonzero(driven < best[:-ahead])
        best[nearer], follows[nearer] = driven[nearer], nearer + ahead
    found = np.flatnonzero(best <= AT.longest * _median(best[np.isfinite(best)]))
    lon, lat = np.median(lon_lat[order], axis=0) if len(order) else (0.0, 0.0)
    drive = Drive((float(lon), float(lat)), order[found], order[follows[found]], best[found])
    return replace(drive, spacing=_spacing(position, drive, cutting, season))


def _spacing(position: Array, drive: Drive, cutting: Mask, season: Indices) -> float:
    """Median distance from a cutting record to the nearest parallel pass of its season on each side [m]."""
    with Extra("geo", "reading a yield log"):
        from scipy.spatial import cKDTree
    both = cutting[drive.here] & cutting[drive.after]
    if both.sum() < AT.fewest:
        return np.nan
    place, direction = position[drive.here[both]], position[drive.after[both]] - position[drive.here[both]]
    forward = direction / np.hypot(*direction.T)[:, None]
    beside, own = AT.beside * float(np.median(drive.step)), season[drive.here[both]]
    some = np.unique(np.linspace(0, len(place) - 1, min(AT.places, len(place))).astype(int))
    tree, gaps = cKDTree(place), np.full((len(some), 2), np.inf)
    for most in AT.nearest:
        left = np.flatnonzero(np.isinf(gaps).any(axis=1))
        distance, near = tree.query(
            place[some[left]], min(most, len(place)), distance_upper_bound=AT.farthest_pass
        )
        row, rank = np.nonzero(np.isfinite(distance))
        i, j = some[left[row]], near[row, rank]
        off, ahead = place[j] - place[i], forward[i]
        across = off[:, 1] * ahead[:, 0] - off[:, 0] * ahead[:, 1]
        is_pass = (np.abs((forward[j] * ahead).sum(axis=1)) > AT.parallel) & (own[j] == own[i])
        is_pass &= (np.abs((off * ahead).sum(axis=1)) < beside) & (np.abs(across) > AT.narrowest_pass)
        is_pass &= np.hypot(across, beside) <= distance[row, -1]  # nearer ones would be among these
        side = left[row[is_pass]], (across[is_pass] > 0.0).astype(int)
        np.minimum.at(gaps, side, np.abs(across[is_pass]))
    middle = _median(gaps)
    if not np.isfinite(middle):
        return np.nan
    is_regular = (np.abs(gaps[np.isfinite(gaps)] / middle - 1.0) < AT.regular).mean() >= AT.least_regular
    return middle if is_regular else np.nan


@dataclass(frozen=True)
class Logged:
    """What a log says.

    raw: columns, and those beside, in their own units
    time: in clock_units, None = no clock
    course: clockwise from north [deg]
    width: of the header, where no column says it [m]
    """

    columns: Mapping[str, Column]
    raw: Mapping[str, Array]
    time: Array | None
    clock_units: Sequence[str]
    cutting: Mask
    width: float | None


Row = Callable[[float], Pair]
"""A row of the table: what a column says beside something else, by the factor of its unit to SI."""


def _doubt(key: str) -> str:
    """Key of a doubt about a quantity."""
    return _DOUBTS.get(key, "plausible")


def _row(key: str, shown: str, value: float, limits: Range, refused: float = np.inf) -> list[Row]:
    """The row of a value in the unit of its column, which times the factor lies within limits; none of nan.

    shown: with the value in it; refused: how far outside it is in another unit, as a ratio less 1; inf where
    it is plausible only
    """
    if not value > 0.0:
        return []
    key = _doubt(key)
    return [lambda f: Pair(key, shown.format(num(value * f)), outside(value * f, limits), 0.0, refused)]


def _nearest(pairs: Iterable[Pair]) -> Pair:
    return min(pairs, key=lambda pair: pair.residual)


def way_rows(logged: Logged, drive: Drive) -> dict[str, list[Row]]:
    """What columns say about the way, beside the positions."""
    rows, other = {}, AT.alike - 1.0
    for key, length in _lengths(logged, drive).items():
        name, steps = logged.columns[key].column, drive.step
        own = (length >= 0.0) & (length <= AT.longest * _median(length))
        shown = float(length[own].sum() / steps[own].sum()) if own.sum() >= AT.fewest else np.nan
        rows[key] = _row(key, f"{name} says {{}} of the way between them", shown, AT.agrees, other)
    width, name = logged.width, "the header"
    if "header_width" in logged.raw:
        width = _median(logged.raw["header_width"][logged.cutting])
        name = logged.columns["header_width"].column
    text = f"passes lie {num(drive.spacing)} m apart, {name} is {{}} of that wide"
    over = (width or np.nan) / drive.spacing
    return rows | {"header_width": _row("header_width", text, over, AT.header_over_spacing, other)}


def _lengths(logged: Logged, drive: Drive) -> dict[str, Array]:
    """The way of each step by the columns that say it, in their units."""
    after, raw = drive.after, logged.raw
    found = {"distance": raw["distance"][after]} if "distance" in raw else {}
    if "speed" in raw and logged.time is not None:
        found["speed"] = raw["speed"][after] * (logged.time[after] - logged.time[drive.here])
    return found


def place_pairs(logged: Logged, position: Array, drive: Drive) -> list[Pair]:
    """The table of a way to read positions [m], shape (n, 2): all that a log says beside them, in the units
    that agree best where none is said.
    """
    steps = drive if logged.time is None else drive.paced(logged.time)
    if len(steps.step) < AT.fewest:
        extent = float(np.hypot(*np.nanstd(position, axis=0)))
        text = f"by them the machine stays within {num(extent)} m"
        return [Pair("step", text, np.inf, 0.0, 0.0)]
    sizes, pairs = [1.0], []
    if logged.time is not None:
        sizes = [UNITS["time"][u] for u in logged.clock_units]
        pace = [drive.speed(logged.time) / size for size in sizes]
        text = f"{num(3.6 * pace[0])} km/h by positions and times"
        pairs.append(Pair("timeline", text, min(outside(v, AT.speed) for v in pace), 0.0, AT.driven))
    for key, rows in way_rows(logged, steps).items():
        column = logged.columns.get(key, Column("", "m"))
        units = sum(CANDIDATES[key], ()) if column.is_assumed else (column.unit,)
        factors = [UNITS[QUANTITIES[key]][u] * s for u in units for s in (sizes if key == "speed" else [1.0])]
        pairs += [_nearest(map(row, factors)) for row in rows]
    azimuth = np.degrees(np.arctan2(*(position[steps.after] - position[steps.here]).T))
    sector = np.round(azimuth / 45.0).astype(int) % 4  # of 45 degrees each: the unit does not matter
    in_pass = _in_pass(position, steps)
    for key, length in _lengths(logged, steps).items():
        over = np.where(in_pass & (length > 0.0), length / steps.step, np.nan)
        middles = [m for k in range(4) if (m := _median(over[sector == k])) > 0.0]
        if len(middles) > 1:
            spread, name = max(middles) / min(middles), logged.columns[key].column
            text = f"{name} over the way between them differs by {num(spread)} with the direction"
            pairs.append(Pair(PLACES, text, spread - 1.0, *AT.every_way))
    if "course" in logged.raw:
        course = logged.raw["course"][steps.after]
        off = np.abs((course - azimuth + 180.0)[np.isfinite(course)] % 360.0 - 180.0)
        if len(off) >= AT.fewest and np.nanmax(course) > np.nanmin(course):
            beside = float(np.median(off))
            text = f"{logged.columns['course'].column} lies {num(beside)} deg beside the way"
            pairs.append(Pair(PLACES, text, beside, *AT.beside_deg))
    return [pair for pair in pairs if np.isfinite(pair.residual)]


def _in_pass(position: Array, drive: Drive) -> Mask:
    """Steps in the middle of a straight way that leads farther than to the next pass, shape (m,)."""
    way = np.cumsum(drive.step)
    reach = 0.5 * AT.farthest_pass
    first = np.searchsorted(way, way - reach)
    last = np.minimum(np.searchsorted(way, way + reach), len(way) - 1)
    chord = np.hypot(*(position[drive.after[last]] - position[drive.here[first]]).T)
    along = way[last] - way[first] + drive.step[first]
    return np.asarray((chord > AT.straight * along) & (AT.straight * chord < along))


def level_pairs(
    columns: Mapping[str, Column], raw: Mapping[str, Array], row_number: Indices
) -> Iterator[Pair]:
    """The rows of a column beside its others: the first ones in one unit, and others in another one, or by
    turns.
    """
    for key in (*FLOWS, "speed", "header_width", "moisture", "elevation"):
        rows = np.flatnonzero(raw[key] > 0.0) if key in raw else np.zeros(0, dtype=int)
        if len(rows) < AT.fewest:
            continue
        size = np.log(raw[key][rows])
        middle = np.sort(size)[len(size) // 10 : -(len(size) // 10)]
        step = int(np.diff(middle).argmax())
        gap = float(np.expm1(middle[step + 1] - middle[step]))
        if gap <= AT.level:
            continue
        is_high = size > 0.5 * (middle[step] + middle[step + 1])
        low, high = (float(np.median(size[own])) for own in (~is_high, is_high))
        sizes = np.log(list(UNITS[QUANTITIES[key]].values()))
        of_units = np.abs(np.subtract.outer(sizes, sizes) - (high - low)) < AT.one_level
        turns = np.flatnonzero(np.diff(is_high)) + 1
        is_once = 0 < len(turns) <= AT.most_turns
        low_spread, high_spread = (_log_spread(size[own]) for own in (~is_high, is_high))
        is_by_turns = high - low > np.log(AT.apart) and abs(high_spread - low_spread) < AT.one_level
        if of_units.any() and (is_once or is_by_turns):
            said = " and ".join(
                f"{num(np.median(raw[key][own]))} in rows {row_number[own[0]]} to {row_number[own[-1]]}"
                for own in np.split(rows, turns)[:2]
            )
            text = f"{key}: {columns[key].column}: {said}" + ", and so on by turns" * (not is_once)
            refused = AT.level if is_once else np.inf
            yield Pair("mixed", text, gap, AT.level, refused, "one unit in a column")


def _log_spread(size: Array) -> float:
    """10th to 90th percentile of logarithms."""
    low, high = np.percentile(size, [10.0, 90.0])
    return float(high - low)


def settle_units(
    found: ColumnMap, logged: Logged, drive: Drive, sheet: str, path: Path
) -> tuple[ColumnMap, list[str]]:
    """The columns with units that agree with the data, and what was inferred or is in doubt.

    logged: its time in s; sheet: of the crop
    Raises InputError for a unit that the data contradicts.
    """
    raw, time, cutting = logged.raw, logged.time, logged.cutting
    bench = _Bench(found, drive.middle, sheet, path)
    steps = drive if time is None else drive.paced(time)
    rows = way_rows(logged, steps)
    if "distance" in raw:
        bench.decide("distance", rows["distance"], "the positions show it", is_needed=False)
    pace = np.nan if time is None else drive.speed(time)
    speed = np.full(len(cutting), pace)
    if time is not None:
        speed[steps.after] = steps.step / _positive(time[steps.after] - time[steps.here])
    if "speed" in raw and pace > 0.0 and not _median(raw["speed"][cutting]) > 0.0:
        dead = bench.columns.pop("speed").column
        bench.notes.append(
            f"plausible: speed: {dead} says 0 at {num(3.6 * pace)} km/h by positions and times, not used"
        )
    elif "speed" in raw:
        seen = rows.get("speed") or _row("speed", "", _median(raw["speed"][cutting]), AT.speed)
        bench.decide("speed", seen, f"{num(3.6 * pace)} km/h by positions and times" * bool(pace > 0.0))
        speed = raw["speed"] * bench.factor("speed")
    header = np.full(len(cutting), np.nan if logged.width is None else logged.width)
    if "header_width" in raw:
        can_be = _row("header_width", "", _median(raw["header_width"][cutting]), AT.header)
        by = f"passes lie {num(drive.spacing)} m apart" * bool(drive.spacing > 0.0)
        bench.decide("header_width", can_be + rows["header_width"], by)
        header = raw["header_width"] * bench.factor("header_width")
    _grain(bench, raw, cutting, header * speed)
    if "elevation" in raw:
        bench.decide("elevation", _row("elevation", "", _median(raw["elevation"]), AT.height), "")
    bench.notes += judge([*_exchanged(bench.columns, raw, cutting), bench.mirrored()], path)
    return replace(found, columns=bench.columns), bench.notes


def _exchanged(columns: Mapping[str, Column], raw: Mapping[str, Array], cutting: Mask) -> list[Pair]:
    """Grain beside its moisture, which is more even: the flow follows speed, width and yield as well."""
    key = next((k for k in FLOWS if k in columns), "")
    if not key or "moisture" not in columns:
        return []
    flow, moisture = columns[key], columns["moisture"]
    flows, moistures = (_spread(raw[k][cutting]) for k in (key, "moisture"))
    text = f"{moisture.column} varies by {percent_of(moistures)}, {flow.column} by {percent_of(flows)}"
    text += ": are they exchanged?"
    entry = f"say with --columns MAP.yaml, in it {key}: {{column: {json.dumps(moisture.column)}}}"
    entry += f", moisture: {{column: {json.dumps(flow.column)}}}"
    residual = moistures / max(flows, 0.01) if moistures > AT.even_moisture else 0.0
    return [Pair("moisture", text, residual, *AT.as_flow, entry, flow.is_given and moisture.is_given)]


def _spread(values: Array) -> float:
    """10th to 90th percentile of those above 0, over their median; nan where there are too few."""
    values = values[values > 0.0]
    if len(values) < AT.fewest:
        return np.nan
    low, middle, high = np.percentile(values, [10.0, 50.0, 90.0])
    return float((high - low) / middle)


def _grain(bench: "_Bench", raw: Mapping[str, Array], cutting: Mask, area_rate: Array) -> None:
    """Units of moisture and of what counts as grain. area_rate: width times speed [m2/s], nan = unknown."""
    share = np.zeros(len(cutting))
    if "moisture" in raw:
        middle = _median(raw["moisture"][cutting])
        grain = _row("moisture", "", middle, AT.moisture)
        bench.decide("moisture", grain, f"{num(middle)} in the middle" if grain else "")
        share = np.clip(np.nan_to_num(raw["moisture"] * bench.factor("moisture")), 0.0, AT.moisture[1])
    per_area = {k: raw[k] for k in FLOWS if k in raw}
    if "grain_flow" in per_area:
        per_area["grain_flow"] = per_area["grain_flow"] / _positive(area_rate)
    if "dry_yield" in per_area:
        per_area["dry_yield"] = per_area["dry_yield"] * np.where(
            share > 0.0, trade.wet_over_dry(bench.sheet, share), 1.0
        )
    key = next((k for k in FLOWS if k in bench.columns), None)
    if key is None:
        return
    crop = load_crop(bench.sheet)
    usual = crop.stand.density * crop.yields.grain_mass
    low, high = (limit * usual for limit in trade.STEMS)
    rows = _row(key, "", _median(per_area[key][cutting]), (low, high)) if usual > 0.0 else []
    by = []
    for other in [k for k in per_area if k != key]:
        ratio = _median(per_area[key][cutting] / _positive(per_area[other][cutting]))
        sizes = [bench.size(other, unit) for unit in bench.possible(other)]
        of_units = [r for size in sizes for r in _row(key, "", ratio / size, AT.agrees, AT.alike - 1.0)]
        if of_units and (other != "dry_yield" or (share > 0.0).any()):
            rows.append(partial(_any, of_units))
            by.append(bench.found.beside[other].column)
    text = f"{crop.name} yields {num(10 * low)} to {num(10 * high)} t/ha"
    bench.decide(key, rows, ", ".join([*by, text]))


def _any(rows: list[Row], factor: float) -> Pair:
    return _nearest(row(factor) for row in rows)


def _is_american(lon: float, lat: float) -> bool:
    west, east, south, north = AT.american
    return west <= lon <= east and south <= lat <= north


class _Bench:
    """Where units are decided, one quantity after the other."""

    def __init__(self, found: ColumnMap, middle: tuple[float, float], sheet: str, path: Path) -> None:
        self.found, self.sheet, self.path = found, sheet, path
        self.columns = dict(found.columns)
        self.notes: list[str] = []
        self._is_in_form = True  # no unit of a known form is contradicted by one of another system
        stated = {**found.beside, **found.columns}
        self._votes = [c.unit for k, c in stated.items() if k in CANDIDATES and not c.is_assumed]
        self.middle, self._is_american = middle, _is_american(*middle)

    def size(self, key: str, unit: str) -> float:
        """Factor of a unit to SI."""
        bushel = trade.bushel_kg_factor(self.sheet) if unit == "bu/ac" else 1.0
        return UNITS[QUANTITIES[key]][unit] * bushel

    def factor(self, key: str) -> float:
        """Factor to SI of the unit that a quantity has now."""
        return self.size(key, self.columns[key].unit)

    def system(self) -> tuple[bool, str]:
        """Whether units are those of the USA, and by what."""
        votes = self._systems()
        if len(votes) == 1:
            return votes.pop(), f"as {', '.join(sorted(set(self._votes) - _NO_SYSTEM))} elsewhere in the log"
        return self._is_american, f"as usual at {'an American' if self._is_american else 'its'} place"

    def _systems(self) -> set[bool]:
        """Whether units that are known are those of the USA."""
        return {unit in US_CUSTOMARY for unit in self._votes if unit not in _NO_SYSTEM}

    def mirrored(self) -> Pair:
        """The place beside the units, of which those of the USA are used there: west may be written without
        its sign.
        """
        lon, lat = self.middle
        units = sorted({c.unit for c in self.columns.values()} & (US_CUSTOMARY - {"ft", "in"}))
        text = f"{', '.join(units)} at {num(lat, places=2)} N, {num(lon, places=2)} E"
        is_west = bool(units) and not self._is_american and _is_american(-lon, lat)
        entry = "where it lies west of Greenwich write lon: {unit: deg W} in --columns MAP.yaml"
        return Pair("place", text, float(is_west), 0.5, entry=entry)

    def possible(self, key: str) -> list[str]:
        """Units that a column beside may have."""
        column = self.found.beside[key]
        return self._own(CANDIDATES[key][0]) if column.is_assumed else [column.unit]

    def _own(self, units: tuple[str, ...]) -> list[str]:
        is_american, _ = self.system()
        return [u for u in units if u in _NO_SYSTEM or (u in US_CUSTOMARY) == is_american]

    def decide(self, key: str, rows: list[Row], shown: str, *, is_needed: bool = True) -> None:
        """Keep, find or refuse the unit of a column; one that is not needed is left out instead.

        rows: of the table, shown: what they say
        """
        if key not in self.columns:
            return
        column = self.columns[key]
        usual, rare = CANDIDATES[key]
        sure = [row for row in rows if row(1.0).refused < np.inf]
        pools = [self._fitting(key, units, rows) for units in (self._own(usual), usual, rare)]
        pool = next((units for units in pools if units), [])
        may_be = pool if column.is_assumed else self._fitting(key, [column.unit], rows)
        if not (is_needed or may_be or column.is_given):
            self.notes.append(f"unused: {key}: {column.column} not used: {shown} otherwise")
            del self.columns[key]
            return
        if not column.is_assumed:
            self._check(key, column, rows, self._fitting(key, usual, rows), shown)
            return
        of_format = column.of_format and self._is_in_form and not sure and column.unit in pools[1]
        if pool:
            unit = column.unit if column.unit in pool or of_format else pool[0]
            system = "" if sure or unit in _NO_SYSTEM or pool is not pools[0] else self.system()[1]
            is_by_place = key in FLOWS and bool(system) and len(self._systems()) != 1
            fits = self._fitting(key, usual, rows) if is_by_place else pool
            also = [u for u in fits if u != unit]
            doubt = f"; {' or '.join(also)} would fit as well" if also else ""
            by = ", ".join(filter(None, (shown, system)))
            word = _doubt(key) if is_by_place and also else "unit"
            text = f"{word}: {key}: {column.column} taken as {unit}{': ' if by else ''}{by}{doubt}"
        else:
            likely = [row for row in rows if row not in sure]
            plausible = self._fitting(key, (*self._own(usual), *usual, *rare), likely)
            if not plausible:
                raise self._refused(key, column, shown, "")
            unit = column.unit if column.unit in plausible else plausible[0]
            text = f"{_doubt(key)}: {key}: {column.column} taken as {unit}, though {shown}"
        if column.of_format and sure and pool:
            self._is_in_form &= (unit in US_CUSTOMARY) == (column.unit in US_CUSTOMARY)
        is_news = not (column.of_format and unit == column.unit and pool)
        self.notes += [text] if is_news else []
        self.columns[key] = replace(column, unit=unit, is_assumed=False, is_shown=True)
        self._votes += [unit] if sure and pool else []

    def _fitting(self, key: str, units: Sequence[str], rows: list[Row]) -> list[str]:
        return [u for u in units if all(row(self.size(key, u)).agrees for row in rows)]

    def _check(self, key: str, column: Column, rows: list[Row], fitting: list[str], shown: str) -> None:
        """A unit that the file or the user says: refused where another one would agree."""
        size = self.size(key, column.unit)
        off = [pair for pair in (row(size) for row in rows) if not pair.agrees]
        better = [u for u in fitting if not 1 / AT.alike < self.size(key, u) / size < AT.alike]
        if better and any(pair.refused < np.inf for pair in off) and not column.is_given:
            raise self._refused(key, column, shown, better[0])
        text = f"{_doubt(key)}: {key}: {column.column} in {column.unit}, though {shown}"
        self.notes += [text] if off else []

    def _refused(self, key: str, column: Column, shown: str, better: str) -> InputError:
        said = f"in {column.unit}" if not column.is_assumed else "without a unit"
        agrees = f", which would be in {better}" if better else ", which no unit makes of it"
        unit = better or column.unit
        flag = f"{key}: {{unit: {json.dumps(unit) if unit == '%' else unit}}}"
        say = f"say the unit with --columns MAP.yaml, in it {flag}"
        expected = f"expected what the data shows: {shown}{agrees}; {say}"
        return InputError(_doubt(key), f"{key}: {column.column} {said}", expected, file=self.path)


def clock_unit(column: Column, time: Array, drive: Drive, path: Path) -> tuple[str, list[str]]:
    """Unit of a numeric clock by which the machine drives as machines do, and notes.

    time: as logged. Raises InputError for a clock that is contradicted.
    """
    pace = drive.speed(time)
    speeds = {u: pace / UNITS["time"][u] for u in (column.unit, *CLOCK_UNITS)}
    fitting = [u for u, speed in speeds.items() if outside(speed, AT.speed) == 0.0]
    unit = fitting[0] if fitting and column.is_assumed else column.unit
    if unit != column.unit:
        return unit, [f"clock: {column.column} taken as {unit}: {num(3.6 * speeds[unit])} km/h"]
    text = f"{column.column}: by it as {unit} the machine drives {num(3.6 * speeds[unit])} km/h"
    better = f"{{unit: {fitting[0]}}}" if fitting else "null, for records one after the other"
    entry = f"say its unit with --columns MAP.yaml, in it time: {better}"
    off = outside(speeds[unit], AT.speed)
    return unit, judge([Pair("timeline", text, off, 0.0, AT.driven, entry, column.is_given)], path)


def _median(values: Array) -> float:
    """Median of the positive values; nan where there are too few."""
    values = values[np.isfinite(values) & (values > 0.0)]
    return float(np.median(values)) if len(values) >= AT.fewest else np.nan


def _positive(values: Array) -> Array:
    return np.where(values > 0.0, values, np.nan)
