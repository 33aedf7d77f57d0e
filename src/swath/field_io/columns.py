"""Which column of a yield log is which quantity, and in which unit.

Known logs are recognised by their headers; for others the usual names are tried, in English, German and
French; a map file completes that by hand, null drops a quantity:

    crs: EPSG:32612                               # only for easting and northing
    lat: {column: Latitude, unit: deg}
    grain_flow: {column: "Flow (lb/s)", unit: lb/s}
    time: null
"""

import difflib
import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from swath.core import units
from swath.core.errors import InputError
from swath.core.units import ACRE, DEG, POUND, SUFFIXES, factors, split_unit
from swath.documents.yaml_document import Document, read_document

WHEAT_LB_PER_BUSHEL = 60.0  # legal weight of a bushel of wheat in the USA; other crops: trade.py

UNITS: dict[str, dict[str, float]] = {
    **{kind: factors(kind) for kind in ("length", "speed", "time", "mass flow", "rotation", "volume flow")},
    "degrees": {symbol: factor / DEG for symbol, factor in factors("angle").items()},
    "yield": {**factors("mass per area"), "bu/ac": WHEAT_LB_PER_BUSHEL * POUND / ACRE},
    "share": {"%": 0.01, "1": 1.0},
    "number": {"1": 1.0},
    "curvature": {"1/m": 1.0, "1/km": 1e-3},
    "text": {"text": 1.0},
}
"""Factor from each unit to the one used inside: m, m/s, s, deg, kg/s, kg/m2, share, rad/s, m3/s."""

QUANTITIES: dict[str, str] = {
    "lat": "degrees",
    "lon": "degrees",
    "easting": "length",
    "northing": "length",
    "elevation": "length",
    "machine": "text",
    "crop": "text",
    "section": "text",
    "date": "text",
    "time": "time",
    "duration": "time",
    "record": "number",
    "speed": "speed",
    "distance": "length",
    "header_width": "length",
    "grain_flow": "mass flow",
    "yield": "yield",
    "dry_yield": "yield",
    "moisture": "share",
    "work_state": "text",
    "crop_height": "length",
    "engine_load": "share",
    "engine_speed": "rotation",
    "fuel": "volume flow",
    "steer_command": "degrees",
    "command_curvature": "curvature",
    "steer_angle": "degrees",
    "yaw_rate": "rotation",
    "engaged": "number",
    "pass": "text",
}
"""Canonical name -> kind of unit. work_state: a word that says whether the header works ('In', 'On', '1');
section: of the header, each with a record of its own; yield: as harvested; dry_yield: at the moisture of the
trade. steer_command: wanted angle of the steered axle, command_curvature: of the wanted path, both > 0 left.
"""
_FLOWS = ("grain_flow", "yield", "dry_yield")  # the first one that a log has counts


@dataclass(frozen=True)
class Column:
    """A column of the file and the unit its numbers have; is_assumed: nothing in the file says the unit."""

    column: str
    unit: str
    is_assumed: bool = False


@dataclass(frozen=True)
class ColumnMap:
    """Canonical name -> column. profile: how it was found. crs: of easting and northing, '' = not stated."""

    columns: dict[str, Column]
    profile: str
    crs: str = ""


def _profile(name: str, **columns: str) -> ColumnMap:
    split = {key: value.rsplit(" ", 1) for key, value in columns.items()}
    return ColumnMap({key: Column(column, unit) for key, (column, unit) in split.items()}, name)


