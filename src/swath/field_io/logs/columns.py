"""Which column of a yield log is which quantity, and in which unit.

Known logs are recognised by their headers; for others the usual names are tried, in English, German and
French, also where a shapefile cut them to ten letters; a map file completes that by hand, null drops a
quantity:

    crs: EPSG:32612                               # only for easting and northing
    lat: {column: Latitude, unit: deg}
    grain_flow: {column: "Flow (lb/s)", unit: lb/s}
    header_width: {unit: ft}                      # of the column that is recognised
    time: null

A unit that nothing in the file says is assumed here; witnesses.py holds it against the data.
"""

import difflib
import os
import re
import unicodedata
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from swath.core import units
from swath.core.errors import InputError, some_of
from swath.core.files.whole_file import write_whole
from swath.core.units import ACRE, DEG, POUND, SUFFIXES, factors, split_unit
from swath.documents.yaml_document import Document, read_document

WHEAT_LB_PER_BUSHEL = 60.0  # legal weight of a bushel of wheat in the USA; other crops: trade.py

UNITS: dict[str, dict[str, float]] = {
    **{kind: factors(kind) for kind in ("length", "speed", "time", "mass flow", "rotation", "volume flow")},
    "degrees": {symbol: factor / DEG for symbol, factor in factors("angle").items()},
    "position": {"deg": 1.0, "rad": 1.0 / DEG, "ddmm": 0.01, "1e-7 deg": 1e-7, "deg W": -1.0, "deg S": -1.0},
    "yield": {**factors("mass per area"), "bu/ac": WHEAT_LB_PER_BUSHEL * POUND / ACRE},
    "share": {"%": 0.01, "1": 1.0},
    "number": {"1": 1.0},
    "curvature": {"1/m": 1.0, "1/km": 1e-3, "1/km right": -1e-3},
    "text": {"text": 1.0},
}
"""Factor from each unit to the one used inside: m, m/s, s, deg, kg/s, kg/m2, share, rad/s, m3/s. ddmm:
degrees and minutes in one number, see coordinates.py; deg W, deg S: > 0 west, south; right: > 0 right.
"""

