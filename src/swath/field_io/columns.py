"""Which column of a yield log is which quantity, and in which unit.

Known logs are recognised by their headers; for others the usual names are tried; a map file decides
everything by hand:

    crs: EPSG:32612                               # only for easting and northing
    lat: {column: Latitude, unit: deg}
    grain_flow: {column: "Flow (lb/s)", unit: lb/s}
"""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from swath.core import units
from swath.core.errors import InputError
from swath.core.units import ACRE, DEG, POUND, SUFFIXES, factors, split_unit
from swath.documents.yaml_document import Document, read_document

WHEAT_LB_PER_BUSHEL = 60.0  # legal weight of a bushel of wheat in the USA

UNITS: dict[str, dict[str, float]] = {
    **{kind: factors(kind) for kind in ("length", "speed", "time", "mass flow", "rotation", "volume flow")},
    "degrees": {symbol: factor / DEG for symbol, factor in factors("angle").items()},
    "yield": {**factors("mass per area"), "bu/ac": WHEAT_LB_PER_BUSHEL * POUND / ACRE},
    "share": {"%": 0.01, "1": 1.0},
    "number": {"1": 1.0},
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
    "time": "time",
    "duration": "time",
    "record": "number",
    "speed": "speed",
    "distance": "length",
    "header_width": "length",
    "grain_flow": "mass flow",
    "yield": "yield",
    "moisture": "share",
    "work_state": "text",
    "crop_height": "length",
    "engine_load": "share",
    "engine_speed": "rotation",
    "fuel": "volume flow",
}
"""Canonical name -> kind of unit. work_state: a word that says whether the header works ('In', 'On', '1')."""


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
)  # fmt: skip
"""Logs recognised when every one of their columns is in the header."""

_USUAL: dict[str, tuple[str, str]] = {  # canonical -> (default unit, pattern on the bare lower-case name)
    "lat": ("deg", r"lat|latitude|y_?wgs84|gps_?lat(itude)?"),
    "lon": ("deg", r"lon|long|longitude|lng|x_?wgs84|gps_?lon(gitude)?"),
    "easting": ("m", r"e|east|easting|utm_?e(ast(ing)?)?|x_?utm"),
    "northing": ("m", r"n|north|northing|utm_?n(orth(ing)?)?|y_?utm"),
    "elevation": ("m", r"z|elev|elevation|alt|altitude|height_?(msl|above_?sea_?level)"),
    "machine": ("text", r"machine|machine_?id|vehicle|vehicle_?id|combine|harvester|serial(_?(no|number))?"),
    "time": ("s", r"t|time|gps_?time|timestamp|seconds|elapsed(_?time)?"),
    "duration": ("s", r"dt|duration|interval|cycle(_?time)?|log(ging)?_?interval"),
    "record": ("1", r"record|id|obj_?_?id|objectid|fid|counter|k"),
    "speed": ("m/s", r"v|speed|velocity|ground_?speed|vehicle_?speed"),
    "distance": ("m", r"dist|distance"),
    "header_width": ("m", r"swath|sw(a)?th_?wi?dth|header_?width|cut(ting)?_?width|working_?width|width"),
    "grain_flow": (
        "kg/s",
        r"flow|grain_?flow|mass_?flow|crop_?flow|crop_flw(_m)?|throughput|grain_?mass_?flow",
    ),
    "yield": ("kg/ha", r"yield|yld|(yield|yld)_?(wet|mass|wet_?mass|(mass|vol)_?wet)|wet_?yield"),
    "moisture": ("%", r"moisture|grain_?moisture|moist|water_?content"),
    "work_state": ("text", r"work_?state|header_?(state|status|up|down)|recording"),
    "crop_height": ("m", r"crop_?height|canopy_?height|plant_?height"),
    "engine_load": ("%", r"engine_?(load|torque)|(engine_?)?percent_?(load|torque)"),
    "engine_speed": ("rpm", r"engine_?(speed|rpm)"),
    "fuel": ("l/h", r"fuel(_?(rate|flow|consumption))?"),
}
_LOG_SUFFIXES = {
    "ms": "m/s", "km_h": "km/h", "kph": "km/h", "kn": "kn", "sec": "s", "kgs": "kg/s", "th": "t/h",
    "lbs_s": "lb/s", "kgha": "kg/ha", "tha": "t/ha", "lbs_ac": "lb/ac", "bu_ac": "bu/ac", "buac": "bu/ac",
    "pct": "%", "lh": "l/h",
}  # fmt: skip
"""Further ends of names in logs; `ms` and `kn` are not what they are in keys."""
_SYMBOLS = {symbol for kind in UNITS.values() for symbol in kind}
_ENDS = sorted(
    {s for s in SUFFIXES if units.UNITS[s].symbol in _SYMBOLS} | {*_LOG_SUFFIXES}, key=len, reverse=True
)

_NAME_IT = "; say which with --columns MAP.yaml, in it lines like {}: {{column: Name, unit: {}}}"


