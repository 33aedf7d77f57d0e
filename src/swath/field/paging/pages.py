"""Store of pages: made where they are needed, forgotten where nothing was changed, packed when far.

A page is a pure function of its index (`PageMaker`); what a run adds to it are cut codes and straw. A page
that was changed is never lost: when it goes out of memory its codes and straw stay, deflated.
"""

import zlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.memory_layout import (
    DROPPED,
    MOVED,
    PAGE_CUT_CELLS,
    PAGE_NODES,
    PAGE_TILES,
    REVISION,
    STEM_REACH,
    TOUCHED,
    Pages,
    different_pages,
)
from swath.field.paging.stored_changes import Change, Key, StoredChanges

Codes = int | NDArray[np.uint8]
N = PAGE_NODES + 1
IDLE = 160  # pages that are made before one that nobody asked for goes out of memory
AHEAD = 128  # pages at most that are made before they are needed
MARGIN = 8  # pages of the table beyond those that are needed
TOUCHED_MAX = 512  # pages that cuts looked at are noted before these notes are taken over
SPARE = 8  # pages, and pages with cells, for which there is room then
TILE_CELLS = PAGE_CUT_CELLS // PAGE_TILES
GROUND_POOLS = ("ground", "straw", "tile_plane", "tile_bump")
SLOT_POOLS = (*GROUND_POOLS, "tile_stand", "tile_top", "tile_prototype", "cut_slot")  # one row per page


@dataclass(frozen=True)
class PageData:
    """A page as it is at the start. codes: one code for the whole page or (512, 512). Rest as in `Pages`."""

    ground: NDArray[np.float32]
    tile_plane: NDArray[np.float32]
    tile_stand: NDArray[np.float32]
    tile_prototype: NDArray[np.int32]
    codes: Codes


