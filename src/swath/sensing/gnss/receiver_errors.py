"""How far off receivers are, by the quality of their fix."""

from dataclasses import dataclass
from math import exp, hypot, sqrt


@dataclass(frozen=True)
class Figures:
    """Errors of one axis.

    noise: white noise, sd per sample [m]
    wander: sd of a first-order Gauss-Markov error [m]
    wander_time: its correlation time [s]
    vertical: the same of the height, over those of east and north
    velocity: white, sd per sample of each axis [m/s]
    """

    noise: float
    wander: float
    wander_time: float
    vertical: float = 1.75
    velocity: float = 0.03

    @property
    def sd(self) -> float:
        """Standard deviation of east and of north, all errors together [m]."""
        return hypot(self.noise, self.wander)

    def difference(self, lag: float) -> float:
        """Sd of the difference of two positions `lag` apart [m], of east and of north; lag [s] > 0."""
        return sqrt(2.0 * self.noise**2 + 2.0 * self.wander**2 * (1.0 - exp(-lag / self.wander_time)))


# What is behind each figure: docs/explanation/sensors.md. The vertical factor is 1.5 to 2 (uncited).
FIGURES = {
    "single": Figures(0.10, 2.0, 3600.0, velocity=0.05),
    "dgps": Figures(0.03, 0.5, 10_800.0, velocity=0.05),
    "float": Figures(0.02, 0.20, 300.0),
    "fix": Figures(0.007, 0.009, 120.0),
}
# Receiver -> quality of its fix, its errors.
RECEIVERS = {
    "rtk": ("fix", FIGURES["fix"]),
    "rtk_standing": (
        "fix",
        Figures(0.0007, 0.0046, 250.0, vertical=2.1),
    ),  # fitted: a u-blox log of 41 minutes
    "ppp": ("float", Figures(0.01, 0.04, 1200.0)),  # converged
    "rtk_float": ("float", FIGURES["float"]),
    "dgps": ("dgps", FIGURES["dgps"]),
    "single": ("single", FIGURES["single"]),
}
