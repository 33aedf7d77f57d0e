"""Yield logs composed of independent axes, each with its truth and the outcome that is expected of it.

`draw(seed)` picks a value on every axis: of the harvest, of the columns, of the file, and in two thirds of
the draws one to three unusual traits. Values of HELD_OUT are not drawn without `held_out=True`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swath.field.maps.projection import Origin, transform, utm_epsg
from tests.field.drawn_logs import drive, late, yields
from tests.readers.log_files import BEGUN, WRITERS, Column, Sheet
from tests.readers.verdict import Drawn, Got, Truth

FT, LB, ACRE, MPH = 0.3048, 0.45359237, 4046.8564224, 0.44704
HELD_OUT: dict[str, set[Any]] = {
    "format": {"geojson", "csv, packed"},
    "separator": {"tab"},
    "encoding": {"utf-16"},
    "names": {"German"},
    "clock": {"12 hours", "ms since 1970"},
    "rate": {5.0},
    "place": {"S W", "zone border"},
    "coordinates": {"UTM, south"},
    "crop": {"rye", "soy"},
    "crop said": {"its name in German"},
    "unit of width": {"cm"},
    "unit of speed": {"kn"},
    "unit of flow": {"t/h"},
    "unit of yield": {"dt/ha"},
    "unit of dry_yield": {"dt/ha"},
    "unit of distance": {"in"},
    "grain": {"yield, dry beside"},
    "turns": {"logged, flow held"},
    "work state": {"On/Off", "width 0"},
    "sections": {4},
    "unusual": {
        "width twice, alike", "north first", "clock set back", "stamps since the last row", "SNA in words",
        "channels invalid in part", "a machine not calibrated", "4 decimals", "speed dead", "table shorter",
        "DBC in UTF-8", "a second receiver",
    },
}  # fmt: skip
"""Axis -> values that are kept for the judge: a quarter of each kind."""

CROPS = {  # lb a bushel, moisture of trade, usual moistures [%], usual yields [t/ha], names
    "wheat": (60, 0.135, (12, 17), (4, 10), ("Wheat", "Winterweizen")),
    "barley": (48, 0.145, (12, 17), (4, 9), ("Winter Barley", "Wintergerste")),
    "maize": (56, 0.155, (16, 30), (6, 15), ("Corn", "Körnermais")),
    "rape": (50, 0.09, (6, 11), (2.2, 5), ("Canola", "Winterraps")),
    "rye": (56, 0.14, (12, 17), (4, 9), ("Rye", "Roggen")),
    "soy": (60, 0.13, (10, 16), (2, 5), ("Soybeans", "Sojabohnen")),
}
PLACES = {
    "N E": (48.1, 11.3), "N W": (40.7, -96.4), "Greenwich": (52.3, -0.9), "S E": (-33.4, 148.2),
    "S W": (-35.1, -60.4), "zone border": (51.2, 11.9995), "far north": (61.8, 23.1),
}  # fmt: skip
UNITS: dict[
    str, dict[str, float]
] = {  # units of a quantity, each as a number of the SI unit; the usual first
    "width": {"m": 1.0, "ft": 1 / FT, "cm": 100.0},
    "speed": {"m/s": 1.0, "km/h": 3.6, "mph": 1 / MPH, "kn": 3600 / 1852},
    "distance": {"m": 1.0, "ft": 1 / FT, "in": 1 / 0.0254},
    "duration": {"s": 1.0},
    "moisture": {"%": 100.0},
    "elevation": {"m": 1.0, "ft": 1 / FT},
    "course": {"deg": 1.0},
    "flow": {"kg/s": 1.0, "lb/s": 1 / LB, "t/h": 3.6},
    "yield": {"kg/ha": 1e4, "t/ha": 10.0, "bu/ac": ACRE / LB, "lb/ac": ACRE / LB, "dt/ha": 100.0},
    "dry_yield": {"kg/ha": 1e4, "t/ha": 10.0, "bu/ac": ACRE / LB, "dt/ha": 100.0},
}
NAMES = {  # key -> in snake case, in English, in German, in at most ten letters with a unit
    "lat": ("lat", "Latitude", "Breitengrad", "Lat"), "lon": ("lon", "Longitude", "Längengrad", "Lon"),
    "easting": ("easting", "Easting", "Rechtswert", "Easting"),
    "northing": ("northing", "Northing", "Hochwert", "Northing"),
    "machine": ("machine", "Machine", "Maschine", "Machine"), "crop": ("crop", "Crop", "Fruchtart", "Crop"),
    "section": ("section", "Section", "Section", "Section"),
    "date": ("date", "Date", "Datum", "Date"), "time": ("time", "Time", "Uhrzeit", "Time"),
    "work": ("work_state", "Work State", "Arbeitsstellung", "WorkState"),
    "width": ("header_width", "Swath Width", "Arbeitsbreite", "Width"),
    "speed": ("speed", "Speed", "Geschwindigkeit", "Speed"),
    "distance": ("distance", "Distance", "Strecke", "Dist"),
    "duration": ("duration", "Duration", "Dauer", "Dur"),
    "moisture": ("moisture", "Moisture", "Kornfeuchte", "Moist"),
    "elevation": ("elevation", "Elevation", "Höhe", "Elev"),
    "course": ("course", "Heading", "Kurs", "Course"),
    "flow": ("grain_flow", "Grain Flow", "Durchsatz", "Flow"), "yield": ("yield", "Yield", "Ertrag", "Yld"),
    "dry_yield": ("dry_yield", "Dry Yield", "Trockenertrag", "YldDry"),
}  # fmt: skip
OTHER_NAMES = {"flow": "Mass Flow", "yield": "Wet Mass", "dry_yield": "Dry Mass Yield", "width": "Cut Width"}
TASK_UNITS = {"width": "m", "speed": "m/s", "distance": "m", "moisture": "%", "elevation": "m",
              "flow": "kg/s", "yield": "t/ha", "dry_yield": "t/ha"}  # fmt: skip
STYLES = ("snake case", "English", "German", "short")
SLUGS = {"m/s": "m_s", "km/h": "kmh", "kg/s": "kg_s", "lb/s": "lb_s", "t/h": "t_h", "kg/ha": "kg_ha",
         "t/ha": "t_ha", "bu/ac": "bu_ac", "lb/ac": "lbs_ac", "dt/ha": "dt_ha", "%": "pct"}  # fmt: skip
SLOW_LAG = 1.5  # s: of a flow that dies away slowly
MEASURED = ("mf4", "asc", "blf")
TABLES = ("csv", "shapefile", "geojson")


class Axes:
    """What is drawn: each value of an axis is noted; without `held_out` those of HELD_OUT are left out."""

    def __init__(self, seed: int, attempt: int, held_out: bool) -> None:
        self.rng = np.random.default_rng([seed, attempt, held_out])
        self.held_out, self.uses_held_out = held_out, False
        self.usual: list[str] = []
        self.chosen: dict[str, Any] = {}

    def pick(self, axis: str, values: Sequence[Any], weights: Sequence[float] | None = None) -> Any:
        """A value of an axis."""
        kept = self.allowed(axis, values)
        share = np.array([1.0 if weights is None else weights[values.index(v)] for v in kept])
        value = kept[int(self.rng.choice(len(kept), p=share / share.sum()))]
        self.uses_held_out |= value in HELD_OUT.get(axis, ())
        self.chosen[axis] = value
        self.usual.append(f"{axis}={value}")
        return value

    def allowed(self, axis: str, values: Sequence[Any]) -> list[Any]:
        """Values that may be drawn."""
        return [v for v in values if self.held_out or v not in HELD_OUT.get(axis, ())]

    def within(self, low: float, high: float) -> float:
        """A number."""
        return float(self.rng.uniform(low, high))


@dataclass
class Records:
    """Records of a harvest in driven order, shape (n,): t [s], x, y [m], v [m/s], way [m] since the last one,
    flow [kg/s] as the sensor shows it, wet: true yield there [kg/m2], nan out of the crop; width [m];
    moisture: share of the wet mass; up: header out of work; machine and part: numbers; off [m]: of a part to
    the right; course: counter-clockwise from x [rad].
    """

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    v: np.ndarray
    way: np.ndarray
    flow: np.ndarray
    wet: np.ndarray
    width: np.ndarray
    moisture: np.ndarray
    up: np.ndarray
    machine: np.ndarray
    part: np.ndarray
    off: np.ndarray
    course: np.ndarray

    def take(self, index: Any) -> "Records":
        """Some of them, in this order."""
        return Records(**{k: v[index] for k, v in vars(self).items()})


@dataclass
class Job:
    """A draw in the making: the axes, the harvest and what is known of it, the sheet once it is made."""

    axes: Axes
    records: Records
    sheet: Sheet
    area: float | None
    is_known: bool = True

    @property
    def rng(self) -> np.random.Generator:
        return self.axes.rng

    def is_(self, axis: str, *values: Any) -> bool:
        """Whether an axis has one of these values."""
        return self.axes.chosen.get(axis) in values

    def has(self, *keys: str) -> bool:
        """Whether the sheet has these columns."""
        return all(self.sheet.of(key) is not None for key in keys)


# ---- the harvest


def harvest(axes: Axes) -> tuple[Records, dict[str, float]]:
    """Records, and the true area [ha], delay [s] and number of passes."""
    rng = axes.rng
    passes = int(rng.integers(7, 13))
    machines = axes.pick("machines", [1, 2] if axes.chosen["format"] in TABLES else [1], [4, 1])
    width, length = axes.within(4.0, 12.5), axes.within(110, 230)
    speed, interval = axes.within(1.2, 2.5), 1.0 / axes.pick("rate", [0.5, 1.0, 2.0, 5.0], [1, 3, 1, 1])
    low, high = CROPS[axes.chosen["crop"]][3]
    level = axes.within(low, high)
    grown = yields(rng, axes.within(0.03, 0.12), 30.0)
    turns = axes.pick("turns", ["not logged", "logged", "logged, flow dies away", "logged, flow 0",
                                "logged, flow held"])  # fmt: skip
    delay = 0.0 if axes.pick("delay", ["taken off", "left"]) == "taken off" else axes.within(3, 14)
    is_logged, has_stops = turns != "not logged", bool(rng.integers(2))
    lag = SLOW_LAG if turns == "logged, flow dies away" else axes.within(0.3, 0.8)
    delay = max(delay, SLOW_LAG) if turns == "logged, flow dies away" else delay
    slant, lead = axes.within(-0.3, 0.3), axes.within(0.5, 2.0) if is_logged else 0.0
    wander, noise, parts = axes.within(0.01, 0.08), axes.within(0.01, 0.05), []
    for index in range(machines):
        lanes = np.arange(index, passes, machines)
        own_speed, turn_s = speed * axes.within(0.95, 1.05), axes.within(14, 24)
        first_up = bool(rng.integers(2))
        x, y, cuts, ends = drive(
            rng, lanes, first_up, length, slant, width, own_speed, turn_s, lead, has_stops
        )
        v = np.hypot(np.gradient(x), np.gradient(y)) / 0.1
        wet = np.where(cuts, grown(x, y) * level / 6.0, np.nan)
        flow = late(rng, np.nan_to_num(wet) * v * width, delay, lag)
        up = ends % 2 == 1
        if turns == "logged, flow 0":
            flow = np.where(up, 0.0, flow)
        elif turns == "logged, flow held":
            flow = flow[np.maximum.accumulate(np.where(up, 0, np.arange(len(x))))]
        rows = np.arange(int(rng.integers(0, 10)), len(x), round(interval * 10))
        rows = rows if is_logged else rows[~up[rows]]
        begun = np.maximum(rows - round(interval * 10), 0)
        track = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
        shown = np.maximum(flow[rows] * (1 + noise * rng.standard_normal(len(rows))), 0.0)
        count = len(rows)
        parts.append(Records(
            t=np.round(rows * 0.1, 3), x=x[rows] + rng.normal(0, wander, count),
            y=y[rows] + rng.normal(0, wander, count),
            v=v[rows], way=track[rows] - track[begun], flow=shown, wet=wet[rows], width=np.full(count, width),
            moisture=np.full(count, axes.chosen["moisture"]) + 0.004 * np.sin(y[rows] / 40), up=up[rows],
            machine=np.full(count, index), part=np.zeros(count, int), off=np.zeros(count),
            course=np.arctan2(np.gradient(y), np.gradient(x))[rows],
        ))  # fmt: skip
    joined = Records(**{k: np.concatenate([getattr(p, k) for p in parts]) for k in vars(parts[0])})
    made = joined.take(np.argsort(joined.t, kind="stable"))
    axes.chosen |= {"interval": interval, "passes": passes}
    size = passes * width * length / 1e4
    return made, {"area": size, "slack": passes * width * speed * interval / 1e4, "delay": delay}


def in_parts(records: Records, shares: Sequence[float]) -> Records:
    """A row for each part of the header, side by side from left to right."""
    step = np.arange(len(records.t))
    index = np.repeat(step, len(shares))
    made = records.take(index)
    share, number = np.tile(shares, len(step)), np.tile(np.arange(len(shares)), len(step))
    middle = np.cumsum(shares) - np.array(shares) / 2 - 0.5
    made.off = made.width * np.tile(middle, len(step))
    made.width, made.flow, made.part = made.width * share, made.flow * share, number
    return made


def places(records: Records, axes: Axes) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
    """lon, lat [deg], easting and northing [m] of records, and the EPSG code of these."""
    lat, lon = PLACES[axes.chosen["place"]]
    turn = axes.chosen["turn"]
    x = records.x + records.off * np.sin(records.course)
    y = records.y - records.off * np.cos(records.course)
    epsg = utm_epsg(lon, lat)
    east, north = transform([[lon, lat]], "EPSG:4326", f"EPSG:{epsg}")[0]
    local = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], axis=1)
    lon, lat = Origin(epsg, east, north).to_lon_lat(local).T
    return lon, lat, east + local[:, 0], north + local[:, 1], epsg


# ---- the columns


def stamps(clock: str, t: np.ndarray, begun: float) -> list[tuple[str, Any]]:
    """(key, cells) of the columns of a clock."""
    if clock == "seconds":
        return [("time", t + begun)]
    if clock == "ms since 1970":
        return [("time", np.round(1000 * (t + 1.7e9 + begun)))]
    when = [BEGUN + timedelta(seconds=float(v)) for v in t]
    if clock == "ISO":
        return [("time", [f"{w:%Y-%m-%dT%H:%M:%S}.{w.microsecond // 1000:03d}Z" for w in when])]
    if clock == "HHMMSS":
        return [("time", np.array([float(f"{w:%H%M%S}") for w in when]))]
    if clock == "12 hours":
        return [("date", [f"{w:%m/%d/%Y}" for w in when]), ("time", [f"{w:%I:%M:%S %p}" for w in when])]
    return [("date", [f"{w:%d.%m.%Y}" for w in when]), ("time", [f"{w:%H:%M:%S}" for w in when])]


def named(key: str, unit: str, style: str, name: str = "") -> str:
    """The name of a column; unit '' for one that says none."""
    base = name or NAMES[key][STYLES.index(style)]
    if not unit:
        return base
    if style == "short":
        name, end = base.replace(" ", ""), SLUGS.get(unit, unit)
        return f"{name}_{end if len(name) + len(end) < 10 else end.replace('_', '')}"
    if style == "snake case":
        return f"{base}_{SLUGS.get(unit, unit)}"
    return f"{base} ({unit})" if style == "English" else f"{base} [{unit}]"


def grains(records: Records, crop: str) -> dict[str, np.ndarray]:
    """What a monitor shows of the grain: flow [kg/s], yield as harvested and dry [kg/m2]."""
    area_rate = np.maximum(records.v, 0.3) * np.maximum(records.width, 0.1)
    wet = np.where((records.v > 0.3) & (records.width > 0.1), records.flow / area_rate, 0.0)
    return {
        "flow": records.flow,
        "yield": wet,
        "dry_yield": wet * (1 - records.moisture) / (1 - CROPS[crop][1]),
    }


def column(axes: Axes, key: str, values: np.ndarray, crop: str, *, must_say: bool = False) -> Column:
    """A column of numbers in a drawn unit, which its name says or not."""
    style, form = axes.chosen["names"], axes.chosen["format"]
    possible = list(UNITS[key])
    if form == "shapefile":  # names of ten letters: units that fit
        possible = [u for u in possible if len(named(key, u, style)) <= 10]
    unit = TASK_UNITS[key] if form == "isoxml" else axes.pick(f"unit of {key}", possible)
    axes.chosen[f"unit of {key}"] = unit
    says = must_say or form == "isoxml" or axes.rng.uniform() < 0.75
    says |= key in ("flow", "yield", "dry_yield")  # nothing shows these units
    says |= key in ("elevation", "course") and unit != next(iter(UNITS[key]))
    axes.usual += [] if says else [f"{key} without its unit"]
    factor = UNITS[key][unit]
    if unit == "bu/ac":
        factor /= CROPS[crop][0]
    shown = unit if says else ""
    return Column(key, named(key, shown, style), shown if form in MEASURED else "", values * factor)


def columns(axes: Axes, records: Records) -> Sheet:
    """The sheet of a log: which columns it has, and how they are called."""
    rng, form, crop = axes.rng, axes.chosen["format"], axes.chosen["crop"]
    axes.pick("place", list(PLACES))
    axes.chosen["turn"] = axes.within(0, 2 * np.pi)
    lon, lat, east, north, epsg = places(records, axes)
    style = "short" if form not in ("csv", "geojson") else axes.pick("names", STYLES[:3])
    axes.chosen["names"] = style
    how: dict[str, Any] = {}
    made: list[Column] = []
    coordinates = ["lat lon"]
    if form == "csv":
        coordinates.append("UTM, south" if epsg > 32700 else "UTM, north")
    if axes.pick("coordinates", coordinates, [2, 1][: len(coordinates)]) != "lat lon":
        made += [Column("easting", named("easting", "", style), "", east),
                 Column("northing", named("northing", "", style), "", north)]  # fmt: skip
        how["crs"] = f"EPSG:{epsg}"
    elif form not in ("shapefile", "geojson"):
        pair = [
            Column("lat", named("lat", "", style), "deg", lat),
            Column("lon", named("lon", "", style), "deg", lon),
        ]
        made += pair if rng.integers(2) else pair[::-1]
    clocks = ["seconds", "ISO", "none", "ms since 1970"]
    clocks += ["date and time", "HHMMSS", "12 hours"] if axes.chosen["interval"] >= 1.0 else []
    clock = axes.pick("clock", clocks) if form in TABLES else "of the format"
    optional = {"speed": 0.6, "distance": 0.4, "duration": 0.3, "elevation": 0.5, "course": 0.2}
    has = {key: bool(rng.uniform() < share) for key, share in optional.items()}
    if clock == "none" and not has["duration"]:
        has["speed"] = has["duration"] = True
    if form not in TABLES:
        has["duration"] = has["course"] = False
        has["distance"] &= form in MEASURED
    has["course"] &= len(np.unique(records.machine)) == 1
    if form in TABLES and clock != "none":
        for key, cells in stamps(clock, records.t, axes.within(0, 5e4)):
            unit = {"ms since 1970": "ms", "seconds": "s" if rng.integers(2) else ""}.get(clock, "")
            made.append(Column(key, named(key, unit if key == "time" else "", style), "", cells))
    state = axes.pick("work state", ["none", "In/Out", "1/0", "On/Off", "width 0"] if form in TABLES
                      else ["none", "1/0", "width 0"])  # fmt: skip
    width = np.where(records.up, 0.0, records.width) if state == "width 0" else records.width
    course = (90 - np.degrees(records.course + axes.chosen["turn"])) % 360
    numbers = {"speed": records.v, "distance": records.way,
               "duration": np.full(len(lon), axes.chosen["interval"]),
               "elevation": 120 + 0.01 * records.x + 0.02 * records.y + rng.normal(0, 0.02, len(lon)),
               "course": course}  # fmt: skip
    made += [
        column(axes, key, numbers[key], crop, must_say=clock == "none")
        for key, is_there in has.items()
        if is_there
    ]
    made += [column(axes, "width", width, crop), column(axes, "moisture", records.moisture, crop)]
    kinds = axes.pick("grain", ["flow", "yield", "dry_yield", "flow, yield beside", "yield, flow beside",
                                "yield, dry beside"])  # fmt: skip
    shown = grains(records, crop)
    wanted = [
        k.replace("dry", "dry_yield") if k == "dry" else k for k in kinds.replace(" beside", "").split(", ")
    ]
    made += [column(axes, key, shown[key], crop, must_say=form in MEASURED) for key in wanted]
    if state in ("In/Out", "On/Off"):
        down, up = state.split("/")
        made.append(Column("work", named("work", "", style), "", np.where(records.up, up, down).tolist()))
    elif state == "1/0":
        made.append(Column("work", named("work", "", style), "", np.where(records.up, 0.0, 1.0)))
    if form in TABLES:
        if len(np.unique(records.machine)) > 1:
            made.append(
                Column("machine", named("machine", "", style), "", [f"C{m + 1}" for m in records.machine])
            )
        if axes.chosen.get("sections"):
            made.append(Column("section", named("section", "", style), "", records.part.astype(float)))
    how["crop"] = _say_crop(axes, made, len(lon))
    made = [made[i] for i in rng.permutation(len(made))]
    if form == "csv":
        how["separator"] = {"tab": "\t"}.get(s := axes.pick("separator", [",", ";", "tab"]), s)
        how["comma"] = how["separator"] == ";" and bool(rng.integers(2))
        axes.usual += ["decimal commas"] if how["comma"] else []
        how["encoding"] = axes.pick("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
    elif form == "mf4":
        how["rates"] = axes.pick("groups", ["one", "other rates"]) != "one"
    return Sheet(made, records.t, lon, lat, how)


def _say_crop(axes: Axes, made: list[Column], count: int) -> str:
    """How the log says its crop; the name that it has in task data."""
    form, crop = axes.chosen["format"], axes.chosen["crop"]
    ways = ["its name", "its name in German", "the file's name"]
    ways = ways[2:] if form in MEASURED else ways[:2] if form == "isoxml" else ways
    way = axes.pick("crop said", [*ways, "not at all"] if crop == "wheat" else ways)
    axes.chosen["file"] = f"{crop}-north" if way == "the file's name" else "north"
    if "name" not in way or way == "the file's name":
        return ""
    name = CROPS[crop][4]["German" in way]
    if form in TABLES:
        made.append(Column("crop", named("crop", "", axes.chosen["names"]), "", [name] * count))
    return name


# ---- unusual traits


@dataclass(frozen=True)
class Trait:
    """An unusual trait. kind: of two of a kind only one is drawn; keys: that may tell it; fits: whether a job
    can have it; make: changes the job. A trait of the records is made before the columns are.
    """

    kind: str
    keys: str
    fits: Callable[[Job], bool]
    make: Callable[[Job], None]


def _stamped(job: Job) -> bool:
    """Time and order of the rows can be told from what the table holds beside positions."""
    return job.has("time") and job.is_("clock", "seconds", "ISO")


def _times(job: Job) -> bool:
    return _stamped(job) and job.is_("format", *TABLES)


def _of_tables(job: Job) -> bool:
    return job.is_("format", *TABLES)


def _paced(job: Job) -> bool:
    """Something says how far it is from one record to the next."""
    is_timed = job.has("time") or job.has("duration") or not _of_tables(job)
    return job.has("distance") or (job.has("speed") and is_timed)


def _restamp(job: Job, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Other times in the column of the clock."""
    column = job.sheet.of("time")
    assert column is not None
    begun = float(column.values[0]) - job.sheet.time[0] if job.is_("clock", "seconds") else 0.0
    column.values = stamps(job.axes.chosen["clock"], change(job.sheet.time), begun)[-1][1]