class PageStore:
    """Pages in memory and what was changed on the others.

    make: gives the pages of indices
    finish: called with the store and keys of pages that just came into memory; tile_size [m]
    limit: number of pages kept in memory beyond those asked for last
    touched: (TOUCHED_MAX, 4) pages that cuts looked at since notes were taken over, in the order of the last
        look: i, j, 1 = some tile of it got lower, 1 = some cell of it changed
    """

    def __init__(
        self,
        make: Callable[[Sequence[Key]], list[PageData]],
        finish: Callable[["PageStore", list[Key]], None] = lambda store, keys: None,
        *,
        tile_size: float = 1.0,
        limit: int = 1024,
    ) -> None:
        self.make, self.finish, self.tile_size, self.limit = make, finish, tile_size, limit
        self.counters = np.zeros(5, np.int64)  # of its pages, see `memory_layout.REVISION`
        self.touched = np.zeros((TOUCHED_MAX, 4), np.int32)
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.counters[:STEM_REACH] += 1
        self.counters[STEM_REACH:] = 0
        self.pages = _empty_pages(self.counters)
        self.code_max = np.zeros((0, PAGE_TILES, PAGE_TILES), np.uint8)  # highest code per tile
        self.ground_low = np.zeros(0, np.float32)  # lowest soil of the page [m]
        self.straw_at = np.zeros(0, np.int64)  # where the straw masses of the page lie, 0 = it has none
        self.keys: dict[Key, int] = {}  # slot of every page in memory, oldest use first
        self._used: dict[Key, int] = {}  # pages made before the last use of each of them
        self._recut: set[Key] = set()
        self.straw_mass: dict[Key, NDArray[np.float64]] = {}  # (64, 64) [kg], pages in memory only
        self.packed = StoredChanges()  # changed pages that are not in memory
        self._untouched: dict[Key, PageData] = {}  # pages that are not in memory, as `make` gives them
        self._around: Sequence[Key] = ()  # pages whose neighbours may be needed next
        self._ahead: dict[Key, PageData] = {}  # of these neighbours what `make` gives, made in advance
        self._free: list[int] = []
        self._free_cut: list[int] = []

    @property
    def recut(self) -> set[Key]:
        """Pages in memory whose codes are not those of the start."""
        self.take_notes()
        return self._recut

    def take_notes(self) -> None:
        """Take over what compiled cuts noted: which pages were used, recut, and may have one code now."""
        if not (count := int(self.counters[TOUCHED])):
            return
        self.counters[TOUCHED] = 0
        for i, j, is_lower, is_cut in self.touched[:count].tolist():
            self.keys[i, j] = slot = self.keys.pop((i, j))
            self._used[i, j] = self.pages.made
            if is_cut:
                self._recut.add((i, j))
            if is_lower:
                self._try_collapse(slot)

    def need(self, keys: Sequence[Key]) -> None:
        """Bring pages into memory; forget those unused for long, and for longest when there are too many."""
        self.take_notes()
        missing = []
        for key in keys:
            slot = self.keys.pop(key, None)
            if slot is None:
                missing.append(key)
            else:
                self.keys[key] = slot
                self._used[key] = self.pages.made
        if not missing:
            return
        excess = len(self.keys) + len(missing) - self.limit
        for key in self._unused(set(keys) if excess > 0 else (), excess):
            self._drop(key)
        self.pages.made += len(missing)
        self._used.update(dict.fromkeys(missing, self.pages.made))
        self._widen(missing)
        made = {k: kept.pop(k) for kept in (self._untouched, self._ahead) for k in missing if k in kept}
        if len(made) < len(missing):
            new = [key for key in missing if key not in made]
            made.update(zip(new, self.make(new), strict=True))
        for key in missing:
            self._insert(key, made[key])
        self.finish(self, missing)
        self.pages.counters[REVISION] += 1
        self._around = keys

    def need_at(self, i: NDArray[np.int64], j: NDArray[np.int64]) -> None:
        """Bring the pages of some indices (n,) into memory."""
        self.need(different_pages(i, j))

    def prepare(self) -> bool:
        """Make room, or one neighbour of the pages needed last, in advance; False where there is all of it.

        What a page holds depends on its index alone: no result changes by it.
        """
        if self._make_room():
            return True
        near = {(i + a, j + b): None for i, j in self._around for a in (-1, 0, 1) for b in (-1, 0, 1)}
        known = (self.keys, self._untouched, self._ahead)
        new = next((key for key in near if not any(key in pages for pages in known)), None)
        if new is not None and len(self._ahead) >= AHEAD:
            self._ahead = {key: page for key, page in self._ahead.items() if key in near}
        if new is None or len(self._ahead) >= AHEAD:
            self._around = ()
            return False
        (self._ahead[new],) = self.make([new])
        return True

    def _make_room(self) -> bool:
        """Let what is nearly full grow, which copies it."""
        if len(self._free) < SPARE and 0 < len(self.pages.ground) < self.limit:
            self._grow()
        elif len(self._free_cut) < SPARE and len(self.pages.cut):
            self._grow_cut()
        else:
            return False
        self.pages.counters[REVISION] += 1
        return True

    def _unused(self, keep: Collection[Key], excess: int) -> list[Key]:
        """Pages unused while IDLE others were made, `excess` at least, never those of `keep`."""
        old: list[Key] = []
        for key in self.keys:
            if self._used[key] > self.pages.made - IDLE and len(old) >= excess:
                break
            if key not in keep:
                old.append(key)
        return old

    def codes_of(self, key: Key) -> Codes:
        """Codes of a page in memory: one for all, or a view (512, 512)."""
        self.take_notes()
        row = int(self.pages.cut_slot[self.keys[key]])
        return -1 - row if row < 0 else self.pages.cut[row]

    def open_cut(self, slot: int) -> int:
        """Row of `cut` of a page, made from its uniform code where it has none."""
        row = int(self.pages.cut_slot[slot])
        if row >= 0:
            return row
        if not self._free_cut:
            self._grow_cut()
        new = self._free_cut.pop()
        self.pages.cut[new] = -1 - row
        self.pages.cut_slot[slot] = new
        return new

    def open_straw(self, key: Key, slot: int, masses: NDArray[np.float64]) -> None:
        """Let a page in memory have straw masses (64, 64) [kg], where compiled code finds them."""
        self.straw_mass[key], self.straw_at[slot] = masses, masses.ctypes.data

    def _try_collapse(self, slot: int) -> None:
        """Give the cut row back when all its cells have one code."""
        row = int(self.pages.cut_slot[slot])
        if row < 0:
            return
        cells = self.pages.cut[row]
        code = int(cells[0, 0])
        if int(self.code_max[slot].min()) == code and bool((cells == code).all()):
            self.pages.cut_slot[slot] = -1 - code
            self._free_cut.append(row)

    def changes(self) -> dict[Key, Change]:
        """Every changed page, in and out of memory, by key in order."""
        found = dict(self.packed)
        for key in self.recut | set(self.straw_mass):
            found[key] = self._pack(key)
        return dict(sorted(found.items()))

    def recut_codes(self) -> Iterator[tuple[Key, Codes]]:
        """Codes of every page, in and out of memory, whose codes are not those of the start."""
        yield from ((key, self.codes_of(key)) for key in self.recut)
        for key in filter(self.packed.has_codes, self.packed):
            codes = self.packed[key].codes
            if codes is not None:
                yield key, inflate_codes(codes)

    def restore(self, changes: dict[Key, Change]) -> None:
        """Forget everything, then take over changed pages."""
        self.clear()
        self.packed = StoredChanges(changes)

    def reset(self) -> None:
        """Forget all changes.

        Pages that were not cut are not made again, but come into memory anew, so that rays meet the same
        bounds as in a fresh store, bit for bit.
        """
        recut = self.recut
        untouched = {key: self._data_of(key) for key in self.keys if key not in recut}
        self.restore({})
        self._untouched = untouched

    def straw_of(self, key: Key) -> NDArray[np.float64] | None:
        """Straw masses (64, 64) [kg] of a page in or out of memory, None without any."""
        mass = self.straw_mass.get(key)
        if mass is None and self.packed.has_straw(key):
            packed = self.packed[key].straw
            mass = None if packed is None else inflate_straw(packed)
        return mass

    def all_straw(self) -> dict[Key, NDArray[np.float64]]:
        """Straw masses of every page that has any."""
        keys = sorted({*self.straw_mass, *filter(self.packed.has_straw, self.packed)})
        return {k: mass for k in keys if (mass := self.straw_of(k)) is not None}

    @property
    def byte_count(self) -> int:
        """Memory held [bytes]."""
        p = self.pages
        pools = [p.table, p.cut, self.code_max, *(getattr(p, name) for name in SLOT_POOLS)]
        return int(sum(a.nbytes for a in (*pools, *self.straw_mass.values())))

    def _insert(self, key: Key, data: PageData) -> None:
        if not self._free:
            self._grow()
        slot = self._free.pop()
        p = self.pages
        p.ground[slot], self.ground_low[slot] = data.ground, data.ground.min()
        p.straw[slot] = 0.0
        p.tile_plane[slot], p.tile_stand[slot] = data.tile_plane, data.tile_stand
        p.tile_prototype[slot] = data.tile_prototype
        change = self.packed.pop(key, None)
        codes = data.codes
        if change is not None and change.codes is not None:
            codes = inflate_codes(change.codes)
            self._recut.add(key)
        if change is not None and change.straw is not None:
            self.open_straw(key, slot, inflate_straw(change.straw))
        if isinstance(codes, int):
            p.cut_slot[slot] = -1 - codes
            self.code_max[slot] = codes
        else:
            p.cut_slot[slot] = -1
            row = self.open_cut(slot)
            p.cut[row] = codes
            self.code_max[slot] = codes.reshape(PAGE_TILES, TILE_CELLS, PAGE_TILES, TILE_CELLS).max(
                axis=(1, 3)
            )
        self.keys[key] = slot
        p.table[key[1] - p.table_y, key[0] - p.table_x] = slot

    def _data_of(self, key: Key) -> PageData:
        """What `make` gave for a page in memory whose codes are those of the start."""
        p, slot, codes = self.pages, self.keys[key], self.codes_of(key)
        ground, plane, stand, prototype = (
            pool[slot].copy() for pool in (p.ground, p.tile_plane, p.tile_stand, p.tile_prototype)
        )
        return PageData(ground, plane, stand, prototype, codes if isinstance(codes, int) else codes.copy())

    def _drop(self, key: Key) -> None:
        p = self.pages
        if key in self._recut or key in self.straw_mass:
            self.packed[key] = self._pack(key)
            self._recut.discard(key)
            self.straw_mass.pop(key, None)
        slot = self.keys.pop(key)
        self.straw_at[slot] = 0
        del self._used[key]
        self.counters[DROPPED] += 1
        if p.cut_slot[slot] >= 0:
            self._free_cut.append(int(p.cut_slot[slot]))
        p.cut_slot[slot] = -1
        p.table[key[1] - p.table_y, key[0] - p.table_x] = -1
        self._free.append(slot)

    def _pack(self, key: Key) -> Change:
        codes: int | bytes | None = None
        if key in self._recut:
            now = self.codes_of(key)
            codes = now if isinstance(now, int) else zlib.compress(now.tobytes(), 1)
        straw = self.straw_mass.get(key)
        return Change(codes, None if straw is None else zlib.compress(straw.tobytes(), 1))

    def _grow(self) -> None:
        p, old = self.pages, len(self.pages.ground)
        new = max(2 * old, 32)
        for name in SLOT_POOLS:
            setattr(p, name, _grown(getattr(p, name), new))
        for name in ("code_max", "ground_low", "straw_at"):
            setattr(self, name, _grown(getattr(self, name), new))
        self.counters[MOVED] += 1
        self._free[:0] = range(new - 1, old - 1, -1)

    def _grow_cut(self) -> None:
        old = len(self.pages.cut)
        new = max(2 * old, 8)
        self.pages.cut = _grown(self.pages.cut, new)
        self.counters[MOVED] += 1
        self._free_cut[:0] = range(new - 1, old - 1, -1)

    def _widen(self, keys: list[Key]) -> None:
        """Let the window table hold the keys; with room on each side where it has to grow."""
        p = self.pages
        ny, nx = p.table.shape
        x, y = np.array([k[0] for k in keys]), np.array([k[1] for k in keys])
        x0, x1, y0, y1 = int(x.min()), int(x.max()) + 1, int(y.min()), int(y.max()) + 1
        if p.table_x <= x0 and x1 <= p.table_x + nx and p.table_y <= y0 and y1 <= p.table_y + ny:
            return
        x0, x1 = _wider(p.table_x, p.table_x + nx, x0, x1)
        y0, y1 = _wider(p.table_y, p.table_y + ny, y0, y1)
        if (x1 - x0) * (y1 - y0) > 1 << 26:
            raise InputError("field", None, "expected a run within one region, the places are too far apart")
        table = np.full((y1 - y0, x1 - x0), -1, np.int32)
        if nx > 0:
            table[p.table_y - y0 : p.table_y - y0 + ny, p.table_x - x0 : p.table_x - x0 + nx] = p.table
        p.table, p.table_x, p.table_y = table, x0, y0
        self.counters[MOVED] += 1


