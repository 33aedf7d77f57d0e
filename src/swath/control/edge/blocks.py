"""A block: the rays of some decimetres of travel, counted by place beside the expected edge and by class.

Many rays together show an edge that no single scan shows: at 30 stems/m2 one ray in six is stopped.
"""

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.control.edge.canopy_classes import AIR, CELL, CLASSES, DUST, HALF, LAYERS, NOTHING, PLACES
from swath.control.edge.detector_rows import ANSWER, ROWS
from swath.core.component import State
from swath.core.portable import exp, log, product
from swath.signals import F64

EDGES = -HALF + CELL * np.arange(PLACES + 1)
WINDOW = 2.5  # m to either side of the expected edge whose rays count for a known edge
ALIKE = 0.24  # m of travel from one look at the stand to another that is independent of it
NONE = 1e-12  # in the place of no counts
FINEST = 0.015  # m, standard deviation that no block falls below
FEWEST = 30.0  # rays to either side of an edge
ABOUT = 10  # places of CELL to either side over which the dust of one is taken, own choice
CLEAR = 0.35  # m beside the edge from which on a ray belongs to one side
# layers that count as one while nothing is known: the stubble, whose plane is not known well, then pairs
_MERGED = np.array([0, *range(8, LAYERS, 2), DUST, NOTHING, AIR])
_WITHIN = slice(round((HALF - WINDOW) / CELL), round((HALF + WINDOW) / CELL) + 1)


ROOM = 20  # scans for which there is room at first, estimated


class Block:
    """Counts (PLACES, CLASSES) of rays beside a frame, and how far along it they lie: see answer_rays.cpp.

    solid: of the same, echoes that were there a scan before; row: as of `detector_rows`; rays: the memory
    of `answers`
    """

    def __init__(self, row: NDArray[Any] | None = None) -> None:
        self.row = np.zeros(1, ROWS["counted"]) if row is None else row
        self.rays = np.zeros(0, ANSWER)
        self.counts: F64 = np.zeros((PLACES, CLASSES))
        self.solid: F64 = np.zeros((PLACES, CLASSES))

    def clear(self) -> None:
        """No rays."""
        lost = self.of("lost")
        self.counts[:] = self.solid[:] = 0.0
        self.row[:] = 0
        self.row["lost"] = lost

    def make_room(self, beams: int) -> bool:
        """Have room for one more scan of so many beams; whether its memory is another now."""
        held = int(self.of("rays"))
        is_short = held + beams > len(self.rays)
        if is_short:
            self.rays = np.concatenate([self.rays[:held], np.zeros(max(held, ROOM * beams), ANSWER)])
        return is_short

    @property
    def answers(self) -> NDArray[Any]:
        """What the rays of its scans say, of ANSWER."""
        return self.rays[: int(self.of("rays"))]

    def fade(self, share: float) -> None:
        """All that it holds counts that much; what the rays of its first scan say is left out."""
        self.counts *= share
        self.solid *= share
        for name in ("travel", "along", "near", "scans"):
            self.row[name] *= share
        left = self.answers[self.answers["scan"] > self.of("first")]
        self.rays[: len(left)] = left
        self.row["rays"] = len(left)
        self.row["first"] += 1.0

    def save(self) -> State:
        """Everything that is needed to go on exactly."""
        kept = {"row": self.row, "counts": self.counts, "solid": self.solid, "rays": self.answers}
        return {name: own.copy() for name, own in kept.items()}

    def load(self, state: State) -> None:
        """Take on a state that `save` gave; its memory is another then."""
        for name in ("row", "counts", "solid"):
            getattr(self, name)[:] = state[name]
        self.rays = state["rays"].copy()

    def of(self, name: str) -> float:
        """A number of its row."""
        return float(self.row[name][0])

    @property
    def travel(self) -> float:
        """From its begin [m]."""
        return self.of("travel")

    @property
    def along(self) -> float:
        """Mean place of its rays along the frame [m]."""
        near = self.of("near")
        return self.of("along") / near if near else float("nan")

    @property
    def alike(self) -> float:
        """Rays per independent ray: successive scans see the same stems."""
        return max(1.0, self.of("scans") / max(1.0, self.travel / ALIKE))

    @property
    def haze(self) -> F64:
        """Optical depth of the dust above the crop about each place, (PLACES,), by the share of the rays that
        it answered there.
        """
        met, wide = self.counts[:, DUST], 2 * ABOUT + 1
        if not met.any():
            return np.zeros(PLACES)
        sums = [np.cumsum(np.pad(counts, (ABOUT + 1, ABOUT))) for counts in (self.counts.sum(axis=1), met)]
        rays, met = (total[wide:] - total[:-wide] for total in sums)
        return log((rays + 1.0) / (rays - met + 1.0))

    def just_inside(self, edge: float) -> F64:
        """Counts of classes (CLASSES,) in the first metre of crop behind an edge [m]."""
        return _between(self.counts, edge + 0.1, edge + 1.1)

    def two_strips(self, edge: float) -> tuple[F64, F64]:
        """Counts of classes (CLASSES,) of the crop just behind an edge [m], and of that further in."""
        return _between(self.counts, edge + 0.1, edge + 0.6), _between(self.counts, edge + 1.2, edge + 2.4)

    def sides(self, edge: float) -> F64:
        """Counts well inside the crop and beside it, then the solid ones of both (4, CLASSES); edge [m]."""
        inside, beside = (edge + CLEAR, edge + WINDOW), (edge - WINDOW, edge - CLEAR)
        return np.stack(
            [_between(c, *strip) for c in (self.counts, self.solid) for strip in (inside, beside)]
        )