def _since_last(job: Job) -> None:
    column = job.sheet.of("time")
    assert column is not None
    column.values = np.maximum(np.diff(job.sheet.time, prepend=job.sheet.time[0] - 1.0), 0.0)


def _thin(job: Job) -> None:
    interval = job.axes.chosen["interval"]
    most = min(5, int(4.9 / interval))
    number = np.unique(job.sheet.time, return_inverse=True)[1]
    index = np.flatnonzero(number % int(job.rng.integers(2, most + 1)) == 0)
    job.records = job.records.take(index)
    job.sheet.rows(index)


def _restart(job: Job) -> None:
    at = int(job.rng.uniform(0.3, 0.7) * len(job.sheet)) // 2 * 2
    if job.is_("format", "asc"):
        job.sheet.how["blocks"] = at
    else:
        t = job.sheet.time
        _restamp(job, lambda _: np.where(np.arange(len(t)) < at, t, t - t[at] + t[0]))


def _set_back(job: Job) -> None:
    at, back = int(job.rng.uniform(0.3, 0.7) * len(job.sheet)), job.axes.within(40, 400)
    t = job.sheet.time
    _restamp(job, lambda _: np.where(np.arange(len(t)) < at, t, t - round(back)))


def _shuffle(job: Job) -> None:
    index = job.rng.permutation(len(job.sheet))
    job.records = job.records.take(index)
    job.sheet.rows(index)
    job.is_known &= job.has("time")