PROFILES = (
    _profile(
        "SI log with machines", lat="lat deg", lon="lon deg", elevation="z_m m", machine="machine text",
        record="k_s 1", duration="dt_s s", speed="speed_m_s m/s", distance="dist_m m",
        header_width="swath_m m", grain_flow="grain_flow_kg_s kg/s", moisture="moisture_pct %",
    ),
    _profile(
        "SI log with time", lat="lat deg", lon="lon deg", elevation="z_m m", time="t_s s", record="id 1",
        distance="dist_m m", header_width="swath_m m", grain_flow="grain_flow_kg_s kg/s",
        moisture="moisture_pct %",
    ),
    _profile(
        "US point shapefile, short names", elevation="elevtn_ ft", machine="dataset text", record="obj__id 1",
        duration="durtn_s s", speed="spd_mp_ mph", distance="dstnc_f ft", header_width="swth_w_ ft",
        grain_flow="crp_flw_m lb/s", moisture="mostr__ %", work_state="wrk_stt text",
    ),
    _profile(
        "John Deere Operations Center", distance="DISTANCE ft", header_width="SWATHWIDTH ft",
        **{"yield": "WetMass lb/ac"}, moisture="Moisture %",
    ),
    _profile(
        "short names, US units", lon="long deg", lat="lat deg", grain_flow="mass lb/s", time="time s",
        duration="seconds s", distance="dist in", moisture="moist %", elevation="elev ft",
    ),
)  # fmt: skip
"""Logs recognised when every one of their columns is in the header; the rest goes by usual names."""
_FEET_PROFILE = "John Deere Operations Center"  # heights without a unit are in feet

AG_LEADER = (
    "Longitude", "Latitude", "Flow(lb/s)", "Time(s)", "Interval(s)", "Distance(in)", "Swath(in)",
    "Moisture(%)", "Header status", "Pass", "Serial", "Field", "Load", "Crop", "GPS status", "PDOP",
    "Elevation(ft)",
)  # fmt: skip
"""Columns of the Ag Leader advanced format, which has no header line: Ag Leader, GPS 2100 Operators Manual,
1998, page 8-7. Units as the yield monitors of that maker log them."""

