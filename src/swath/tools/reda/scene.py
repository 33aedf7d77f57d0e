"""What is asked: sensors on a standing machine before a crop edge, a person at places before and behind it.

After REDA, a person on a grid of places under changing conditions (doi:10.3390/s22155745); the places, crop
and weather here are our own.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.edge import StraightEdge, make_edge
from swath.field.field import Field, make_field
from swath.field.field_setup import FieldSetup
from swath.field.obstacles import Path as ObstaclePath
from swath.field.obstacles import SheetObstacle, things_of
from swath.field.site_setup import Body, SiteSetup
from swath.field.stand import uniform
from swath.field.terrain import plane
from swath.signals.setup import MachineGeometry

EDGE_M = 6.0  # the crop begins so far ahead of the sensors, which stand above the knife
KNIFE_M = 0.5
NAME, TARGET = "rig", "person"
RIG = MachineGeometry(3.0, 2.0, 2.0, 0.5, 6.0, KNIFE_M, 0.0, 0.5, 0.5, (-3.0, 0.0, 1.0, 0.5, 3.0))
WEATHERS = {"clear": (0.0, 0.0), "dust": (0.1, 0.0), "rain": (0.0, 10.0)}  # extinction [1/m], rain [mm/h]
INSIDE = (-3.0, -1.0, 1.0, 3.0, 5.0, 8.0, 11.0, 14.0, 18.0)  # places behind the crop edge [m], < 0 before it
ASIDE = (-8.0, -4.0, 0.0, 4.0, 8.0)
SENSORS = ("lidar", "radar-24ghz", "radar-77ghz-corner", "camera")


@dataclass(frozen=True)
class Condition:
    """height: of the crop [m]; density [stems/m2]; weather: a key of WEATHERS"""

    height: float
    density: float
    weather: str

    @property
    def name(self) -> str:
        """Such as `wheat 0.85 m, 500/m2, dust` without the crop."""
        return f"{self.height:g} m, {self.density:g} stems/m2, {self.weather}"

    @property
    def file(self) -> str:
        """Name of its figure."""
        return f"reda-{100 * self.height:.0f}cm-{self.density:.0f}-{self.weather}.png"


@dataclass(frozen=True)
class Settings:
    """heights [m], densities [stems/m2], weathers: every combination is a condition

    sensors: of SENSORS; target: a kind of `data/obstacles/`; target_height: None = its sheet's
    low_height: of the same one lower, for the table alone [m]; crop: sheet; moisture: of the straw [%]
    camera_px: width of the picture; camera_least_px: height of what is seen of the person that a detector
    needs; least: share of looks from which on a place counts as covered
    repeats: at each place, within 0.3 m; looks: of a radar at each of them
    """

    heights: tuple[float, ...] = (0.6, 0.85)
    densities: tuple[float, ...] = (300.0, 500.0)
    weathers: tuple[str, ...] = tuple(WEATHERS)
    sensors: tuple[str, ...] = SENSORS
    target: str = TARGET
    target_height: float | None = None
    low_height: float = 0.8
    crop: str = "wheat"
    moisture: float = 12.0
    camera_px: int = 1280
    camera_least_px: float = 40.0
    least: float = 0.9
    repeats: int = 2
    looks: int = 8
    seed: int = 1
    base: Path = field(default_factory=Path)

    def __post_init__(self) -> None:
        """InputError for a value that cannot be used."""
        for key, values, low, high in (
            ("--crop-height-m", self.heights, 0.2, 3.0),
            ("--stems-per-m2", self.densities, 10.0, 1500.0),
            ("--moisture-percent", (self.moisture,), 0.0, 80.0),
            ("--camera-px", (self.camera_px,), 64.0, 20000.0),
            ("--camera-least-px", (self.camera_least_px,), 1.0, 2000.0),
            ("--least", (self.least,), 0.01, 1.0),
            ("--repeats", (self.repeats,), 1.0, 100.0),
            ("--seed", (self.seed,), 0.0, 2.0**31),
        ):
            for value in values:
                if not low <= value <= high:
                    raise InputError(key, value, f"expected {low:g} to {high:g}")
        for key, names, known in (
            ("--weather", self.weathers, tuple(WEATHERS)),
            ("--sensor", self.sensors, SENSORS),
        ):
            for name in names:
                if name not in known:
                    raise InputError(key, name, f"expected one of {', '.join(known)}")
            if len(set(names)) < len(names):
                raise InputError(key, " ".join(names), "expected each only once")

    def conditions(self) -> list[Condition]:
        """All of them, the weather last."""
        return [Condition(*values) for values in product(self.heights, self.densities, self.weathers)]


class Scene:
    """The field of a condition, with a person who can be put anywhere. setup: what sensors are given."""

    def __init__(self, settings: Settings, condition: Condition) -> None:
        self.settings, self.condition = settings, condition
        self.stream = Stream(settings.seed, "reda")
        self.field = _field(settings, condition, self.stream)
        self.setup = SiteSetup(self.field, RIG, Pose.identity(), "left", 0.1, NAME, base=settings.base)
        self.field.ensure(0.0, 0.0, 60.0)
        self.height: float | None = settings.target_height

    @property
    def weather(self) -> tuple[float, float]:
        """Extinction of the dust [1/m] and rain [mm/h]."""
        return WEATHERS[self.condition.weather]

    def put(self, inside: float, aside: float, *, repeat: int = 0) -> Body:
        """The person at a place behind the crop edge, within 0.3 m of it after the first time."""
        moved = np.zeros(2)
        turn = 0.0
        if repeat:
            draw = self.stream.child(f"place {inside:g} {aside:g}").at(repeat)
            moved, turn = draw.uniform(-0.3, 0.3, 2), float(draw.uniform(-180.0, 180.0))
        x, y = EDGE_M + inside + float(moved[0]), aside + float(moved[1])
        thing = SheetObstacle(
            kind=self.settings.target,  # type: ignore[arg-type]
            name=TARGET,
            x_m=x,
            y_m=y,
            height_m=self.height,
            heading_deg=turn,
            path=ObstaclePath(to=((x - 1.0, y),)),  # what can go is not part of the standing obstacles
        )
        self.clear()
        self.setup.bodies.set_things(things_of([thing], self.field))
        return next(body for body in self.setup.bodies.around(NAME) if body.name == TARGET)

    def clear(self) -> None:
        """Nobody there."""
        self.setup.bodies.set_things(())


def places() -> Iterator[tuple[float, float]]:
    """All of the grid, (inside, aside) [m]."""
    return product(INSIDE, ASIDE)


def _field(settings: Settings, condition: Condition, stream: Stream) -> Field:
    crop = load_crop(settings.crop, settings.base)
    setup = FieldSetup()
    params = uniform.Params(
        crop=settings.crop,
        stems_per_m2=condition.density,
        row_spacing_m=crop.stand.row_spacing,
        height_factor=condition.height / crop.stand.height,
    )
    line: Any = StraightEdge(
        x_m=EDGE_M, y_m=-200.0, length_m=400.0, crop_begins_m=None, stubble_height_m=0.15
    )
    ground, stand = plane.Plane(plane.Params(), setup), uniform.Uniform(params, setup)
    return make_field(ground, stand, make_edge(line, setup), crop=crop, stream=stream.child("stand"))
