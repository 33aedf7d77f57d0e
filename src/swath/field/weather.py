"""The weather over a field: one for all sensors, for the crop and for what floats.

`field.weather` says it in numbers, or by the hour in a file; `SiteWeather` gives the air and the sun at any
time of a run, in SI. What a sensor's own keys say wins over it.

Extinction, of light in the air [1/m]:

- fog by its meteorological optical range V, at which 5 % of a beam are left: ln 20 / V at 550 nm (WMO-No. 8),
  times (wavelength / 550 nm)^-q with q of Kim, McArthur and Korevaar 2001 (doi:10.1117/12.417512) up to 6 km,
  of Kruse, McGlauchlin and McQuistan 1962 beyond: fog dims all wavelengths alike, haze short ones more
- rain by `drops` of the sizes that Marshall and Palmer 1948 found: 3.65e-4 R^0.63, twice their geometric
  section; or `goodin`, 0.01 R^0.6, the loss of one scanner (Goodin et al. 2019,
  doi:10.3390/electronics8010089), 25 times as much
- dust as said: coarse dust dims 550 to 1550 nm alike within 15 %
"""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache
from math import acos, atan2, cos, hypot, inf, isnan, log, sin
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.asked import Tell, bare, gathered, telling
from swath.core.errors import Extra, InputError, MissingExtra
from swath.core.schedule import NS
from swath.core.units import DEG, HOUR, PERCENT
from swath.documents.validation import validate
from swath.documents.witness import ask
from swath.documents.yaml_document import Document
from swath.field.field_setup import from_azimuth
from swath.field.light import Light, light
from swath.field.maps.projection import Origin
from swath.field.moisture import DAY
from swath.field.weather_table import DEW_POINT, EARLIER, read_table
from swath.field.weather_witnesses import WITNESSES

T = TypeVar("T")
RainLaw = Literal["drops", "goodin"]
LEFT_AT_MOR = 0.05  # of a beam after the meteorological optical range (WMO-No. 8)
GREEN = 550e-9  # wavelength of visibilities [m]
KELVIN = 273.15
SUN_STEP_S = 10  # the sun stands still so long; it moves by 0.04 deg


@dataclass(frozen=True, kw_only=True)
class Weather:
    """The weather of a run.

    rain_mm_h: rain
    fog_mor_m: meteorological optical range of fog or haze: 5 % of a beam are left after it; none = clear air
    dust_per_m: extinction of dust that is everywhere
    wind_m_s: wind speed 2 m above the ground, for dust that drifts, thermal cameras and straw that dries;
        crop leans in it only with `field.stand.wind`, `{}` will do
    wind_azimuth_deg: direction in which the wind blows, clockwise from north, for dust and crop
    temperature_c: of the air, for thermal cameras and straw that dries
    humidity_percent: relative humidity of the air, for thermal cameras and straw that dries
    cloud_percent: cloud cover, 0 clear to 100 overcast
    sun_azimuth_deg: direction of the sun, clockwise from north; none = by time and place
    sun_elevation_deg: elevation of the sun; none = by time and place
    time: when the run starts, such as `2026-07-25T13:34+02:00`; with the place of the field it gives the sun
        (extras `light` and, for `field.origin`, `geo`)
    file: CSV with the column `hour`, hours of the day of `time` in its zone, up to 48 (beyond 24 of the next
        day), and any of the keys above that are numbers, taken instead of them, linear between rows; of
        several rows the first and last hour enclose `time`. Or a download by the hour of a usual service, as
        it is: EPW, NASA POWER (CSV), Open-Meteo (CSV), DWD CDC (produkt_*.txt)
    """

    rain_mm_h: Annotated[float, Ge(0), Le(300)] = 0.0
    fog_mor_m: Annotated[float, Ge(5), Le(100_000)] | None = None
    dust_per_m: Annotated[float, Ge(0), Le(10)] = 0.0
    wind_m_s: Annotated[float, Ge(0), Le(30)] = 0.0
    wind_azimuth_deg: Annotated[float, Ge(-360), Le(360)] = 90.0
    temperature_c: Annotated[float, Ge(-40), Le(60)] = 25.0
    humidity_percent: Annotated[float, Gt(0), Le(100)] = 50.0
    cloud_percent: Annotated[float, Ge(0), Le(100)] = 0.0
    sun_azimuth_deg: Annotated[float, Ge(-360), Le(360)] | None = None
    sun_elevation_deg: Annotated[float, Ge(-90), Le(90)] | None = None
    time: str | None = None
    file: str | None = None