class KeptPages:
    """A maker of pages that keeps what it made last. most: pages."""

    def __init__(self, make: Callable[[Sequence[Key]], list[PageData]], most: int = 1024) -> None:
        self._make, self._most = make, most
        self._kept: dict[Key, PageData] = {}

    def __call__(self, keys: Sequence[Key]) -> list[PageData]:
        """The pages of indices."""
        kept = self._kept
        new = [key for key in keys if key not in kept]
        made = dict(zip(new, self._make(new), strict=True)) if new else {}
        found = [made[key] if key in made else kept.pop(key) for key in keys]
        kept.update(zip(keys, found, strict=True))
        for key in list(kept)[: max(len(kept) - self._most, 0)]:
            del kept[key]
        return found


def inflate_codes(codes: int | bytes) -> Codes:
    """Codes of a page from their packed form."""
    if isinstance(codes, int):
        return codes
    flat = np.frombuffer(zlib.decompress(codes), np.uint8)
    return flat.reshape(PAGE_CUT_CELLS, PAGE_CUT_CELLS)


def inflate_straw(straw: bytes) -> NDArray[np.float64]:
    """Straw masses of a page from their packed form."""
    flat = np.frombuffer(zlib.decompress(straw), np.float64)
    return flat.reshape(PAGE_NODES, PAGE_NODES).copy()


