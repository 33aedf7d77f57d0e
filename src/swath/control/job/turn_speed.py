"""How fast a combine drives between two passes: on the straights of a long way as on transport."""

from math import ceil, sqrt

from swath.control.job.passes import Route

BRAKE = 0.4  # m/s2, gentler than the drive can
LONG, STRAIGHT = 80.0, 2e-3  # m, from which a way is no turn; 1/m, less than which is no bend
EVERY = 2.0  # m between two looks along the way


def speed_between(route: Route, way: float, turning: float, fastest: float) -> float:
    """Speed [m/s] so far along a pass and the turn behind it [m]: on the straights of a long way at most
    `fastest`, from which it brakes before the next bend, and before the pass; else `turning`.
    """
    if route.turn < LONG or fastest <= turning:
        return turning
    reach = (fastest**2 - turning**2) / (2.0 * BRAKE) + EVERY
    for i in range(-1, ceil(reach / EVERY) + 1):
        ahead = way + EVERY * i
        if ahead > route.length + route.turn or abs(route.line.curvature(ahead, 1.0)) > STRAIGHT:
            return min(fastest, sqrt(turning**2 + 2.0 * BRAKE * max(EVERY * (i - 1), 0.0)))
    return fastest
