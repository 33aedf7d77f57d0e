"""The columns of a drawn log: which quantities it holds, in which units, under which names."""

from datetime import timedelta
from typing import Any

import numpy as np

from tests.readers.harvests import CROPS, MEASURED, PLACES, TABLES, Axes, Records, places
from tests.readers.log_files import BEGUN, Column, Sheet

FT, LB, ACRE, MPH = 0.3048, 0.45359237, 4046.8564224, 0.44704
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
    clocks = ["seconds", "ISO", "ms since 1970"]
    clocks += [] if axes.chosen.get("sections") else ["none"]  # who writes sections writes when
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
    elif form == "isoxml":
        how["logs"] = axes.pick("time logs", [1, 2])
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
