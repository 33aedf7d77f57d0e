"""Noise of inertial units as their data sheets and tests give it."""

from dataclasses import dataclass
from math import sqrt

from swath.core.units import DEG

STANDARD_GRAVITY = 9.80665  # of the unit g in data sheets [m/s2]
HOUR = 3600.0


@dataclass(frozen=True)
class Axis:
    """One kind of sensor; its unit is rad/s or m/s2.

    density: of its white noise [unit/sqrt(Hz)], as data sheets give it: the Allan deviation at 1 s
    instability: the least Allan deviation [unit]
    """

    density: float
    instability: float

    @property
    def walk(self) -> float:
        """Density K of a random walk of the bias [unit/sqrt(s)] that gives this least Allan deviation.

        White noise N and such a walk have the Allan variance N^2 / tau + K^2 tau / 3 (IEEE Std 952-1997,
        annex C), with the minimum 2 N K / sqrt(3).
        """
        return self.instability**2 * sqrt(3.0) / (2.0 * self.density) if self.density > 0.0 else 0.0


@dataclass(frozen=True)
class Unit:
    """An inertial unit: its gyroscopes [rad/s] and accelerometers [m/s2]."""

    gyro: Axis
    accel: Axis


def _unit(gyro_deg_s: float, gyro_deg_h: float, accel_ug: float, accel_mg: float) -> Unit:
    accel = Axis(accel_ug * 1e-6 * STANDARD_GRAVITY, accel_mg * 1e-3 * STANDARD_GRAVITY)
    return Unit(Axis(gyro_deg_s * DEG, gyro_deg_h * DEG / HOUR), accel)


# deg/s/sqrt(Hz), deg/h, ug/sqrt(Hz), mg; where they are from: docs/explanation/sensors.md
UNITS = {
    "mti-1": _unit(0.007, 10.0, 120.0, 0.03),
    "adis16470": _unit(0.34 / 60.0, 8.0, 0.037 / 60.0 / STANDARD_GRAVITY * 1e6, 0.013),
    "bmi088": _unit(0.014, 15.0, 175.0, 0.035),
}
