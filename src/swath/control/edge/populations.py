"""What rays answer in the crop and beside it, learned while driving, and what one more answer is worth.

The class of an answer is a layer of height above the stubble side, dust, no echo, or an echo of the air at
the scanner (`canopy_rays`): nothing behind it answered louder. Counts of the classes on either side of the
edges accepted so far give the log-likelihood ratio of every class.
Nothing is assumed about crop, stubble, density or dust: where puffs swallow the beams on one side only,
"no echo" itself is evidence.
"""

import numpy as np
from numpy.typing import NDArray

from swath.control.edge.canopy_classes import AIR, CLASSES, DUST, LAYER, LAYERS, LOWEST, NOTHING
from swath.control.edge.profile import Clears
from swath.core.portable import exp, log
from swath.signals import F64

MEMORY, SHORT = 15.0, 2.0  # m of travel after which counts are worth 1/e; the same of what has just changed
FRESH, STRANGE = 0.25, 0.15  # share of the short memory, and of anything above the stubble, in the crop
STRAY = 0.03  # share of answers beside the crop that are something else: weeds, straw
MOST = 3.0  # nat that one ray is worth at most
CROP_FROM, CROP_TO = 0.18, (1.15, 2.5)  # m above the stubble: heights of crop that was not seen yet
STUBBLE_TO, LITTLE = 0.8, 0.12  # m; part of the fullest layer's echoes below which a population ends
MAT, FEW = 0.08, 10.0  # m above the middle of the stubble: of crop that lies flat; echoes that show it
COMES_AGAIN = 0.1  # share of the echoes of a layer: fewer that come again are dust
SAMPLE = 0.5  # counts added to each class
TOP = 0.9  # share of the echoes of a stand below its height
NONE = 1e-9  # in the place of no counts, to divide by
_HEIGHT = LOWEST + LAYER * (np.arange(LAYERS) + 0.5)
_TOP = LOWEST + LAYER * (np.arange(LAYERS) + 1)


class Populations(Clears):
    """Counts of classes in the crop, beside it, the solid ones of both, and lately in the crop (5, CLASSES).

    In the air echoes do not come again from scan to scan: a layer where they do not is dust.

    Layers are counted over the plane of the stubble.
    """

    kept = ("counts", "_told", "_first", "_is_air")

    def clear(self) -> None:
        """Nothing learned."""
        self._count(np.zeros((5, CLASSES)))

    def begin(self, sides: F64) -> None:
        """Start with the counts of both sides, as `Block.sides`."""
        self._count(np.vstack([sides, sides[:1]]))

    def move(self, travel: float) -> None:
        """Old counts fade over a travel [m]."""
        self._count(self.counts * exp(-travel / np.array([*4 * [MEMORY], SHORT]))[:, None])

    def add(self, sides: F64) -> None:
        """Counts of both sides of an edge that was accepted, as `Block.sides`."""
        self._count(self.counts + np.vstack([sides, sides[:1]]))

    def _standing(self, side: int) -> F64:
        """Counts of a side, 0 = the crop, without the layers in which nothing comes again (LAYERS,)."""
        return np.asarray(np.where(self._is_air, 0.0, self.counts[side, :LAYERS]))

    def _count(self, counts: F64) -> None:
        self.counts = counts
        self._told: tuple[float, float, float, float] | None = None  # heights and dust of these counts
        self._first: int | None = None  # the lowest layer of these counts that is no stubble
        echoes, solid = (counts[k, :LAYERS] + counts[k + 1, :LAYERS] for k in (0, 2))
        self._is_air: NDArray[np.bool_] = COMES_AGAIN * echoes >= solid + 1.0  # layers of both sides

    def ratios(self, haze: F64 | None = None) -> F64:
        """Log-likelihood ratio [nat] of each class: crop over stubble, (CLASSES,).

        haze: echoes of dust in a layer for each ray that gets there, at places (n,); then (n, CLASSES)
        """
        crop, stubble, lately = _shares(self.counts[[0, 1, 4]])
        above = np.zeros(CLASSES)
        first, tall = self._first_layer(), self._standing(0)
        tall[:first] = 0.0
        top = max(_end_of_peak(tall) + 2, first + 1)
        above[first:top] = 1.0
        above /= max(float(above.sum()), 1.0)
        crop = (1.0 - FRESH - STRANGE) * crop + FRESH * lately + STRANGE * above
        stubble = (1.0 - STRAY) * stubble + STRAY / CLASSES
        if haze is not None:
            dust = haze[:, None] * (np.arange(CLASSES) < LAYERS)
            crop, stubble = crop + dust, stubble + dust
        worth = np.clip(log(crop / stubble), -MOST, MOST)
        worth[..., top : DUST + 1] = 0.0  # a puff above the crop says nothing of what is behind it
        return np.asarray(worth)

    def heights(self) -> tuple[float, float, float]:
        """(crop height, stubble height, share stopped): of echoes above the stubble's own 97th percentile
        the height of the canopy, the 90th percentile of the stubble, both above the plane [m], and the share
        of the rays within the crop that the crop stopped.
        """
        return self._tell()[:3]

    def top(self) -> float:
        """Height of the canopy over the plane of the stubble [m]."""
        return self._tell()[0]

    def dust(self) -> float:
        """The greater share of both sides' rays that met dust, or, in the crop, came back with no echo.

        On the stubble side "no echo" may be that of a ray along the ground.
        """
        return self._tell()[3]

    def _tell(self) -> tuple[float, float, float, float]:
        if self._told is None:
            crop, stubble = self._standing(0), self._standing(1)
            first = self._first_layer()
            answered = float(self.counts[0].sum() - self.counts[0, [DUST, AIR]].sum())
            sides = self.counts[[0, 1, 4]]
            lost = sides[:, DUST] + sides[:, AIR] + [1.0, 0.0, 1.0] * sides[:, NOTHING]
            dust = lost / np.maximum(sides.sum(axis=1), NONE)
            self._told = (
                canopy_height(crop, first),
                _percentile(stubble, TOP),
                float(crop[first:].sum()) / max(answered, NONE),
                float(dust.max()),
            )
        return self._told

    def height_of(self, counts: F64) -> float:
        """Height of the canopy over the plane [m] in other counts (CLASSES,), nan where they hold little."""
        return canopy_height(np.where(self._is_air, 0.0, counts[:LAYERS]), self._first_layer())

    def has_mat(self, counts: F64) -> bool:
        """Other counts (CLASSES,) show crop that lies flat: no canopy, but above the stubble."""
        return middle_of(counts) > middle_of(self.counts[1]) + MAT

    def _first_layer(self) -> int:
        """The lowest layer that is no stubble."""
        if self._first is None:
            low = np.where(_HEIGHT < STUBBLE_TO, self._standing(1), 0.0)
            self._first = _end_of_peak(low) + 1
        return self._first