def _wider(first: int, end: int, needed: int, needed_end: int) -> tuple[int, int]:
    """First and end of a range that holds another one: room of an eighth is added where that lies beyond."""
    if first == end:
        return needed - MARGIN, needed_end + MARGIN
    room = MARGIN + (end - first) // 8
    below = needed - room if needed < first else first
    return below, needed_end + room if needed_end > end else end


def _empty_pages(counters: NDArray[np.int64]) -> Pages:
    f = np.float32
    return Pages(
        counters=counters,
        table=np.full((0, 0), -1, np.int32),
        table_x=0,
        table_y=0,
        ground=np.zeros((0, N, N), f),
        straw=np.zeros((0, N, N), f),
        tile_plane=np.zeros((0, PAGE_TILES, PAGE_TILES, 3), f),
        tile_stand=np.zeros((0, PAGE_TILES, PAGE_TILES, 4), f),
        tile_top=np.zeros((0, PAGE_TILES, PAGE_TILES), f),
        tile_prototype=np.zeros((0, PAGE_TILES, PAGE_TILES), np.int32),
        cut_slot=np.zeros(0, np.int32),
        cut=np.zeros((0, PAGE_CUT_CELLS, PAGE_CUT_CELLS), np.uint8),
        tile_bump=np.zeros((0, PAGE_TILES, PAGE_TILES), f),
    )


def _grown(pool: NDArray[Any], count: int) -> NDArray[Any]:
    grown = np.zeros((count, *pool.shape[1:]), pool.dtype)
    grown[: len(pool)] = pool
    return grown
