"""Odometry with the errors of wheel speed, gyro and steer-angle sensor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Le

from swath.compiled import Compiled
from swath.core.component import Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.rows import row_of
from swath.core.together import InWorlds, KeepsRows, Samples
from swath.core.units import DEG, PERCENT
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated
from swath.sensing import CHECKED
from swath.sensing.normals import AllNormals
from swath.signals import MachineState, Odometry, SteerState, WheelState

Share = Annotated[float, Ge(0), Le(30)]
Angle = Annotated[float, Ge(0), Le(10)]


@dataclass(frozen=True)
class Params:
    """Errors of the three sensors. Each constant error is drawn once per run, N(0, sd).

    slip_percent: how much faster the wheels turn than the ground passes: 2 to 6 % on stubble (uncited). Where
        the motion reports its wheels' slip (`wheel_slip`), that counts instead
    speed_scale_percent: sd of the calibration error of the speed
    speed_noise_m_s: sd of the speed's noise per sample
    gyro_bias_deg_s: sd of the gyro's constant bias
    gyro_noise_deg_s: sd of the gyro's noise per sample (a MEMS gyro of 0.014 deg/s/sqrt(Hz) read at 50 Hz
        gives 0.07 deg/s, plus vibration)
    steer_bias_deg: sd of the steering angle's zero error
    steer_noise_deg: sd of the steering angle's noise per sample
    """

    slip_percent: Share = 3.0
    speed_scale_percent: Share = 1.0
    speed_noise_m_s: Annotated[float, Ge(0), Le(5)] = 0.02
    gyro_bias_deg_s: Angle = 0.02
    gyro_noise_deg_s: Angle = 0.1
    steer_bias_deg: Angle = 0.2
    steer_noise_deg: Angle = 0.05


class ErrorOdometry(InWorlds):
    """Truth, scaled, biased and noisy."""

    inputs: tuple[Port, ...] = (
        Port("state", MachineState),
        Port("steering", SteerState),
        Port("wheels", WheelState, optional=True),
    )
    outputs = (Port("odometry", Odometry),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.p = params

    def errors(self, sample: Odometry) -> dict[str, tuple[float, float]]:
        """Noise, and the constant errors with the slip that nobody measures."""
        p = self.p
        stays = hypot(p.slip_percent, p.speed_scale_percent) * PERCENT
        return {
            "speed": (p.speed_noise_m_s, stays * abs(sample.speed)),
            "yaw_rate": (p.gyro_noise_deg_s * DEG, p.gyro_bias_deg_s * DEG),
            "steer_angle": (p.steer_noise_deg * DEG, p.steer_bias_deg * DEG),
        }

    @classmethod
    def together(cls, parts: Sequence["ErrorOdometry"]) -> "Odometers":
        """Make one object that steps these parts of many worlds together."""
        return Odometers(parts)


class IdealOdometry(ErrorOdometry):
    """The true speed over ground, however the wheels slip."""

    inputs = ErrorOdometry.inputs[:2]


class Odometers(KeepsRows, Compiled):
    """Odometers of many worlds. constant: drawn for each: error of the speed, with slip, two biases."""

    kept = ("constant",)
    reads: ClassVar = {"state": MachineState, "steering": SteerState, "wheels": WheelState}

    def __init__(self, parts: Sequence[ErrorOdometry]) -> None:
        n = len(parts)
        super().__init__(n, {"odometry": row_of(Odometry, n)})
        self._p = [part.p for part in parts]
        sizes = [(p.speed_noise_m_s, p.gyro_noise_deg_s * DEG, p.steer_noise_deg * DEG) for p in self._p]
        self._noise_sd, self._noise = np.array(sizes), np.zeros((n, 3))
        self._normals = AllNormals(self._noise)
        self.constant = np.zeros((n, 4))

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Draw the constant errors."""
        self._normals.reset(streams)
        for world, (p, stream) in enumerate(zip(self._p, streams, strict=True)):
            draw = stream.at(0).standard_normal(3).tolist()
            error = 1 + p.speed_scale_percent * PERCENT * draw[0]
            biases = p.gyro_bias_deg_s * DEG * draw[1], p.steer_bias_deg * DEG * draw[2]
            self.constant[world] = error, error * (1 + p.slip_percent * PERCENT), *biases
        arrays = self.sent["odometry"].arrays
        arrays["speed"][:], arrays["yaw_rate"][:], arrays["steer_angle"][:] = 0.0, *self.constant[:, 2:].T
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """The noise, then a sample with it."""
        from swath.sensing.odometry.error_kernel import measure

        has_wheels = "wheels" in self.given
        inputs = [
            self.column("wheels" if has_wheels else "state", "speed"),
            self.column("state", "yaw_rate"),
            self.column("steering", "angle"),
        ]
        table = self.sent["odometry"].memory.view(np.float64).reshape(self.worlds, -1)
        given = [*inputs, 0 if has_wheels else 1, self.constant, self._noise_sd, self._noise, table]
        return [self._normals.launch(self.clock[1:2], self.needs), self.launch(measure, *given)]

    def supply(self, stage: int) -> None:
        """Numbers that numpy draws."""
        self._normals.finish(int(self.clock[1]))


LEVEL = Level(
    ErrorOdometry,
    Params,
    "wheel slip, scale error, gyro bias and noise",
    cost="20 us per sample, 7 us in a batch of worlds",
    tolerance="equal to ideal with every error at 0",
    checked=CHECKED,
)
PRESETS = {
    "ideal": LEVEL.preset(
        "true speed, yaw rate and steer angle",
        "7 us per sample",
        IdealOdometry,
        **dict.fromkeys(Params.__dataclass_fields__, 0.0),
    )
}