def middle_of(counts: F64) -> float:
    """Median height [m] of the echoes among counts (CLASSES,), nan where they are few."""
    echoes = counts[:LAYERS]
    return _percentile(echoes, 0.5) if float(echoes.sum()) > FEW else float("nan")


def canopy_height(layers: F64, first: int) -> float:
    """90th percentile [m] of the echoes that belong to the canopy, nan when there are too few.

    layers: counts from the lowest layer on. The canopy reaches from layer `first` over its fullest layer to
    where a tenth of that is left: puffs of dust above it do not count.
    """
    canopy = layers.copy()
    canopy[:first] = 0.0
    if float(canopy.sum()) < 10.0:
        return float("nan")
    canopy[_end_of_peak(canopy) :] = 0.0
    return _percentile(canopy, TOP)


def _end_of_peak(layers: F64) -> int:
    """The first layer above the fullest one that holds little of what that holds."""
    padded = np.zeros(len(layers) + 2)  # much quicker than `numpy.pad`
    padded[1:-1] = layers
    smooth = 0.25 * padded[:-2] + 0.5 * layers + 0.25 * padded[2:]
    peak = int(smooth.argmax())
    is_sparse = smooth[peak:] < LITTLE * smooth[peak]
    first = int(is_sparse.argmax())
    return peak + first if is_sparse[first] else len(layers)


def overlap_of(first: F64, second: F64) -> float:
    """Bhattacharyya coefficient of two rows of counts: of all rays, or, where less, of the echoes near."""
    sides = np.stack([first, second])
    return min(float(np.sqrt(a * b).sum()) for a, b in map(_shares, (sides, sides[:, :LAYERS])))


def crop_excess(crop: F64, stubble: F64) -> float:
    """By how much the share of rays that crop may have stopped is higher in the crop than beside it.

    Low echoes alone, or all: above the first limit there may be puffs of dust, on the stubble side alone.
    """
    excess = []
    for top in CROP_TO:
        is_crop = (_HEIGHT > CROP_FROM) & (top > _HEIGHT)
        shares = [
            float(side[:LAYERS][is_crop].sum()) / max(float(side.sum()), NONE) for side in (crop, stubble)
        ]
        excess.append(shares[0] - shares[1])
    return max(excess)


def _shares(counts: F64) -> F64:
    raised = counts + SAMPLE / CLASSES * 4.0
    return np.asarray(raised / raised.sum(axis=1, keepdims=True))


def _percentile(counts: F64, share: float) -> float:
    total = float(counts.sum())
    if total <= 0.0:
        return float("nan")
    return float(np.interp(share, counts.cumsum() / total, _TOP[: len(counts)]))
