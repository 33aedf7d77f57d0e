"""Where an edge begins: every place and heading weighed over all the travel so far, the crop not known yet.

An edge parts two populations of answers. Neither is known, so each side of a place has its own shares of the
classes: what two populations explain better than one, less what their free shares are worth (Schwarz, 1978),
is evidence of an edge there. It adds up from block to block along the line that goes on from there at each
heading, and fades, since line and crop may change. A strip within the crop, such as a tramline, parts two
populations too, and is weighed against the edge. The edge begins where the chance of none is small.
"""

from dataclasses import dataclass
from math import isfinite, pi, sqrt, tan

import numpy as np

from swath.control.edge.blocks import EDGES, Block
from swath.control.edge.canopy_classes import AIR, CELL, CLASSES, DUST, LAYERS, NOTHING, PLACES
from swath.control.edge.canopy_rays import EdgeFrame
from swath.control.edge.profile import Clears
from swath.core.portable import exp, log
from swath.signals import F64

HEADINGS = 0.05 * np.arange(-2, 3)  # rad to the machine, at which an edge may go on: estimated
FADE = 4.0  # m of travel after which evidence is worth 1/e: estimated, so far an edge is straight
BESIDE = 20  # places, 2 m, to either side whose populations are compared: estimated, so far stands are alike
STRIPS = np.arange(3, 7)  # places, width of strips within a stand: wheels leave 0.3 to 0.6 m
DOUBT = 1e-4  # odds of no edge at which one begins: own choice
WIDE = 4  # cells of a place that count as one
NONE = 1e-12  # in the place of no counts
# layers that count as one while nothing is known: the stubble, whose plane is not known well, then pairs
_MERGED = np.array([0, *range(8, LAYERS, 2), DUST, NOTHING, AIR])
_DUST = int(
    np.searchsorted(_MERGED, DUST)
)  # of those: what stands above the crop is no dust, but crop that is taller
_PLACE = EDGES[WIDE:-1:WIDE]
_COUNT = PLACES // WIDE
Place = tuple[float, float, float]  # x, u [m], angle [rad]


@dataclass(frozen=True)
class Begun:
    """Where it begins: beside the frame [m], with a variance [m2], at an angle to it [rad]; gain [nat]."""

    place: float
    variance: float
    angle: float
    gain: float


class EdgeStart(Clears):
    """What speaks for an edge at each place and heading. seen: the rays themselves, along the machine."""

    kept = ("seen", "_counts", "_moved", "_place")

    def clear(self) -> None:
        """Nothing seen."""
        self.seen = Block()
        self._counts: F64 = np.zeros((len(HEADINGS), _COUNT, len(_MERGED)))  # independent rays
        self._moved: F64 = np.zeros(len(HEADINGS))  # m that counts lie aside of where they should
        self._place = (0.0, 0.0, 0.0)  # x, u [m], angle [rad] of the last frame amid its rays

    def add(self, block: Block, frame: EdgeFrame, at: tuple[float, float, float]) -> None:
        """A block of rays in a frame ahead of a machine that stands at x, u [m] with a heading [rad]."""
        left, along = float(exp(-block.travel / FADE)), block.along if isfinite(block.along) else 0.0
        place = _at(_at(at, (frame.x, frame.u, frame.angle)), (along, 0.0, 0.0))
        coarse = block.counts.reshape(_COUNT, WIDE, CLASSES).sum(axis=1)
        fresh = np.add.reduceat(coarse, _MERGED, axis=1) / block.alike
        tall = block.solid[:, DUST].reshape(_COUNT, WIDE).sum(axis=1) / block.alike
        fresh[:, _DUST] -= tall
        fresh[:, _DUST - 1] += tall
        x, u, turned = _from(place, self._place)
        for k, angle in enumerate(HEADINGS.tolist()):
            self._moved[k] += u - x * tan(angle + turned)
            cells = round(float(self._moved[k]) / (WIDE * CELL))
            self._moved[k] -= cells * WIDE * CELL
            self._counts[k] = left * _shifted(self._counts[k], cells) + fresh
        self.seen.join(block, left)
        self._place = place

    def edge(self, spread: float) -> Begun | None:
        """The edge, once it is sure that there is one. spread: deviation of where it is expected [m]."""
        sums = np.concatenate([np.zeros_like(self._counts[:, :1]), np.cumsum(self._counts, axis=1)], axis=1)
        middle = np.arange(1, _COUNT)
        low, high = np.maximum(middle - BESIDE, 0), np.minimum(middle + BESIDE, _COUNT)
        beside, inside = sums[:, middle] - sums[:, low], sums[:, high] - sums[:, middle]
        usual = 0.5 * (_PLACE / spread) ** 2 + log(sqrt(2.0 * pi) * spread / (WIDE * CELL) * len(HEADINGS))
        gain = _two_over_one(beside, inside) - usual
        gain[~(_stopped(inside) > _stopped(beside))] = -np.inf
        best = float(gain.max())
        if not isfinite(best):
            return None
        chance = exp(gain - best)
        k, n = np.unravel_index(int(gain.argmax()), gain.shape)
        strip = _strip(sums[k, low[n] : high[n] + 1] - sums[k, low[n]])
        sure = best + float(log(chance.sum())) - max(strip, 0.0)  # over no edge, or a strip [nat]
        if sure < -float(log(DOUBT)):
            return None
        chance /= chance.sum()
        place, angle = float((chance * _PLACE).sum()), float((chance.sum(axis=1) * HEADINGS).sum())
        variance = float((chance * (_PLACE - place) ** 2).sum()) + (WIDE * CELL) ** 2
        return Begun(place, variance, angle, sure)