def _copy(job: Job) -> None:
    count = len(job.sheet)
    a = int(job.rng.uniform(0, 0.5) * count)
    again = np.arange(a, a + int(job.rng.uniform(0.25, 0.5) * count))
    index = np.repeat(np.arange(count), 2) if job.rng.integers(2) else np.r_[np.arange(count), again]
    job.records = job.records.take(index)
    job.sheet.rows(index)


def _second(job: Job, key: str, factor: float, name: str = "", noise: float = 0.0) -> None:
    """One more source of a quantity, in another unit where it is a column of a table."""
    first = job.sheet.of(key)
    assert first is not None
    values = first.values * factor * (1 + noise * job.rng.standard_normal(len(first.values)))
    if job.is_("format", *MEASURED):
        job.sheet.how["second"] = [(first, values)]
        return
    other = Column(key, "", "", values)
    unit = job.axes.chosen[f"unit of {key}"]
    style = job.axes.chosen["names"]
    other.name = named(key, unit, style if style == "short" else "English", name or OTHER_NAMES[key])
    at = int(job.rng.integers(len(job.sheet.columns) + 1))
    job.sheet.columns.insert(at, other)


def _may_repeat(job: Job) -> bool:
    """The format can hold one quantity twice, under names that say it in full."""
    return not job.is_("format", "isoxml", "shapefile")


