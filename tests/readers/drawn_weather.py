"""Days of weather drawn by physics, written as tables of users and as downloads of services, with faults.

A day is a season at a latitude and a kind of weather: a wave of temperature by the sun, a dew point, humidity
by both, fog where the air is saturated and calm, rain from covered skies. What is written is that day in a
form; a fault changes what is written, never the day. A fault is only drawn where the day lets physics
contradict it, by `Fault.shows`; a clear sky in oktas, for one, is also one in percent.
"""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.schedule import NS
from swath.field.weather import KELVIN, SiteWeather, Weather
from tests.readers.verdict import Drawn, Got, Truth

Columns = dict[str, np.ndarray]
Draw = np.random.Generator
OPEN_METEO = "latitude,longitude,elevation,utc_offset_seconds,timezone,timezone_abbreviation"
AT_2_M = 0.748  # FAO-56, equation 47, of 10 m
LATER_H = 4.0

KINDS = {  # mean, amplitude [K] and spread of both, lack of dew [K], cloud low and high [%], wind [m/s], rain
    "clear": (18, 7, 9, (0, 4), 2.5, 0.0),
    "fair": (20, 6, 8, (5, 60), 3.0, 0.0),
    "dull": (12, 1.5, 3, (85, 100), 3.0, 0.05),
    "showers": (16, 4, 4, (40, 100), 4.5, 0.35),
    "rain": (13, 1.5, 1.5, (92, 100), 4.0, 0.8),
    "fog": (9, 4, 0.6, (10, 70), 1.0, 0.0),
    "hot": (31, 7, 14, (0, 25), 3.0, 0.0),
    "desert": (30, 9, 33, (0, 6), 4.0, 0.0),
    "tropical": (28, 3, 4, (30, 95), 2.5, 0.2),
    "polar": (-22, 2, 3, (0, 100), 4.0, 0.0),
    "storm": (11, 2, 3, (80, 100), 10.5, 0.5),
    "foehn": (14, 3, 14, (10, 50), 8.0, 0.0),
    "monsoon": (27, 1.5, 1.2, (95, 100), 5.0, 0.9),
    "front": (15, 2, 3, (50, 100), 5.0, 0.3),
}
FORMS = (
    "own",
    "own",
    "own",
    "own",
    "epw",
    "power",
    "open-meteo",
    "dwd TU",
    "dwd FF",
    "dwd N",
    "dwd RR",
    "power LST",
    "dwd 10",
)
HELD_OUT = {
    "kind": {"foehn", "monsoon", "front"},
    "form": {"power LST", "dwd 10"},
    "fault": {"kn", "rad", "tenths", "unsorted", "gap", "missing"},
}
KEYS = (
    "temperature_c",
    "humidity_percent",
    "cloud_percent",
    "wind_m_s",
    "wind_azimuth_deg",
    "rain_mm_h",
    "fog_mor_m",
)


@dataclass(frozen=True)
class Day:
    """hour: local, of the day; true: key -> numbers at them, as exact as they are written."""

    kind: str
    hour: np.ndarray
    true: Columns
    dew: np.ndarray
    start: float
    zone: float
    longitude: float

    def at(self, key: str, later: float = 0.0) -> float:
        """A number between the hours."""
        return float(np.interp(self.start + later, self.hour, self.true[key]))


def pressure(t: Any) -> Any:
    """Of saturated vapour [hPa]."""
    return 6.112 * np.exp(17.62 * t / (243.12 + t))


def _smooth(r: Draw, n: int, memory: float = 0.8) -> np.ndarray:
    out = np.zeros(n)
    for k in range(1, n):
        out[k] = memory * out[k - 1] + np.sqrt(1 - memory**2) * r.standard_normal()
    return out


