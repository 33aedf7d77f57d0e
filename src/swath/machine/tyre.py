"""Brush tyre with a relaxation length, and what an axle carries.

The brush model with a parabolic pressure over the patch (Pacejka 2012, Tyre and Vehicle Dynamics, section
3.2.1), written per load, since the cornering stiffness of large tyres grows about with the load:

    Fy / Fz = friction * (1 - (1 - x)^3),  x = min(1, stiffness * |tan alpha| / (3 friction))

The slip that the tread feels lags behind the slip of the wheel over the relaxation length sigma
(Pacejka 2012, section 7.2):   sigma ds/dt + |vx| s = vy.   For small slip this is a lagging force,
sigma dF/dt + |v| F = |v| F_ss; kept as slip it still holds the machine on a side slope at standstill.
"""

from math import cos, pi, sqrt

from swath.core.errors import InputError
from swath.core.units import DEG_PER_G

GRAVITY = 9.81  # [m/s2]
CREEP_SPEED = 0.5  # below this the carcass damps (Pacejka 2012, section 8.6, there 2.5 m/s) [m/s]
ROLLING_SPEED = 0.1  # rolling resistance grows to its full value up to this speed [m/s]
LEAST_LOAD = 0.02  # an axle keeps this share of the weight: it does not tip over
MOST_COMPLIANT = 0.02  # compliance of the stiffest axle: stiffness over load 50 [rad]
CREEP_DAMPING = 0.5  # damping ratio of the lateral carcass spring at standstill (estimate)


def axle_stiffness(stiffness: float, understeer: float, *, steers_ahead: bool) -> tuple[float, float]:
    """Cornering stiffness over load [1/rad] of the fixed and of the steered axle.

    stiffness: their harmonic mean [1/rad]; understeer: gradient K [rad per m/s2], the angle of the steered
    axle that a lateral acceleration asks for beyond atan(L kappa): K g = 1/n_front - 1/n_rear (Gillespie
    1992, Fundamentals of Vehicle Dynamics, eq. 6-15, stiffness per load). Raises InputError where an axle
    would have none.
    """
    if understeer == 0.0:
        return stiffness, stiffness
    half = 0.5 * understeer * GRAVITY
    most = 1.0 / stiffness - MOST_COMPLIANT
    if abs(half) > most:
        limit = 2.0 * most / GRAVITY / DEG_PER_G
        expected = f"expected at most {limit:.3g} either way with stiffness_per_rad = {stiffness:g}"
        raise InputError("understeer_deg_per_g", round(understeer / DEG_PER_G, 6), expected)
    front, rear = 1.0 / (1.0 / stiffness + half), 1.0 / (1.0 / stiffness - half)
    return (rear, front) if steers_ahead else (front, rear)


def creep_damping(speed: float, stiffness: float, relaxation: float) -> float:
    """Damping force over load per lateral speed [s/m]; 0 above CREEP_SPEED.

    At rest a tyre is a spring of stiffness * Fz / relaxation; without this a stopped machine swings for ever.
    """
    if abs(speed) >= CREEP_SPEED:
        return 0.0
    at_rest = 2.0 * CREEP_DAMPING * sqrt(stiffness / (relaxation * GRAVITY))
    return at_rest * 0.5 * (1.0 + cos(pi * speed / CREEP_SPEED))