def _grain(job: Job) -> str:
    """The only column of grain; empty where there are two."""
    keys = [c.key for c in job.sheet.columns if c.key in ("flow", "yield", "dry_yield")]
    return keys[0] if len(keys) == 1 else ""


def _differs(job: Job) -> None:
    _second(job, _grain(job), float(job.rng.choice([job.axes.within(0.3, 0.9), job.axes.within(1.12, 1.7)])))
    job.is_known = False


def _average(job: Job) -> None:
    _second(job, "yield", 0.0, "Average Yield")
    other = next(c for c in job.sheet.columns if c.name.startswith("Average"))
    count = len(other.values)
    other.values = job.sheet.of("yield").values.mean() * (0.6 + 0.2 * np.arange(count) / count)  # type: ignore[union-attr]
    job.sheet.columns.remove(other)
    job.sheet.columns.insert(0, other)


def _swap(job: Job, one: str, other: str) -> None:
    if job.is_("format", "shapefile", "geojson", "isoxml"):
        job.sheet.lon, job.sheet.lat = job.sheet.lat, job.sheet.lon
        return
    a, b = job.sheet.of(one), job.sheet.of(other)
    assert a is not None
    assert b is not None
    a.values, b.values = b.values, a.values


def _tear(job: Job, part: str = ".shp") -> None:
    share = job.axes.within(0.6, 0.92)
    job.sheet.how |= {"torn": share, "torn_part": part}
    job.area = None
    job.is_known &= job.is_("format", "csv") and not job.sheet.how.get("packed")
    job.records = job.records.take(np.arange(len(job.records.t)) < share * len(job.records.t))


