"""Threshing and separation along a drum or a rotor: two coupled exponentials.

Grain in the ear u and free grain in the straw f over the length x:

    du/dx = -lambda u,   df/dx = lambda u - beta f,   separated = 1 - u - f

(Miu, Combine Harvesters, 2015; separation alone: Boettinger, Beck and Kutzbach). Both rates fall with the
layer.
"""

from math import exp, expm1

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.component import KeepsState

Array = NDArray[np.float64]
FRONT, WIDTH, EAR, FREE, STRAW, FED, SCALE = range(
    7
)  # rows: front and width of the length, kg, factor on rates


def coupled(ear: float, free: float, threshing: float, separation: float) -> tuple[float, float]:
    """(grain in the ear, free grain) after a length, from those before it; both rates times the length.

    Exact for any two rates, equal ones too.
    """
    gap = separation - threshing
    grown = 1.0 + 0.5 * gap if abs(gap) < 1e-6 else expm1(gap) / gap
    left = exp(-separation)
    return ear * exp(-threshing), free * left + ear * threshing * left * grown


class Rotor(KeepsState):
    """Parcels of crop that pass through the rotors; each parcel of one step is exact on its own.

    A parcel has a front and a width; it is threshed until its front comes to the end, then leaves bit by bit.
    threshing, separation: rates over the whole length at the nominal layer; exponent: both go with
    layer^-exponent; passage: time through it at nominal speed [s]
    """

    kept = ("_parcels",)

    def __init__(self, threshing: float, separation: float, exponent: float, passage: float) -> None:
        if abs(separation - threshing) < 1e-6 * threshing:
            separation = threshing * (1.0 + 1e-6)  # two rates that are never equal need no limit
        self._rates, self._exponent, self._passage = (threshing, separation), exponent, passage
        self.clear()

    def clear(self) -> None:
        """Empty it."""
        self._parcels = np.zeros((7, 0))

    def advance(
        self,
        crop: tuple[float, float, float, float],
        *,
        layer: float,
        dt: float,
        ratio: float,
        threshability: float,
    ) -> tuple[float, list[float]]:
        """Take in a step's crop [kg] and move everything on by dt [s].

        crop: grain in the ear, free grain, straw, and the grain it had before the drum [kg]
        layer: thickness of what enters, 1 = nominal; ratio: rotor speed over nominal; threshability: factor
        on both rates. Returns the grain separated [kg] and what leaves [kg], four as `crop`
        """
        path = dt * ratio / self._passage
        if any(crop):
            scale = max(layer, 1e-3) ** -self._exponent
            new = np.array([[0.0], [path], *([m] for m in crop), [scale]])
            self._parcels = np.concatenate([self._parcels, new], axis=1)
        p = self._parcels
        if p.shape[1] == 0:
            return 0.0, [0.0] * 4
        front = p[FRONT] + path
        done = (np.minimum(front, 1.0) - p[FRONT]) * p[SCALE]
        threshing, separation = self._rates
        still, kept = portable.exp(
            done * np.array([[-threshability * threshing], [-threshability * separation]])
        )
        ear = p[EAR] * still
        free = p[FREE] * kept + p[EAR] * (still - kept) * (threshing / (separation - threshing))
        separated = float((p[EAR] + p[FREE] - ear - free).sum())
        p[FRONT], p[EAR], p[FREE] = front, ear, free
        return separated, self._leave()

    def held(self) -> tuple[float, float]:
        """Grain and straw in it [kg]."""
        total = self._parcels.sum(axis=1)
        return float(total[EAR] + total[FREE]), float(total[STRAW])

    def _leave(self) -> list[float]:
        """Take out what is beyond the end; the first parcels first."""
        p, out, whole = self._parcels, np.zeros(4), 0
        for i in range(p.shape[1]):
            over = float(p[FRONT, i]) - 1.0
            if over <= 0.0:
                break
            if over >= float(p[WIDTH, i]) - 1e-12:
                out += p[EAR:SCALE, i]
                whole += 1
                continue
            gone = p[EAR:SCALE, i] * (over / float(p[WIDTH, i]))
            p[EAR:SCALE, i] -= gone
            p[WIDTH, i] -= over
            p[FRONT, i] = 1.0
            out += gone
        self._parcels = p[:, whole:]
        result: list[float] = out.tolist()
        return result