def _day(r: Draw, kind: str, hour: np.ndarray, zone: float, longitude: float) -> Day:
    mean, swing, lack, (low, high), wind, wet = KINDS[kind]
    n, solar = len(hour), hour - zone + longitude / 15.0
    wave = np.cos(2 * np.pi * (solar - 15.0) / 24.0)
    t = mean + r.normal(0, 3) + swing * r.uniform(0.7, 1.2) * wave + 0.3 * _smooth(r, n)
    if kind == "front":
        t -= 8.0 / (1.0 + np.exp(-(hour - r.uniform(6, 18))))
    dew = np.minimum(t.mean() - lack * r.uniform(0.8, 1.2) + 0.4 * _smooth(r, n), 27.5)
    t, dew = np.round(t, 1), np.round(np.minimum(dew, t), 1)
    humidity = np.clip(np.round(100 * pressure(dew) / pressure(t), 1), 2, 100)
    if kind in ("clear", "desert"):
        cloud = np.where(r.random(n) < 0.25, r.exponential(high, n), 0.0)
    else:
        cloud = low + (high - low) * (0.5 + 0.5 * np.tanh(1.2 * _smooth(r, n) + 0.6 * r.standard_normal()))
    cloud = np.clip(np.round(cloud), 0, 100)
    speed = np.maximum(wind * r.uniform(0.7, 1.25) * (1 + 0.25 * wave) + 0.2 * wind * _smooth(r, n), 0.0)
    falls = (r.random(n) < wet) & (cloud > 60) & (humidity > 60)
    rain = np.where(falls, np.round(r.exponential(3.0 if kind == "monsoon" else 1.2, n), 1), 0.0)
    foggy = (humidity >= 97.0) & (rain == 0.0) & (speed < 3.0) & (kind == "fog")
    sight = np.where(
        foggy, r.uniform(40, 900, n), np.clip((102.0 - humidity) * r.uniform(400, 900), 1500, 60_000)
    )
    sight = np.where(rain > 0.0, np.minimum(sight, 9000.0 / (1 + rain)), sight)
    azimuth = (r.uniform(0, 360) + 25 * _smooth(r, n, 0.95)) % 360
    true = {
        "temperature_c": t,
        "humidity_percent": humidity,
        "cloud_percent": cloud,
        "wind_m_s": np.round(np.minimum(speed, 25.0), 1),
        "wind_azimuth_deg": np.round(azimuth),
        "rain_mm_h": rain,
        "fog_mor_m": np.round(sight, -1),
    }
    start = float(np.round(r.uniform(max(hour[0], 1.0), min(hour[-1], 23.0) - LATER_H) * 2) / 2)
    return Day(kind, hour, true, dew, start, zone, longitude)


@dataclass(frozen=True)
class Fault:
    """shows: whether physics contradicts what is written; change: what is written; text: the lines of it."""

    keys: tuple[str, ...]
    shows: Callable[[Day], bool] = lambda day: True
    change: Callable[[Draw, Columns, Day], None] = lambda r, c, day: None
    text: Callable[[Draw, list[str]], list[str]] = lambda r, lines: lines


def _scaled(
    key: str, factor: float, offset: float = 0.0, digits: int = 2
) -> Callable[[Draw, Columns, Day], None]:
    def change(_: Draw, c: Columns, day: Day) -> None:
        c[key] = np.round(c[key] * factor + offset, digits)

    return change


def _swapped(one: str, other: str) -> Callable[[Draw, Columns, Day], None]:
    def change(_: Draw, c: Columns, day: Day) -> None:
        c[one], c[other] = c[other], c[one]

    return change


def _covered(day: Day) -> bool:
    cloud = day.true["cloud_percent"]
    return float(np.percentile(cloud, 70)) >= 55.0 and cloud.max() > 75.0


def _fast(factor: float) -> Callable[[Day], bool]:
    def shows(day: Day) -> bool:
        wind, t = day.true["wind_m_s"] * factor, day.true["temperature_c"]
        is_arid = float(np.median(day.true["humidity_percent"])) < 35.0
        return wind.max() > 30.5 or (not is_arid and float(np.median(wind)) * max(np.ptp(t), 5.0) > 200.0)

    return shows


def _waves(day: Day) -> bool:
    return day.kind in ("clear", "hot", "desert", "fair") and np.ptp(day.true["temperature_c"]) > 10.0


