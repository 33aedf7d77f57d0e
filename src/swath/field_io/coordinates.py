"""Positions of a log in lon/lat, and whether they are what they are taken for.

Other axes, units or signs stretch, turn or mirror the way of a machine. The log itself shows that: by the way
it logs between records, in each direction; by its clock; by the width of the header beside the distance
between passes; by its course. Positions that this contradicts are refused where another reading agrees with
all of it. A place that is wrong by a shift alone contradicts nothing: it is printed.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, some_of
from swath.field.projection import known_crs, transform, utm_epsg
from swath.field_io.columns import QUANTITIES, UNITS, Column, ColumnMap
from swath.field_io.table import Table
from swath.field_io.witnesses import AT, CANDIDATES, Drive

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
DDMM = "ddmm"  # degrees and minutes as NMEA 0183 writes them: 5215.1234 is 52 deg 15.1234 min
FARTHEST_M = 20e3  # from the median position: no field is that large
MIRRORED = ("deg W", "deg S")
BEYOND_DEG = 6.0  # where a system is still used beside its own area: the next zone
LEAST_PLACED = 0.5  # share of the positions: with less on one place of the earth they are something else
MOST_PLACED = 0.9  # and with so much they are positions
_ANGLE = re.compile(
    r"([NSEW]?)\s*([+-]?\d+(?:\.\d+)?)(?:[\s°d:]+(\d+(?:\.\d+)?))?(?:[\s'’′m:]+(\d+(?:\.\d+)?))?"
    r"[\s\"”″'’′°]*([NSEW]?)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Reading:
    """A way to read positions. lon_lat [deg], shape (n, 2); area: west, south, east, north [deg] where its
    system is used; name: in a sentence; entries: of a map of columns
    """

    lon_lat: Array
    area: tuple[float, float, float, float] = (-180.0, -84.0, 180.0, 84.0)
    name: str = ""
    entries: str = ""

    def placed(self) -> tuple[Mask, Mask, Mask]:
        """Positions that are numbers, that are on earth, and of these far from the others, shape (n,)."""
        lon, lat = self.lon_lat.T
        west, south, east, north = self.area
        finite = np.asarray(np.isfinite(self.lon_lat).all(axis=1))
        on_earth = np.asarray(
            (lon >= west) & (lon <= east) & (lat >= south) & (lat <= north)
            & ((lon != 0.0) | (lat != 0.0)) & finite
        )  # fmt: skip
        if not on_earth.any():
            return finite, on_earth, np.zeros(len(lon), dtype=bool)
        centre = np.median(self.lon_lat[on_earth], axis=0)
        away = np.hypot((lon - centre[0]) * np.cos(np.radians(centre[1])), lat - centre[1]) * 111.2e3
        return finite, on_earth, np.asarray(on_earth & (away > FARTHEST_M))

    def share(self) -> float:
        """Share of the positions on one place of the earth."""
        finite, on_earth, away = self.placed()
        return float((on_earth & ~away).sum()) / max(int(finite.sum()), 1)


Others = Callable[[], list[Reading]]
Driven = Callable[[Reading], tuple[Array, Drive] | None]


@dataclass(frozen=True)
class Logged:
    """What a log says about its way. raw: columns in their own units; time: in clock_units, None = no clock;
    course: clockwise from north [deg], None = not logged; width: of the header, where no column says it [m]
    """

    columns: Mapping[str, Column]
    raw: Mapping[str, Array]
    time: Array | None
    clock_units: Sequence[str]
    cutting: Mask
    width: float | None


def numbers(table: Table, column: Column) -> Array:
    """A column of lat or lon in degrees; also of text like 52°15'12"N. nan where it is none."""
    values = table.numbers(column.column)
    if np.isfinite(values).sum() < 0.5 * len(values):
        values = np.array([_angle(text) for text in table.texts(column.column)])
    return in_degrees(values, column.unit)


def in_degrees(values: Array, unit: str) -> Array:
    """Coordinates in one of UNITS["position"] in degrees, > 0 north or east."""
    if unit == DDMM:
        whole = np.trunc(values / 100.0)
        return np.asarray(whole + (values - 100.0 * whole) / 60.0)
    return values * UNITS["position"][unit]


