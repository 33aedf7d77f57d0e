"""A small set of levels and field parts, so that scenario files are tested without the simulator behind."""

import sys
from dataclasses import dataclass, field
from types import ModuleType
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le
from pydantic import Field

from swath.core.errors import InputError
from swath.core.registry import Level, Registry
from swath.scenario.slots import Catalogue, SlotKind


@dataclass(frozen=True)
class Mount:
    """z_m: above ground; pitch_deg: nose down."""

    z_m: Annotated[float, Ge(-30), Le(30)] = 2.4
    pitch_deg: float = 16.0


@dataclass(frozen=True)
class Lidar:
    """sensor: name or file; sub_rays: per beam; sector_deg: first and last azimuth."""

    sensor: str = "sick-lms511-hr"
    mount: Mount = field(default_factory=Mount)
    sub_rays: Annotated[int, Ge(1), Le(217)] = 19
    sector_deg: tuple[float, float] | None = None
    echo: Literal["nearest", "percentile"] = "percentile"
    noise: bool = True


@dataclass(frozen=True)
class Empirical:
    """sensor: name or file; spread_m: of the range."""

    sensor: str = "sick-lms511-hr"
    spread_m: Annotated[float, Gt(0)] = 0.1


@dataclass(frozen=True)
class Speed:
    """speed_kmh: over ground."""

    speed_kmh: Annotated[float, Gt(0), Le(40)] = 7.0


@dataclass(frozen=True)
class Nothing:
    """No parameters."""


@dataclass(frozen=True)
class Stand:
    """stems_per_m2: density; row_spacing_m: of the drill; density_file: a map."""

    crop: str = "wheat"
    stems_per_m2: Annotated[float, Gt(0), Le(2000)] = 500.0
    row_spacing_m: Annotated[float, Ge(0), Le(2)] = 0.125
    density_file: str | None = None

    def __post_init__(self):
        if self.row_spacing_m > 0.5 and self.stems_per_m2 > 1000:
            raise InputError("row_spacing_m", self.row_spacing_m, "expected at most 0.5 at this density")


@dataclass(frozen=True)
class Dem:
    """file: a GeoTIFF of heights."""

    file: str


@dataclass(frozen=True)
class Tooth:
    """depth_m: of the bite."""

    depth_m: float

    def __post_init__(self):
        if self.depth_m > 5:
            raise InputError("depth_m", self.depth_m, "expected at most 5")


@dataclass(frozen=True)
class Straight:
    """length_m: of the edge; gaps: pieces without crop; teeth: bitten out."""

    shape: Literal["straight"] = "straight"
    length_m: Annotated[float, Gt(0), Le(1e5)] = 200.0
    gaps: tuple[tuple[float, float], ...] = ()
    teeth: tuple[Tooth, ...] = ()


@dataclass(frozen=True)
class Curve:
    """radius_m: > 0 to the left."""

    shape: Literal["curve"]
    radius_m: Annotated[float, Gt(0)]


@dataclass(frozen=True)
class Post:
    """x_m, y_m: where; height_m: above ground."""

    kind: Literal["post"]
    x_m: float
    y_m: float
    height_m: Annotated[float, Gt(0)] = 2.0


@dataclass(frozen=True)
class Box:
    """x_m, y_m: where; size_m: edge lengths."""

    kind: Literal["box"]
    x_m: float
    y_m: float
    size_m: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Boundary:
    """points_m: corners."""

    points_m: tuple[tuple[float, float], ...]


class Part:
    """A component that does nothing."""

    inputs = outputs = ()

    def __init__(self, params, setup):
        self.params = params


def _module(name, **content):
    module = ModuleType(name)
    module.__path__ = []
    module.__spec__ = __spec__
    module.__dict__.update(content)
    sys.modules[name] = module
    return module


class FakeRegistry(Registry):
    """Levels from a table; files of the user's as in the real one."""

    table = {
        "terrain": {"plane": Nothing, "formula": Nothing, "dem": Dem},
        "stand": {"uniform": Stand},
        "lidar": {"plants": Lidar, "empirical": Empirical},
        "steer": {"preview": Speed, "pursuit": Nothing},
        "speed": {"constant": Speed},
    }

    def names(self, kind):
        return list(self.table[kind])

    def get(self, kind, level, *, base=None):
        if level in self.table[kind]:
            return Level(Part, self.table[kind][level], summary=f"{level} level")
        return super().get(kind, level, base=base)


_module(
    "fake_field_parts",
    Edge=Annotated[Straight | Curve, Field(discriminator="shape")],
    Obstacle=Annotated[Post | Box, Field(discriminator="kind")],
    Boundary=Boundary,
)
SLOTS = (
    SlotKind("lidar", (), "plants", 25.0, (), is_plural=True),
    SlotKind("steer", (), "preview", 50.0, (), {"scan": ("lidar", "scan")}),
    SlotKind("speed", (), "constant", 10.0, ()),
)
FAKE = Catalogue(
    FakeRegistry(dict.fromkeys(FakeRegistry.table, ())),
    SLOTS,
    {"terrain": "formula", "stand": "uniform"},
    {
        "edge": "fake_field_parts:Edge",
        "obstacles": "fake_field_parts:Obstacle",
        "boundary": "fake_field_parts:Boundary",
        "weather": "swath.field.weather:Weather",
        "evaluators": "swath.judge.catalogue:load_evaluators",
    },
    {"combine": {"lidar": "plants", "steer": "preview", "speed": "constant"}, "tractor_with_trailer": {}},
)

GOOD = """\
format: swath scenario 2
name: small
summary: a small one
seed: 3
run: {distance_m: 50}
field:
  terrain: plane
  stand:
    level: uniform
    stems_per_m2: 400
  edge: {shape: straight, length_m: 80, gaps: [[10, 12]]}
  obstacles:
    - {kind: post, x_m: 3, y_m: -2}
machines:
  combine:
    machine: lexion-700-class
    start: {along_edge_m: 2}
    lidar:
      level: plants
      rate_hz: 25
      mount: {z_m: 2.5}
      wires: {scan: lidar.scan}
    steer: preview
    speed: {speed_kmh: 7}
expect:
  lateral_rms_m: {max: 0.05}
"""
