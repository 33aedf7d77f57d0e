"""What is gone from a field, counted anew from the codes of its cells: the check of what cuts returned."""

from collections.abc import Mapping
from itertools import islice
from math import fsum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.cutting.cut_result import TILE_CELLS, Cut, StemIndex
from swath.field.memory_layout import PAGE_CUT_CELLS
from swath.field.paging.pages import Codes, PageStore, inflate_codes
from swath.field.paging.stored_changes import Key
from swath.kernels import repeatable, start_warp

TOGETHER = 16  # pages that are made for one look
TILES = 64  # of a page


def recount_pages(store: PageStore, stems: StemIndex, begun: Mapping[Key, int | bytes | None]) -> Cut:
    """Sum over all changed pages, tile by tile and stem by stem, of what is gone against the start.

    begun: packed codes of pages that were not whole at the start
    """
    total, changed, counter = list[tuple[Any, ...]](), store.recut_codes(), None
    while some := dict(islice(changed, TOGETHER)):
        counter = counter or _Counter(stems, store.tile_size)
        for data, (key, codes) in zip(store.make([*some]), some.items(), strict=True):
            before = begun.get(key)
            start = _full(data.codes if before is None else inflate_codes(before))
            total += counter.gone(data.tile_prototype, data.tile_stand, start, _full(codes))
    grain, straw, stem_count, *rest = zip(*total, strict=True) if total else [()] * 6
    return Cut(fsum(grain), fsum(straw), sum(stem_count), *map(fsum, rest))


class _Counter:
    """The compiled count, and the memory that it reads and writes."""

    def __init__(self, stems: StemIndex, tile_size: float) -> None:
        start_warp()
        from swath.field.cutting import recount_kernel as kernel

        library, self._cell = stems.library, tile_size / TILE_CELLS
        columns = (
            (library.stem_start, np.int32), (library.stem_xy, np.float32), (library.stem_rank, np.float32),
            (library.stem_height, np.float64), (stems.ear_height, np.float64), (library.grain_kg, np.float64),
            (library.straw_kg, np.float64), (stems.is_crop, np.uint8),
        )  # fmt: skip
        self._kept = [np.ascontiguousarray(column, dtype) for column, dtype in columns]
        self._whole = np.array([0] * 4 + [column.ctypes.data for column in self._kept], np.int64)
        self._real = np.array([library.tile_size, stems.straw_exponent])
        self._masses, self._counts = np.zeros((TILES, 4)), np.zeros((TILES, 4), np.int32)
        arrays = self._whole, self._real, self._masses, self._counts
        shared = [start_warp().array(a, device="cpu", copy=False) for a in arrays]
        self._launch = repeatable(kernel.recount_page, shared).launch

    def gone(
        self,
        prototypes: NDArray[np.int32],
        stand: NDArray[np.float32],
        start: NDArray[np.uint8],
        now: NDArray[np.uint8],
    ) -> list[tuple[Any, ...]]:
        """From each changed tile of a page the numbers of a `Cut`.

        prototypes, stand: of its tiles; start, now: codes (512, 512)
        """
        dtypes = np.uint8, np.uint8, np.int32, np.float32
        given: list[NDArray[Any]] = [
            np.ascontiguousarray(a, d) for a, d in zip((start, now, prototypes, stand), dtypes, strict=True)
        ]
        self._whole[:4] = [a.ctypes.data for a in given]
        self._launch()
        shares, found = stand[..., 3].ravel().tolist(), []
        rows = zip(self._masses.tolist(), self._counts.tolist(), shares, strict=True)
        for (grain, straw, left, stubble), (is_changed, stem_count, cells, _), share in rows:
            if is_changed:
                area = cells * self._cell**2 if share > 0.0 else 0.0
                found.append((grain, straw, stem_count, area, left, stubble))
        return found


def _full(codes: Codes) -> NDArray[np.uint8]:
    if isinstance(codes, int):
        return np.full((PAGE_CUT_CELLS, PAGE_CUT_CELLS), codes, np.uint8)
    return codes
