"""LiDAR level `replay`: measured heights seen again from another path, speed, mounting and scan pattern.

The paper's first approach: measured scans, made into plant heights in a position grid by `swath
height-map build`, are what the beams meet. One ray per beam; the spot of the scanner that measured is in the
heights already. What the headers have cut since the start is brought into the grid.
"""

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from swath.core.component import Outputs, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import DEG
from swath.field.field import Field
from swath.field.memory_layout import PAGE_CUT_CELLS, STANDING
from swath.field.paging.pages import Codes
from swath.field.paging.stored_changes import Key
from swath.field.site_setup import SiteSetup
from swath.rays.height_cells import UNTOUCHED
from swath.rays.height_grid import TILE, HeightGrid, load_height_grid
from swath.rays.heights import SOLID, UNMEASURED, HeightCaster
from swath.sensing.labels import Label
from swath.sensing.scanner import ScannerParams, ScanningLidar
from swath.sensing.single import SingleRays
from swath.signals import F64, U8

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


DULL = 0.3  # intensity where the measurement had none, assumed
Place = Annotated[float, Ge(-1e5), Le(1e5)]


OF_MEASURED: U8 = np.array([Label.NONE, Label.UNKNOWN, Label.UNKNOWN, Label.OBSTACLE], np.uint8)  # by kind


@dataclass(frozen=True)
class Params(ScannerParams):
    """Heights that were measured.

    file: a height map made by `swath height-map build`
    draw: `random` = a height of the distribution, drawn anew for every place and scan; or always one
        `percentile` of it
    percentile: which percentile, from 0 to 100
    grain_m: beams that end in the same square of this side draw the same
    ground: heights stand on the `measured` ground, or on that of the `field`
    x_m: east coordinate of the map's origin in the field
    y_m: north coordinate of the map's origin in the field
    z_m: height of the map's origin in the field
    heading_deg: direction of the map's x axis in the field, from east
    noise: `none`, because measured heights have it in them, or `data_sheet` = that of the data sheet on top
    """

    file: str = field(kw_only=True)
    draw: Literal["random", "percentile"] = "random"
    percentile: Annotated[float, Ge(0), Le(100)] = 50.0
    grain_m: Annotated[float, Ge(0.005), Le(10)] = 0.05
    ground: Literal["measured", "field"] = "measured"
    x_m: Place = 0.0
    y_m: Place = 0.0
    z_m: Annotated[float, Ge(-9000), Le(9000)] = 0.0
    heading_deg: Annotated[float, Ge(-360), Le(360)] = 0.0
    noise: Literal["data_sheet", "none"] = "none"


class ReplayLidar(ScanningLidar):
    """Scans a grid of measured heights with a moving scanner.

    beam_count: beams since the start; unmeasured_count: those that ended where nothing was measured
    """

    kept = (*ScanningLidar.kept, "beam_count", "unmeasured_count")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        self.params = params
        path = Path(params.file)
        grid = load_height_grid(path if path.is_absolute() else setup.base / path)
        self.grid = _placed(grid, params, setup.field)
        self.caster = HeightCaster(self.grid)
        self.watch = CutWatch(setup.field, self.caster)
        self.rays = SingleRays(self.scanner, judged=SOLID, blind=UNMEASURED, by_signal=False, scored=False)
        self._share = params.percentile / 100.0 if params.draw == "percentile" else -1.0
        self.beam_count = self.unmeasured_count = 0

    def reset(self, stream: Stream) -> Outputs:
        """As every scanner, and nothing counted; what was cut is the field's to remember."""
        self._seed = stream.integer()
        self.beam_count = self.unmeasured_count = 0
        self.watch.forget()
        outputs = super().reset(stream)
        self.rays.reset(stream)
        return outputs

    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A scan from sensor origins (beam_count, 3) and rotations (beam_count, 3, 3) in the world."""
        rays, beams, n = self.rays, self.rays.beams, len(origins)
        solids = self.setup.solids()
        self.caster.set_scan(
            range_max=self.scanner.reach,
            seed=scan_seed(self._seed, t),
            share=self._share,
            grain=self.params.grain_m,
        )
        rays.aim(t, origins, rotations)
        self.caster.march(beams, solids)
        while self.watch.lower(beams.cell[:n]):
            self.caster.march(beams, solids)
        self.ray_count += n
        self.beam_count += n
        self.unmeasured_count += int(np.count_nonzero(beams.kind[:n] == UNMEASURED))
        return rays.report(t, origins)

    def labels(self) -> U8:
        """Of the echoes of the newest scan: what was measured is not known by name."""
        return self.rays.labels(self.setup, OF_MEASURED)

    @property
    def notes(self) -> list[str]:
        """As of every scanner, and the share of beams that ended where nothing was measured."""
        found = self.scanner.notes
        if self.unmeasured_count:
            share = 100.0 * self.unmeasured_count / self.beam_count
            found.append(f"lidar: {share:.2g} % of the beams ended where nothing was measured")
        return found

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""
        super().load(state)
        self.watch.forget()


def scan_seed(seed: int, t: int) -> int:
    """32 bits of both numbers: the finish of splitmix64 (Steele et al. 2014, doi:10.1145/2660193.2660195)."""
    z = (seed * 0x9E3779B97F4A7C15 + t) & 0xFFFFFFFFFFFFFFFF
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & 0xFFFFFFFFFFFFFFFF
    z = (z ^ z >> 27) * 0x94D049BB133111EB & 0xFFFFFFFFFFFFFFFF
    return (z ^ z >> 31) & 0xFFFFFFFF


def _placed(grid: HeightGrid, params: Params, ground: Field) -> HeightGrid:
    """The grid where the parameters want it."""
    turn = params.heading_deg * DEG
    c, s = np.cos(turn), np.sin(turn)
    x, y, z = grid.origin
    origin = np.array([params.x_m + c * x - s * y, params.y_m + s * x + c * y, params.z_m + z])
    intensity = np.nan_to_num(grid.intensity, nan=DULL)
    grid = dataclasses.replace(grid, origin=origin, yaw=grid.yaw + turn, intensity=intensity)
    if params.ground == "measured":
        return grid
    ny, nx = grid.ground.shape
    at = grid.to_world(*np.meshgrid(np.arange(nx) * grid.node, np.arange(ny) * grid.node))
    height = ground.ground_height(*at) + params.z_m - origin[2]
    return dataclasses.replace(grid, ground=np.ascontiguousarray(height, np.float32))


LEVEL = Level(
    ReplayLidar,
    Params,
    "measured scans as heights in a grid, seen again from another path",
    cost="about 0.3 us per beam, 1/35 to 1/50 of plants with 37 sub-rays",
    tolerance="height histogram of a run next to the recorded one within 2 cm of plants (Wasserstein-1)",
)
