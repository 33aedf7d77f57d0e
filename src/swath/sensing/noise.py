"""Noise of a scanner as its data sheet gives it: range, constant bias, angle; and drop-outs."""

import numpy as np
from numpy.typing import NDArray

from swath.core.random import Stream
from swath.sensing.lidar_sheet import LidarSheet
from swath.signals import F64


class Noise:
    """What one instance of a scanner adds.

    is_on: False = no range noise, bias, resolution and angle noise of the sheet
    angle: one sigma of the direction in the scan plane [rad], None = the sheet's
    dropout: chance that a beam is lost
    """

    def __init__(self, sheet: LidarSheet, *, is_on: bool, angle: float | None, dropout: float) -> None:
        self.sheet, self.is_on, self.dropout = sheet, is_on, dropout
        self.angle = angle if angle is not None else sheet.angle_noise if is_on else 0.0
        self.bias = 0.0
        self._stream = Stream(0, "noise")

    def reset(self, stream: Stream) -> None:
        """Draws the constant range bias [m] of this instance, uniform in the data sheet's band."""
        band = self.sheet.systematic if self.is_on else 0.0
        self.bias = float(stream.at(0).uniform(-band, band))
        self._stream = stream

    def measure(self, distance: F64, rng: np.random.Generator, signal: F64 | None = None) -> F64:
        """Reported ranges [m] of true ones, any shape, nan stays nan.

        signal: received energy over the least detectable, same shape
        """
        if not self.is_on:
            return distance
        sigma = self.sheet.noise_sigma(distance, signal)
        noisy = distance + self.bias + sigma * rng.standard_normal(distance.shape)
        step = self.sheet.resolution
        return np.round(noisy / step) * step if step > 0 else noisy

    def swing(self, t: int, count: int) -> F64 | None:
        """Azimuth errors of the beams in the sweep that ends at t [rad], (count,), None = no angle noise."""
        if self.angle == 0.0:
            return None
        return self.angle * self._stream.child("angle").at(t).standard_normal(count)

    def dropped(self, t: int, count: int) -> NDArray[np.bool_] | None:
        """Which beams of the sweep that ends at t are lost, (count,), None = none ever."""
        if self.dropout == 0.0:
            return None
        return np.asarray(self._stream.child("drop_out").at(t).uniform(size=count) < self.dropout)
