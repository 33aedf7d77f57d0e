"""Weather by the hour from a file: tables in the keys of `field.weather`, and downloads of usual services.

A download is known by its head. What stands in which column, in which unit and zone:

- EPW (EnergyPlus, Auxiliary Programs, chapter 2): eight lines of head, 35 columns; the hours 1 to 24 are the
  ends of hours, in the standard time of LOCATION (pvlib 1156, NREL ssc 459). Months of several years make one
  typical year: month and day are compared. A visibility of 0 is missing
- NASA POWER (power.larc.nasa.gov/docs/services/api/temporal/hourly, pvlib 2500): means of the hour from HR
  on, in UTC or in LST, the solar time of the place in whole hours; -999 is missing
- Open-Meteo: two blocks of head and rows, units in brackets behind the names, utc_offset_seconds of all
  stamps, rain as the sum over the step before a stamp
- DWD CDC (produkt_*.txt): semicolons, UTC, -999 is missing, cloud in eighths with -1 = not seen

Wind is given at 10 m and from where it comes: `AT_2_M` and 180 deg make it that of `field.weather`.
"""

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from itertools import pairwise
from math import log
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.files.read_file import open_to_read
from swath.core.units import HOUR
from swath.documents.number_table import column_names, read_numbers
from swath.documents.packed import readable
from swath.documents.text_file import read_bytes
from swath.documents.validation import unknown_key

Array = NDArray[np.float64]
DAY = 24.0  # h
AT_2_M = 4.87 / log(67.8 * 10.0 - 5.42)
"""Wind 2 m over grass, of that at 10 m: the logarithmic law of FAO-56 (Allen et al. 1998), equation 47."""
EARLIER = -3.0  # h: a row of the day before encloses a midnight between two rows
CLEAREST, UNLIMITED = 1e5, 1e6  # m: a longer range of sight is this one, up to what is none
DEW_POINT, FROM = "dew_point_c", "deg from"  # a witness, no key of the weather; as winds are named

_TEMPERATURES = {
    "°C": (1.0, 0.0), "C": (1.0, 0.0), "°F": (5.0 / 9.0, -160.0 / 9.0), "F": (5.0 / 9.0, -160.0 / 9.0),
    "K": (1.0, -273.15),
}  # fmt: skip
UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "temperature_c": _TEMPERATURES,
    DEW_POINT: _TEMPERATURES,
    "humidity_percent": {"%": (1.0, 0.0)},
    "cloud_percent": {"%": (1.0, 0.0), "1/10": (10.0, 0.0), "1/8": (12.5, 0.0)},
    "wind_m_s": {"m/s": (1.0, 0.0), "km/h": (1 / 3.6, 0.0), "mp/h": (0.44704, 0.0), "mph": (0.44704, 0.0),
                 "kn": (1852.0 / 3600.0, 0.0)},
    "wind_azimuth_deg": {FROM: (1.0, 180.0)},
    "rain_mm_h": {"mm/hour": (1.0, 0.0), "mm/day": (1.0 / DAY, 0.0), "mm": (1.0, 0.0), "inch": (25.4, 0.0)},
    "fog_mor_m": {"m": (1.0, 0.0), "km": (1000.0, 0.0), "ft": (0.3048, 0.0)},
}  # fmt: skip
"""Key of the weather -> unit of a service -> factor and offset."""
DEPTHS = ("mm", "inch")  # of rain over the step before a stamp


@dataclass(frozen=True)
class Column:
    """A column of a service: its name there, the key that it becomes, its unit unless the head says it.

    missing: numbers that stand for none; factor: to what the key means, beside the unit
    """

    name: str
    key: str
    unit: str = ""
    missing: tuple[float, ...] = (-999.0,)
    factor: float = 1.0


@dataclass(frozen=True)
class Head:
    """What the head of a download says.

    names: of the columns; least: cells of a row at least; units: by name, where the head has them
    zone: of the stamps; stamp: the time of a row, None where it has none; note: how times were read
    first: lines before the first row
    """

    names: Sequence[str]
    zone: tzinfo
    stamp: Callable[[Sequence[str]], datetime | None]
    note: str
    first: int
    units: Mapping[str, str] = field(default_factory=dict)
    least: int = 0


@dataclass(frozen=True)
class Service:
    """A usual source of weather. sign: pattern at the begin of its files; any_year: rows are of any year."""

    name: str
    sign: str
    read_head: Callable[[list[str], Path], Head]
    columns: tuple[Column, ...]
    separator: str = ","
    any_year: bool = False


