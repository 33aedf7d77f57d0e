"""Brush tyre with a relaxation length, and what an axle carries.

The brush model with a parabolic pressure over the patch (Pacejka 2012, Tyre and Vehicle Dynamics, section
3.2.1), written per load, since the cornering stiffness of large tyres grows about with the load:

    Fy / Fz = friction * (1 - (1 - x)^3),  x = min(1, stiffness * |tan alpha| / (3 friction))

The slip that the tread feels lags behind the slip of the wheel over the relaxation length sigma
(Pacejka 2012, section 7.2):   sigma ds/dt + |vx| s = vy.   For small slip this is a lagging force,
sigma dF/dt + |v| F = |v| F_ss; kept as slip it still holds the machine on a side slope at standstill.
"""

from math import cos, pi, sqrt

GRAVITY = 9.81  # [m/s2]
CREEP_SPEED = 0.5  # below this the carcass damps (Pacejka 2012, section 8.6, there 2.5 m/s) [m/s]
ROLLING_SPEED = 0.1  # rolling resistance grows to its full value up to this speed [m/s]
CREEP_DAMPING = 0.5  # damping ratio of the lateral carcass spring at standstill (estimate)


def creep_damping(speed: float, stiffness: float, relaxation: float) -> float:
    """Damping force over load per lateral speed [s/m]; 0 above CREEP_SPEED.

    At rest a tyre is a spring of stiffness * Fz / relaxation; without this a stopped machine swings for ever.
    """
    if abs(speed) >= CREEP_SPEED:
        return 0.0
    at_rest = 2.0 * CREEP_DAMPING * sqrt(stiffness / (relaxation * GRAVITY))
    return at_rest * 0.5 * (1.0 + cos(pi * speed / CREEP_SPEED))
