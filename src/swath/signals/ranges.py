"""Ranges of what signals hold, in SI: what a field, a machine and its sensors can come to.

All are estimates, wide enough for any machine that works in a field: what lies outside is a slip, such as
degrees for radians or a place for a distance. Masses may be as little below 0 as rounding and solvers end,
measured flows as their noise takes them.
"""

from math import pi

SHARE = 0.0, 1.0
CODE8, CODE16 = (0, 255), (0, 65_535)
NUMBER = 0.0, 2.0**53  # of a thing that is followed: whole in a float
DIMENSIONLESS = -1e3, 1e3  # a ratio that may be large at standstill
LOAD = -10.0, 1e3  # of an engine over what it gives
SPEED_RATIO = -0.1, 5.0  # of an engine over its rated speed
RATIO = -1.0, 1e6  # a load over another one
GAIN = 0.0, 1e6
RECEIVED = -1e6, 1e6  # power of an echo, in whatever a device counts it: a share, raw counts, decibels
COEFFICIENT = -1e6, 1e6  # of a lens
PIXEL = -1e5, 1e5
PIXELS = 0.0, 1e10
COVARIANCE = -1e12, 1e12

PLACE = -1e7, 1e7  # in a field's frame, or in a grid of the Earth [m]
HEIGHT = -2e4, 2e4  # of a place, of an antenna [m]
WAY = -1e8, 1e8  # driven, forward less backward [m]
FAR = -1e5, 1e5  # from one machine to another or along a path ahead [m]
SIGHT = 0.0, 1e4  # of a sensor [m]
ASIDE = -50.0, 50.0  # what a header or a scanner at the machine reaches [m]
AHEAD = -50.0, 500.0  # likewise, ahead [m]
PART = -50.0, 50.0  # from a machine's origin to one of its parts [m]
SIZE = 0.0, 1e3  # of a thing in a field [m]
TOP = -100.0, 1e3  # of it [m]
CANOPY = -1.0, 10.0  # top of crop or stubble as measured, of knives and feelers [m]
BOX = -15.0, 15.0  # in and about an open box [m]
DEVIATION = 0.0, 1e6  # 1 sigma, of what is as good as not known too

ANGLE = -3.15, 3.15  # half a turn, rounded by whatever sends it [rad]
HEADING = -4.0 * pi, 4.0 * pi  # from east, however it is wrapped [rad]
STEEP = -1.58, 1.58  # a quarter of a turn, likewise: wheels, headers, latitudes [rad]
CURVATURE = -2.0, 2.0  # [1/m]
EXTINCTION = 0.0, 1e3  # [1/m]

SPEED = -30.0, 30.0  # of a machine [m/s]
MEASURED_SPEED = -100.0, 100.0  # [m/s]
RATE = -10.0, 10.0  # of a machine that turns, of an axle that steers [rad/s]
MEASURED_RATE = -100.0, 100.0  # [rad/s]
ACCELERATION = -100.0, 100.0  # [m/s2]
FORCE_PER_MASS = -1e4, 1e4  # as an inertial unit feels it [m/s2]

MASS = -1.0, 1e6  # in or on a machine [kg]
TOTAL = -1.0, 1e9  # since the start [kg]
AMOUNT = -1e-6, 1e5  # in a step [kg], [m2]
COUNT = 0, 10**12
FLOW = -10.0, 1e3  # [kg/s]
CROP = 0.0, 100.0  # [kg/m2]
FORCE = -1e7, 1e7  # [N]
POWER = -1e8, 1e8  # [W]
ENGINE = -1.0, 2e3  # [rad/s]
STEP = 0.0, 1e6  # length of a step [s]
AGE = 0.0, 1e10  # [s]
SWEEP = -60.0, 1.0  # time of a beam before the end of its sweep [s]
EXPOSURE = 0.0, 3600.0  # [s]
KELVIN = 0.0, 1e4  # apparent temperature [K]
