"""First-order loops with a limited rate, solved exactly: no step size enters."""

from math import copysign, expm1, isfinite

from swath.core.errors import InputError
from swath.machine.machine_sheet import Dynamics
from swath.signals import EngineState


def approach(value: float, target: float, dt: float, *, lag: float, limit: float) -> tuple[float, float]:
    """Solve dv/dt = clip((target - v) / lag, -limit, limit) over dt [s].

    lag > 0 [s]; limit > 0 [units of v per s]. Returns (v(dt), integral of v over dt). Outside limit * lag of
    the target v is a ramp, inside an exponential.
    """
    error = target - value
    if error == 0.0:
        return value, value * dt
    ramp = abs(error) / limit - lag
    if ramp > 0.0:
        ramp = min(dt, ramp)
        slope = copysign(limit, error)
        reached = value + slope * ramp
        area = (value + 0.5 * slope * ramp) * ramp
    else:
        ramp, reached, area = 0.0, value, 0.0
    rest = dt - ramp
    if rest > 0.0:
        gap = target - reached
        gone = -gap * expm1(-rest / lag)
        area += target * rest - lag * gone
        reached += gone
    return reached, area


class SpeedLoop:
    """The drive as its closed loop: first order with limited acceleration (hydrostat under a governor)."""

    def __init__(self, dynamics: Dynamics) -> None:
        self._d = dynamics

    def advance(self, speed: float, wanted: float, dt: float) -> tuple[float, float]:
        """(speed after dt [s], distance in it [m]); speeds [m/s], < 0 backwards. Slowing uses `decel`."""
        if not isfinite(wanted):
            raise InputError("speed command", wanted, "expected a finite speed")
        d = self._d
        fastest = d.max_speed
        target = wanted if -fastest <= wanted <= fastest else copysign(fastest, wanted)
        grows = abs(target) > abs(speed) and target * speed >= 0.0
        return approach(speed, target, dt, lag=d.speed_lag, limit=d.accel if grows else d.decel)


def within_drive(wanted: float, drive: EngineState | None) -> float:
    """A wanted speed [m/s], at most what the drive can give; without a powertrain unchanged."""
    return wanted if drive is None else min(max(wanted, -drive.speed_limit), drive.speed_limit)