_USUAL: dict[str, tuple[str, tuple[str, ...]]] = {
    "lat": ("deg", (r"(gps_?)?lat(itude)?", r"lat(itude)?_?wgs_?84|y_?wgs84", r"(geogr\w*_)?breite(ngrad)?")),
    "lon": (
        "deg",
        (r"lon|(gps_?)?long?(itude)?|lng", r"(lng|long?(itude)?)_?wgs_?84|x_?wgs84",
         r"(geogr\w*_)?laenge(ngrad)?"),
    ),
    "easting": ("m", (r"e|east|easting|utm_?e(ast(ing)?)?|x_?utm|rechtswert",)),
    "northing": ("m", (r"n|north|northing|utm_?n(orth(ing)?)?|y_?utm|hochwert",)),
    "elevation": (
        "m", (r"z|elev|elevation|alt|altitude|height_?(msl|above_?sea_?level)|hoehe(_?ue?_?nn)?",)
    ),
    "machine": (
        "text",
        (r"machine|machine_?id|vehicle|vehicle_?id|combine|harvester|maschine|maehdrescher|moissonneuse",
         r"(machine_?)?serial(_?(no|number))?|seriennummer"),
    ),
    "crop": (
        "text",
        (r"crop(_?(name|type))?|grain(_?type)?|commodity|fruchtart|frucht|kultur|culture|espece", r"product"),
    ),
    "section": ("text", (r"section_?id|section",)),
    "date": ("text", (r"date|gps_?date|date_?utc|utc_?date|datum",)),
    "time": (
        "s",
        (r"iso_?time|time_?stamp(_?utc)?|date_?time(_?utc)?|zeitstempel|horodatage",
         r"t|time|gps_?time|utc(_?time)?|time_?utc|uhrzeit|zeit|heure", r"seconds|elapsed(_?time)?"),
    ),
    "duration": ("s", (r"dt|duration|interval|cycle(_?time)?|log(ging)?_?interval", r"seconds")),
    "record": ("1", (r"record|id|obj_?_?id|objectid|fid|counter|k",)),
    "speed": ("m/s", (r"v|speed|velocity|ground_?speed|vehicle_?speed|geschwindigkeit|vitesse",)),
    "distance": ("m", (r"dist|distance|strecke",)),
    "header_width": (
        "m",
        (r"swath|sw(a)?th_?wi?dth|header_?width|cut(ting)?_?width|work(ing)?_?width|width|schnittbreite"
         r"|arbeitsbreite|schneidwerksbreite|largeur(_?de_?(coupe|travail))?", r"breite"),
    ),
    "grain_flow": (
        "kg/s",
        (r"flow|grain_?flow|mass_?flow|crop_?flow|crop_flw(_m)?|throughput|grain_?mass_?flow|durchsatz"
         r"|korn(massen)?strom|massenstrom|debit(_?grain)?",),
    ),
    "yield": (
        "kg/ha",
        (r"(yield|yld)_?(wet|mass|wet_?mass|(mass|vol)_?wet)|wet_?yield|yield_?wet|wet_?mass", r"yield|yld",
         r"(korn|nass|feucht)?ertrag(_?(feucht|nass))?|rendement"),
    ),
    "dry_yield": (
        "kg/ha",
        (r"dry_?(mass_?|vol(ume)?_?)?yield|(yield|yld)_?((mass|vol)_?)?dry(_?vol(ume)?|_?mass)?|vryieldmass",
         r"vryieldvol|yield_?vol(ume)?", r"trockenertrag|ertrag_?trocken"),
    ),
    "moisture": (
        "%", (r"(grain_?)?moisture|moist|water_?content|(korn)?feucht(e|igkeit)|humidite(_?grain)?",)
    ),
    "work_state": ("text", (r"work_?state|header_?(state|status|up|down)|recording|arbeitsstellung",)),
    "crop_height": ("m", (r"crop_?height|canopy_?height|plant_?height|bestandeshoehe",)),
    "engine_load": ("%", (r"engine_?(load|torque)|(engine_?)?percent_?(load|torque)",)),
    "engine_speed": ("rpm", (r"engine_?(speed|rpm)",)),
    "fuel": ("l/h", (r"fuel(_?(rate|flow|consumption))?",)),
    "steer_command": (
        "deg",
        (r"steer(ing)?(_?angle)?_?(command|cmd|set_?point|target|wanted)|lenkwinkel_?soll|soll_?lenkwinkel"
         r"|(commanded|wanted|target)_?steer(ing)?(_?angle)?",),
    ),
    "command_curvature": ("1/m", (r"(command|cmd|wanted|target)(ed)?_?curvature|curvature_?(command|cmd)",)),
    "steer_angle": ("deg", (r"steer(ing)?(_?angle)?(_?(actual|measured))?|wheel_?angle|lenkwinkel(_?ist)?",)),
    "yaw_rate": ("deg/s", (r"yaw_?rate|turn_?rate|gier(rate|geschwindigkeit)|vitesse_?(de_?)?lacet",)),
    "engaged": ("1", (r"(steering_?|auto_?steer_?)?(engaged|active)|auto_?steer(ing)?(_?on)?",)),
    "pass": ("text", (r"pass(_?(id|no|number))?|ueberfahrt|passage",)),
}  # fmt: skip
"""Canonical -> unit without one in the name, and patterns on the bare lower-case name, the best first."""
_BESIDE = ("crop", "section", "date", "engine_load", "engine_speed", "fuel")  # what known logs may also hold
_BUSHELS = r"vryieldvol|yield_?vol(ume)?"  # without a unit these are bushels
_WORDS = ("machine", "crop", "section", "date", "time", "work_state", "pass")  # brackets in them: no units
_LOG_SUFFIXES = {
    "ms": "m/s", "km_h": "km/h", "kph": "km/h", "kn": "kn", "sec": "s", "kgs": "kg/s", "th": "t/h",
    "lbs_s": "lb/s", "kgha": "kg/ha", "tha": "t/ha", "lbs_ac": "lb/ac", "bu_ac": "bu/ac", "buac": "bu/ac",
    "pct": "%", "percent": "%", "lh": "l/h", "dt_ha": "dt/ha", "lb_sec": "lb/s", "1_m": "1/m", "1_km": "1/km",
}  # fmt: skip
"""Further ends of names in logs; `ms` and `kn` are not what they are in keys."""
_SYMBOLS = {symbol for kind in UNITS.values() for symbol in kind}
_ENDS = sorted(
    {s for s in SUFFIXES if units.UNITS[s].symbol in _SYMBOLS} | {*_LOG_SUFFIXES}, key=len, reverse=True
)


class ColumnsMissing(InputError):
    """The header lacks what an import needs. template: a map with a place for each, to be filled in."""

    template: str


