"""A crop: the numbers of its stand, organs, yield and reflectance, read from a card of data/crops."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from swath.core.errors import InputError
from swath.core.units import DEG
from swath.documents.data_sheets import Card, find_card
from swath.field.facts import LENGTH, RATIO, number, section
from swath.field.mesh_crop import MeshFacts, mesh_facts
from swath.field.organs import (
    AWN,
    BRANCH,
    COB,
    NECK,
    POD,
    TASSEL,
    AwnFacts,
    BranchFacts,
    CobFacts,
    NeckFacts,
    PodFacts,
    TasselFacts,
)

Habit = Literal["cereal", "branched", "maize", "weed", "stubble", "mesh"]
REFLECTIVE = {
    "cereal": ("ear", "leaf"),
    "branched": ("branch", "pod"),
    "maize": ("leaf", "branch", "cob"),
    "weed": (),
    "stubble": (),
    "mesh": (),
}
SEEDS = {"cereal": "grains_per_ear", "branched": "seeds_per_pod", "maize": "grains_per_cob"}


@dataclass(frozen=True)
class StandFacts:
    """density [1/m2], row_spacing [m], stems_per_plant, tiller_spread [m] (sd of a stem's foot about its
    plant), height [m] (mean, ground to the highest point but awns), height_cv, stubble_height [m]
    sowing_jitter: how far a plant is from its even place in the row, 0 = even, 1 = up to the next one's."""

    density: float
    row_spacing: float
    stems_per_plant: float
    tiller_spread: float
    height: float
    height_cv: float
    stubble_height: float
    sowing_jitter: float = 1.0


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
    """grain_mass: of a mean stem (its ear, pods or cob) [kg]; straw_to_grain: straw above ground per grain
    mass; bare_mass: of a mean stem without any grain [kg]

    straw_exponent p: share of straw below relative height s is 1 - (1 - s)^p
    grain_density, swath_density: bulk [kg/m3]; grain_moisture: fraction
    """

    grain_mass: float
    straw_to_grain: float
    straw_exponent: float
    grain_density: float
    swath_density: float
    grain_moisture: float
    bare_mass: float = 0.0

    @property
    def straw_mass(self) -> float:
        """Straw above ground of a mean stem [kg]."""
        return self.grain_mass * self.straw_to_grain if self.grain_mass > 0.0 else self.bare_mass


@dataclass(frozen=True)
class Crop:
    """One crop. reflectance: organ name (lower case, as in `layout.Organ`) -> reflectance at 905 nm.

    habit: how its plants are built, a module of `field/plants`; says which of the organs it has; plants of
    habit `mesh` have no facts of a stem, theirs are zero
    """

    name: str
    stand: StandFacts
    stem: StemFacts
    yields: YieldFacts
    reflectance: dict[str, float]
    habit: Habit = "cereal"
    ear: EarFacts | None = None
    leaf: LeafFacts | None = None
    neck: NeckFacts | None = None
    awn: AwnFacts | None = None
    branch: BranchFacts | None = None
    pod: PodFacts | None = None
    tassel: TasselFacts | None = None
    cob: CobFacts | None = None
    mesh: MeshFacts | None = None

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
    habit = _habit(card)
    mesh = mesh_facts(card) if habit == "mesh" else None
    stand = StandFacts(
        density=number(card, "stand.density", ("1/m2",), 1.0, 3000.0),
        row_spacing=number(card, "stand.row_spacing", LENGTH, 0.0, 1.0),
        stems_per_plant=number(card, "stand.stems_per_plant", RATIO, 1.0, 20.0),
        tiller_spread=number(card, "stand.tiller_spread", LENGTH, 0.0, 0.2),
        height=number(card, "stand.height", LENGTH, 0.05, 4.0) if mesh is None else mesh.height,
        height_cv=number(card, "stand.height_cv", RATIO, 0.0, 0.5),
        stubble_height=number(card, "stand.stubble_height", LENGTH, 0.0, 2.0),
        sowing_jitter=number(card, "stand.sowing_jitter", RATIO, 0.0, 1.0)
        if card.has("stand.sowing_jitter")
        else 1.0,
    )
    leafy = habit in ("cereal", "maize", "weed")
    crop = Crop(
        name=card.text("name"),
        habit=habit,
        stand=stand,
        stem=_stem(card) if mesh is None else StemFacts(0.0, 0.0, 0.0, 0.0, 0.0),
        ear=_ear(card) if habit == "cereal" else None,
        leaf=_leaf(card) if leafy else None,
        neck=section(card, "neck", NeckFacts, NECK) if "neck" in card.data else None,
        awn=section(card, "awn", AwnFacts, AWN) if "awn" in card.data else None,
        branch=section(card, "branch", BranchFacts, BRANCH) if habit == "branched" else None,
        pod=section(card, "pod", PodFacts, POD) if habit == "branched" else None,
        tassel=section(card, "tassel", TasselFacts, TASSEL) if habit == "maize" else None,
        cob=section(card, "cob", CobFacts, COB) if habit == "maize" else None,
        yields=_yields(card, habit, stand.height),
        reflectance=_reflectance(card, habit) | ({} if mesh is None else mesh.reflectances()),
        mesh=mesh,
    )
    card.refuse_unknown("habit", "summary", "kind", "note")
    return crop


