"""What the headers have cut since the start, brought into a grid of measured heights."""

import numpy as np
from numpy.typing import NDArray

from swath.field.field import Field
from swath.field.memory_layout import PAGE_CUT_CELLS, STANDING
from swath.field.pages import Codes
from swath.field.stored_changes import Key
from swath.rays.height_cells import UNTOUCHED
from swath.rays.height_grid import TILE
from swath.rays.heights import HeightCaster

Ints = NDArray[np.int64]


class CutWatch:
    """Lowers the cells of a caster's grid where the field's crop stood at the start and stands no more.

    Looked at only where a ray has just met a measured cell, page by page: what is not seen costs nothing.
    A cell is cut when the field is cut at its middle.
    """

    def __init__(self, field: Field, caster: HeightCaster) -> None:
        self.field, self.caster = field, caster
        grid = caster.grid
        self._tile = np.zeros((len(grid.quantiles), 2), np.int64)
        ty, tx = np.nonzero(grid.table >= 0)
        self._tile[grid.table[ty, tx]] = np.stack([tx, ty], axis=1)
        self._start: dict[Key, Codes] = {}

    def forget(self) -> None:
        """Start anew from the field as it is; `lower` finds again what is cut."""
        self.caster.cells.restore()

    def lower(self, met: NDArray[np.int32]) -> bool:
        """True when some cells that rays met (-1 = none) were cut: those are lowered now, cast again."""
        store = self.field.store
        if not (store.recut or store.packed):
            return False
        cell = np.unique(met[met >= 0].astype(np.int64))
        held = self.caster.cells.cut_at(cell)
        u, v, page = self._places(cell)
        keys = np.unique(page, axis=0)
        is_lower = False
        for i, j in keys.tolist():
            if self._is_changed((i, j)):
                mine = (page == (i, j)).all(axis=1)
                if (self._stubble((i, j), u[mine], v[mine]) != held[mine]).any():
                    self._refresh((i, j))
                    is_lower = True
        return is_lower

    def _is_changed(self, key: Key) -> bool:
        store = self.field.store
        return key in store.recut or store.packed.has_codes(key)

    def _places(self, cell: Ints) -> tuple[Ints, Ints, Ints]:
        """Cut cell of the field (u, v) at the middle of grid cells, and its page (n, 2)."""
        slot, rest = cell // TILE**2, cell % TILE**2
        side = self.caster.grid.cell
        x, y = self.caster.grid.to_world(
            (self._tile[slot, 0] * TILE + rest % TILE + 0.5) * side,
            (self._tile[slot, 1] * TILE + rest // TILE + 0.5) * side,
        )
        size = self.field.maker.cell
        u, v = (np.floor(a / size).astype(np.int64) for a in self.field.to_stand(x, y))
        return u, v, np.stack([u // PAGE_CUT_CELLS, v // PAGE_CUT_CELLS], axis=1)

    def _stubble(self, key: Key, u: Ints, v: Ints) -> NDArray[np.uint8]:
        """Stubble height [cm] of cut cells of a page that stood at the start, UNTOUCHED elsewhere."""
        if key not in self._start:
            self._start[key] = self.field.maker.codes([key])[0]
        self.field.store.need([key])
        now = _codes_at(self.field.store.codes_of(key), u, v)
        stood = _codes_at(self._start[key], u, v) == STANDING
        return np.where(stood & (now != STANDING), now, UNTOUCHED).astype(np.uint8)

    def _refresh(self, key: Key) -> None:
        """Bring all grid cells in a page up to date."""
        page_side = self.field.maker.side
        side = self.caster.grid.cell * TILE
        middle = self.field.maker.to_world((key[0] + 0.5) * page_side, (key[1] + 0.5) * page_side)
        u, v = self.caster.grid.to_local(*middle)
        far = np.hypot((self._tile[:, 0] + 0.5) * side - u, (self._tile[:, 1] + 0.5) * side - v)
        slots = np.flatnonzero(far <= (page_side + side) * np.sqrt(0.5))
        cell = (slots[:, None] * TILE**2 + np.arange(TILE**2)).ravel()
        cu, cv, page = self._places(cell)
        mine = (page == key).all(axis=1)
        self.caster.cells.lower(cell[mine], self._stubble(key, cu[mine], cv[mine]))


def _codes_at(codes: Codes, u: Ints, v: Ints) -> NDArray[np.uint8]:
    if isinstance(codes, int):
        return np.full(len(u), codes, np.uint8)
    return codes[v % PAGE_CUT_CELLS, u % PAGE_CUT_CELLS]