def find_columns(
    header: Sequence[str],
    path: Path,
    columns: Path | None,
    has_points: bool,
    *,
    units: Mapping[str, str] | None = None,
    needs_width: bool = False,
) -> ColumnMap:
    """The column map for a header: a known log, else the usual names; the map file completes it.

    has_points: positions come from the geometry (shapefile), no column has to give them
    units: column -> unit, where the log says so beside its table
    Raises ColumnsMissing, which names everything that no column gives: positions, grain flow or yield and,
    if needed, the width of the header.
    """
    known = (p for p in PROFILES if all(c.column in header for c in p.columns.values()))
    base = next((p for p in known if has_points or "lat" in p.columns), None)
    given, dropped, crs = ({}, set(), "") if columns is None else read_map(columns, header)
    taken = {c.column for c in (*given.values(), *(base.columns if base else {}).values())}
    rest = guess([name for name in header if name not in taken], path).columns
    if base is not None and base.profile == _FEET_PROFILE:
        feet = {k: replace(c, unit="ft") for k, c in rest.items() if k == "elevation" and c.is_assumed}
        rest = {k: c for k, c in rest.items() if k not in _FLOWS} | feet
    elif base is not None:
        rest = {k: c for k, c in rest.items() if k in _BESIDE}
    found = {**rest, **(base.columns if base else {})}
    for alike in (_FLOWS, ("lat", "lon", "easting", "northing")):
        if set(alike) & given.keys():
            found = {k: c for k, c in found.items() if k not in alike}
    found = {k: c for k, c in {**found, **given}.items() if k not in dropped}
    flow = next((key for key in _FLOWS if key in found), None)
    found = {k: c for k, c in found.items() if k not in _FLOWS or k == flow}
    stated = {k: (units or {}).get(c.column, "") for k, c in found.items() if k not in given}
    found |= {k: Column(found[k].column, u) for k, u in stated.items() if u in UNITS[QUANTITIES[k]]}
    name = base.profile if base else "usual names"
    _require(found, header, path, has_points, needs_width)
    return ColumnMap(found, name if columns is None else f"map {columns.name}, {name}", crs)


def guess(header: Sequence[str], path: Path) -> ColumnMap:
    """Columns by their usual names; a unit in the name ('speed_kmh', 'Flow (lb/s)') wins over the default.

    Raises InputError for a unit in brackets that is not known.
    """
    found: dict[str, Column] = {}
    free = {name: _split_unit(name) for name in header}
    for key, (default, patterns) in _USUAL.items():
        for pattern in patterns:
            name = next((n for n, split in free.items() if _fits(key, pattern, *split, n, path)), None)
            if name is not None:
                bare, unit = free.pop(name)
                kinds = UNITS[QUANTITIES[key]]
                assumed = "bu/ac" if re.fullmatch(_BUSHELS, bare) else default
                is_assumed = unit not in kinds and len(kinds) > 1
                found[key] = Column(name, unit if unit in kinds else assumed, is_assumed)
                break
    return ColumnMap(found, "usual names")


def _fits(key: str, pattern: str, bare: str, unit: str | None, name: str, path: Path) -> bool:
    if not re.fullmatch(pattern, bare):
        return False
    kinds = UNITS[QUANTITIES[key]]
    if unit is None or unit in kinds or key in _WORDS:
        return True
    if key in (*_FLOWS, "header_width", "speed") and not any(unit in known for known in UNITS.values()):
        raise InputError(f"unit of {name!r}", unit, f"expected one of {', '.join(kinds)}", file=path)
    return False


def read_map(path: Path, header: Sequence[str]) -> tuple[dict[str, Column], set[str], str]:
    """Columns of a YAML file, what it drops (null), and its crs; all is checked. Raises InputError."""
    document = read_document(path)
    raw = document.data
    if not isinstance(raw, dict) or not raw:
        raise InputError("columns", raw, "expected canonical names, each with a column and a unit", file=path)
    crs = raw.get("crs", "")
    if not isinstance(crs, str):
        raise document.error(("crs",), crs, "expected text like EPSG:32612")
    entries = {key: value for key, value in raw.items() if key != "crs"}
    found = {key: _entry(key, value, header, document) for key, value in entries.items()}
    return (
        {key: column for key, column in found.items() if column is not None},
        {key for key, column in found.items() if column is None},
        crs,
    )