def _again(job: Job) -> None:
    job.sheet.how |= {"again": int(job.rng.integers(30, len(job.sheet))), "total": bool(job.rng.integers(2))}


def _parts(job: Job, shares: Sequence[float]) -> None:
    """A row for each part of the header, without a column that says so."""
    job.sheet.rows(np.repeat(np.arange(len(job.sheet)), len(shares)))
    _scale(job, ("width", "flow"), np.tile(shares, len(job.records.t)))
    job.records = in_parts(job.records, shares)
    at = places(job.records, job.axes)
    job.sheet.lon, job.sheet.lat = at[:2]
    for c in job.sheet.columns:
        if c.key in ("lon", "lat", "easting", "northing"):
            c.values = at[("lon", "lat", "easting", "northing").index(c.key)]


def _drop(job: Job, key: str) -> None:
    job.sheet.columns = [c for c in job.sheet.columns if c.key != key]


def _scale(job: Job, keys: Sequence[str], factor: Any) -> None:
    for c in job.sheet.columns:
        if c.key in keys and c.is_number:
            c.values = c.values * factor


def _wrong_width(job: Job) -> None:
    factor = float(job.rng.choice([job.axes.within(0.55, 0.88), job.axes.within(1.15, 1.5)]))
    _scale(job, ("width",), factor)
    _scale(job, ("yield", "dry_yield"), 1.0 / factor)  # as a monitor makes it
    job.is_known = False


