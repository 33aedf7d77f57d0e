"""A crop: the numbers of its stand, organs, yield and reflectance, read from a card of data/crops."""

import math
from dataclasses import dataclass
from pathlib import Path

from swath.core.errors import InputError
from swath.core.units import CM, DEG, GRAM, MM, PERCENT
from swath.data.cards import Card, find_card

UNITS = {
    "1": 1.0,
    "1/m2": 1.0,
    "kg/m3": 1.0,
    "m": 1.0,
    "cm": CM,
    "mm": MM,
    "deg": DEG,
    "%": PERCENT,
    "g": GRAM,
}
LENGTH, RATIO = ("m", "cm", "mm"), ("1", "%")


@dataclass(frozen=True)
class StandFacts:
    """density [1/m2], row_spacing [m], stems_per_plant, tiller_spread [m] (sd of a stem's foot about its
    plant), height [m] (mean, ground to the tip of the ear), height_cv, stubble_height [m]."""

    density: float
    row_spacing: float
    stems_per_plant: float
    tiller_spread: float
    height: float
    height_cv: float
    stubble_height: float


@dataclass(frozen=True)
class StemFacts:
    """diameter_base, diameter_top [m], diameter_cv; lean_mean, lean_sd [rad] of the chord foot to ear."""

    diameter_base: float
    diameter_top: float
    diameter_cv: float
    lean_mean: float
    lean_sd: float


@dataclass(frozen=True)
class EarFacts:
    """length, width, thickness [m], length_cv; inclination_mean, inclination_sd [rad] from vertical."""

    length: float
    length_cv: float
    width: float
    thickness: float
    inclination_mean: float
    inclination_sd: float

    @property
    def diameter(self) -> float:
        """Mean silhouette width over all view azimuths [m].

        Cauchy: perimeter / pi, of the ellipse width x thickness (Ramanujan's first approximation).
        """
        a, b = 0.5 * self.width, 0.5 * self.thickness
        return 3.0 * (a + b) - math.sqrt((3.0 * a + b) * (a + 3.0 * b))


@dataclass(frozen=True)
class LeafFacts:
    """Dried blades: count_min, count_max; node_top: foot of the highest, node_step: down to the next [share
    of the stem's length]; length, width [m] with cv; elevation_start, elevation_end [rad] of the blade above
    horizontal at its foot and its tip, elevation_sd [rad]."""

    count_min: int
    count_max: int
    node_top: float
    node_step: float
    length: float
    length_cv: float
    width: float
    width_cv: float
    elevation_start: float
    elevation_end: float
    elevation_sd: float


@dataclass(frozen=True)
class YieldFacts:
    """grain_mass: of a mean ear [kg]; straw_to_grain: straw above ground per grain mass

    straw_exponent p: share of straw below relative height s is 1 - (1 - s)^p
    grain_density, swath_density: bulk [kg/m3]; grain_moisture: fraction
    """

    grain_mass: float
    straw_to_grain: float
    straw_exponent: float
    grain_density: float
    swath_density: float
    grain_moisture: float


@dataclass(frozen=True)
class Crop:
    """One crop. reflectance: organ name (lower case, as in `layout.Organ`) -> reflectance at 905 nm."""

    name: str
    stand: StandFacts
    stem: StemFacts
    ear: EarFacts
    leaf: LeafFacts
    yields: YieldFacts
    reflectance: dict[str, float]

    def straw_below(self, relative_height: float) -> float:
        """Share of a stem's straw mass below a height given as a fraction of the plant's height."""
        s = min(max(relative_height, 0.0), 1.0)
        return float(1.0 - (1.0 - s) ** self.yields.straw_exponent)