SUN_KEYS = "sun_azimuth_deg", "sun_elevation_deg"
MAY_BE_STATED = {
    "air_c": "temperature_c", "falls": "rain_mm_h", "blows": "wind_m_s", "damp": "humidity_percent",
}  # fmt: skip
"""Measure of witnesses -> key: of the table, else of the scenario."""
COLUMNS = tuple(n for n in Weather.__dataclass_fields__ if n not in ("time", "file"))


@dataclass(frozen=True)
class Air:
    """The air at one time.

    rain: [mm/h]
    mor: meteorological optical range [m], inf = clear
    dust: extinction of dust [1/m]
    wind: velocity east and north, 2 m above the ground [m/s]
    temperature: [K]
    humidity: share of saturation [1]
    cloud: 0 clear to 1 overcast
    """

    rain: float = 0.0
    mor: float = inf
    dust: float = 0.0
    wind: tuple[float, float] = (0.0, 0.0)
    temperature: float = KELVIN + 25.0
    humidity: float = 0.5
    cloud: float = 0.0


AIR_KEYS = {
    "rain": ("rain_mm_h",), "mor": ("fog_mor_m",), "dust": ("dust_per_m",),
    "wind": ("wind_m_s", "wind_azimuth_deg"), "temperature": ("temperature_c",),
    "humidity": ("humidity_percent",), "cloud": ("cloud_percent",),
}  # fmt: skip
"""Field of `Air` -> the keys that it is made of."""


@dataclass(frozen=True)
class Sun:
    """Where the sun stands, refraction included [rad]. azimuth: clockwise from the north of the world."""

    azimuth: float
    elevation: float


class SiteWeather:
    """The weather of a field through a run.

    params: as the scenario says it
    origin: where the field lies, None = nobody knows
    folder: where relative file names start
    notes: how its file was read, and what is doubtful in it
    """

    def __init__(self, params: Weather, origin: Origin | None = None, folder: Path | None = None) -> None:
        self.params, self._origin = params, origin
        params = bare(params)  # who asks for the air asks for keys
        self._start = None if params.time is None else _moment(params.time)
        self._rows, self.notes = None, list[str]()
        if params.file is not None:
            self._rows, self.notes = _rows(params, self._start, folder or Path(), origin)
        self._of_air = {name: self._tell(keys) for name, keys in AIR_KEYS.items()}
        self._of_sun = {"azimuth": self._tell(SUN_KEYS[:1]), "elevation": self._tell(SUN_KEYS[1:])}
        self._constant = None if self._rows is not None else telling(_air(params), self._of_air)
        missing = [n for n in SUN_KEYS if getattr(params, n) is None and n not in (self._rows or {})]
        if len(missing) == 1:
            raise InputError(f"field.weather.{missing[0]}", None, "expected both angles of the sun, or none")
        if self._is_by_place and self._start is not None and origin is None and self._rows is None:
            expected = "expected a field that lies on Earth: field.origin, or an imported one"
            raise InputError("field.weather.time", params.time, expected)

    def _tell(self, keys: Iterable[str]) -> Tell:
        """What tells that keys were asked for; of those that its file has, the file and the time."""
        known = set(self._rows or ())
        known |= {"wind_m_s", "wind_azimuth_deg"} if "wind_east" in known else set()
        named = {name for key in keys for name in (("file", "time") if key in known else (key,))}
        return gathered(lambda: [getattr(self.params, name) for name in sorted(named)])[1]

    @property
    def start(self) -> datetime | None:
        """When the run starts, None = nobody says."""
        return None if self.params.time is None else self._start

    @property
    def _is_by_place(self) -> bool:
        given = self._rows or {}
        return bare(self.params).sun_elevation_deg is None and "sun_elevation_deg" not in given

    @property
    def may_be_dim(self) -> bool:
        """Whether there is rain, fog or dust at any time."""
        if self._constant is not None:
            return extinction(self._constant, GREEN) > 0.0
        rows = self._rows or {}
        named = ("rain_mm_h", "fog_mor_m", "dust_per_m")
        return any(name in rows or getattr(self.params, name) for name in named)

    def beyond(self, t: int | None = None) -> list[str]:
        """That its file of several rows does not cover a run up to t [ns], None = a whole day, else []."""
        if self._rows is None or self._start is None or len(hours := self._rows["hour"]) == 1:
            return []
        begin, end = float(hours[0]), float(hours[-1])
        if end - begin >= DAY or (
            t is not None and _within(hours, hour_of(self._start)) + t / NS / HOUR <= end
        ):
            return []
        said = f"beyond the hours of its file, {begin:g} to {end:g}, its nearest row is taken"
        why = "straw dries through a whole day; " if t is None else ""
        return [f"field.weather: derived: {why}{said}"]

    def at(self, t: int) -> Air:
        """The air at a time of the run [ns]."""
        return self._constant or telling(_air(self._params_at(t)), self._of_air)

    def sun(self, t: int) -> Sun | None:
        """The sun at a time of the run [ns]; None where the scenario says nothing of it."""
        params = self._params_at(t)
        if params.sun_azimuth_deg is not None and params.sun_elevation_deg is not None:
            sun = Sun(params.sun_azimuth_deg * DEG, params.sun_elevation_deg * DEG)
            return telling(sun, self._of_sun)
        if (start := self.start) is None or self._origin is None:
            return None
        step = t // (SUN_STEP_S * NS)
        return sun_at(start + timedelta(seconds=step * SUN_STEP_S), self._origin)

    def light(self, t: int) -> Light | None:
        """The light at a time of the run [ns]; None where the scenario says nothing of the sun."""
        sun = self.sun(t)
        return None if sun is None else light(sun.elevation, self.at(t).cloud)

    def params_at(self, t: int) -> Weather:
        """What the scenario and its file say at a time of the run [ns]."""
        if self._rows is None:
            return self.params
        return telling(self._params_at(t), {key: self._tell([key]) for key in COLUMNS})

    def _params_at(self, t: int) -> Weather:
        rows, start = self._rows, self._start
        if rows is None or start is None:
            return bare(self.params)
        hour = _within(rows["hour"], _within(rows["hour"], hour_of(start)) + t / NS / HOUR)
        found: dict[str, Any] = {
            name: float(np.interp(hour, rows["hour"], rows[name])) for name in rows if name != "hour"
        }
        if {"wind_east", "wind_north"} <= found.keys():  # between rows a vector, not an angle
            east, north = found.pop("wind_east"), found.pop("wind_north")
            found |= {"wind_m_s": hypot(east, north), "wind_azimuth_deg": atan2(east, north) / DEG}
        return replace(bare(self.params), **found)