def _pauses(day: Day) -> bool:
    """Whether rain falls long before the end, and then for several hours none."""
    fell = np.flatnonzero(day.true["rain_mm_h"] > 0.15)
    if not len(fell) or day.hour[fell[0]] >= day.hour[-1] - 8:
        return False
    return float(np.gradient(day.hour)[fell[0] :][day.true["rain_mm_h"][fell[0] :] == 0.0].sum()) >= 4.0


def _sentinel(r: Draw, c: Columns, day: Day) -> None:
    usual = {
        "temperature_c": (-999, 99.9, 9999),
        "humidity_percent": (-999, 999, 9999),
        "wind_m_s": (99.9, -999),
        "rain_mm_h": (-999, 999),
        "cloud_percent": (-999, 999),
    }
    key = str(r.choice(list(usual)))
    c[key] = c[key].copy()
    c[key][r.integers(len(c[key]), size=r.integers(1, 4))] = r.choice(usual[key])


def _total(_: Draw, c: Columns, day: Day) -> None:
    c["rain_mm_h"] = np.round(np.cumsum(c["rain_mm_h"] * np.gradient(day.hour)), 1)


def _zero(r: Draw, c: Columns, day: Day) -> None:
    c["temperature_c"] = c["temperature_c"].copy()
    c["temperature_c"][r.integers(2, len(day.hour) - 2)] = 0.0


def _hours(of: Callable[[np.ndarray], np.ndarray]) -> Callable[[Draw, Columns, Day], None]:
    def change(_: Draw, c: Columns, day: Day) -> None:
        c["hour"] = of(c["hour"])

    return change


def _turned(_: Draw, c: Columns, day: Day) -> None:
    n = round(12.0 / float(np.diff(day.hour[:2])[0]))
    for key in KEYS:
        c[key] = np.roll(c[key], n)


def _without(r: Draw, lines: list[str]) -> list[str]:
    first = int(r.integers(4, len(lines) - 9))
    return lines[:first] + lines[first + int(r.integers(3, 6)) :]


def _unsorted(r: Draw, lines: list[str]) -> list[str]:
    k = int(r.integers(3, len(lines) - 3))
    return [*lines[:k], lines[k + 1], lines[k], *lines[k + 2 :]]