def load_crop(name: str, base: Path | None = None) -> Crop:
    """Crop by bundled name (`wheat`) or from a user's YAML file (relative to `base`).

    Raises InputError that names the key and the file when a number is missing, has no source, another unit
    than its quantity can have, or lies outside what a crop can be.
    """
    card = Card(find_card("crops", name, base))
    stand = StandFacts(
        density=_number(card, "stand.density", ("1/m2",), 1.0, 3000.0),
        row_spacing=_number(card, "stand.row_spacing", LENGTH, 0.0, 2.0),
        stems_per_plant=_number(card, "stand.stems_per_plant", RATIO, 1.0, 20.0),
        tiller_spread=_number(card, "stand.tiller_spread", LENGTH, 0.0, 0.2),
        height=_number(card, "stand.height", LENGTH, 0.1, 4.0),
        height_cv=_number(card, "stand.height_cv", RATIO, 0.0, 0.5),
        stubble_height=_number(card, "stand.stubble_height", LENGTH, 0.0, 2.0),
    )
    stem = StemFacts(
        diameter_base=_number(card, "stem.diameter_base", LENGTH, 1e-4, 0.1),
        diameter_top=_number(card, "stem.diameter_top", LENGTH, 1e-4, 0.1),
        diameter_cv=_number(card, "stem.diameter_cv", RATIO, 0.0, 0.5),
        lean_mean=_number(card, "stem.lean_mean", ("deg",), 0.0, 45 * DEG),
        lean_sd=_number(card, "stem.lean_sd", ("deg",), 0.0, 45 * DEG),
    )
    ear = EarFacts(
        length=_number(card, "ear.length", LENGTH, 0.005, 0.5),
        length_cv=_number(card, "ear.length_cv", RATIO, 0.0, 0.5),
        width=_number(card, "ear.width", LENGTH, 1e-3, 0.2),
        thickness=_number(card, "ear.thickness", LENGTH, 1e-3, 0.2),
        inclination_mean=_number(card, "ear.inclination_mean", ("deg",), 0.0, 170 * DEG),
        inclination_sd=_number(card, "ear.inclination_sd", ("deg",), 0.0, 90 * DEG),
    )
    if ear.length <= ear.diameter:
        raise InputError("ear.length", ear.length, "expected longer than wide", file=card.path)
    return Crop(
        card.text("name"), stand, stem, ear, _leaf(card), _yields(card, stand.height), _reflectance(card)
    )


def _leaf(card: Card) -> LeafFacts:
    count_min = round(_number(card, "leaf.count_min", RATIO, 0, 20))
    return LeafFacts(
        count_min=count_min,
        count_max=round(_number(card, "leaf.count_max", RATIO, count_min, 20)),
        node_top=_number(card, "leaf.node_top", RATIO, 0.05, 1.0),
        node_step=_number(card, "leaf.node_step", RATIO, 0.0, 0.5),
        length=_number(card, "leaf.length", LENGTH, 0.005, 1.0),
        length_cv=_number(card, "leaf.length_cv", RATIO, 0.0, 0.5),
        width=_number(card, "leaf.width", LENGTH, 2e-4, 0.2),
        width_cv=_number(card, "leaf.width_cv", RATIO, 0.0, 0.5),
        elevation_start=_number(card, "leaf.elevation_start", ("deg",), -90 * DEG, 90 * DEG),
        elevation_end=_number(card, "leaf.elevation_end", ("deg",), -90 * DEG, 90 * DEG),
        elevation_sd=_number(card, "leaf.elevation_sd", ("deg",), 0.0, 60 * DEG),
    )


def _yields(card: Card, height: float) -> YieldFacts:
    grains = _number(card, "yield.grains_per_ear", RATIO, 1.0, 5000.0)
    thousand = _number(card, "yield.thousand_grain_mass", ("g",), 1e-4, 1.0)
    share = _number(card, "yield.straw_below_share", RATIO, 0.01, 0.9)
    below = _number(card, "yield.straw_below_height", LENGTH, 0.01, 0.9 * height) / height
    return YieldFacts(
        grain_mass=grains * thousand / 1000.0,
        straw_to_grain=_number(card, "yield.straw_to_grain", RATIO, 0.05, 10.0),
        straw_exponent=math.log(1.0 - share) / math.log(1.0 - below),
        grain_density=_number(card, "yield.grain_density", ("kg/m3",), 100.0, 1500.0),
        swath_density=_number(card, "yield.swath_density", ("kg/m3",), 1.0, 500.0),
        grain_moisture=_number(card, "yield.grain_moisture", RATIO, 0.0, 0.6),
    )


def _reflectance(card: Card) -> dict[str, float]:
    names = ("ground", "straw", "stem", "ear", "leaf", "stubble", "weed")
    return {name: _number(card, f"reflectance.{name}", RATIO, 0.0, 1.0) for name in names}


def _number(card: Card, key: str, units: tuple[str, ...], low: float, high: float) -> float:
    value = card.number(key)
    unit = str(card.entry(key).get("unit"))
    if unit not in units:
        raise InputError(f"{key}.unit", unit, f"expected {' or '.join(units)}", file=card.path)
    factor = UNITS[unit]
    slack = 1e-12 * max(abs(low), abs(high))
    if not low - slack <= value * factor <= high + slack:
        limits = f"expected {low / factor:g} to {high / factor:g} {unit if unit != '1' else ''}".rstrip()
        raise InputError(key, value, limits, file=card.path)
    return value * factor