def _habit(card: Card) -> Habit:
    name = card.data.get("habit", "cereal")
    for habit in get_args(Habit):
        if name == habit:
            return habit  # type: ignore[no-any-return]
    raise InputError("habit", name, f"expected one of {', '.join(get_args(Habit))}", file=card.path)


def _stem(card: Card) -> StemFacts:
    return StemFacts(
        diameter_base=number(card, "stem.diameter_base", LENGTH, 1e-4, 0.1),
        diameter_top=number(card, "stem.diameter_top", LENGTH, 1e-4, 0.1),
        diameter_cv=number(card, "stem.diameter_cv", RATIO, 0.0, 0.5),
        lean_mean=number(card, "stem.lean_mean", ("deg",), 0.0, 45 * DEG),
        lean_sd=number(card, "stem.lean_sd", ("deg",), 0.0, 45 * DEG),
    )


def _ear(card: Card) -> EarFacts:
    ear = EarFacts(
        length=number(card, "ear.length", LENGTH, 0.005, 0.5),
        length_cv=number(card, "ear.length_cv", RATIO, 0.0, 0.5),
        width=number(card, "ear.width", LENGTH, 1e-3, 0.2),
        thickness=number(card, "ear.thickness", LENGTH, 1e-3, 0.2),
        inclination_mean=number(card, "ear.inclination_mean", ("deg",), 0.0, 170 * DEG),
        inclination_sd=number(card, "ear.inclination_sd", ("deg",), 0.0, 90 * DEG),
    )
    if ear.length <= ear.diameter:
        raise InputError("ear.length", ear.length, "expected longer than wide", file=card.path)
    return ear


def _leaf(card: Card) -> LeafFacts:
    count_min = round(number(card, "leaf.count_min", RATIO, 0, 20))
    return LeafFacts(
        count_min=count_min,
        count_max=round(number(card, "leaf.count_max", RATIO, count_min, 20)),
        node_top=number(card, "leaf.node_top", RATIO, 0.05, 1.0),
        node_step=number(card, "leaf.node_step", RATIO, 0.0, 0.5),
        length=number(card, "leaf.length", LENGTH, 0.005, 1.0),
        length_cv=number(card, "leaf.length_cv", RATIO, 0.0, 0.5),
        width=number(card, "leaf.width", LENGTH, 2e-4, 0.2),
        width_cv=number(card, "leaf.width_cv", RATIO, 0.0, 0.5),
        elevation_start=number(card, "leaf.elevation_start", ("deg",), -90 * DEG, 90 * DEG),
        elevation_end=number(card, "leaf.elevation_end", ("deg",), -90 * DEG, 90 * DEG),
        elevation_sd=number(card, "leaf.elevation_sd", ("deg",), 0.0, 60 * DEG),
    )


def _yields(card: Card, habit: Habit, height: float) -> YieldFacts:
    share = number(card, "yield.straw_below_share", RATIO, 0.01, 0.9)
    below = number(card, "yield.straw_below_height", LENGTH, 0.01, 0.9 * height) / height
    has_grain = habit in SEEDS
    if habit == "mesh":
        return _mesh_yields(card, math.log(1.0 - share) / math.log(1.0 - below))
    return YieldFacts(
        grain_mass=_grain_mass(card, habit) if has_grain else 0.0,
        straw_to_grain=number(card, "yield.straw_to_grain", RATIO, 0.05, 10.0) if has_grain else 0.0,
        straw_exponent=math.log(1.0 - share) / math.log(1.0 - below),
        grain_density=number(card, "yield.grain_density", ("kg/m3",), 100.0, 1500.0),
        swath_density=number(card, "yield.swath_density", ("kg/m3",), 1.0, 500.0),
        grain_moisture=number(card, "yield.grain_moisture", RATIO, 0.0, 0.6),
        bare_mass=0.0 if has_grain else number(card, "yield.stem_mass", ("g",), 1e-6, 1.0),
    )


def _mesh_yields(card: Card, straw_exponent: float) -> YieldFacts:
    """Masses of a mean plant as they are."""
    grain = number(card, "yield.grain_mass", ("g",), 0.0, 10.0)
    straw = number(card, "yield.straw_mass", ("g",), 1e-6, 10.0)
    return YieldFacts(
        grain_mass=grain,
        straw_to_grain=straw / grain if grain > 0.0 else 0.0,
        straw_exponent=straw_exponent,
        grain_density=number(card, "yield.grain_density", ("kg/m3",), 100.0, 1500.0),
        swath_density=number(card, "yield.swath_density", ("kg/m3",), 1.0, 500.0),
        grain_moisture=number(card, "yield.grain_moisture", RATIO, 0.0, 0.6),
        bare_mass=straw,
    )


def _grain_mass(card: Card, habit: Habit) -> float:
    """Grain of a mean stem [kg]."""
    grains = number(card, f"yield.{SEEDS[habit]}", RATIO, 1.0, 5000.0)
    if habit == "branched":
        grains *= number(card, "pod.per_plant", *POD["per_plant"])
    thousand = number(card, "yield.thousand_grain_mass", ("g",), 1e-4, 1.0)
    return grains * thousand / 1000.0


def _reflectance(card: Card, habit: Habit) -> dict[str, float]:
    stem = [] if habit == "mesh" else ["stem"]
    names = ["ground", "straw", *stem, *REFLECTIVE[habit], "stubble", "weed"]
    names += ["awn"] if "awn" in card.data else []
    return {name: number(card, f"reflectance.{name}", RATIO, 0.0, 1.0) for name in names}
