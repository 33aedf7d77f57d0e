"""Positions of a log in lon/lat, and whether they are what they are taken for.

Other axes, units or signs stretch, turn or mirror the way of a machine. The log itself shows that: by the way
it logs between records, in each direction; by its clock; by the width of the header beside the distance
between passes; by its course. Positions that this contradicts are refused where another reading agrees with
all of it. A place that is wrong by a shift alone contradicts nothing: it is printed.
"""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, some_of
from swath.core.number_text import num, percent_of
from swath.documents.witness import Pair
from swath.field.maps.projection import known_crs, transform, utm_epsg
from swath.field_io.logs.columns import UNITS, Column, ColumnMap
from swath.field_io.logs.table import Table
from swath.field_io.logs.witnesses import PLACES, Drive, Logged, place_pairs

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
DDMM = "ddmm"  # degrees and minutes as NMEA 0183 writes them: 5215.1234 is 52 deg 15.1234 min
FARTHEST_M = 20e3  # from the median position: no field is that large
MIRRORED = ("deg W", "deg S")
BEYOND_DEG = 6.0  # where a system is still used beside its own area: the next zone
NOWHERE = 0.1, 0.5  # share of the positions that are on no place of the earth: noted, something else
_ANGLE = re.compile(
    r"([NSEW]?)\s*([+-]?\d+(?:\.\d+)?)(?:[\s°d:]+(\d+(?:\.\d+)?))?(?:[\s'’′m:]+(\d+(?:\.\d+)?))?"
    r"[\s\"”″'’′°]*([NSEW]?)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Reading:
    """A way to read positions. lon_lat [deg], shape (n, 2); area: west, south, east, north [deg] where its
    system is used; name: in a sentence; entries: of a map of columns.
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


Others = Callable[[], Iterable[Reading]]
Driven = Callable[[Reading], tuple[Array, Drive] | None]


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
        note = f"reference: {lon.column} counts from 0 to 360 deg: those above 180 are west" * bool(
            is_beyond.mean() > 0.5
        )
        return own, note, lambda: list(_of_degrees(table, lat, lon))
    if {"easting", "northing"} <= columns.keys() and table.points is None:
        pair = columns["easting"], columns["northing"]
        if not found.crs:
            expected = "expected crs: EPSG:... in the column map for easting, northing"
            raise InputError("reference", None, expected, file=path)
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
            raise InputError("reference", None, expected, file=path)
        text, note = "EPSG:4326", "reference: no .prj: positions taken as WGS 84"
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
    """Name and entries of a reading of two columns, exchanged or not. plain: unit that needs no word then."""
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
    against = [pair for pair in _pairs(own, drive, logged) if pair.contradicts]
    if not against:
        return []
    doubts = [pair.shown for pair in against]
    better: list[Reading] = []
    signs = (False, True) if "course" in logged.raw else (False,)
    for is_mirrored in signs:
        for other in [] if better else others():
            same = np.allclose(other.lon_lat, own.lon_lat, equal_nan=True, rtol=0.0, atol=1e-9)
            if (
                same
                or 1.0 - other.share() > NOWHERE[0]
                or is_mirrored != any(m in other.name for m in MIRRORED)
            ):
                continue
            seen = _pairs(other, drive, logged)
            better += [other] if all(pair.agrees for pair in seen) and len(seen) > 1 else []
    columns = [found.columns[k] for k in ("lat", "lon", "easting", "northing") if k in found.columns]
    is_said = (columns and all(c.is_given for c in columns)) or bool(found.axes)
    named = ", ".join(f"{c.column} in {c.unit}" for c in columns) or "as in the shapes"
    if is_said or not better:
        reasons = doubts if better else [pair.shown for pair in against if pair.key == PLACES]
        return [f"place: {named}, though {'; '.join(reasons)}"] if reasons else []
    ways = some_of((other.name for other in better), 2, " or ")
    expected = f"expected what the log shows: {some_of(doubts, 2, '; ')}; all agrees with {ways}"
    error = InputError("place", named, expected, file=path)
    error.others = tuple(
        InputError("--columns MAP.yaml", None, f"for {o.name}, at {place(o.lon_lat)}, write {o.entries}")
        for o in better
    )
    raise error


def _pairs(reading: Reading, drive: Driven, logged: Logged) -> list[Pair]:
    """The table of a reading."""
    away = 1.0 - reading.share()
    nowhere = Pair("place", f"{percent_of(away)} of them are at no place", away, *NOWHERE)
    driven = None if nowhere.contradicts else drive(reading)
    return [nowhere, *([] if driven is None else place_pairs(logged, *driven))]


def place(lon_lat: Array) -> str:
    """Where positions [deg], shape (n, 2), are: `52.1234 N, 9.8765 E (UTM zone 32N, EPSG:32632)`."""
    known = lon_lat[np.isfinite(lon_lat).all(axis=1)]
    if not len(known):
        return "no place"
    lon, lat = (float(v) for v in np.median(known, axis=0))
    north, east = (num(abs(v), side, places=4) for v, side in ((lat, "NS"[lat < 0]), (lon, "EW"[lon < 0])))
    at = f"{north}, {east}"
    if abs(lat) > 84.0 or abs(lon) > 180.0:
        return f"{at}, which is not on earth"
    epsg = utm_epsg(lon, lat)
    return f"{at} (UTM zone {epsg % 100}{'N' if epsg < 32700 else 'S'}, EPSG:{epsg})"