def _uncalibrated(job: Job) -> None:
    factor = float(job.rng.choice([job.axes.within(0.65, 0.82), job.axes.within(1.22, 1.5)]))
    _scale(job, ("flow", "yield", "dry_yield"), np.where(job.records.machine == 0, factor, 1.0))
    job.is_known = False


def _poor(job: Job) -> None:
    low = CROPS[job.axes.chosen["crop"]][3][0]
    factor = job.axes.within(0.05, 0.12) * low / (10 * float(np.nanmean(job.records.wet)))
    _scale(job, ("flow", "yield", "dry_yield"), factor)
    job.records.wet = job.records.wet * factor


def _bad(job: Job, share: float, key: str, value: float) -> None:
    c = job.sheet.of(key)
    assert c is not None
    c.values = np.where(job.rng.random(len(job.sheet)) < share, value, c.values)


def _words(job: Job) -> None:
    c = job.sheet.of(_main(job))
    assert c is not None
    bad = job.rng.random(len(job.sheet)) < job.axes.within(0.03, 0.15)
    if job.is_("format", "mf4"):
        job.sheet.how["words"] = c.key
    else:
        c.values = [("SNA" if wrong else f"{v:.4f}") for v, wrong in zip(c.values, bad, strict=True)]
        if job.sheet.how.get("comma"):
            c.values = [v.replace(".", ",") for v in c.values]


def _main(job: Job) -> str:
    return job.axes.chosen["grain"].split(",")[0]


def _unnamed(job: Job) -> None:
    c = job.sheet.of(_main(job))
    assert c is not None
    c.name, c.unit = named(c.key, "", job.axes.chosen["names"]), ""


def _no_moisture(job: Job) -> None:
    _scale(job, ("moisture",), np.arange(len(job.sheet)) < 0.66 * len(job.sheet))


