"""Odometry with the errors of wheel speed, gyro and steer-angle sensor."""

from dataclasses import dataclass
from math import hypot
from typing import Annotated

from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Normals, Stream
from swath.core.registry import Level
from swath.core.units import DEG, PERCENT
from swath.field.site_setup import SiteSetup
from swath.signals import MachineState, Odometry, SteerState, WheelState

Share = Annotated[float, Ge(0), Le(30)]
Angle = Annotated[float, Ge(0), Le(10)]


@dataclass(frozen=True)
class Params:
    """Errors of the three sensors; each constant error is drawn once per run, N(0, sd).

    slip_percent: the wheels turn faster than the ground passes: 2 to 6 % on stubble (uncited); where the
    motion says itself how its wheels slip (`wheel_slip`), that counts instead
    speed_scale_percent: sd of the calibration error; speed_noise_m_s: sd per sample
    gyro_bias_deg_s: sd of the constant bias; gyro_noise_deg_s: sd per sample (a 0.014 deg/s/sqrt(Hz) MEMS
    gyro read at 50 Hz gives 0.07 deg/s plus vibration)
    steer_bias_deg: sd of the zero error; steer_noise_deg: sd per sample
    """

    slip_percent: Share = 3.0
    speed_scale_percent: Share = 1.0
    speed_noise_m_s: Annotated[float, Ge(0), Le(5)] = 0.02
    gyro_bias_deg_s: Angle = 0.02
    gyro_noise_deg_s: Angle = 0.1
    steer_bias_deg: Angle = 0.2
    steer_noise_deg: Angle = 0.05


class ErrorOdometry(KeepsState):
    """Truth, scaled, biased and noisy."""

    inputs = (
        Port("state", MachineState),
        Port("steering", SteerState),
        Port("wheels", WheelState, optional=True),
    )
    outputs = (Port("odometry", Odometry),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._p = params

    def errors(self, sample: Odometry) -> dict[str, tuple[float, float]]:
        """Noise, and the constant errors with the slip that nobody measures."""
        p = self._p
        stays = hypot(p.slip_percent, p.speed_scale_percent) * PERCENT
        return {
            "speed": (p.speed_noise_m_s, stays * abs(sample.speed)),
            "yaw_rate": (p.gyro_noise_deg_s * DEG, p.gyro_bias_deg_s * DEG),
            "steer_angle": (p.steer_noise_deg * DEG, p.steer_bias_deg * DEG),
        }

    def reset(self, stream: Stream) -> Outputs:
        """Draw the constant errors."""
        p = self._p
        draw = stream.at(0).standard_normal(3).tolist()
        self._normals = Normals(stream)
        self._error = 1 + p.speed_scale_percent * PERCENT * draw[0]
        self._scale = self._error * (1 + p.slip_percent * PERCENT)
        self._gyro_bias = p.gyro_bias_deg_s * DEG * draw[1]
        self._steer_bias = p.steer_bias_deg * DEG * draw[2]
        return {"odometry": Odometry(0, 0.0, self._gyro_bias, self._steer_bias)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """One sample at t + dt."""
        p = self._p
        state: MachineState = inputs["state"]
        steering: SteerState = inputs["steering"]
        wheels: WheelState | None = inputs.get("wheels")
        speed = state.speed * self._scale if wheels is None else wheels.speed * self._error
        noise = self._normals.at(t + dt, 3).tolist()
        return {
            "odometry": Odometry(
                t + dt,
                float(speed + p.speed_noise_m_s * noise[0]),
                float(state.yaw_rate + self._gyro_bias + p.gyro_noise_deg_s * DEG * noise[1]),
                float(steering.angle + self._steer_bias + p.steer_noise_deg * DEG * noise[2]),
            )
        }


LEVEL = Level(
    ErrorOdometry,
    Params,
    "wheel slip, scale error, gyro bias and noise",
    cost="10 us per sample",
    tolerance="equal to ideal with every error at 0",
)