@dataclass(frozen=True)
class Table:
    """rows: key -> numbers, with `hour` of the day of the start; lines: where they stand; notes: how read."""

    rows: dict[str, Array]
    lines: Sequence[int]
    notes: tuple[str, ...]


def read_table(path: Path, start: datetime, keys: Sequence[str]) -> Table:
    """The weather around a day. InputError for what is no table of `hour` and keys and of no service."""
    with open_to_read(path, "table", "a table") as file:
        head = file.read(200).decode("utf-8-sig", "replace")
    found = next((s for s in SERVICES if re.match(s.sign, head)), None)
    if found is not None:
        with readable("damaged", f"a file of {found.name}", path):
            return _of_service(found, path, start)
    for name in column_names(path):
        if name not in ("hour", *keys):
            expected = unknown_key(name, ("hour", *keys), "unknown column")
            if re.search("dir|from|richt", name.lower()):
                expected = "unknown column; wind_azimuth_deg is where the wind blows to: from + 180"
            raise InputError(name, None, expected, file=path, line=1)
    rows = read_numbers(path, ["hour"], keys)
    note = f"clock: hours of {path.name} are taken in the zone of time, {start:UTC%z}"
    return Table(rows, range(2, 2 + len(rows["hour"])), (note,))


def _of_service(service: Service, path: Path, start: datetime) -> Table:
    text = read_bytes(path, "table", service.name)
    try:
        lines = text.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:  # names of places
        lines = text.decode("cp1252", "replace").splitlines()
    head = service.read_head(lines, path)
    midnight = start.replace(hour=0, minute=0, second=0, microsecond=0)
    found: list[tuple[float, int, list[str]]] = []  # hour, line, cells
    days, notes = set(), [head.note]
    for line, row in _rows(lines, head, service.separator):
        moment = head.stamp(row)
        if moment is None or not (head.least or len(head.names)) <= len(row) <= len(head.names):
            if line < len(lines):
                expected = f"expected a time and {len(head.names)} cells of {service.name}"
                raise InputError("damaged", service.separator.join(row), expected, file=path, line=line)
            notes.append(f"damaged: {path.name} ends within line {line}")
            continue
        if service.any_year and (moment := _nearest_year(moment, start)) is None:
            continue
        days.add(moment.date())
        hour = (moment.replace(tzinfo=head.zone) - midnight).total_seconds() / HOUR
        if EARLIER <= hour <= 2.0 * DAY:
            found.append((hour, line, row))
    if not found:
        expected = f"expected a day of the file, {min(days)} to {max(days)}" if days else "expected rows"
        raise InputError("field.weather.time", start.isoformat(), expected, file=path)
    if service.any_year:  # of the last days of a year, too
        found.sort()
    hours, at, cells = (list(part) for part in zip(*found, strict=True))
    step = float(np.median(np.diff(hours))) if len(hours) > 1 else 1.0
    rows, said = {"hour": np.array(hours)}, list[str]()
    for column in service.columns:
        if column.name not in head.names or column.key in rows:
            continue
        unit, known = column.unit or head.units.get(column.name, ""), UNITS[column.key]
        if unit not in known:
            raise InputError("unit", unit, f"expected {column.name} in one of {', '.join(known)}", file=path)
        place, numbers = head.names.index(column.name), np.full(len(hours), np.nan)
        for n, (row, line) in enumerate(zip(cells, at, strict=True)):
            numbers[n] = _number(row[place] if place < len(row) else "", column, path, line)
        gaps = np.isnan(numbers)
        if gaps.all():
            notes.append(f"unused: {column.name}, without a value on this day")
            continue
        if gaps.any():
            said_of = f"{gaps.sum()} of {len(gaps)} rows have no {column.name}"
            notes.append(f"lost: {said_of}: taken between their neighbours")
            numbers[gaps] = np.interp(rows["hour"][gaps], rows["hour"][~gaps], numbers[~gaps])
        factor, offset = known[unit]
        numbers = (numbers * factor + offset) * column.factor
        if unit in DEPTHS:
            numbers = numbers / step
        if column.key == "wind_azimuth_deg":
            numbers = numbers % 360.0
        if column.key == "fog_mor_m":
            numbers = np.where(numbers < UNLIMITED, np.minimum(numbers, CLEAREST), numbers)
        rows[column.key] = numbers
        said.append(f"{column.key} of {column.name} [{unit}]{' at 10 m' if column.factor == AT_2_M else ''}")
    if not said:
        expected = f"expected one of {', '.join(c.name for c in service.columns)}"
        raise InputError("columns", ", ".join(head.names), expected, file=path)
    return Table(rows, at, (f"form: {path.name} is of {service.name}: {', '.join(said)}", *notes))


