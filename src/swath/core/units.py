"""The converter at the border: file keys and flags carry their unit, inside everything is SI and radians.

speed = params.speed_kmh * KMH
"""

from math import pi

KMH = 1.0 / 3.6
DEG = pi / 180.0
MM = 1e-3
CM = 1e-2
MRAD = 1e-3
PERCENT = 1e-2
MS = 1e-3
GRAM = 1e-3