def _angle(text: str) -> float:
    """Degrees of text with degrees, minutes, seconds or letters, nan where it is none."""
    found = _ANGLE.fullmatch(text.strip())
    if found is None or (found[1] and found[5]):
        return np.nan
    degrees, minutes, seconds = (float(part or 0.0) for part in found.group(2, 3, 4))
    if abs(degrees) > 180.0 or minutes > 60.0 or seconds > 60.0:  # 60 is how 59.9999 may be printed
        return np.nan
    size = abs(degrees) + minutes / 60.0 + seconds / 3600.0
    sign = -1.0 if (found[1] or found[5]).upper() in ("S", "W") else 1.0
    return sign * (-size if found[2].startswith("-") else size)


def reading_of(table: Table, found: ColumnMap, path: Path) -> tuple[Reading, str, Others]:
    """Positions as they are said, what was assumed of them, and all other readings of the same numbers.

    Raises InputError where no system is known.
    """
    columns = found.columns
    if {"lat", "lon"} <= columns.keys():
        lat, lon = columns["lat"], columns["lon"]
        east = numbers(table, lon)
        is_beyond = (east > 180.0) & (east <= 360.0)  # counted on to the east
        own = Reading(np.stack([np.where(is_beyond, east - 360.0, east), numbers(table, lat)], axis=1))
        note = f"lon: {lon.column} counts from 0 to 360 deg: those above 180 are west" * bool(
            is_beyond.mean() > 0.5
        )
        return own, note, lambda: list(_of_degrees(table, lat, lon))
    if {"easting", "northing"} <= columns.keys() and table.points is None:
        pair = columns["easting"], columns["northing"]
        if not found.crs:
            expected = "expected crs: EPSG:... in the column map for easting, northing"
            raise InputError("crs", None, expected, file=path)
        raw = np.stack([table.numbers(c.column) for c in pair], axis=1)
        sizes = [UNITS["length"][c.unit] for c in pair]
        own = _projected(raw * sizes, found.crs)
        return own, "", lambda: list(_of_metres(raw, pair, found.crs))
    assert table.points is not None
    points, text, note = table.points, found.crs or table.crs, ""
    if not text:
        inside = np.nanmax(np.abs(points), axis=0, initial=0.0) <= (180.0, 180.0)
        if not inside.all():
            expected = "expected a .prj in the archive or crs in the column map"
            raise InputError("crs", None, expected, file=path)
        text, note = "EPSG:4326", "no .prj: positions taken as WGS 84"
    own = _projected(points[:, ::-1] if found.axes == "yx" else points, text)
    turned = [_projected(points[:, ::-1], text, "x and y exchanged", "axes: yx")] if not found.axes else []
    return own, note, lambda: turned


def _projected(points: Array, crs: str, name: str = "", entries: str = "") -> Reading:
    system = known_crs(crs)
    used = system.area_of_use
    area = Reading.area
    if used is not None and system.is_projected and used.west < used.east:
        area = (used.west - BEYOND_DEG, max(used.south - BEYOND_DEG, -84.0), used.east + BEYOND_DEG,
                min(used.north + BEYOND_DEG, 84.0))  # fmt: skip
    return Reading(transform(points, system, "EPSG:4326"), area, name, entries)


def _of_degrees(table: Table, lat: Column, lon: Column) -> Iterator[Reading]:
    for is_turned in (False, True):
        north, east = (lon, lat) if is_turned else (lat, lon)
        for units in (*((u, u) for u in UNITS["position"] if u not in MIRRORED), ("deg", "deg W"),
                      ("deg S", "deg"), ("deg S", "deg W")):  # fmt: skip
            made = [numbers(table, Column(c.column, u)) for c, u in zip((north, east), units, strict=True)]
            said = _said(("lat", "lon"), (north, east), units, is_turned, "deg")
            yield Reading(np.stack(made[::-1], axis=1), Reading.area, *said)


def _of_metres(raw: Array, pair: tuple[Column, Column], crs: str) -> Iterator[Reading]:
    for is_turned in (False, True):
        for unit in ("m", "cm", "mm", "km", "ft"):
            points = (raw[:, ::-1] if is_turned else raw) * UNITS["length"][unit]
            order = pair[::-1] if is_turned else pair
            said = _said(("easting", "northing"), order, (unit, unit), is_turned, "m")
            yield _projected(points, crs, *said)