def _torn(r: Draw, lines: list[str]) -> list[str]:
    k = int(r.integers(len(lines) - 4, len(lines)))
    return [*lines[:k], lines[k][: max(2, len(lines[k]) // 3)]]


OWN = {
    "oktas": Fault(("plausible",), _covered, _scaled("cloud_percent", 0.08, digits=0)),
    "tenths": Fault(("plausible",), _covered, _scaled("cloud_percent", 0.1, digits=0)),
    "cloud share": Fault(("plausible",), _covered, _scaled("cloud_percent", 0.01)),
    "humidity share": Fault(("plausible",), change=_scaled("humidity_percent", 0.01, digits=3)),
    "sight km": Fault(("plausible",), change=_scaled("fog_mor_m", 0.001)),
    "km/h": Fault(("plausible",), _fast(3.6), _scaled("wind_m_s", 3.6, digits=1)),
    "kn": Fault(("plausible",), _fast(1.944), _scaled("wind_m_s", 1.944, digits=1)),
    "K": Fault(("plausible",), change=_scaled("temperature_c", 1.0, 273.15)),
    "degF": Fault(
        ("plausible",), lambda d: d.true["temperature_c"].max() > 16.0, _scaled("temperature_c", 1.8, 32.0, 1)
    ),
    "rad": Fault(
        ("plausible",),
        change=_scaled("wind_azimuth_deg", np.pi / 180, digits=3),
        shows=lambda d: (
            float(np.percentile(d.true["wind_azimuth_deg"], 75)) > 140.0
            and float(np.ptp(d.true["wind_azimuth_deg"])) > 35.0
        ),
    ),
    "rain total": Fault(("plausible",), _pauses, _total),
    "sentinel": Fault(("plausible",), change=_sentinel),
    "zero": Fault(("plausible",), lambda d: float(np.abs(d.true["temperature_c"]).min()) > 12.5, _zero),
    "swapped T RH": Fault(
        ("plausible", "timeline"),
        lambda d: d.true["humidity_percent"].max() > 61.0 or _waves(d),
        _swapped("temperature_c", "humidity_percent"),
    ),
    "swapped wind cloud": Fault(
        ("plausible",), lambda d: d.true["cloud_percent"].max() > 31.0, _swapped("wind_m_s", "cloud_percent")
    ),
    "swapped azimuth RH": Fault(
        ("plausible",),
        lambda d: d.true["wind_azimuth_deg"].max() > 101.0,
        _swapped("wind_azimuth_deg", "humidity_percent"),
    ),
    "minutes": Fault(("timeline",), change=_hours(lambda h: h * 60)),
    "12-hour clock": Fault(("timeline",), change=_hours(lambda h: (h - 0.01) % 12 + 0.01)),
    "turned": Fault(("timeline", "plausible"), _waves, _turned),
    "gap": Fault(("lost",), text=_without),
    "unsorted": Fault(("timeline",), text=_unsorted),
    "twice": Fault(("timeline",), text=lambda r, lines: [*lines[:9], lines[8], *lines[9:]]),
    "torn": Fault(("table", "field.weather.time"), text=_torn),
    "commas": Fault(("table",), text=lambda r, lines: [lines[0], *(t.replace(".", ",") for t in lines[1:])]),
    "semicolons": Fault(("table",), text=lambda r, lines: [t.replace(",", ";") for t in lines]),
}


def _missing(value: str) -> Callable[[Draw, list[str]], list[str]]:
    """Replaces cells of a few rows, of a column of numbers that the service has."""

    def text(r: Draw, lines: list[str]) -> list[str]:
        mark = ";" if ";" in lines[-1] else ","
        out = list(lines)
        place = {";": 3, ",": 4 if lines[0].startswith("-BEGIN") else 1}[mark]
        place = 6 if lines[0].startswith("LOCATION") else place
        for k in r.integers(len(lines) - 20, len(lines) - 2, size=3):
            row = out[k].split(mark)
            row[place] = (
                value if value != "none" else {";": "-999", ",": "99.9" if place == 6 else "-999"}[mark]
            )
            out[k] = mark.join(row)
        return out

    return text


SERVICE = {
    "missing": Fault(("lost", "plausible"), text=_missing("none")),
    "9999": Fault(("plausible",), text=_missing("9999")),
    "word": Fault(("damaged",), text=_missing("n/a")),
    "comma": Fault(("damaged",), text=_missing("1,5")),
    "torn": Fault(("damaged", "field.weather.time"), text=_torn),
    "twice": Fault(("timeline",), text=lambda r, lines: [*lines[:-12], lines[-13], *lines[-12:]]),
    "by the day": Fault(("form",)),
}


def _own(c: Columns) -> list[str]:
    names = [n for n in ("hour", *KEYS) if n in c]
    return [
        ",".join(names),
        *(",".join(f"{v:g}" for v in row) for row in zip(*(c[n] for n in names), strict=True)),
    ]


def _stamps(day: Day, date: datetime, zone: float, shift: float = 0.0) -> list[datetime]:
    return [date + timedelta(hours=float(h) - day.zone + zone - shift) for h in day.hour]


def _epw(day: Day, c: Columns, date: datetime) -> list[str]:
    lines = [
        f"LOCATION,S\u00e3o Drawn,-,-,TMY3,725300,40.00,{day.longitude:.2f},{day.zone:.1f},201.0",
        "DESIGN CONDITIONS,0",
        "TYPICAL/EXTREME PERIODS,0",
        "GROUND TEMPERATURES,0",
        "HOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0",
        "COMMENTS 1,",
        "COMMENTS 2,",
        "DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31",
    ]
    for n, t in enumerate(_stamps(day, date, day.zone)):
        at, hour = (t, t.hour) if t.hour else (t - timedelta(days=1), 24)
        row = [
            at.year - 20,
            at.month,
            at.day,
            hour,
            60,
            "?9?9",
            c["temperature_c"][n],
            day.dew[n],
            round(c["humidity_percent"][n]),
            99000,
            *[0] * 10,
            round((c["wind_azimuth_deg"][n] + 180) % 360),
            c["wind_m_s"][n],
            round(c["cloud_percent"][n] / 10),
            0,
            c["fog_mor_m"][n] / 1000,
            77777,
            9,
            999999999,
            10,
            0.1,
            0,
            88,
            0.2,
            c["rain_mm_h"][n],
            1,
        ]
        lines.append(",".join(str(v) for v in row))
    return lines


def _power(day: Day, c: Columns, date: datetime, lst: bool) -> list[str]:
    zone = round(day.longitude / 15) if lst else 0
    names = {
        "T2M": ("C", c["temperature_c"]),
        "T2MDEW": ("C", day.dew),
        "RH2M": ("%", c["humidity_percent"]),
        "WS10M": ("m/s", c["wind_m_s"]),
        "WD10M": ("Degrees", (c["wind_azimuth_deg"] + 180) % 360),
        "PRECTOTCORR": ("mm/hour", c["rain_mm_h"]),
        "PS": ("kPa", np.full(len(day.hour), 99.0)),
    }
    lines = [
        "-BEGIN HEADER-",
        "NASA/POWER Source Native Resolution Hourly Data ",
        f"Dates (month/day/year): {date:%m/%d/%Y} through {date:%m/%d/%Y} in {'LST' if lst else 'UTC'}",
        f"Location: Latitude  40.0   Longitude {day.longitude:.4f} ",
        "The value for missing source data that cannot be computed [...]: -999 ",
        "Parameter(s): ",
        *(f"{k:22} MERRA-2 Something at 2 Meters ({u}) " for k, (u, _) in names.items()),
        "-END HEADER-",
        ",".join(["YEAR", "MO", "DY", "HR", *names]),
    ]
    for n, t in enumerate(_stamps(day, date, zone, 0.5)):
        lines.append(
            ",".join(str(v) for v in (t.year, t.month, t.day, t.hour, *(v[n] for _, v in names.values())))
        )
    return lines


def _open_meteo(day: Day, c: Columns, date: datetime, r: Draw) -> list[str]:
    unit, factor = [("km/h", 3.6), ("m/s", 1.0), ("kn", 1 / 0.514444), ("mp/h", 1 / 0.44704)][r.integers(4)]
    hot = bool(r.random() < 0.2)
    names = {
        f"temperature_2m ({'°F' if hot else '°C'})": c["temperature_c"] * 1.8 + 32
        if hot
        else c["temperature_c"],
        "relative_humidity_2m (%)": c["humidity_percent"],
        "precipitation (mm)": c["rain_mm_h"],
        "cloud_cover (%)": c["cloud_percent"],
        "visibility (m)": c["fog_mor_m"],
        f"wind_speed_10m ({unit})": c["wind_m_s"] * factor,
        "wind_direction_10m (°)": (c["wind_azimuth_deg"] + 180) % 360,
    }
    lines = [
        OPEN_METEO,
        f"40.0,{day.longitude:.2f},38.0,{round(day.zone * 3600)},Etc/Drawn,GMT",
        "",
        ",".join(["time", *names]),
    ]
    for n, t in enumerate(_stamps(day, date, day.zone)):
        lines.append(",".join([f"{t:%Y-%m-%dT%H:%M}", *(f"{v[n]:.2f}" for v in names.values())]))
    return lines


def _dwd(day: Day, c: Columns, date: datetime, form: str) -> list[str]:
    names = {
        "TU": ("QN_9", {"TT_TU": c["temperature_c"], "RF_TU": c["humidity_percent"]}),
        "FF": ("QN_3", {"   F": c["wind_m_s"], "   D": (c["wind_azimuth_deg"] + 180) % 360}),
        "N": ("QN_8", {" V_N": np.round(c["cloud_percent"] / 12.5)}),
        "RR": ("QN_8", {"  R1": c["rain_mm_h"]}),
        "10": ("  QN", {"TT_10": c["temperature_c"], "RF_10": c["humidity_percent"], "TD_10": day.dew}),
    }
    quality, columns = names[form]
    stamp = "%Y%m%d%H%M" if form == "10" else "%Y%m%d%H"
    lines = [";".join(["STATIONS_ID", "MESS_DATUM", quality, *columns, "eor"])]
    for n, t in enumerate(_stamps(day, date, 0.0)):
        lines.append(
            ";".join(
                ["       1260", f"{t:{stamp}}", "    3", *(f"{v[n]:7.1f}" for v in columns.values()), "eor"]
            )
        )
    return lines


HOLDS = {
    "own": KEYS,
    "epw": KEYS,
    "open-meteo": KEYS,
    "power": tuple(k for k in KEYS if k[:3] not in ("clo", "fog")),
    "dwd TU": KEYS[:2],
    "dwd 10": KEYS[:2],
    "dwd FF": KEYS[3:5],
    "dwd N": ("cloud_percent",),
    "dwd RR": ("rain_mm_h",),
}
BY_THE_DAY = {
    "epw": [
        "LOCATION,A,B,C,D,1,40,8,1.0,200",
        "DATA PERIODS,1,4,Data,Sunday,1/1,12/31",
        "2001,1,1,1,15,?," + "0," * 28 + "0",
    ],
    "power": [
        "-BEGIN HEADER-",
        "NASA/POWER Native Resolution Daily Data ",
        "-END HEADER-",
        "YEAR,MO,DY,T2M",
        "2026,7,25,18",
    ],
    "open": [OPEN_METEO, "40,8,38.0,0,GMT,GMT", "", "time,temperature_2m_max (°C)", "2026-07-25,18"],
    "dwd": ["STATIONS_ID;MESS_DATUM;QN_3;  FX;  FM;eor", "1358;20260725;10;12.1;4.3;eor"],
}


def _changed(fault: Fault, day: Day) -> set[str]:
    """Columns that a fault changes: two faults of one column may hide each other."""
    columns: Columns = {"hour": day.hour, **day.true}
    fault.change(np.random.default_rng(0), columns, day)
    changed = {k for k, v in columns.items() if v is not ({"hour": day.hour} | day.true)[k]}
    return changed | (set(KEYS) if fault in (OWN["turned"], OWN["sentinel"]) else set())


def draw(seed: int, held_out: bool = False) -> Drawn:
    """A day, its form and up to two faults. held_out: of values of the axes that are left out else."""
    r = np.random.default_rng([seed, int(held_out), 86])

    def of(axis: str, values: Any) -> str:
        left = [v for v in values if held_out or v not in HELD_OUT[axis]]
        return str(r.choice(left)) if left else ""

    form, kind = of("form", FORMS), of("kind", KINDS)
    longitude = float(np.round(r.uniform(-170, 170), 2))
    zone = float(round(longitude / 15) + r.integers(0, 2))
    if form == "own":
        step = float(r.choice([0.5, 1.0, 1.0, 1.0, 2.0]))
        hour = np.arange(0.0, 24.01 if r.random() < 0.5 else 24.0 - step / 2, step)
    else:
        half, step = 0.5 if form.startswith("power") else 0.0, 1 / 6 if form == "dwd 10" else 1.0
        hour = np.arange(-12.0, 40.0, step) + half
    day = _day(r, kind, hour, zone, longitude)
    date = datetime(2026, 1, 1) + timedelta(days=int(r.integers(2, 360)))
    faults, chosen = OWN if form == "own" else SERVICE, dict[str, Fault]()
    for _ in range(int(r.choice([0, 1, 1, 1, 2, 0]))):
        taken = {key for name in chosen for key in _changed(faults[name], day)}
        shown = [n for n, f in faults.items() if f.shows(day) and n not in chosen]
        shown = [n for n in shown if not taken & _changed(faults[n], day)]
        if form == "dwd FF":
            shown = [n for n in shown if n != "9999"]
        if step != 1.0:
            shown = [n for n in shown if n not in ("zero", "gap", "rain total")]
        if name := of("fault", shown):
            chosen[name] = faults[name]
    if "by the day" in chosen:
        chosen = {"by the day": chosen["by the day"]}
    written = {"hour": hour, **day.true}
    for fault in chosen.values():
        fault.change(r, written, day)
    keep = KEYS
    if form == "own" and not chosen:
        keep = tuple(k for k in KEYS if r.random() < 0.8 or k == KEYS[0])
        written = {k: v for k, v in written.items() if k in ("hour", *keep)}
    holds = HOLDS["power" if form == "power LST" else form]
    lines = _lines(form, day, written, date, r)
    for fault in chosen.values():
        lines = fault.text(r, lines)
    if "by the day" in chosen:
        lines = BY_THE_DAY[form.split()[0].split("-")[0]]
    start = (date + timedelta(hours=day.start)).replace(tzinfo=timezone(timedelta(hours=zone)))

    def write(folder: Path) -> tuple[Path, str]:
        path = folder / ("produkt_x.txt" if form.startswith("dwd") else "day.csv")
        path.write_text("\n".join(lines) + "\n", encoding="cp1252" if form == "epw" else "utf-8")
        return path, start.isoformat()

    truth = _truth(
        day,
        form,
        tuple(k for k in keep if k in holds),
        covered=set(chosen) & {"oktas", "tenths", "cloud share"},
    )
    return Drawn(
        seed,
        write,
        {} if "by the day" in chosen else truth,
        expected=frozenset(key for f in chosen.values() for key in f.keys),
        usual=(f"kind={kind}", f"form={form}", f"step={step:.2g}", f"zone={zone:+g}", f"start={day.start:g}"),
        unusual=tuple(f"fault={n}" for n in chosen),
    )


def _lines(form: str, day: Day, c: Columns, date: datetime, r: Draw) -> list[str]:
    if form == "own":
        return _own(c)
    if form == "epw":
        return _epw(day, c, date)
    if form == "open-meteo":
        return _open_meteo(day, c, date, r)
    return (
        _power(day, c, date, form == "power LST")
        if form.startswith("power")
        else _dwd(day, c, date, form[4:])
    )


def _truth(day: Day, form: str, keys: tuple[str, ...], covered: set[str]) -> dict[str, Truth]:
    """What the air is at the start and LATER_H after it; winds of services are those at 10 m."""
    at_2_m = 1.0 if form == "own" else AT_2_M
    steps = {"epw": 10.0, "dwd N": 12.5}
    angle = np.radians(day.true["wind_azimuth_deg"])
    speed = day.true["wind_m_s"] * at_2_m
    true: Columns = {**day.true, "east": speed * np.sin(angle), "north": speed * np.cos(angle)}
    true["cloud_percent"] = np.round(true["cloud_percent"] / steps.get(form, 1.0)) * steps.get(form, 1.0)
    close = {
        "temperature_c": 0.1,
        "humidity_percent": 0.6,
        "cloud_percent": 25.0 if covered else 0.1,
        "east": 0.06,
        "north": 0.06,
        "rain_mm_h": 0.05,
        "fog_mor_m": 20.0,
    }
    if {"wind_m_s", "wind_azimuth_deg"} <= set(keys):
        keys = (*keys, "east", "north")
    of = Day(day.kind, day.hour, true, day.dew, day.start, day.zone, day.longitude)
    return {
        f"{k}+{h:g}": Truth(of.at(k, h), absolute=close[k])
        for k in keys
        if k in close
        for h in (0.0, LATER_H)
    }


def read(given: tuple[Path, str], out: Path) -> Got:
    """The air that swath makes of a file."""
    path, start = given
    weather = SiteWeather(Weather(time=start, file=str(path)))
    numbers: dict[str, float | None] = {}
    for h in (0.0, LATER_H):
        air = weather.at(round(h * 3600 * NS))
        found = {
            "temperature_c": air.temperature - KELVIN,
            "humidity_percent": 100 * air.humidity,
            "cloud_percent": 100 * air.cloud,
            "east": air.wind[0],
            "north": air.wind[1],
            "rain_mm_h": air.rain,
            "fog_mor_m": air.mor,
        }
        numbers |= {f"{k}+{h:g}": v for k, v in found.items()}
    return Got(numbers, tuple(weather.notes))


if __name__ == "__main__":
    import sys

    from tests.readers.verdict import table, verdict

    first, count = int(sys.argv[1]), int(sys.argv[2])
    verdicts = [verdict(draw(seed, "--held-out" in sys.argv), read) for seed in range(first, first + count)]
    for one in verdicts:
        if not one.is_good:
            print("\n".join(one.lines()))
    print("\n".join(table(verdicts)))
