"""The plants of the field's tile prototypes as a page draws them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import Organ, PlantLibrary, Shape

MOST_PIECES = 52_000  # of all prototypes that are sent
MAIN = (Organ.STEM, Organ.EAR, Organ.BRANCH, Organ.POD, Organ.COB)  # drawn from afar too
UNIT = 1.0 / 2000.0  # of positions [m]
THIN = 1.0 / 10000.0  # of radii and half widths [m]


@dataclass(frozen=True)
class Plants:
    """Pieces of plants, prototype after prototype, each with `per` rows (unused ones have organ 0).

    Of a prototype first the stems and ears by the rank of their plant, so that its first n rows are a thinner
    stand, then leaves and the rest.
    ends: (k, per, 6) int16 in UNIT: both ends; width: (k, per, 3) int16 in THIN: half width of ribbons and
    triangles, radius in the first place and zeros for capsules
    organ: (k, per) uint8, 128 added to triangles, 64 to capsules; stem: (k, per) uint16
    feet: (k, most, 3) uint16 per stem: x, y in UNIT, rank in 1/65535
    mains: stems and ears of each prototype; left_out: share of the pieces that are not sent
    """

    ends: NDArray[np.int16]
    width: NDArray[np.int16]
    organ: NDArray[np.uint8]
    stem: NDArray[np.uint16]
    feet: NDArray[np.uint16]
    mains: list[int]
    left_out: float

    @property
    def count(self) -> int:
        """Prototypes."""
        return len(self.mains)

    @property
    def notes(self) -> list[str]:
        """What a reader should know of it."""
        share = 100.0 * self.left_out
        return [f"{share:.0f} % of the pieces of plants are left out"] if share > 0.0 else []


def plants_of(library: PlantLibrary) -> Plants:
    """As many prototypes as fit into MOST_PIECES; of one that alone does not fit, an even choice."""
    chosen = _chosen(library)
    while len(chosen) > 1 and sum(len(c) for c, _ in chosen) > MOST_PIECES:
        chosen = chosen[: len(chosen) // 2]
    total = sum(len(c) for c, _ in chosen)
    if total > MOST_PIECES:
        rows, mains = chosen[0]
        keep = np.unique(np.linspace(0, len(rows) - 1, MOST_PIECES).astype(int))
        chosen = [(rows[keep], int(np.searchsorted(keep, mains)))]
    sent = sum(len(c) for c, _ in chosen)
    per = max(1, *(len(c) for c, _ in chosen)) if chosen else 1
    first = library.stem_start
    most = max(1, int(np.diff(first).max(initial=1)))
    plants = Plants(
        np.zeros((len(chosen), per, 6), np.int16),
        np.zeros((len(chosen), per, 3), np.int16),
        np.zeros((len(chosen), per), np.uint8),
        np.zeros((len(chosen), per), np.uint16),
        np.zeros((len(chosen), most, 3), np.uint16),
        [mains for _, mains in chosen],
        1.0 - sent / max(total, 1),
    )
    for k, (rows, _) in enumerate(chosen):
        _fill(plants, k, library, rows)
    return plants


def _chosen(library: PlantLibrary) -> list[tuple[NDArray[np.int64], int]]:
    """Rows of each prototype's own pieces in their order, and how many of them are stems and ears."""
    foot = library.base.astype(float)
    own = np.all((foot >= 0.0) & (foot < library.tile_size), axis=1)
    tile = np.searchsorted(library.stem_start, library.owner, side="right") - 1
    main = np.isin(library.organ, MAIN)
    rank = library.stem_rank[library.owner]
    rows = np.flatnonzero(own)
    rows = rows[np.lexsort((rows, rank[rows], ~main[rows], tile[rows]))]
    starts = np.searchsorted(tile[rows], np.arange(library.tile_count + 1))
    parts = [rows[a:b] for a, b in pairwise(starts.tolist())]
    return [(part, int(main[part].sum())) for part in parts]


def _fill(plants: Plants, k: int, library: PlantLibrary, rows: NDArray[np.int64]) -> None:
    n = len(rows)
    ends = np.concatenate([library.a[rows], library.b[rows]], axis=1)
    plants.ends[k, :n] = _int16(ends / UNIT)
    capsule = library.shape[rows] == Shape.CAPSULE
    width = np.where(capsule[:, None], 0.0, library.width[rows])
    width[capsule, 0] = library.radius[rows][capsule]
    plants.width[k, :n] = _int16(width / THIN)
    kind = 64 * capsule + 128 * (library.shape[rows] == Shape.TRIANGLE)
    plants.organ[k, :n] = library.organ[rows] + kind
    first, last = int(library.stem_start[k]), int(library.stem_start[k + 1])
    plants.stem[k, :n] = np.clip(library.owner[rows] - first, 0, 65535)
    feet = library.stem_xy[first:last] / UNIT
    plants.feet[k, : last - first, :2] = np.clip(np.rint(feet), 0, 65535)
    plants.feet[k, : last - first, 2] = np.rint(65535 * np.clip(library.stem_rank[first:last], 0.0, 1.0))


def _int16(values: NDArray[np.floating]) -> NDArray[np.int16]:
    return np.asarray(np.clip(np.rint(values), -32767, 32767), dtype=np.int16)