def _said(
    keys: tuple[str, str], columns: Sequence[Column], units: tuple[str, str], is_turned: bool, plain: str
) -> tuple[str, str]:
    """Name and entries of a reading of two columns, exchanged or not. plain: unit that needs no word then"""
    name = " and ".join(keys) + " exchanged" * is_turned
    if not is_turned or set(units) != {plain}:
        name += f" in {' and '.join(dict.fromkeys(units))}"
    entries = (
        f"{key}: {{" + f"column: {json.dumps(c.column)}, " * is_turned + f"unit: {unit}}}"
        for key, c, unit in zip(keys, columns, units, strict=True)
    )
    return name, ", ".join(entries)


def check_places(
    own: Reading, others: Others, drive: Driven, logged: Logged, found: ColumnMap, path: Path
) -> list[str]:
    """What the log contradicts of its positions, as notes.

    drive: positions [m] and what they show, None where there are too few
    Raises InputError where another reading agrees with all of it, and the user has not said this one.
    """
    against = [w for w in _witnesses(own, drive, logged) if w.contradicts]
    if not against:
        return []
    doubts = [w.text for w in against]
    better: list[Reading] = []
    signs = (False, True) if "course" in logged.raw else (False,)
    for is_mirrored in signs:
        for other in [] if better else others():
            same = np.allclose(other.lon_lat, own.lon_lat, equal_nan=True, rtol=0.0, atol=1e-9)
            if same or other.share() < MOST_PLACED or is_mirrored != any(m in other.name for m in MIRRORED):
                continue
            seen = _witnesses(other, drive, logged)
            better += [other] if all(w.agrees for w in seen) and len(seen) > 1 else []
    columns = [found.columns[k] for k in ("lat", "lon", "easting", "northing") if k in found.columns]
    is_said = (columns and all(c.is_given for c in columns)) or bool(found.axes)
    named = ", ".join(f"{c.column} in {c.unit}" for c in columns) or "as in the shapes"
    if is_said or not better:
        told = doubts if better else [w.text for w in against if w.is_news]
        return [f"positions: {named}, though {'; '.join(told)}"] if told else []
    ways = some_of((other.name for other in better), 2, " or ")
    expected = f"expected what the log shows: {some_of(doubts, 2, '; ')}; all agrees with {ways}"
    error = InputError("log.positions", named, expected, file=path)
    error.others = tuple(
        InputError("--columns MAP.yaml", None, f"for {o.name}, at {place(o.lon_lat)}, write {o.entries}")
        for o in better
    )
    raise error


@dataclass(frozen=True)
class _Seen:
    """What one witness says of a reading. Between `contradicts` and `agrees` it says nothing.

    is_news: no other check tells it
    """

    contradicts: bool
    agrees: bool
    text: str
    is_news: bool = False


def _witnesses(reading: Reading, drive: Driven, logged: Logged) -> list[_Seen]:
    share = reading.share()
    text = f"{100 * (1 - share):.0f} % of them are at no place"
    seen = [_Seen(share < LEAST_PLACED, share >= MOST_PLACED, text)]
    driven = None if seen[0].contradicts else drive(reading)
    if driven is None:
        return seen
    position, whole = driven
    steps = whole if logged.time is None else whole.paced(logged.time)
    if len(whole.step) < AT.fewest:
        extent = float(np.hypot(*np.nanstd(position, axis=0)))
        return [*seen, _Seen(True, False, f"by them the machine stays within {extent:.2g} m")]
    sizes = [1.0] if logged.time is None else [UNITS["time"][u] for u in logged.clock_units]
    if logged.time is not None and np.isfinite(pace := whole.speed(logged.time)):
        speeds = [3.6 * pace / size for size in sizes]
        slow, fast = AT.drive
        usual = [3.6 * limit for limit in AT.speed]
        text = f"{speeds[0]:.3g} km/h by positions and times"
        wide = all(not slow <= v <= fast for v in speeds)
        seen.append(_Seen(wide, any(usual[0] <= v <= usual[1] for v in speeds), text))
    way = position[steps.after] - position[steps.here]
    lengths: dict[str, float | Array] = {"distance": 1.0}
    if logged.time is not None:
        lengths["speed"] = logged.time[steps.after] - logged.time[steps.here]
    for key, length in lengths.items():
        if key not in logged.raw:
            continue
        ratio = logged.raw[key][steps.after] * length / steps.step
        column = logged.columns[key]
        factors = [f * s for f in _factors(key, column) for s in (sizes if key == "speed" else [1.0])]
        seen += _of_way(column, ratio, factors)
        seen += _of_directions(column, ratio, np.degrees(np.arctan2(*way.T)))
    if np.isfinite(whole.spacing) and (seen_width := _of_spacing(logged, whole.spacing)):
        seen.append(seen_width)
    if "course" in logged.raw and (turned := _of_course(logged, steps, np.arctan2(*way.T))):
        seen.append(turned)
    return seen