def _nowhere(job: Job) -> None:
    bad = job.rng.random(len(job.sheet)) < 0.04
    job.sheet.lon, job.sheet.lat = np.where(bad, 0.0, job.sheet.lon), np.where(bad, 0.0, job.sheet.lat)
    for key in ("lat", "lon"):
        if (c := job.sheet.of(key)) is not None:
            c.values = np.where(bad, 0.0, c.values)


def _coarse(job: Job) -> None:
    for key in ("lat", "lon"):
        c = job.sheet.of(key)
        assert c is not None
        c.values = np.round(c.values, 4)
    job.is_known = False


def _slow(job: Job) -> None:
    job.sheet.how["slow"] = {"width": np.inf, "moisture": 10.0, "elevation": 5.0}


def _relative(job: Job) -> None:
    job.sheet.how["relative"] = True


def _how(job: Job, **how: Any) -> None:
    job.sheet.how |= how


def _ends_of(job: Job) -> bool:
    """A machine's times and places are its own: no sections, one machine."""
    return not job.axes.chosen.get("sections") and job.is_("machines", 1)


def _has_witness_of_speed(job: Job) -> bool:
    return job.has("speed") and (job.has("time") or not _of_tables(job))


TRAITS = {
    # who, and which part
    "two parts, equal": Trait("part", "timeline width sources", lambda j: _of_tables(j) and _ends_of(j),
                              lambda j: _parts(j, (0.5, 0.5))),
    "two parts, unequal": Trait("part", "timeline width sources", lambda j: _of_tables(j) and _ends_of(j),
                                lambda j: _parts(j, (2 / 3, 1 / 3))),
    "two machines, no column": Trait("part", "timeline lost calibration", lambda j: j.has("machine", "time"),
                                     lambda j: _drop(j, "machine")),
    "a machine not calibrated": Trait("part", "calibration", lambda j: j.has("machine"), _uncalibrated),
    # order and time of the rows
    "thinned": Trait("order", "timeline", lambda j: (j.has("distance") or j.has("duration")) and _ends_of(j)
                     and _of_tables(j), _thin),
    "restarted": Trait("order", "timeline lost", lambda j: (_times(j) and _ends_of(j)) or j.is_("format", "asc"),
                       _restart),
    "clock set back": Trait("order", "timeline lost", lambda j: _times(j) and _ends_of(j), _set_back),
    "stamps since the last row": Trait("order", "timeline", lambda j: j.is_("clock", "seconds") and _times(j)
                                       and _ends_of(j), _since_last),
    "relative stamps": Trait("order", "timeline", lambda j: j.is_("format", "asc"), _relative),
    "rows shuffled": Trait("order", "timeline lost", _of_tables, _shuffle),
    "rows copied": Trait("order", "timeline lost", _of_tables, _copy),
    # sources
    "grain twice, alike": Trait("source", "sources", lambda j: bool(_grain(j)) and _may_repeat(j),
                                lambda j: _second(j, _grain(j), 1.0, noise=0.002)),
    "grain twice, differs": Trait("source", "sources", lambda j: bool(_grain(j)) and _may_repeat(j),
                                  _differs),
    "width twice, alike": Trait("source", "sources width", _may_repeat,
                                lambda j: _second(j, "width", 1.0)),
    "width twice, differs": Trait("source", "sources width", _may_repeat,
                                  lambda j: _second(j, "width", j.axes.within(0.5, 0.9))),
    "average yield beside": Trait("source", "sources", lambda j: j.has("yield") and _of_tables(j)
                                  and not j.is_("format", "shapefile"), _average),
    "all on two buses": Trait("source", "sources", lambda j: j.is_("format", "asc", "blf"), lambda j: _how(
        j, second=[(c, c.values) for c in j.sheet.columns if c.is_number])),
    "a second receiver": Trait("source", "sources", lambda j: j.is_("format", *MEASURED), lambda j: _how(
        j, second=[(c, c.values + 1.5e-5) for c in j.sheet.columns if c.key in ("lat", "lon")])),
    # place
    "lat and lon swapped": Trait("place", "place", lambda j: j.is_("coordinates", "lat lon") and _paced(j),
                                 lambda j: _swap(j, "lat", "lon")),
    "north first": Trait("place", "place", lambda j: j.has("easting"),
                         lambda j: _swap(j, "easting", "northing")),
    "positions of 0": Trait("place", "place lost", lambda j: j.is_("coordinates", "lat lon"), _nowhere),
    "4 decimals": Trait("place", "place", lambda j: j.has("lat") and j.is_("format", "csv"), _coarse),
    # file
    "torn": Trait("file", "damaged lost", lambda j: True, _tear),
    "table shorter": Trait("file", "damaged lost", lambda j: j.is_("format", "shapefile"),
                           partial(_tear, part=".dbf")),
    "header again": Trait("file", "damaged lost", lambda j: j.is_("format", "csv"), _again),
    "slow channels": Trait("file", "lost sources", lambda j: j.is_("format", "mf4"), _slow),
    "channels invalid in part": Trait("file", "lost", lambda j: j.is_("format", "mf4"),
                                      lambda j: _how(j, invalid=("moisture", "elevation"))),
    "DBC in UTF-8": Trait("file", "damaged", lambda j: j.is_("format", "asc", "blf"),
                          lambda j: _how(j, comment="angles in °, temperatures in °C")),
    # numbers
    "width set wrong": Trait("width", "width", lambda j: True, _wrong_width),
    "speed in another unit": Trait("speed", "plausible timeline", _has_witness_of_speed,
                                   lambda j: _scale(j, ("speed",), 3.6)),
    "speed dead": Trait("speed", "plausible timeline", _has_witness_of_speed,
                        lambda j: _scale(j, ("speed",), 0.0)),
    "grain without its unit": Trait("unit", "yield plausible columns unit",
                                    lambda j: not j.is_(f"unit of {_main(j)}", "kg/s", "kg/ha"), _unnamed),
    "hardly any grain": Trait("level", "yield", lambda j: True, _poor),
    "no moisture in a third": Trait("moisture", "moisture plausible lost",
                                    lambda j: not j.is_("grain", "dry_yield"), _no_moisture),
    "-999 in the grain": Trait("bad", "lost plausible", lambda j: True,
                               lambda j: _bad(j, 0.06, _main(j), -999.0)),
    "SNA in words": Trait("bad", "lost plausible", lambda j: j.is_("format", "csv", "mf4"), _words),
}  # fmt: skip
"""Unusual traits by name."""
WEIGHTS = {"order": 3.0, "part": 3.0, "source": 1.5, "place": 1.0, "file": 1.0}
"""How often a kind is drawn, 0.5 where it is not named: some fit few logs, some all."""


