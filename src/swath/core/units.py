"""The units of all that comes from outside: the key carries the unit, inside everything is SI and radians.

speed = params.speed_kmh * KMH
"""

from dataclasses import dataclass
from math import pi

KMH = 1.0 / 3.6
DEG = pi / 180.0
DEG_PER_G = DEG / 9.80665  # rad per m/s2 of lateral acceleration
KPA = 1e3
HOUR = 3600.0
MM = 1e-3
CM = 1e-2
MRAD = 1e-3
PERCENT = 1e-2
MS = 1e-3
GRAM = 1e-3
RPM = pi / 30.0
POUND, FOOT, ACRE, GALLON = 0.45359237, 0.3048, 4046.8564224, 3.785411784e-3  # exact: kg, m, m2, US m3
TONNE_M2 = 0.1  # t/ha in kg/m2


def digits_in(text: str) -> int:
    """The number that a text of digits says, -1 for another text: `int` takes those of other scripts, too,
    `str.isdigit` raised ones, and neither has an end.
    """
    return int(text) if text.isascii() and text.isdigit() and len(text) < 19 else -1


@dataclass(frozen=True)
class Unit:
    """A unit. symbol: as people write it; kind: units of one kind measure the same; factor: to SI."""

    symbol: str
    kind: str
    factor: float = 1.0


UNITS = {
    "m": Unit("m", "length"),
    "km": Unit("km", "length", 1000.0),
    "cm": Unit("cm", "length", CM),
    "mm": Unit("mm", "length", MM),
    "um": Unit("um", "length", 1e-6),
    "nm": Unit("nm", "length", 1e-9),
    "ft": Unit("ft", "length", FOOT),
    "feet": Unit("ft", "length", FOOT),
    "in": Unit("in", "length", 0.0254),
    "inch": Unit("in", "length", 0.0254),
    "m2": Unit("m2", "area"),
    "ha": Unit("ha", "area", 1e4),
    "acre": Unit("acre", "area", ACRE),
    "m3": Unit("m3", "volume"),
    "s": Unit("s", "time"),
    "ms": Unit("ms", "time", MS),
    "us": Unit("us", "time", 1e-6),
    "ns": Unit("ns", "time", 1e-9),
    "min": Unit("min", "time", 60.0),
    "h": Unit("h", "time", 3600.0),
    "d": Unit("d", "time", 86400.0),
    "m_s": Unit("m/s", "speed"),
    "kmh": Unit("km/h", "speed", KMH),
    "mph": Unit("mph", "speed", 0.44704),
    "knots": Unit("kn", "speed", 1852 / 3600),
    "ft_s": Unit("ft/s", "speed", FOOT),
    "mm_s": Unit("mm/s", "speed", MM),
    "mm_h": Unit("mm/h", "speed", MM / 3600.0),
    "m_s2": Unit("m/s2", "acceleration"),
    "deg": Unit("deg", "angle", DEG),
    "rad": Unit("rad", "angle"),
    "mrad": Unit("mrad", "angle", MRAD),
    "rad_s": Unit("rad/s", "rotation"),
    "deg_s": Unit("deg/s", "rotation", DEG),
    "rpm": Unit("rpm", "rotation", RPM),
    "deg_s2": Unit("deg/s2", "angular acceleration", DEG),
    "rpm_s": Unit("rpm/s", "angular acceleration", RPM),
    "deg_per_g": Unit("deg/g", "angle per acceleration", DEG_PER_G),
    "hz": Unit("Hz", "frequency"),
    "ghz": Unit("GHz", "frequency", 1e9),
    "khz": Unit("kHz", "frequency", 1000.0),
    "kg": Unit("kg", "mass"),
    "g": Unit("g", "mass", GRAM),
    "t": Unit("t", "mass", 1000.0),
    "lb": Unit("lb", "mass", POUND),
    "kg_m2": Unit("kg/m2", "mass per area"),  # after `inertia` kg m2: the same number
    "g_m2": Unit("g/m2", "mass per area", GRAM),
    "kg_ha": Unit("kg/ha", "mass per area", 1e-4),
    "dt_ha": Unit("dt/ha", "mass per area", 0.01),
    "t_ha": Unit("t/ha", "mass per area", TONNE_M2),
    "lb_ac": Unit("lb/ac", "mass per area", POUND / ACRE),
    "kg_m3": Unit("kg/m3", "density"),
    "kg_s": Unit("kg/s", "mass flow"),
    "g_s": Unit("g/s", "mass flow", GRAM),
    "kg_h": Unit("kg/h", "mass flow", 1 / 3600),
    "t_h": Unit("t/h", "mass flow", 1000.0 / 3600),
    "lb_s": Unit("lb/s", "mass flow", POUND),
    "l_s": Unit("l/s", "volume flow", 1e-3),
    "l_h": Unit("l/h", "volume flow", 1e-3 / 3600.0),
    "gal_h": Unit("gal/h", "volume flow", GALLON / 3600.0),
    "n": Unit("N", "force"),
    "kn": Unit("kN", "force", 1000.0),
    "kw": Unit("kW", "power", 1000.0),
    "kw_per_m": Unit("kW/m", "power per length", 1000.0),
    "kj_per_kg": Unit("kJ/kg", "energy per mass", 1000.0),
    "g_kwh": Unit("g/kWh", "mass per energy", 1e-3 / 3.6e6),
    "kpa": Unit("kPa", "pressure", 1000.0),
    "bar": Unit("bar", "pressure", 1e5),
    "per_m": Unit("1/m", "per length"),
    "per_m2": Unit("1/m2", "per area"),
    "per_ha": Unit("1/ha", "per area", 1e-4),
    "per_s": Unit("1/s", "frequency"),
    "per_s2": Unit("1/s2", "per time squared"),
    "per_rad": Unit("1/rad", "per angle"),
    "percent_mm": Unit("%/mm", "ratio per length", PERCENT / MM),
    "percent": Unit("%", "ratio", PERCENT),
    "fraction": Unit("share 0 to 1", "ratio"),
    "": Unit("1", "ratio"),
}
"""End of a key -> unit: `speed_kmh` is in km/h. A key without one is a plain number."""

SUFFIXES = sorted(filter(None, UNITS), key=len, reverse=True)


@dataclass(frozen=True)
class Quantity:
    """A number, or a list of them, of a data sheet, with the unit at the end of its key ("" = none).

    low, high: limits in that unit
    key: in the sheet, where it is not the field's name, without the unit
    """

    unit: str
    low: float | None = None
    high: float | None = None
    key: str = ""

    def file_key(self, field: str) -> str:
        """The key in the sheet: field's name and unit."""
        return "_".join(filter(None, (self.key or field, self.unit)))


def split_unit(key: str) -> tuple[str, str]:
    """A file key as (quantity, unit): `speed_kmh` -> ("speed", "km/h"); no unit -> (key, "")."""
    for suffix in SUFFIXES:
        if key.endswith("_" + suffix) and len(key) > len(suffix) + 1:
            return key[: -len(suffix) - 1], UNITS[suffix].symbol
    return key, ""


def factors(kind: str) -> dict[str, float]:
    """Symbol of each unit of a kind -> factor to SI."""
    return {unit.symbol: unit.factor for unit in UNITS.values() if unit.kind == kind}


def rounded(value: float, digits: int) -> float:
    """A number with so many digits that count, as people read it."""
    return float(f"{value:.{digits}g}")
