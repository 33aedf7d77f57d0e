"""How fast a cart drives along its way: bends ahead, and the time that the steering takes between them."""

from math import sqrt

from swath.control.steer.guidance_line import GuidanceLine

SIDEWAYS = 0.8  # m/s2, most in a bend
STEERS = 0.16  # rad/s (9 deg/s), of the steering angle: less than steering along a path can
LEAST = 1e-3  # 1/m, 1/m2


def bend_speed(line: GuidanceLine, way: float, speed: float, wheelbase: float) -> float:
    """Speed [m/s] so far along a line [m], for the next metres at the present speed [m/s]."""
    ahead = [way + i for i in range(-2, int(2.0 + 2.5 * speed) + 4, 2)]
    bends = [line.curvature(at, 1.0) for at in ahead]
    bend = max(abs(k) for k in bends[1:-1])
    change = max(abs(b - a) for a, b in zip(bends, bends[2:], strict=False)) / 4.0
    return min(sqrt(SIDEWAYS / max(bend, LEAST)), STEERS / wheelbase / max(change, LEAST))