# ---- the draw


def draw(seed: int, held_out: bool = False) -> Drawn:
    """A log. held_out: at least one value that is kept for the judge."""
    for attempt in range(100):
        axes = Axes(seed, attempt, held_out)
        drawn = _draw(seed, axes)
        if not held_out or axes.uses_held_out:
            return drawn
    raise AssertionError(seed)


def _draw(seed: int, axes: Axes) -> Drawn:
    form = axes.pick("format", ["csv", "csv, packed", "shapefile", "geojson", "isoxml", "mf4", "asc", "blf"],
                     [6, 1, 3, 1.5, 2, 2, 1.5, 1])  # fmt: skip
    axes.chosen["format"] = form.partition(",")[0]
    crop = axes.pick("crop", list(CROPS), [4, 1, 2, 1, 1, 1])
    axes.chosen["moisture"] = axes.within(*CROPS[crop][2]) / 100
    records, truth = harvest(axes)
    if axes.chosen["format"] in TABLES and axes.chosen["machines"] == 1:
        count = axes.pick("sections", [0, 3, 4], [6, 1, 1])
        records = in_parts(records, [1 / count] * count) if count else records
    sheet = columns(axes, records)
    sheet.how["packed"] = form == "csv, packed"
    job = Job(axes, records, sheet, truth["area"])
    unusual = _traits(job) if seed % 3 else []
    wet = job.records.wet[np.isfinite(job.records.wet)]
    true = {"yield_t_ha": Truth(10.0 * float(wet.mean()))}
    if job.area is not None:
        true["area_ha"] = Truth(job.area, absolute=0.03 * job.area + truth["slack"])
    counts = {"unaccounted": 0}
    if not job.sheet.how.keys() & {"torn", "again"}:
        counts["records"] = len(job.sheet)
    return Drawn(
        seed, partial(_write, job), true if job.is_known else {},
        frozenset(key for name in unusual for key in TRAITS[name].keys.split()), counts, tuple(axes.usual),
        tuple(unusual),
        claims={"delay_s": Truth(truth["delay"], absolute=max(1.5, 1.2 * axes.chosen["interval"]))},
        allowed=frozenset({"delay"}),
    )  # fmt: skip


def _traits(job: Job) -> list[str]:
    """One to three unusual traits of different kinds, made in the order of TRAITS."""
    most, made = int(job.rng.integers(1, 4)), list[str]()
    names = job.axes.allowed("unusual", list(TRAITS))
    late = [job.rng.exponential() / WEIGHTS.get(TRAITS[name].kind, 0.5) for name in names]
    for _, name in sorted(zip(late, names, strict=True)):
        is_new = TRAITS[name].kind not in {TRAITS[other].kind for other in made}
        if len(made) < most and is_new and TRAITS[name].fits(job):
            job.axes.uses_held_out |= name in HELD_OUT["unusual"]
            made.append(name)
    made.sort(key=list(TRAITS).index)
    for name in made:
        TRAITS[name].make(job)
    return made


def _write(job: Job, folder: Path) -> tuple[Path, Path | None]:
    """The log, and the map of its columns."""
    path = WRITERS[job.axes.chosen["format"]](folder, job.sheet, job.axes.chosen["file"])
    if "crs" not in job.sheet.how:
        return path, None
    given = folder / "columns.yaml"
    given.write_text(f"crs: {job.sheet.how['crs']}\n")
    return path, given


def read(given: tuple[Path, Path | None], out: Path) -> Got:
    """What an import makes of a log."""
    from swath.field_io.importer import import_log

    log, columns = given
    report = import_log(log, out, columns=columns, progress=False)
    rows = report.rows
    left = rows["read"] - sum(rows["broken"].values()) - sum(report.removed.values()) - report.kept
    delays = [m["flow_delay_s"] for m in report.machines if m["kept"]]
    return Got(
        {"yield_t_ha": report.crop["yield_t_ha"], "area_ha": report.field["area_ha"]}, report.notes,
        {"records": rows["read"], "unaccounted": left}, {"delay_s": delays},
    )  # fmt: skip