QUANTITIES: dict[str, str] = {
    "lat": "position",
    "lon": "position",
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
    "course": "degrees",
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
trade. course: of the way, clockwise from north. steer_command: wanted angle of the steered axle,
command_curvature: of the wanted path, both > 0 left.
"""
MOST_TOLD = 30  # columns that are not used, one by one
FLOWS = ("grain_flow", "yield", "dry_yield")  # the first one that a log has counts


@dataclass(frozen=True)
class Column:
    """A column of the file and the unit its numbers have.

    is_assumed: nothing in the file says the unit
    of_format: logs of its form usually have it
    is_given: the user says it
    is_shown: the data shows it
    parts: columns that add up to it; its own name where it is one of several parts (left, section 2)
    is_lesser: another column says by its name more surely that it is the quantity
    """

    column: str
    unit: str
    is_assumed: bool = False
    of_format: bool = False
    is_given: bool = False
    is_shown: bool = False
    parts: tuple[str, ...] = ()
    is_lesser: bool = False

    @property
    def by(self) -> str:
        """How the unit is known, in a word."""
        if self.is_given:
            return "--columns"
        if self.is_shown:
            return "the data"
        if self.is_assumed:
            return "its form" if self.of_format else "usual"
        return "its name"


@dataclass(frozen=True)
class ColumnMap:
    """Canonical name -> column. profile: how it was found. crs: of easting and northing, '' = not stated.

    axes: 'xy' or 'yx', the order of the two numbers of a shape, '' = not stated
    header: all columns

    beside: further columns of grain that do not count, but say something of the units of that which does
    others: further columns of the same quantity as the one in `columns`
    """

    columns: dict[str, Column]
    profile: str
    crs: str = ""
    axes: str = ""
    beside: dict[str, Column] = field(default_factory=dict)
    header: tuple[str, ...] = ()
    others: dict[str, tuple[Column, ...]] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """What was taken for what, as plain data: `columns` and `not_used`."""
        taken = {k: {"column": c.column, "unit": c.unit, "unit_by": c.by} for k, c in self.columns.items()}
        beside = {
            k: {"column": c.column, "unit": c.unit, "unit_by": "a check"} for k, c in self.beside.items()
        }
        all_of = (*self.columns.values(), *self.beside.values())
        used = {name for c in all_of for name in (c.column, *c.parts)}
        return {"columns": {**beside, **taken}, "not_used": [n for n in self.header if n not in used]}


def _profile(name: str, **columns: str) -> ColumnMap:
    split = {key: value.rsplit(" ", 1) for key, value in columns.items()}
    made = {k: Column(c, unit, is_assumed=True, of_format=True) for k, (c, unit) in split.items()}
    return ColumnMap(made, name)


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
        "Ag Leader advanced", lon="Longitude deg", lat="Latitude deg", grain_flow="Flow lb/s", time="Time s",
        duration="Interval s", distance="Distance in", header_width="Swath in", moisture="Moisture %",
        work_state="Header status text",
    ),
    _profile(
        "Ag Leader 2000", lon="Longitude deg", lat="Latitude deg", grain_flow="Flow lb/s", time="Time s",
        duration="Interval s", distance="Distance in", header_width="Swath ft", moisture="Moisture %",
        work_state="Header position text", elevation="Elevation m",
    ),
    _profile(
        "short names, US units", lon="long deg", lat="lat deg", grain_flow="mass lb/s", time="time s",
        duration="seconds s", distance="dist in", moisture="moist %", elevation="elev ft",
    ),
)  # fmt: skip
"""Logs recognised when every one of their columns is in the header; the rest goes by usual names."""
_BY_NAME = ("John Deere Operations Center", "Ag Leader advanced", "Ag Leader 2000")
"""Of these the further columns go by usual names, too."""

AG_LEADER = (
    "Longitude", "Latitude", "Flow", "Time", "Interval", "Distance", "Swath", "Moisture", "Header status",
    "Pass", "Serial", "Field", "Load", "Crop", "GPS status", "PDOP", "Elevation",
)  # fmt: skip
"""Columns of the Ag Leader advanced format, which has no header line: Ag Leader, GPS 2100 Operators Manual,
1998, page 8-7."""
AG_LEADER_2000 = tuple({"Header status": "Header position"}.get(name, name) for name in AG_LEADER)
"""Raw files of the Yield Monitor 2000, where the header is Up or Down, with other units: an example at
http://adamchukpa.mcgill.ca/web_ssm/web_yield.html."""


def _composed(things: str, words: str) -> str:
    """Names of two words in either order: `combineid`, `idcombine`."""
    pairs = [(a, b) for a in things.split() for b in words.split()]
    return " ".join([a + b for a, b in pairs] + [b + a for a, b in pairs])


_MACHINE = "machine vehicle combine harvester maschine maschinen fahrzeug maehdrescher moissonneuse"
_NUMBER = "id no nr num number nummer numero"
_SERIAL = "serial serialno serialnr serialnum serialnumber seriennummer seriennr sn"

_USUAL: dict[str, tuple[str, tuple[str, ...]]] = {
    "lat": ("deg", (
        "lat latitude gpslat gpslatitude",
        "latwgs84 latitudewgs84 ywgs84 breite breitengrad geogrbreite geographischebreite geogrbreitengrad",
    )),
    "lon": ("deg", (
        "lon long longitude gpslon gpslong gpslongitude lng",
        "lonwgs84 longwgs84 lngwgs84 longitudewgs84 xwgs84 laenge laengengrad geogrlaenge geographischelaenge"
        " geogrlaengengrad",
    )),
    "easting": ("m", ("e east easting utme utmeast utmeasting xutm rechtswert",)),
    "northing": ("m", ("n north northing utmn utmnorth utmnorthing yutm hochwert",)),
    "elevation": ("m", (
        "z elev elevation alt altitude heightmsl heightabovesealevel hoehe hoehenn hoeheunn hoeheuenn"
        " gpshoehe gpsalt gpsaltitude gpselevation",
    )),
    "machine": ("text", (
        f"{_MACHINE} {_composed(_MACHINE, _NUMBER)}",
        f"{_composed(_MACHINE, _SERIAL)} {_SERIAL.removesuffix(' sn')}",
    )),
    "crop": ("text", (
        "crop cropname croptype grain graintype commodity fruchtart frucht kultur culture espece", "product",
    )),
    "section": ("text", ("section sectionid",)),
    "date": ("text", ("date gpsdate dateutc utcdate datum",)),
    "time": ("s", (
        "isotime timestamp timestamputc datetime datetimeutc zeitstempel horodatage",
        "t time gpstime utc utctime timeutc uhrzeit zeit heure itow gpsitow tow gpstow",
        "seconds elapsed elapsedtime",
    )),
    "duration": ("s", (
        "dt dur duration interval cycle cycletime loginterval logginginterval dauer duree", "seconds",
    )),
    "record": ("1", ("record id objid objectid fid counter k",)),
    "speed": ("m/s", (
        "v speed velocity groundspeed vehiclespeed vehiclspeed geschwindigkeit fahrgeschwindigkeit vitesse"
        " vitesseavancement",
        "groundbasedspeed groundbasedmachinespeed navigationbasedvehiclespeed",
        "wheelbasedspeed wheelbasedmachinespeed wheelbasedvehiclespeed",
    )),
    "distance": ("m", ("dist distance strecke wegstrecke fahrstrecke",)),
    "course": ("deg", (
        "course heading headingdeg coursedeg trackdeg trackangle trackdegrees courseoverground cog azimuth"
        " bearing compassbearing gpscourse gpsheading kurs fahrtrichtung cap",
    )),
    "header_width": ("m", (
        "swath swathwidth swathwdth swthwidth swthwdth headerwidth cutwidth cuttingwidth workwidth"
        " workingwidth width schnittbreite arbeitsbreite schneidwerksbreite largeur largeurcoupe"
        " largeurdecoupe largeurtravail largeurdetravail",
        "breite",
    )),
    "grain_flow": ("kg/s", (
        "flow grainflow massflow cropflow cropflw cropflwm throughput grainmassflow durchsatz korndurchsatz"
        " kornstrom kornmassenstrom massenstrom debit debitgrain",
    )),
    "yield": ("kg/ha", (
        "yieldwet yieldmass yieldwetmass yieldmasswet yieldvolwet yldwet yldmass yldwetmass yldmasswet"
        " yldvolwet wetyield wetmass",
        "yield yld",
        "ertrag kornertrag nassertrag feuchtertrag ertragfeucht ertragnass rendement rendementhumide",
    )),
    "dry_yield": ("kg/ha", (
        "dryyield drymassyield dryvolyield dryvolumeyield yielddry yielddryvol yielddryvolume yielddrymass"
        " yieldmassdry yieldvoldry ylddry ylddryvol ylddrymass yldmassdry yldvoldry vryieldmass",
        "vryieldvol vryieldvolume yieldvol yieldvolume",
        "trockenertrag ertragtrocken rendementsec",
    )),
    "moisture": ("%", (
        "moisture grainmoisture moist watercontent feuchte feuchtigkeit kornfeuchte kornfeuchtigkeit humidite"
        " humiditegrain",
    )),
    "work_state": ("text", (
        "workstate headerstate headerstatus headerup headerdown recording arbeitsstellung",
    )),
    "crop_height": ("m", ("cropheight canopyheight plantheight bestandeshoehe",)),
    "engine_load": ("%", ("engineload enginetorque percentload percenttorque enginepercentload"
                          " enginepercenttorque enginepercentloadatcurrentspeed engpercentloadatcurrentspeed",
                          "actualenginepercenttorque actualengpercenttorque")),
    "engine_speed": ("rpm", ("enginespeed enginerpm engspeed",)),
    "fuel": ("l/h", ("fuel fuelrate fuelflow fuelconsumption enginefuelrate engfuelrate",)),
    "steer_command": ("deg", (
        "steercommand steeringcommand steercmd steeringcmd steersetpoint steeringsetpoint steertarget"
        " steeringtarget steerwanted steeringwanted steeranglecommand steeringanglecommand steeranglecmd"
        " steeringanglecmd steeranglesetpoint steeringanglesetpoint steerangletarget steeringangletarget"
        " steeranglewanted steeringanglewanted lenkwinkelsoll solllenkwinkel commandedsteer commandedsteering"
        " commandedsteerangle commandedsteeringangle wantedsteer wantedsteering wantedsteerangle"
        " wantedsteeringangle targetsteer targetsteering targetsteerangle targetsteeringangle",
    )),
    "command_curvature": ("1/m", (
        "commandcurvature commandedcurvature cmdcurvature wantedcurvature targetcurvature curvaturecommand"
        " curvaturecmd",
    )),
    "steer_angle": ("deg", (
        "steer steering steerangle steeringangle steeractual steeringactual steermeasured steeringmeasured"
        " steerangleactual steeringangleactual steeranglemeasured steeringanglemeasured wheelangle lenkwinkel"
        " lenkwinkelist",
    )),
    "yaw_rate": ("deg/s", (
        "yawrate turnrate gierrate giergeschwindigkeit vitesselacet vitessedelacet",
    )),
    "engaged": ("1", ("engaged active steeringengaged steeringactive autosteerengaged autosteeractive"
                      " autosteer autosteeron autosteering autosteeringon",)),
    "pass": ("text", ("pass passid passno passnum passnumber ueberfahrt passage",)),
}  # fmt: skip
"""Canonical -> unit without one in the name, and names in lower case without signs, the best first."""
_NAMES = {key: [set(names.split()) for names in tiers] for key, (_, tiers) in _USUAL.items()}
SOURCED = (*FLOWS, "header_width", "moisture", "speed", "elevation", "distance", "lat", "lon")
"""Quantities that may have several sources."""
ADDED = ("grain_flow", "header_width")  # quantities whose parts add up
_NUMBERED = re.compile(r"(.{3,}?)(?:sensor)?\d")  # name of one of several sensors
_SIDE = r"(?:left|right|links|rechts|gauche|droite|(?:section|sec|teilbreite)\d+)"
_PART = re.compile(rf"^{_SIDE}|{_SIDE}$")  # of a header, in a name
_ELEMENT = re.compile(r"_det_\d+$")  # of task data: counts where no column is of the whole machine
_CUT = 10  # letters of a column's name in a shapefile (dBASE)
_LEAST_OF_NAME = 5  # letters by which a name that is cut off is known
# what known logs may also hold
_BESIDE = ("course", "crop", "section", "date", "engine_load", "engine_speed", "fuel")
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


COLUMN_HEAD = ("column", "is", "unit", "unit by")


def column_rows(source: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows under COLUMN_HEAD of `ColumnMap.summary`: what was taken for what, then what was not used."""
    plain = [
        (
            c["column"],
            key,
            *(("", "") if QUANTITIES[key] in ("text", "number") else (c["unit"], c["unit_by"])),
        )
        for key, c in source["columns"].items()
    ]
    unused = source["not_used"]
    more = [(f"and {len(unused) - MOST_TOLD} more", "not used", "", "")] if len(unused) > MOST_TOLD else []
    return [*plain, *((name, "not used", "", "") for name in unused[:MOST_TOLD]), *more]


Needs = Mapping[str, tuple[tuple[str, ...], ...]]
"""What a log has to hold, in words, and the columns that give it: one of these groups."""
PLACE: Needs = {"lat and lon (or easting and northing)": (("lat", "lon"), ("easting", "northing"))}
CROP: Needs = {"grain_flow or yield": (("yield",), ("grain_flow",), ("dry_yield",))}
WIDTH: Needs = {"header_width (or --header-width-m)": (("header_width",),)}


class ColumnsMissing(InputError):
    """The header lacks what an import needs. template: a map with a place for each, to be filled in."""

    template: str


def find_columns(
    header: Sequence[str],
    path: Path,
    columns: Path | None,
    has_points: bool,
    *,
    needs: Needs,
    units: Mapping[str, str] | None = None,
) -> ColumnMap:
    """The column map for a header: a known log, else the usual names; the map file completes it.

    has_points: positions come from the geometry (shapefile), no column has to give them
    needs: what has to be there; units: column -> unit, where the log says so beside its table
    Raises ColumnsMissing, which names everything of `needs` that no column gives.
    """
    known = (p for p in PROFILES if all(c.column in header for c in p.columns.values()))
    base = next((p for p in known if has_points or "lat" in p.columns), None)
    given, dropped, system = ({}, set(), {}) if columns is None else read_map(columns, header)
    whole = {k: c for k, c in given.items() if c.column}
    of_base = {} if base is None else {k: _checked(c) for k, c in base.columns.items()}
    taken = {c.column for c in (*whole.values(), *of_base.values())}
    said = {key for key, column in given.items() if not column.column} | dropped
    guessed = guess([name for name in header if name not in taken], path, said)
    usual = guessed.columns
    beside = {k: c for k, c in usual.items() if k in FLOWS}
    if base is not None:
        also = QUANTITIES.keys() - FLOWS if base.profile in _BY_NAME else _BESIDE
        usual = {k: c for k, c in usual.items() if k in also}
    found = {**usual, **of_base}
    for alike in (FLOWS, ("lat", "lon", "easting", "northing")):
        if set(alike) & whole.keys():
            found = {k: c for k, c in found.items() if k not in alike}
    found = {k: c for k, c in {**found, **whole}.items() if k not in dropped}
    flow = next((key for key in FLOWS if key in found), None)
    beside = {k: c for k, c in {**beside, **found}.items() if k in FLOWS and k not in {flow, *dropped}}
    found = {k: c for k, c in found.items() if k not in FLOWS or k == flow}
    for group in (found, beside):
        stated = {k: (units or {}).get(c.column, "") for k, c in group.items() if k not in given}
        group |= {
            k: replace(group[k], unit=u, is_assumed=False)
            for k, u in stated.items()
            if u in UNITS[QUANTITIES[k]]
        }
    found |= {k: _with_unit(k, c.unit, found, columns) for k, c in given.items() if not c.column}
    name = base.profile if base else "usual names"
    require(found, header, path, needs)
    profile = name if columns is None else f"map {columns.name}, {name}"
    others = {k: more for k, more in guessed.others.items() if k in found and k not in {*of_base, *whole}}
    return ColumnMap(found, profile, **system, beside=beside, header=tuple(header), others=others)


def _checked(of_format: Column) -> Column:
    """A column of a known log; not assumed where its name says its unit."""
    return replace(of_format, is_assumed=_split_unit(of_format.column)[1] != of_format.unit)


def _with_unit(key: str, unit: str, found: Mapping[str, Column], columns: Path | None) -> Column:
    if key not in found:
        raise InputError(key, {"unit": unit}, "expected its column, too: none is recognised", file=columns)
    return replace(found[key], unit=unit, is_assumed=False, is_given=True)


def guess(header: Sequence[str], path: Path, said: Collection[str] = ()) -> ColumnMap:
    """Columns by their usual names; a unit in the name ('speed_kmh', 'Flow (lb/s)') wins over the default.

    said: quantities whatever the unit in the name
    A name of ten letters may be cut off, and may end with that of a sensor or an element. Raises InputError
    for a unit in brackets that is not known.
    """
    found: dict[str, Column] = {}
    others: dict[str, tuple[Column, ...]] = {}
    free = list(header)
    for is_element in (False, True):
        pool = {name: bare for name in header if ((bare := _ELEMENT.sub("", name)) != name) is is_element}
        for key, names in [(k, names) for k, tiers in _NAMES.items() for names in tiers]:
            if key in found:
                continue
            own = [replace(c, column=name, parts=(name,) * bool(c.parts)) for name, bare in pool.items()
                   if name in free and (c := _named(key, names, bare, path, said))]  # fmt: skip
            if key in ADDED:
                whole = [c for c in own if not c.parts]
                own = whole or own[: len(own) * (len(own) > 1)]
            if own:
                free.remove(own[0].column)
                found[key] = own[0]
                others |= {key: tuple(own[1:])} if own[1:] else {}
    as_sure = {c.column for more in others.values() for c in more}
    free = [name for name in free if name not in as_sure]
    for key in [k for k in SOURCED if k in found]:
        wanted = set[str]().union(*_NAMES[key])
        less = [
            replace(c, is_lesser=True)
            for name in free
            if (c := _named(key, wanted, name, path, said)) and not c.parts
        ]
        others |= {key: (*others.get(key, ()), *less)} if less else {}
        free = [name for name in free if name not in {c.column for c in less}]
    for name in free:
        cut = _cut(name)
        if cut is not None and cut[0] not in found:
            found[cut[0]] = cut[1]
    return ColumnMap({key: found[key] for key in _USUAL if key in found}, "usual names", others=others)


def _named(key: str, names: Collection[str], name: str, path: Path, said: Collection[str]) -> Column | None:
    """The column of this name where it is one of these names, with its unit."""
    bare, unit = _split_unit(name)
    numbered = _NUMBERED.fullmatch(bare) if key in SOURCED else None
    of_part = _PART.sub("", bare) if key in SOURCED else bare
    is_part = bare not in names and of_part in names
    if bare not in names:
        bare = of_part if is_part else numbered[1] if numbered else bare
    kinds = UNITS[QUANTITIES[key]]
    if bare in names and (unit is None or unit in kinds or key in _WORDS or key in said):
        return replace(_column(key, name, bare, unit), parts=(name,) * is_part)
    if _letters(name) in names:
        return _column(key, name, _letters(name), None)
    is_needed = bare in names and key in (*FLOWS, "header_width", "speed")
    if is_needed and not any(unit in known for known in UNITS.values()):
        raise InputError(f"unit of {name!r}", unit, f"expected one of {', '.join(kinds)}", file=path)
    return None


def _column(key: str, column: str, name: str, unit: str | None) -> Column:
    """unit: None where the column says none. A yield by volume is in bushels."""
    kinds = UNITS[QUANTITIES[key]]
    default = "bu/ac" if key in FLOWS and "vol" in name else _USUAL[key][0]
    return Column(column, unit if unit in kinds else default, unit not in kinds and len(kinds) > 1)


def _cut(name: str) -> tuple[str, Column] | None:
    """The quantity of a name that ends with its tenth letter, None where there is none or more than one.

    Cut within the unit ('Distance_f') or within the name ('Arbeitsbre').
    """
    if len(name) != _CUT:
        return None
    ends = [i for i, letter in enumerate(name) if letter == "_"]
    readings = [(_letters(name[:i]), _letters(name[i:])) for i in reversed(ends)]
    for bare, end in readings:
        for key, tiers in _NAMES.items():
            units = {u for u, spelled in _spelled(QUANTITIES[key]) if spelled.startswith(end)}
            if end and units and any(bare in names for names in tiers):
                return key, _column(key, name, bare, units.pop() if len(units) == 1 else None)
    for bare, unit in ((_letters(name), None), _split_unit(name)):
        begun = {key: full for key, tiers in _NAMES.items() for names in tiers for full in sorted(names)
                 if full.startswith(bare) and (unit is None or unit in UNITS[QUANTITIES[key]])}  # fmt: skip
        if len(bare) >= _LEAST_OF_NAME and len(begun) == 1:
            ((key, full),) = begun.items()
            return key, _column(key, name, full, unit)
    return None


def _spelled(kind: str) -> list[tuple[str, str]]:
    """Units of a kind, each as it may stand in a name, without signs."""
    return [(u, _letters(u)) for u in UNITS[kind]] + [
        (u, end.replace("_", "")) for end in _ENDS if (u := _unit_of(end)) in UNITS[kind]
    ]


def read_map(path: Path, header: Sequence[str]) -> tuple[dict[str, Column], set[str], dict[str, str]]:
    """Columns of a YAML file, what it drops (null), its crs and axes; all is checked. Raises InputError."""
    document = read_document(path)
    raw = document.data
    if not isinstance(raw, dict) or not raw:
        raise InputError("columns", raw, "expected canonical names, each with a column and a unit", file=path)
    crs = raw.get("crs", "")
    if not isinstance(crs, str):
        raise document.error(("crs",), crs, "expected text like EPSG:32612")
    axes = raw.get("axes", "")
    if axes not in ("", "xy", "yx"):
        raise document.error(("axes",), axes, "expected xy or yx, the order of the two numbers of a shape")
    entries = {key: value for key, value in raw.items() if key not in ("crs", "axes")}
    found = {key: _entry(key, value, header, document) for key, value in entries.items()}
    return (
        {key: column for key, column in found.items() if column is not None},
        {key for key, column in found.items() if column is None},
        {"crs": crs, "axes": axes},
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
    if not isinstance(value, dict) or not set(value) <= {"column", "unit"} or not value:
        raise document.error((key,), value, "expected {column: name, unit: unit}, or null")
    column = str(value.get("column", ""))
    whole = [name for name in header if re.fullmatch(re.escape(column) + r" \[[^]]*\]", name)]
    column = whole[0] if column not in header and len(whole) == 1 else column
    if column not in header and "column" in value:
        near = difflib.get_close_matches(column, header, 1)
        hint = f", nearest is {near[0]!r}" if near else ""
        raise document.error((key, "column"), column, f"expected a column of the log{hint}")
    known = UNITS[QUANTITIES[key]]
    named = _column(key, column, *_split_unit(column))
    unit = str(value.get("unit", named.unit))
    if unit not in known:
        raise document.error((key, "unit"), unit, f"expected one of {', '.join(known)}")
    is_stated = "unit" in value or len(known) == 1
    return replace(named, unit=unit, is_assumed=not is_stated and named.is_assumed, is_given=is_stated)


def require(found: Collection[str], header: Sequence[str], path: Path, needs: Needs) -> None:
    """Raises ColumnsMissing where no column gives what is needed."""
    missing = {n: ways[0] for n, ways in needs.items() if not any(set(way) <= {*found} for way in ways)}
    if missing:
        keys = [key for group in missing.values() for key in group]
        units = ("t/ha" if key == "yield" else _USUAL[key][0].replace("%", '"%"') for key in keys)
        lines = [f'{key}: {{column: "?", unit: {unit}}}' for key, unit in zip(keys, units, strict=True)]
        is_map = missing.keys() == WIDTH.keys() and "yield" in found
        hint = "--as map takes yields in any order; " if is_map else ""
        error = ColumnsMissing(
            "columns", some_of(header, 12),
            f"expected columns for {', '.join(missing)}; {hint}say which with --columns MAP.yaml, in it "
            f"lines like {lines[-1].replace(chr(34) + '?' + chr(34), 'Name')}", file=path,
        )  # fmt: skip
        names = "\n".join(f"#   {name}" for name in header[:100])
        error.template = f"# which column of {path.name} is what; its columns:\n{names}\n" + "\n".join(lines)
        raise error


@contextmanager
def map_to_fill(log: Path, out: Path | None, columns: Path | None) -> Iterator[None]:
    """Where columns are missing, a map to fill in is written beside `out`, and the error names it.

    columns: a map that is given already: then, and without `out`, nothing is written.
    """
    try:
        yield
    except ColumnsMissing as error:
        if out is None or columns is not None or not os.access(out.parent, os.W_OK):
            raise
        made = out.parent / f"{log.name.partition('.')[0]}.columns.yaml"
        if not os.path.exists(made):
            write_whole(made, error.template + "\n")
        needed = error.expected.rpartition("; ")[0]
        expected = f"{needed}; fill in {made} and give it with --columns"
        raise InputError(error.key, None, expected, file=log) from error


def unit_symbol(text: str) -> str:
    """A unit as it is written here: `lbs/ac`, `lb1ac-1`, `KPH`, `prcnt` are known spellings."""
    unit = re.sub(r"^(\w+)1\[?(\w+)\]?-1$", r"\1/\2", text.strip().lower().replace("lbs", "lb"))
    unit = unit.replace("/hr", "/h").replace("/sec", "/s").replace("/acre", "/ac").replace("to/ha", "t/ha")
    known = {"°": "deg", "arcdeg": "deg", "percent": "%", "prcnt": "%", "kph": "km/h", "kmh": "km/h",
             "1/min": "rpm", "°/s": "deg/s", "q/ha": "dt/ha",
             "tonne/ha": "t/ha", "tonnes/ha": "t/ha", "mg/ha": "t/ha", "mi/h": "mph",
             "meter": "m", "feet": "ft", "inch": "in", "sec": "s"}  # fmt: skip
    return known.get(unit, unit)


def _plain(text: str) -> str:
    """Lower case without accents; umlauts as two letters."""
    text = re.sub("[äöüß]", lambda m: {"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"}[m[0]], text.casefold())
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()


def _letters(text: str) -> str:
    """Lower-case letters and digits of a name, without signs and accents."""
    return re.sub(r"[^0-9a-z]", "", _plain(unicodedata.normalize("NFC", text)))


def _unit_of(end: str) -> str:
    """Unit of an end of a name: `kg_s`, `pct`."""
    return _LOG_SUFFIXES.get(end) or split_unit(f"x_{end}")[1]


def _split_unit(name: str) -> tuple[str, str | None]:
    """('grainflow', 'kg/s') of 'Grain_Flow_kg_s' or 'Grain flow (kg/s)'; unit None when the name has none.

    A unit in brackets that is not known stays as it is, so that the column is not taken for something else.
    """
    bracket = re.fullmatch(r"(.*?)\s*[\[(]([^)\]]*)[\])]", unicodedata.normalize("NFC", name.strip()))
    if bracket:
        return _letters(bracket[1]), unit_symbol(bracket[2])
    bare = re.sub(r"[\s\-./]+", "_", _plain(unicodedata.normalize("NFC", name.strip()))).strip("_")
    for end in _ENDS:
        if bare.endswith("_" + end) and len(bare) > len(end) + 1:
            return _letters(bare[: -len(end) - 1]), _unit_of(end)
    return _letters(bare), None