def extinction(air: Air, wavelength: float, rain_law: RainLaw = "drops") -> float:
    """Extinction of light of a wavelength [m] by fog, dust and rain together [1/m]."""
    return fog_extinction(air.mor, wavelength) + rain_extinction(air.rain, rain_law) + air.dust


def rain_extinction(rain: float, law: RainLaw) -> float:
    """Extinction of light by rain [mm/h], by a law of the module's head [1/m]."""
    return 0.01 * float(rain**0.6) if law == "goodin" else 3.65e-4 * float(rain**0.63)


def fog_extinction(mor: float, wavelength: float, left: float = LEFT_AT_MOR) -> float:
    """Extinction of light by fog or haze [1/m].

    mor: distance after which the share `left` of a beam remains at 550 nm [m], inf = clear; wavelength: [m]
    """
    if mor == inf:
        return 0.0
    km = mor / 1000.0
    if km > 50.0:
        q = 1.6
    elif km > 6.0:
        q = 1.3
    elif km > 1.0:
        q = 0.16 * km + 0.34
    else:
        q = max(km - 0.5, 0.0)
    return -log(left) / mor * float((wavelength / GREEN) ** -q)


@lru_cache(maxsize=256)
def sun_at(moment: datetime, origin: Origin) -> Sun:
    """The sun by the algorithm of Reda and Andreas 2004 (doi:10.1016/j.solener.2003.12.003).

    Its azimuth is against the north of the grid, which the world's axes follow.
    """
    with Extra("light", "the sun by time and place"):
        from pvlib.solarposition import get_solarposition
    lon, lat = origin.to_lon_lat([[0.0, 0.0]])[0].tolist()
    found = get_solarposition([moment], lat, lon, altitude=origin.height).iloc[0]
    north = origin.grid()["convergence_deg"]
    return Sun(
        round((float(found["azimuth"]) - north) * DEG, 9), round(float(found["apparent_elevation"]) * DEG, 9)
    )


def _air(p: Weather) -> Air:
    heading = from_azimuth(p.wind_azimuth_deg)
    return Air(
        rain=p.rain_mm_h,
        mor=inf if p.fog_mor_m is None or isnan(p.fog_mor_m) else p.fog_mor_m,
        dust=p.dust_per_m,
        wind=(p.wind_m_s * cos(heading), p.wind_m_s * sin(heading)),
        temperature=KELVIN + p.temperature_c,
        humidity=p.humidity_percent * PERCENT,
        cloud=p.cloud_percent * PERCENT,
    )


