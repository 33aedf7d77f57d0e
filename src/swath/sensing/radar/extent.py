"""From where an extended thing throws back, and how its apparent place wanders from look to look.

The sides that a thing turns to a radar throw back evenly, as seen from there. Which sides these are is looked
up in steps of 5 deg around it, seen from afar, level; where they lie is exact. Echoes of one resolution cell
have random phases; they shift its apparent place (glint) by a normal error with the standard deviation

    sd_of_the_echoes * sqrt(mean / (2 power))

for a look of this power: the quotient of two Gaussian sums (Delano 1953, A theory of target glint or angular
scintillation in radar tracking, Proc. IRE 41). It is never larger than the thing.
"""

from dataclasses import replace
from math import atan2, pi, sqrt

import numpy as np

from swath.core.frames import Pose
from swath.field.site_setup import Body
from swath.field.solids import moved
from swath.sensing.radar.solid_rays import aimed, distances
from swath.signals import F64

ASPECTS = 72  # around a thing
AFAR = 1000.0  # from where its sides are looked at [m]


class Scatterers:
    """Of things, each kept by its name, size and aspect once it is known."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, bytes, int], F64] = {}

    def of(self, body: Body, eye: F64) -> F64:
        """Points of the sides that a body turns to an eye (3,), each for the same share: world (n, 3)."""
        x, y, _ = (body.pose.inverse().apply(eye) - body.middle).tolist()
        aspect = round(atan2(y, x) * ASPECTS / (2.0 * pi)) % ASPECTS
        key = body.name, body.half.tobytes(), aspect
        if key not in self._known:
            self._known[key] = _facing(body, 2.0 * pi * aspect / ASPECTS)
        return body.pose.apply(self._known[key])


def _facing(body: Body, aspect: float) -> F64:
    """Points in the body's frame (n, 3) that rays from an aspect [rad] meet; its middle where none does."""
    own = replace(body, solids=moved(body.solids, body.pose.inverse()), pose=Pose.identity())
    eye = body.middle + AFAR * np.array([np.cos(aspect), np.sin(aspect), 0.0])
    directions = aimed(own, eye)
    far = distances(own.solids, eye, directions)
    meets = np.isfinite(far)
    return np.asarray(eye + far[meets, None] * directions[meets]) if meets.any() else body.middle[None]


def glint(mean: float, power: float) -> float:
    """Standard deviation of the apparent place over that of the echoes. mean, power: over noise."""
    return sqrt(min(1.0, mean / (2.0 * max(power, 1e-9))))