def _factors(key: str, column: Column) -> list[float]:
    """To SI, of every unit that a column may have."""
    sizes = UNITS[QUANTITIES[key]]
    return [sizes[u] for u in (sum(CANDIDATES[key], ()) if column.is_assumed else (column.unit,))]


def _of_way(column: Column, ratio: Array, factors: list[float]) -> list[_Seen]:
    known = ratio[np.isfinite(ratio) & (ratio > 0.0)]
    if len(known) < AT.fewest:
        return []
    middles = [float(np.median(known)) * factor for factor in factors]
    off = min(middles, key=lambda m: abs(np.log(m)))
    text = f"{column.column} says {off:.2f} of the way between them"
    return [_Seen(not 1 / AT.alike < off < AT.alike, AT.agrees[0] <= off <= AT.agrees[1], text)]


def _of_directions(column: Column, ratio: Array, azimuth: Array) -> list[_Seen]:
    """The way by directions, of 45 degrees each: the unit does not matter."""
    known = np.isfinite(ratio) & (ratio > 0.0)
    sector = np.round(azimuth / 45.0).astype(int) % 4
    held = [ratio[known & (sector == k)] for k in range(4)]
    middles = [float(np.median(own)) for own in held if len(own) >= AT.fewest]
    if len(middles) < 2:
        return []
    spread = max(middles) / min(middles)
    text = f"{column.column} over the way between them differs by {spread:.2f} with the direction"
    return [_Seen(spread > AT.every_way[1], spread < AT.every_way[0], text, is_news=True)]


def _of_spacing(logged: Logged, spacing: float) -> _Seen | None:
    """Width of the header beside the distance between passes."""
    if "header_width" in logged.raw:
        column = logged.columns["header_width"]
        values = logged.raw["header_width"][logged.cutting]
        values = values[np.isfinite(values) & (values > 0.0)]
        if len(values) < AT.fewest:
            return None
        name, widths = column.column, [float(np.median(values)) * f for f in _factors("header_width", column)]
    elif logged.width is not None:
        name, widths = "the header", [logged.width]
    else:
        return None
    low, high = AT.header_over_spacing
    ratios = [width / spacing for width in widths]
    best = min(ratios, key=lambda r: abs(np.log(r)))
    text = f"passes lie {spacing:.2f} m apart, {name} is {best * spacing:.2f} m wide"
    wide = all(not low / AT.alike**0.5 <= r <= high * AT.alike for r in ratios)
    return _Seen(wide, any(low <= r <= high for r in ratios), text)


def _of_course(logged: Logged, steps: Drive, azimuth: Array) -> _Seen | None:
    """The logged course beside the azimuth [rad] of the way."""
    course = np.radians(logged.raw["course"][steps.after])
    off = np.exp(1j * (course - azimuth))[np.isfinite(course)]
    if len(off) < AT.fewest or np.ptp(course[np.isfinite(course)]) == 0.0:
        return None
    mean = complex(off.mean())
    turn = float(np.degrees(np.angle(mean)))
    column = logged.columns["course"].column
    text = f"{column} lies {abs(turn):.0f} deg beside the way" + (
        "" if abs(mean) > AT.same_course else ", in the mean of many"
    )
    is_along = abs(mean) > AT.same_course and abs(turn) < AT.beside_deg[0]
    is_other = abs(mean) < 0.5 * AT.same_course or abs(turn) > AT.beside_deg[1]
    return _Seen(is_other, is_along, text, is_news=True)


def place(lon_lat: Array) -> str:
    """Where positions [deg], shape (n, 2), are: `52.1234 N, 9.8765 E (UTM zone 32N, EPSG:32632)`."""
    known = lon_lat[np.isfinite(lon_lat).all(axis=1)]
    if not len(known):
        return "no place"
    lon, lat = (float(v) for v in np.median(known, axis=0))
    at = f"{abs(lat):.4f} {'N' if lat >= 0 else 'S'}, {abs(lon):.4f} {'E' if lon >= 0 else 'W'}"
    if abs(lat) > 84.0 or abs(lon) > 180.0:
        return f"{at}, which is not on earth"
    epsg = utm_epsg(lon, lat)
    return f"{at} (UTM zone {epsg % 100}{'N' if epsg < 32700 else 'S'}, EPSG:{epsg})"
