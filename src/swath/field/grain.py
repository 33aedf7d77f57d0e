"""Grain that leaves a machine: who takes it, and the piles of it on the ground."""

from math import floor, fsum, isfinite
from typing import Any, Protocol

from swath.core.component import KeepsState
from swath.core.errors import InputError
from swath.signals.setup import OpenBox

SQUARE = 0.5  # grain on the ground is counted by squares of this side [m]


class GrainReceiver(Protocol):
    """Whatever grain can fall on or into: the ground, the body of a cart."""

    def receive(self, mass_kg: float, place: Any) -> None:
        """Take over grain [kg] that comes down from `place`, world point (3,) [m]. It keeps all of it."""
        ...


class GrainBox(Protocol):
    """An open box on a machine. box: its measures; gained: grain in it beyond that of the start [kg]."""

    @property
    def box(self) -> OpenBox:
        """Measures of the box."""

    @property
    def gained(self) -> float:
        """Grain in it beyond that at the start [kg]."""

    def pour(self, mass: float, x: float, y: float, ground: GrainReceiver, pose: Any) -> float:
        """Take grain [kg] at a place [m]; the mass that stays in the box [kg]."""

    def surface_at(self, x: float, y: float) -> float:
        """Height of the surface at a place of the box [m]."""


class GrainPiles(KeepsState):
    """Mass of grain on the ground, by squares of the world [kg]."""

    kept = ("_mass",)

    def __init__(self) -> None:
        self._mass: dict[tuple[int, int], float] = {}

    def add(self, x: float, y: float, mass_kg: float) -> None:
        """Grain [kg] onto the square of a world point [m]. Raises InputError for a mass below 0."""
        if not 0.0 <= mass_kg < float("inf"):
            raise InputError("mass_kg", mass_kg, "expected >= 0")
        if not (isfinite(x) and isfinite(y)):
            raise InputError("position", (x, y), "expected finite x and y")
        if mass_kg > 0.0:
            square = floor(x / SQUARE), floor(y / SQUARE)
            self._mass[square] = self._mass.get(square, 0.0) + mass_kg

    def piles(self) -> list[tuple[float, float, float]]:
        """Middle of each square with grain and the grain there: x, y [m], mass [kg]."""
        return [((i + 0.5) * SQUARE, (j + 0.5) * SQUARE, m) for (i, j), m in self._mass.items()]

    @property
    def total(self) -> float:
        """Mass of all grain on the ground [kg]."""
        return fsum(self._mass.values())