def _moment(text: str) -> datetime:
    """A time with its zone. InputError for anything else."""
    expected = "expected a time with its zone, 1900 to 2100, such as 2026-07-25T13:34+02:00"
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise InputError("field.weather.time", text, expected) from None
    if moment.tzinfo is None or not 1900 <= moment.year <= 2100:
        raise InputError("field.weather.time", text, expected)
    return moment


def hour_of(moment: datetime) -> float:
    """Hour of its day."""
    return moment.hour + moment.minute / 60.0 + moment.second / HOUR


def _within(hours: np.ndarray, hour: float) -> float:
    """An hour, or the same of the day after or before where only that lies within the hours of a file."""
    return next((h for h in (hour, hour + DAY, hour - DAY) if hours[0] <= h <= hours[-1]), hour)


def _check_cell(name: str, value: float, path: Path, line: int) -> None:
    """InputError for a cell that no weather can have."""
    _, errors = validate(Weather, {name: value}, (), Document({}))
    if errors:
        expected = f"{errors[0].expected}; is it in another unit, or does it stand for none?"
        raise InputError("plausible", f"{name} {value:g}", expected, file=path, line=line)


def _rows(
    params: Weather, start: datetime | None, folder: Path, origin: Origin | None
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Columns of the file, hours rising, the wind as a vector, and notes. InputError for no weather."""
    path = folder / str(params.file)
    if start is None:
        raise InputError(
            "field.weather.time", None, "expected the time at which the run starts, for the file"
        )
    table = read_table(path, start, COLUMNS)
    rows, hours = table.rows, table.rows["hour"]
    if len(hours) == 0:
        raise InputError("hour", None, "expected at least one row", file=path)
    for name, column in rows.items():
        unknown = np.flatnonzero(~np.isfinite(column))
        for row in (*unknown[:1].tolist(), int(column.argmin()), int(column.argmax())):
            if name in COLUMNS:
                _check_cell(name, float(column[row]), path, table.lines[row])
            elif name == "hour" and not EARLIER <= column[row] <= 2.0 * DAY:
                expected = "expected an hour of the day, 0 to 24, or of the next, up to 48"
                raise InputError("timeline", float(column[row]), expected, file=path, line=table.lines[row])
    if falls := np.flatnonzero(np.diff(hours) <= 0.0).tolist():
        said = f"hour {hours[falls[0] + 1]:g} after {hours[falls[0]]:g}"
        line = table.lines[falls[0] + 1]
        raise InputError("timeline", said, "expected hours that rise", file=path, line=line)
    if len(hours) > 1 and not hours[0] <= _within(hours, hour_of(start)) <= hours[-1]:
        expected = f"expected a time within the hours of the file, {hours[0]:g} to {hours[-1]:g}"
        raise InputError("field.weather.time", params.time, expected, file=path)
    notes = [*table.notes, *ask(WITNESSES, rows | _measures(rows, params, start, origin), path)]
    rows.pop(DEW_POINT, None)
    if "wind_m_s" in rows or "wind_azimuth_deg" in rows:
        speed = rows.pop("wind_m_s", np.full(len(rows["hour"]), params.wind_m_s))
        azimuth = rows.pop("wind_azimuth_deg", np.full(len(rows["hour"]), params.wind_azimuth_deg)) * DEG
        rows |= {"wind_east": speed * np.sin(azimuth), "wind_north": speed * np.cos(azimuth)}
    return rows, notes


def _measures(
    rows: dict[str, np.ndarray], params: Weather, start: datetime, origin: Origin | None
) -> dict[str, Any]:
    """What witnesses of a table ask beside its columns."""
    hours, offset = rows["hour"], start.utcoffset() or timedelta()
    found: dict[str, Any] = {
        name: rows.get(key, np.full(len(hours), getattr(params, key))) for name, key in MAY_BE_STATED.items()
    }
    if origin is None:
        return found | {"zone": hours}
    lon = float(origin.to_lon_lat([[0.0, 0.0]])[0, 0])
    found["sun"] = hours - offset.total_seconds() / HOUR + lon / 15.0
    if set(SUN_KEYS) <= rows.keys():
        row = int(rows["sun_elevation_deg"].argmax())
        moment = start + timedelta(hours=float(hours[row]) - hour_of(start))
        azimuth, elevation = (float(rows[name][row]) * DEG for name in SUN_KEYS)
        with suppress(MissingExtra):
            true = sun_at(moment, origin)
            cosine = sin(true.elevation) * sin(elevation)
            cosine += cos(true.elevation) * cos(elevation) * cos(true.azimuth - azimuth)
            found["sun_off_deg"] = acos(min(max(cosine, -1.0), 1.0)) / DEG
    return found