@dataclass(frozen=True)
class Found:
    """The edge of a block. beside [m] of the frame, variance [m2]; gain [nat] over "all crop" and "no crop".

    lead [nat]: of the best place anywhere, `best` [m], over the best one within the gate
    blank: width of the strip about the edge in which no ray says anything [m]
    """

    beside: float
    variance: float
    gain: float
    lead: float
    blank: float
    best: float = 0.0


def find_edge(block: Block, ratios: F64, gate: float, known: float = inf) -> Found:
    """The edge within +-`gate` [m] of the frame: its mean and variance under the likelihood of all places.

    ratios: of each class, (CLASSES,), or at each place, (PLACES, CLASSES)
    known: variance [m2] with which the edge is known to lie on the frame: mean and variance are then what the
    block adds to that. Where dust hides one side it only says on which side the edge is not.
    """
    strip = slice(_WITHIN.start, _WITHIN.stop - 1)
    counts, is_alike = block.counts[strip], ratios.ndim == 1
    worth = product(counts, ratios) if is_alike else np.einsum("nk,nk->n", counts, ratios[strip])
    worth = worth / block.alike
    score = np.concatenate([np.cumsum(worth[::-1])[::-1], [0.0]])
    place = EDGES[_WITHIN]
    gain = score - max(float(score[0]), 0.0)
    near = np.abs(place) <= gate
    best = float(gain[near].max())
    chance = exp(gain[near] - best)
    chance /= chance.sum()
    mean = float((chance * place[near]).sum())
    variance = float((chance * (place[near] - mean) ** 2).sum())
    if known < inf:
        mean, variance = _added(place[near], chance, known)
    top = int(gain.argmax())
    lead, blank = float(gain[top]) - best, _blank(block.counts, mean)
    return Found(mean, variance + FINEST**2, best, lead, blank, float(place[top]))


def _added(place: F64, chance: F64, known: float) -> tuple[float, float]:
    """Mean [m] and variance [m2] of the normal that takes one about 0 of the variance `known` to the mean and
    the variance of its product with the chances of places. It lies among these: of chances that rise to one
    side all the way no normal is like them.
    """
    both = chance * exp(-0.5 * place**2 / known)
    both /= both.sum()
    mean = float((both * place).sum())
    variance = max(float((both * (place - mean) ** 2).sum()), CELL**2 / 12.0)  # of one place
    more = 1.0 / variance - 1.0 / known
    if more <= 1e-3:
        return 0.0, 1e3
    return min(max(mean / (variance * more), float(place[0])), float(place[-1])), 1.0 / more


def _blank(counts: F64, edge: float) -> float:
    """Width of the strip about an edge [m] in which there are no counts (PLACES, CLASSES) but of dust."""
    filled = np.flatnonzero(np.delete(counts, DUST, axis=1).any(axis=1))
    above = int(np.searchsorted(EDGES[filled], edge))
    first = float(EDGES[filled[above]]) if above < len(filled) else HALF
    last = float(EDGES[filled[above - 1]]) + CELL if above else -HALF
    return max(first - last, 0.0)


def split(block: Block, expected: float, spread: float) -> tuple[float, float, F64, F64]:
    """Where two unknown populations part best: (place [m], gain [nat], crop's counts, stubble's counts).

    Every place is tried as the edge, each side with its own shares of the classes; the gain is that of two
    populations over one, less what chance gives, and a normal prior of `spread` [m] about `expected` [m].
    """
    coarse = np.add.reduceat(block.counts.reshape(PLACES // 4, 4, CLASSES).sum(axis=1), _MERGED, axis=1)
    below = np.cumsum(coarse, axis=0)[:-1]
    total = coarse.sum(axis=0)
    above = total - below
    gain = (_entropy(below) + _entropy(above) - _entropy(total[None])) / block.alike
    gain -= np.count_nonzero(total)
    place = EDGES[4:-1:4]
    rays = below.sum(axis=1), above.sum(axis=1)
    gain[(rays[0] < FEWEST) | (rays[1] < FEWEST)] = -np.inf
    weighed = gain - 0.5 * ((place - expected) / spread) ** 2
    best = float(place[int(np.argmax(weighed))])
    first = round((best + HALF) / CELL)
    return best, float(weighed.max()), block.counts[first:].sum(axis=0), block.counts[:first].sum(axis=0)


def _entropy(counts: F64) -> F64:
    """Log-likelihood [nat] of rows of counts under their own shares."""
    total = counts.sum(axis=1, keepdims=True)
    return np.asarray((counts * log(np.maximum(counts, NONE) / np.maximum(total, NONE))).sum(axis=1))


def _between(counts: F64, low: float, high: float) -> F64:
    first, last = (min(max(round((v + HALF) / CELL), 0), PLACES) for v in (low, high))
    return np.asarray(counts[first:last].sum(axis=0))