def _at(frame: Place, place: Place) -> Place:
    """A place and angle in a frame, in the frame that this one is in: x, u [m], angle [rad]."""
    c, s = float(np.cos(frame[2])), float(np.sin(frame[2]))
    return frame[0] + c * place[0] - s * place[1], frame[1] + s * place[0] + c * place[1], frame[2] + place[2]


def _from(frame: Place, place: Place) -> Place:
    """The same the other way: a place and angle as a frame beside it has them."""
    c, s = float(np.cos(frame[2])), float(np.sin(frame[2]))
    x, u = place[0] - frame[0], place[1] - frame[1]
    return c * x + s * u, c * u - s * x, place[2] - frame[2]


def _shifted(counts: F64, cells: int) -> F64:
    """Rows of counts that many places further in."""
    moved = np.zeros_like(counts)
    if abs(cells) < len(counts):
        moved[max(cells, 0) : len(counts) + min(cells, 0)] = counts[
            max(-cells, 0) : len(counts) - max(cells, 0)
        ]
    return moved


def _two_over_one(first: F64, second: F64) -> F64:
    """By how much two populations explain counts (..., n) better than one [nat]."""
    both = first + second
    alike = [np.maximum(counts.sum(axis=-1), 1.0) for counts in (first, second, both)]
    shares = 0.5 * (np.count_nonzero(both, axis=-1) - 1.0)
    gain = _entropy(first) + _entropy(second) - _entropy(both)
    return np.asarray(gain - shares * log(alike[0] * alike[1] / alike[2]))


def _strip(sums: F64) -> float:
    """The same of the best strip within a window, over the populations on both of its sides being alike.

    sums: of the counts of classes from the window's begin to each place, (n + 1, classes)
    """
    first, width = (a.ravel() for a in np.meshgrid(np.arange(1, len(sums) - 1), STRIPS))
    is_within = first + width < len(sums) - 1
    first, last = first[is_within], (first + width)[is_within]
    strip = sums[last] - sums[first]
    return float(_two_over_one(strip, sums[-1] - strip).max()) if len(strip) else 0.0


def _stopped(counts: F64) -> F64:
    """Share of the rays among counts (..., classes) that something above the stubble stopped."""
    rays = counts.sum(axis=-1) - counts[..., _DUST]
    return np.asarray(counts[..., 1:_DUST].sum(axis=-1) / np.maximum(rays, NONE))


def _entropy(counts: F64) -> F64:
    """Log-likelihood [nat] of counts (..., classes) under their own shares."""
    total = counts.sum(axis=-1, keepdims=True)
    return np.asarray((counts * log(np.maximum(counts, NONE) / np.maximum(total, NONE))).sum(axis=-1))
