"""Threshing and separation along a drum or a rotor: two coupled exponentials.

Grain in the ear u and free grain in the straw f over the length x:

    du/dx = -lambda u,   df/dx = lambda u - beta f,   separated = 1 - u - f

(Miu, Combine Harvesters, 2015; separation alone: Boettinger, Beck and Kutzbach). Both rates fall with the
layer.
"""

from math import exp, expm1
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.component import State

Array = NDArray[np.float64]
LEAD, WIDTH, EAR, FREE, STRAW, FED, LAYER = range(7)  # columns of the parcels; lead and width of the length


def coupled(ear: Any, free: Any, threshing: Any, separation: Any) -> tuple[Any, Any]:
    """(grain in the ear, free grain) after a length, from those before it; both rates times the length.

    Exact for any two rates, equal ones too.
    """
    gap = np.asarray(separation) - threshing
    small = np.abs(gap) < 1e-6
    safe = np.where(small, 1.0, gap)
    grown = np.where(small, 1.0 + 0.5 * gap, np.expm1(safe) / safe)
    left = np.exp(-np.asarray(separation))
    return ear * np.exp(-np.asarray(threshing)), free * left + ear * threshing * left * grown


def coupled_one(ear: float, free: float, threshing: float, separation: float) -> tuple[float, float]:
    """As `coupled`, for plain numbers and many times faster."""
    gap = separation - threshing
    grown = 1.0 + 0.5 * gap if abs(gap) < 1e-6 else expm1(gap) / gap
    left = exp(-separation)
    return ear * exp(-threshing), free * left + ear * threshing * left * grown


class Rotor:
    """Parcels of crop on their way through the rotors; each parcel of one step is exact on its own.

    A parcel has a lead and a width; it is threshed until its lead comes to the end, then leaves bit by bit.

    threshing, separation: rates over the whole length at the nominal layer; exponent: both go with
    layer^-exponent; passage: time through it at nominal speed [s]
    """

    def __init__(self, threshing: float, separation: float, exponent: float, passage: float) -> None:
        self._rates, self._exponent, self._passage = (threshing, separation), exponent, passage
        self.clear()

    def clear(self) -> None:
        """Empty it."""
        self._parcels = np.zeros((0, 7))

    def advance(
        self, crop: tuple[float, float, float, float], *, layer: float, dt: float, ratio: float, ease: float
    ) -> tuple[float, Array]:
        """Take in a step's crop [kg] and move everything on by dt [s].

        crop: grain in the ear, free grain, straw, and the grain it had before the drum [kg]
        layer: thickness of what enters, 1 = nominal; ratio: rotor speed over nominal; ease: factor on both
        rates. Returns the grain separated [kg] and what leaves [kg], shape (4,) as `crop`
        """
        parcels, way = self._parcels, dt * ratio / self._passage
        if any(crop):
            parcels = np.concatenate([parcels, np.array([[0.0, way, *crop, max(layer, 1e-3)]])])
        if len(parcels) == 0:
            return 0.0, np.zeros(4)
        new = parcels.copy()
        done = np.minimum(way, 1.0 - parcels[:, LEAD]) * ease * parcels[:, LAYER] ** -self._exponent
        before = parcels[:, EAR] + parcels[:, FREE]
        u, f = coupled(parcels[:, EAR], parcels[:, FREE], self._rates[0] * done, self._rates[1] * done)
        new[:, EAR], new[:, FREE] = u, f
        over = np.maximum(parcels[:, LEAD] + way - 1.0, 0.0)
        share = np.where(
            over >= new[:, WIDTH] - 1e-12, np.where(over > 0.0, 1.0, 0.0), over / (new[:, WIDTH] + 1e-300)
        )
        new[:, LEAD] = np.minimum(parcels[:, LEAD] + way, 1.0)
        new[:, WIDTH] -= over
        leaving = new[:, EAR:LAYER] * share[:, None]
        new[:, EAR:LAYER] -= leaving
        self._parcels = new[share < 1.0]
        return float((before - u - f).sum()), leaving.sum(axis=0)

    def held(self) -> tuple[float, float]:
        """Grain and straw in it [kg]."""
        total = self._parcels.sum(axis=0)
        return float(total[EAR] + total[FREE]), float(total[STRAW])

    def save(self) -> State:
        """The parcels."""
        return {"parcels": self._parcels.copy()}

    def load(self, state: State) -> None:
        """Back to a saved moment."""
        self._parcels = np.array(state["parcels"])