def _rows(lines: list[str], head: Head, separator: str) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of each row, down to the next empty line."""
    for n, row in enumerate(csv.reader(lines[head.first :], delimiter=separator), start=head.first + 1):
        if not "".join(row).strip():
            return
        yield n, [cell.strip() for cell in row]


def _number(text: str, column: Column, path: Path, line: int) -> float:
    try:
        number = float(text or "nan")
    except ValueError:
        expected = f"expected a number of {column.name}, such as 10.5"
        raise InputError("damaged", text, expected, file=path, line=line) from None
    return np.nan if number in column.missing else number


def _nearest_year(moment: datetime, start: datetime) -> datetime | None:
    """The same day of the year that lies nearest to the start; None for 29 February in a year without it."""
    for year in (start.year, start.year - 1, start.year + 1):
        with suppress(ValueError):
            if abs((moved := moment.replace(year=year)) - start.replace(tzinfo=None)).days <= 183:
                return moved
    return None


def _by_the_day(service: str, path: Path) -> InputError:
    expected = f"expected {service} by the hour, this is by the day or month"
    return InputError("form", service, expected, file=path)


def _moment(*parts: str, after_h: float = 0.0) -> datetime | None:
    """Of year, month, day and so on."""
    try:
        year, month, day, hour, minute = (*map(int, parts), 0, 0)[:5]
        return datetime(year, month, day, hour, minute) + timedelta(hours=after_h)
    except (ValueError, OverflowError):
        return None


def _head_of_epw(lines: list[str], path: Path) -> Head:
    first = next((n for n, line in enumerate(lines) if re.match(r"\d{4},", line)), len(lines))
    periods = next((line.split(",") for line in lines[:first] if line.startswith("DATA PERIODS")), [])
    zone, per_hour = float(next(csv.reader(lines))[8]), int(periods[2]) if len(periods) > 2 else 1
    if per_hour != 1:
        raise InputError("form", f"EPW, {per_hour} rows an hour", "expected one row an hour", file=path)

    def stamp(row: Sequence[str]) -> datetime | None:
        is_hour = len(row) > 3 and row[3].isdigit() and 1 <= int(row[3]) <= DAY
        return _moment(*row[:3], after_h=float(row[3])) if is_hour else None

    note = f"clock: hours of EPW are their ends, UTC{zone:+g}, of any year"
    least = EPW_NAMES.index("visibility") + 1
    return Head(EPW_NAMES, timezone(timedelta(hours=zone)), stamp, note, first, least=least)


def _head_of_power(lines: list[str], path: Path) -> Head:
    end = next((n for n, line in enumerate(lines[:-1]) if line.startswith("-END HEADER-")), None)
    names = [] if end is None else [name.strip() for name in lines[end + 1].split(",")]
    if end is None or "HR" not in names:
        raise _by_the_day("NASA POWER", path)
    about, solar = "\n".join(lines[:end]), 0
    if re.search(r"\bin LST\b", about):
        place = re.search(r"longitude\s+(-?[\d.]+)", about, re.IGNORECASE)
        if place is None:
            raise InputError("clock", "LST", "expected the longitude in the head", file=path)
        solar = round(float(place[1]) / 15.0)
    units = dict(re.findall(r"^(\w+)\s.*\(([^()]*)\)\s*$", about, re.MULTILINE))
    order = [names.index(name) for name in ("YEAR", "MO", "DY", "HR")]

    def stamp(row: Sequence[str]) -> datetime | None:
        return _moment(*(row[k] for k in order if k < len(row)), after_h=0.5)

    note = f"clock: means of hours of NASA POWER stand at half past, UTC{solar:+d}"
    return Head(names, timezone(timedelta(hours=solar)), stamp, note, end + 2, units)


def _head_of_open_meteo(lines: list[str], path: Path) -> Head:
    about = dict(zip(*(line.split(",") for line in lines[:2]), strict=False))
    if "location_id" in about:
        raise InputError("form", "Open-Meteo", "expected one place, these are several", file=path)
    pairs = enumerate(pairwise(lines[2:]), start=3)
    of_hours = r"time,.*\n(\d+-\d+-\d+T|\d{9})"
    first = next((n for n, pair in pairs if re.match(of_hours, "\n".join(pair))), None)
    if first is None:
        raise _by_the_day("Open-Meteo", path)
    zone = timezone(timedelta(seconds=int(about["utc_offset_seconds"])))
    heads = [name.strip().partition(" (") for name in lines[first - 1].split(",")]

    def stamp(row: Sequence[str]) -> datetime | None:
        if row[0].isdigit():
            return datetime.fromtimestamp(int(row[0]), zone).replace(tzinfo=None)
        return _moment(*re.split("[-T:]", row[0]))

    units = {name: unit.rstrip(")") for name, _, unit in heads}
    note = f"clock: stamps of Open-Meteo are UTC{zone.utcoffset(None).total_seconds() / HOUR:+g}"
    return Head([name for name, _, _ in heads], zone, stamp, note, first, units)


def _head_of_dwd(lines: list[str], path: Path) -> Head:
    names, row = ([cell.strip() for cell in line.split(";")] for line in [*lines, ""][:2])
    place = names.index("MESS_DATUM")
    if len(row) <= place or len(row[place]) < len("2026072513"):
        raise _by_the_day("DWD CDC", path)

    def stamp(row: Sequence[str]) -> datetime | None:
        text = row[place] if place < len(row) else ""
        return _moment(text[:4], *(text[k : k + 2] for k in range(4, len(text), 2)))

    return Head(names, UTC, stamp, "clock: stamps of DWD CDC are UTC", 1)


EPW_NAMES = (
    *(f"column {n}" for n in range(1, 7)), "dry bulb", "dew point", "relative humidity",
    *(f"column {n}" for n in range(10, 21)), "wind direction", "wind speed", "total sky cover", "column 24",
    "visibility", *(f"column {n}" for n in range(26, 34)), "liquid precipitation", "column 35",
)  # fmt: skip
SERVICES = (
    Service("EPW", "LOCATION,", _head_of_epw, (
        Column("dry bulb", "temperature_c", "C", (99.9,)),
        Column("dew point", DEW_POINT, "C", (99.9,)),
        Column("relative humidity", "humidity_percent", "%", (999.0,)),
        Column("wind direction", "wind_azimuth_deg", FROM, (999.0,)),
        Column("wind speed", "wind_m_s", "m/s", (999.0,), AT_2_M),
        Column("total sky cover", "cloud_percent", "1/10", (99.0,)),
        Column("visibility", "fog_mor_m", "km", (9999.0, 0.0)),
        Column("liquid precipitation", "rain_mm_h", "mm", (999.0,)),
    ), any_year=True),
    Service("NASA POWER", "-BEGIN HEADER-", _head_of_power, (
        Column("T2M", "temperature_c"),
        Column("T2MDEW", DEW_POINT),
        Column("RH2M", "humidity_percent"),
        Column("WS2M", "wind_m_s"),
        Column("WS10M", "wind_m_s", factor=AT_2_M),
        Column("WD2M", "wind_azimuth_deg", FROM),
        Column("WD10M", "wind_azimuth_deg", FROM),
        Column("CLOUD_AMT", "cloud_percent"),
        Column("PRECTOTCORR", "rain_mm_h"),
    )),
    Service("Open-Meteo", "(location_id,)?latitude,longitude,elevation,utc_offset", _head_of_open_meteo, (
        Column("temperature_2m", "temperature_c"),
        *(Column(name, DEW_POINT) for name in ("dew_point_2m", "dewpoint_2m")),
        *(Column(name, "humidity_percent") for name in ("relative_humidity_2m", "relativehumidity_2m")),
        *(Column(name, "wind_m_s", factor=AT_2_M) for name in ("wind_speed_10m", "windspeed_10m")),
        *(Column(name, "wind_azimuth_deg", FROM) for name in ("wind_direction_10m", "winddirection_10m")),
        *(Column(name, "cloud_percent") for name in ("cloud_cover", "cloudcover")),
        *(Column(name, "rain_mm_h") for name in ("precipitation", "rain")),
        Column("visibility", "fog_mor_m"),
    )),
    Service("DWD CDC", r"STATIONS_ID;\s*MESS_DATUM", _head_of_dwd, (
        *(Column(name, "temperature_c", "C") for name in ("TT_TU", "TT_10", "TT_STD", "TT")),
        *(Column(name, DEW_POINT, "C") for name in ("TD_10", "TD_STD", "TD")),
        *(Column(name, "humidity_percent", "%") for name in ("RF_TU", "RF_10", "RF_STD")),
        *(Column(name, "wind_m_s", "m/s", factor=AT_2_M) for name in ("F", "FF_10")),
        *(Column(name, "wind_azimuth_deg", FROM) for name in ("D", "DD_10")),
        Column("V_N", "cloud_percent", "1/8", (-999.0, -1.0)),
        Column("V_VV", "fog_mor_m", "m"),
        *(Column(name, "rain_mm_h", "mm") for name in ("R1", "RWS_10")),
    ), ";"),
)  # fmt: skip
"""Each is refused by name where its file is not by the hour."""