def _entry(key: str, value: object, header: Sequence[str], document: Document) -> Column | None:
    if key not in QUANTITIES:
        near = difflib.get_close_matches(key, QUANTITIES, 1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        expected = f"expected one of {', '.join(QUANTITIES)}{hint}"
        raise InputError("column name", key, expected, file=document.file, line=document.line((key,)))
    if value is None:
        return None
    if isinstance(value, str):
        value = {"column": value}
    if not isinstance(value, dict) or not set(value) <= {"column", "unit"} or "column" not in value:
        raise document.error((key,), value, "expected {column: name, unit: unit}, or null")
    column, unit = str(value["column"]), str(value.get("unit", _USUAL[key][0]))
    if column not in header:
        near = difflib.get_close_matches(column, header, 1)
        hint = f", nearest is {near[0]!r}" if near else ""
        raise document.error((key, "column"), column, f"expected a column of the log{hint}")
    known = UNITS[QUANTITIES[key]]
    if unit not in known:
        raise document.error((key, "unit"), unit, f"expected one of {', '.join(known)}")
    return Column(column, unit)


def _require(
    found: Collection[str], header: Sequence[str], path: Path, has_points: bool, needs_width: bool
) -> None:
    shown = ", ".join(h[:24] for h in header[:12])
    missing: dict[str, tuple[str, ...]] = {}
    if not has_points and not ({"lat", "lon"} <= set(found) or {"easting", "northing"} <= set(found)):
        missing["lat and lon (or easting and northing)"] = ("lat", "lon")
    if not set(_FLOWS) & set(found):
        missing["grain_flow or yield"] = ("yield",)
    if needs_width and "header_width" not in found:
        missing["header_width (or --header-width-m)"] = ("header_width",)
    if missing:
        units = {"yield": "t/ha"}
        keys = [key for group in missing.values() for key in group]
        lines = [f'{key}: {{column: "?", unit: {units.get(key, _USUAL[key][0])}}}' for key in keys]
        is_map = list(missing.values()) == [("header_width",)] and "yield" in found
        hint = "--as map takes yields in any order; " if is_map else ""
        error = ColumnsMissing(
            "log.header", shown,
            f"expected columns for {', '.join(missing)}; {hint}say which with --columns MAP.yaml, in it "
            f"lines like {lines[-1].replace(chr(34) + '?' + chr(34), 'Name')}", file=path,
        )  # fmt: skip
        names = "\n".join(f"#   {name}" for name in header[:100])
        error.template = f"# which column of {path.name} is what; its columns:\n{names}\n" + "\n".join(lines)
        raise error


def unit_symbol(text: str) -> str:
    """A unit as it is written here: `lbs/ac`, `lb1ac-1`, `KPH`, `prcnt` are known spellings."""
    unit = re.sub(r"^(\w+)1\[?(\w+)\]?-1$", r"\1/\2", text.strip().lower().replace("lbs", "lb"))
    unit = unit.replace("/hr", "/h").replace("/sec", "/s").replace("/acre", "/ac").replace("to/ha", "t/ha")
    known = {"°": "deg", "arcdeg": "deg", "percent": "%", "prcnt": "%", "kph": "km/h", "kmh": "km/h",
             "mi/h": "mph", "meter": "m", "feet": "ft", "inch": "in", "sec": "s"}  # fmt: skip
    return known.get(unit, unit)


def _plain(text: str) -> str:
    """Lower case without accents; umlauts as two letters."""
    text = re.sub("[äöüß]", lambda m: {"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"}[m[0]], text.casefold())
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()


def _split_unit(name: str) -> tuple[str, str | None]:
    """('grain_flow', 'kg/s') of 'Grain_Flow_kg_s' or 'Grain flow (kg/s)'; unit None when the name has none.

    A unit in brackets that is not known stays as it is, so that the column is not taken for something else.
    """
    bracket = re.fullmatch(r"(.*?)\s*[\[(]([^)\]]*)[\])]", unicodedata.normalize("NFC", name.strip()))
    if bracket:
        return re.sub(r"[\s\-.()\[\]]+", "_", _plain(bracket[1])).strip("_"), unit_symbol(bracket[2])
    bare = re.sub(r"[\s\-./]+", "_", _plain(unicodedata.normalize("NFC", name.strip()))).strip("_")
    for end in _ENDS:
        if bare.endswith("_" + end) and len(bare) > len(end) + 1:
            return bare[: -len(end) - 1], _LOG_SUFFIXES.get(end) or split_unit(bare)[1]
    return bare, None
