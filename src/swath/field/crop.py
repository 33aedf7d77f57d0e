"""A crop: the numbers of its stand, organs, yield and reflectance. `crop_sheet.py` reads its data sheet.

Which organs it has and how its plants are drawn is its habit: a file of `field/plants`, or of the user.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeVar

from swath.core.errors import InputError
from swath.documents.data_sheets import Sheet
from swath.documents.sheet_fields import Quantity, annotated

CV = Quantity("percent", 0, 50)  # of a coefficient of variation
REFLECTANCE = annotated(float, Quantity("", 0, 1))
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class StandFacts:
    """density [1/m2], row_spacing [m], stems_per_plant, tiller_spread [m] (sd of a stem's foot about its
    plant), height [m] (mean, ground to the highest point but awns), height_cv, stubble_height [m]
    seen_height [m]: below which nine of ten echoes of a scanner lie that looks over the stand; 0 = height
    sowing_jitter: how far a plant is from its even place in the row, 0 = even, 1 = up to the next one's.
    """

    density: Annotated[float, Quantity("per_m2", 1, 3000)]
    row_spacing: Annotated[float, Quantity("cm", 0, 100)]
    stems_per_plant: Annotated[float, Quantity("", 1, 20)]
    tiller_spread: Annotated[float, Quantity("mm", 0, 200)]
    height: Annotated[float, Quantity("cm", 5, 400)]
    height_cv: Annotated[float, CV]
    stubble_height: Annotated[float, Quantity("cm", 0, 200)]
    seen_height: Annotated[float, Quantity("cm", 0, 450)] = 0.0
    sowing_jitter: Annotated[float, Quantity("percent", 0, 100)] = 1.0


@dataclass(frozen=True, kw_only=True)
class StemFacts:
    """diameter_base, diameter_top [m], diameter_cv; lean_mean, lean_sd [rad] of the chord foot to ear."""

    diameter_base: Annotated[float, Quantity("mm", 0.1, 100)] = 0.0
    diameter_top: Annotated[float, Quantity("mm", 0.1, 100)] = 0.0
    diameter_cv: Annotated[float, CV] = 0.0
    lean_mean: Annotated[float, Quantity("deg", 0, 45)] = 0.0
    lean_sd: Annotated[float, Quantity("deg", 0, 45)] = 0.0


@dataclass(frozen=True, kw_only=True)
class YieldSection(ABC):
    """What every sheet says of the yield. straw_below_share: of the straw, below straw_below_height [m].

    grain_density, swath_density: bulk [kg/m3]
    grain_moisture: fraction.
    """

    straw_below_share: Annotated[float, Quantity("percent", 1, 90)]
    straw_below_height: Annotated[float, Quantity("cm", 1, 360)]
    grain_density: Annotated[float, Quantity("kg_m3", 100, 1500)]
    swath_density: Annotated[float, Quantity("kg_m3", 1, 500)]
    grain_moisture: Annotated[float, Quantity("percent", 0, 60)]

    @abstractmethod
    def masses(self, organs: "Organs") -> tuple[float, float, float]:
        """Masses of a mean stem: grain [kg], straw over grain, and the mass of one without any grain [kg]."""


@dataclass(frozen=True, kw_only=True)
class GrainYield(YieldSection, ABC):
    """Yield with grain. thousand_grain_mass [kg]; straw_to_grain: straw above ground per grain mass."""

    thousand_grain_mass: Annotated[float, Quantity("g", 0.1, 1000)]
    straw_to_grain: Annotated[float, Quantity("", 0.05, 10)]

    @abstractmethod
    def grains(self, organs: "Organs") -> float:
        """Grains of a mean stem."""

    def masses(self, organs: "Organs") -> tuple[float, float, float]:
        """See `YieldSection`."""
        return self.grains(organs) * self.thousand_grain_mass / 1000.0, self.straw_to_grain, 0.0


@dataclass(frozen=True, kw_only=True)
class BareYield(YieldSection):
    """Yield of plants without grain. stem_mass: of one stem [kg]."""

    stem_mass: Annotated[float, Quantity("g", 1e-3, 1000)]

    def masses(self, organs: "Organs") -> tuple[float, float, float]:
        """See `YieldSection`."""
        return 0.0, 0.0, self.stem_mass


@dataclass(frozen=True)
class YieldFacts:
    """grain_mass: of a mean stem (its ear, pods or cob) [kg]; straw_to_grain: straw above ground per grain
    mass; bare_mass: of a mean stem without any grain [kg].

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
class Habit:
    """How plants of a crop are built: the object `HABIT` of a file of `field/plants`, or of the user.

    make: draws plants, called as make(crop, count, rng, how), see `plants/drawing.py`
    yields: class of the sheet's section `yield`
    organs: section of the sheet -> class of its facts, "" for one of several sections; `optional` ones may be
        missing
    reflective: organs whose reflectance the sheet gives, beside ground, straw, stubble and weed; an optional
        organ's own only where it has one
    has_stem: whether the sheet has a section `stem`
    stand: class of its section `stand`
    reduced_leaf_parts: ribbons per leaf for the detail `reduced`
    complete: makes the crop whole with what is not numbers
    pieces: mean number of primitives of a plant, where it may be so large that fewer prototypes have to do
    fruit_only: whether `make` draws less for `Drawing.fruit_only`
    """

    make: Callable[..., Any]
    yields: type[YieldSection]
    organs: Mapping[str, type] = field(default_factory=dict)
    optional: tuple[str, ...] = ()
    reflective: tuple[str, ...] = ("stem",)
    has_stem: bool = True
    stand: type[StandFacts] = StandFacts
    reduced_leaf_parts: int = 3
    complete: "Callable[[Crop, Sheet], Crop] | None" = None
    pieces: "Callable[[Crop], float] | None" = None
    fruit_only: bool = False


class Organs(tuple[Any, ...]):
    """The facts of a crop's organs, found by their class."""

    def of(self, kind: type[T]) -> T | None:
        """The facts of one kind, None for a crop without that organ."""
        return next((organ for organ in self if isinstance(organ, kind)), None)

    def __getitem__(self, kind: type[T]) -> T:  # type: ignore[override]
        """The facts of one kind. InputError for a crop without that organ."""
        found = self.of(kind)
        if found is None:
            raise InputError("crop", kind.__name__, "expected a crop that has this organ")
        return found

    def replaced(self, new: Any) -> "Organs":
        """A copy with other facts of one kind."""
        return Organs(new if isinstance(organ, type(new)) else organ for organ in self)


@dataclass(frozen=True)
class Crop:
    """One crop. reflectance: organ name (lower case, as in `memory_layout.Organ`) -> reflectance at 905 nm.

    organs: of its habit; plants without a stem section have a stem of zeros
    """

    name: str
    stand: StandFacts
    stem: StemFacts
    yields: YieldFacts
    reflectance: dict[str, float]
    habit: Habit
    organs: Organs = field(default_factory=Organs)


@dataclass(frozen=True, kw_only=True)
class Head:
    """The first lines of a crop's sheet."""

    format: str
    name: str
    habit: str = "cereal"
    summary: str = ""
    note: str = ""