def find_columns(header: Sequence[str], path: Path, columns: Path | None, has_points: bool) -> ColumnMap:
    """The column map for a header: from the map file when given, else a known log, else the usual names.

    has_points: positions come from the geometry (shapefile), no column has to give them.
    Raises InputError when positions, or both grain flow and yield, have no column.
    """
    if columns is not None:
        found = read_map(columns, header)
    else:
        known = (p for p in PROFILES if all(c.column in header for c in p.columns.values()))
        found = next((p for p in known if has_points or "lat" in p.columns), None) or guess(header, path)
    _require(found, header, path, has_points)
    return found


def guess(header: Sequence[str], path: Path) -> ColumnMap:
    """Columns by their usual names; a unit in the name ('speed_kmh', 'Flow (lb/s)') wins over the default.

    Raises InputError for a unit in brackets that is not known.
    """
    found: dict[str, Column] = {}
    for name in header:
        bare, unit = _split_unit(name)
        for key, (default, pattern) in _USUAL.items():
            if key in found or not re.fullmatch(pattern, bare):
                continue
            kinds = UNITS[QUANTITIES[key]]
            if unit is None or unit in kinds:
                found[key] = Column(name, unit or default, is_assumed=unit is None and len(kinds) > 1)
                break
            if not any(unit in known for known in UNITS.values()):
                raise InputError(f"unit of {name!r}", unit, f"expected one of {', '.join(kinds)}", file=path)
    return ColumnMap(found, "usual names")


def read_map(path: Path, header: Sequence[str]) -> ColumnMap:
    """Column map from a YAML file; every name, column and unit is checked. Raises InputError."""
    document = read_document(path)
    raw = document.data
    if not isinstance(raw, dict) or not raw:
        raise InputError("columns", raw, "expected canonical names, each with a column and a unit", file=path)
    crs = raw.get("crs", "")
    if not isinstance(crs, str):
        raise document.error(("crs",), crs, "expected text like EPSG:32612")
    found = {key: _entry(key, value, header, document) for key, value in raw.items() if key != "crs"}
    return ColumnMap(found, f"map {path.name}", crs)


def _entry(key: str, value: object, header: Sequence[str], document: Document) -> Column:
    if key not in QUANTITIES:
        near = difflib.get_close_matches(key, QUANTITIES, 1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        expected = f"expected one of {', '.join(QUANTITIES)}{hint}"
        raise InputError("column name", key, expected, file=document.file, line=document.line((key,)))
    if isinstance(value, str):
        value = {"column": value}
    if not isinstance(value, dict) or not set(value) <= {"column", "unit"} or "column" not in value:
        raise document.error((key,), value, "expected {column: name, unit: unit}")
    column, unit = str(value["column"]), str(value.get("unit", _USUAL[key][0]))
    if column not in header:
        near = difflib.get_close_matches(column, header, 1)
        hint = f", nearest is {near[0]!r}" if near else ""
        raise document.error((key, "column"), column, f"expected a column of the log{hint}")
    known = UNITS[QUANTITIES[key]]
    if unit not in known:
        raise document.error((key, "unit"), unit, f"expected one of {', '.join(known)}")
    return Column(column, unit)


def _require(found: ColumnMap, header: Sequence[str], path: Path, has_points: bool) -> None:
    columns, shown = found.columns, ", ".join(h[:24] for h in header[:12])
    if not has_points and not ({"lat", "lon"} <= set(columns) or {"easting", "northing"} <= set(columns)):
        what = "columns for lat and lon (or easting and northing)"
        raise InputError("log.header", shown, f"expected {what}{_NAME_IT.format('lat', 'deg')}", file=path)
    if "grain_flow" not in columns and "yield" not in columns:
        what = "a column for grain_flow or yield"
        raise InputError("log.header", shown, f"expected {what}{_NAME_IT.format('yield', 't/ha')}", file=path)


def _split_unit(name: str) -> tuple[str, str | None]:
    """('grain_flow', 'kg/s') of 'Grain_Flow_kg_s' or 'Grain flow (kg/s)'; unit None when the name has none.

    A unit in brackets that is not known stays as it is, so that the column is not taken for something else.
    """
    text = name.strip().lower()
    bracket = re.fullmatch(r"(.*?)\s*[\[(]([^)\]]*)[\])]", text)
    if bracket:
        unit = bracket[2].strip().replace("lbs/", "lb/")
        unit = {"°": "deg", "percent": "%", "kph": "km/h", "kmh": "km/h"}.get(unit, unit)
        return re.sub(r"[\s\-.()\[\]]+", "_", bracket[1]).strip("_"), unit
    bare = re.sub(r"[\s\-./]+", "_", text).strip("_")
    for end in _ENDS:
        if bare.endswith("_" + end) and len(bare) > len(end) + 1:
            return bare[: -len(end) - 1], _LOG_SUFFIXES.get(end) or split_unit(bare)[1]
    return bare, None
