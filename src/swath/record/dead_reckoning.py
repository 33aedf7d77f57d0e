"""How far off a dead reckoning is: covariance of x, y and heading as speed and yaw rate with errors add up.

Errors that stay during a run are followed by their sensitivities, those that are new with every sample as a
covariance: first-order propagation through x += v dt cos, y += v dt sin, heading += w dt (Thrun, Burgard, Fox
2005, Probabilistic Robotics, 5.4), in plain numbers.
"""

from math import cos, sin

LEAST = 1e-12  # variance at the start: a covariance of zeros would say that it is unknown
Doubt = tuple[float, ...]
"""x, y [m] by what stays of the speed; x, y, heading by what stays of the yaw rate; covariance of the noise:
xx, xy, yy, xh, yh, hh.
"""
EXACT_START: Doubt = (0.0, 0.0, 0.0, 0.0, 0.0, LEAST, 0.0, LEAST, 0.0, 0.0, LEAST)
Spread = tuple[float, float]  # standard deviation of each sample, and of what stays


def gone(doubt: Doubt, heading: float, speed: float, dt: float, speed_sd: Spread, rate_sd: Spread) -> Doubt:
    """The doubt after dt [s] at the middle heading [rad]. speed_sd [m/s]; rate_sd [rad/s]"""
    u, v, p, q, r, xx, xy, yy, xh, yh, hh = doubt
    c, s = cos(heading), sin(heading)
    a, b = -s * speed * dt, c * speed * dt  # of x, y per heading
    turn = rate_sd[1] * dt
    along, turned = (speed_sd[0] * dt) ** 2, (rate_sd[0] * dt) ** 2
    middle = hh + 0.25 * turned
    return (
        u + c * speed_sd[1] * dt,
        v + s * speed_sd[1] * dt,
        p + a * (r + 0.5 * turn),
        q + b * (r + 0.5 * turn),
        r + turn,
        xx + 2.0 * a * xh + a * a * middle + c * c * along,
        xy + a * yh + b * xh + a * b * middle + c * s * along,
        yy + 2.0 * b * yh + b * b * middle + s * s * along,
        xh + a * (hh + 0.5 * turned),
        yh + b * (hh + 0.5 * turned),
        hh + turned,
    )


def covariance(doubt: Doubt) -> tuple[float, ...]:
    """Of (x, y, heading), row by row, (9,)."""
    u, v, p, q, r, xx, xy, yy, xh, yh, hh = doubt
    xx, xy, yy = xx + u * u + p * p, xy + u * v + p * q, yy + v * v + q * q
    xh, yh, hh = xh + p * r, yh + q * r, hh + r * r
    return xx, xy, xh, xy, yy, yh, xh, yh, hh
