"""The field: the one truth that every sensor looks at and every header cuts."""

from collections.abc import Sequence
from dataclasses import fields
from functools import cached_property, partial
from math import fsum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.abilities import HasNotes
from swath.core.asked import bare, gathered, telling
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.crop import Crop
from swath.field.crop_sheet import weed_crop
from swath.field.cutting.cut_field import Cutter
from swath.field.cutting.cut_result import Corner, Cut, StemIndex, cells_inside, corners_of
from swath.field.cutting.height_bounds import update_tops
from swath.field.cutting.land import LandMemory, Tasks
from swath.field.cutting.recount import recount_pages
from swath.field.edges.boundary import Region
from swath.field.edges.edge import Edges, check_edges, named_edges
from swath.field.edges.edge_defects import BrokenEdge, Gap
from swath.field.edges.profile import Profile, refused
from swath.field.edges.rows import moved_edges, rows_of
from swath.field.edges.track import EdgeShape
from swath.field.field_setup import HasExtent, Stand, Terrain
from swath.field.grain import GrainPiles
from swath.field.ground.footprint import Block, Footprint
from swath.field.ground.soil import Ruts, Soil, Strip
from swath.field.memory_layout import PAGE_CUT_CELLS, PAGE_NODES, STANDING, Pages, PlantLibrary
from swath.field.moisture import Moisture
from swath.field.paging.pages import KeptPages, PageStore
from swath.field.paging.stored_changes import Change, Key
from swath.field.plume import Puffs
from swath.field.straw import StrawLayer, write_depth
from swath.field.tile_generator import PageMaker
from swath.field.weather import SiteWeather
from swath.field.wetness import by_weather, film_share
from swath.field.wind import Sway, Wind, make_sway

Array = NDArray[np.float64]
FEW = 4  # points at most whose ground is looked up without a page, beside a profile
FAR = 1e6  # places beyond this are refused [m]
PROFILED = 32.0  # of the ground on a profile's way that is held at a time [m]


class Field:
    """Terrain, stand and what was cut and dropped. All positions are world ENU metres.

    library: plant prototypes; pages: the memory that rays read, in the stand frame, which is the world turned
        by `stand_yaw` [rad] about z
    edges: of the crop at the start, by name
    crop_height, seen_height: usual ones of the crop, standing upright [m]: of its tips, as a scanner sees it
    grain: on the ground
    moisture: of the stand
    wind: what sways the stand; the library and the pages know nothing of it
    weather: None = the scenario says nothing of it

    Pages come into memory by `ensure`, and by themselves where any verb touches the field.
    """

    def __init__(
        self,
        terrain: Terrain,
        stand: Stand,
        edges: Edges,
        library: PlantLibrary,
        *,
        stream: Stream,
        boundary: Region | None = None,
        crop_height: float = 0.0,
        seen_height: float = 0.0,
        straw_exponent: float = 1.0,
        straw_density: float = 25.0,
        page_limit: int = 1024,
        weather: SiteWeather | None = None,
    ) -> None:
        if stand.density_max > library.density_max * (1.0 + 1e-6):
            expected = f"expected at most the {library.density_max:g} stems/m2 of the plant library"
            raise InputError("field.stand.density_max", stand.density_max, expected)
        self.terrain, self.stand, self.boundary = terrain, stand, boundary
        self.rows = rows_of(library.row_spacing, float(stand.row_heading))
        edges, self._moved = moved_edges(edges, self.rows)
        self.edges: Edges = edges
        self.library = library
        self.stand_yaw = float(stand.row_heading)
        said: Moisture = getattr(stand, "moisture", Moisture())
        self._by_weather = bare(said).is_by_weather
        self.moisture = by_weather(said, weather, crop_height)
        self.weather = weather
        self.plumes: dict[str, Puffs] = {}  # by machine
        self.wind = _felt_wind(getattr(stand, "wind", None), self.stand_yaw, weather)
        self.straw_density, self.crop_height, self.seen_height = straw_density, crop_height, seen_height
        self.stems = StemIndex(library, straw_exponent)
        seed = stream.child("tiles").integer()
        self.maker = PageMaker(terrain, stand, edges, boundary, library, seed)
        self.soil: Soil | None = None  # firm ground
        self.ruts = Ruts()
        finish = partial(
            _finish, library=library, sway=self._sway, depth_per_kg=self._depth_per_kg, ruts=self.ruts
        )
        self.store = PageStore(self.maker.make, finish, tile_size=library.tile_size, limit=page_limit)
        self.grain = GrainPiles()
        self.profile: Profile | None = None  # what is looked at and cut instead of pages
        self._begun: dict[str, Any] | None = None  # what the start is, where it is not the untouched field
        self._begun_grain = 0.0
        self._turn = float(np.cos(self.stand_yaw)), float(np.sin(self.stand_yaw))
        turn, depth = (*self._turn, self.stand_yaw), self._depth_per_kg
        self._land = LandMemory(self.store, library, turn=turn, sway=self._sway, depth_per_kg=depth)

    @cached_property
    def _cutter(self) -> Cutter:
        return Cutter(self._land, self.stems)

    @cached_property
    def _straw(self) -> StrawLayer:
        return StrawLayer(self._land)

    @property
    def notes(self) -> list[str]:
        """What was assumed of the maps that it is made of, and of its edges."""
        parts = {"field.terrain": self.terrain, "field.stand": self.stand, "field.weather": self.weather}
        said = [f"{key}: {n}" for key, p in parts.items() if isinstance(p, HasNotes) for n in p.notes]
        if self.weather is not None and self._by_weather:
            said += self.weather.beyond()
        return [*said, *self._moved]

    def film(self, t: int) -> float:
        """Share of the straw that water covers at a time of the run [ns]."""
        return film_share(self.moisture.of_straw(t), self.moisture)

    @property
    def pages(self) -> Pages:
        """Page memory as in `layout.Pages`. Its arrays are replaced when they grow: read them anew."""
        return self.store.pages

    @property
    def first_edge(self) -> EdgeShape:
        """Line of the first edge, without gaps and teeth: for whoever needs an edge and has no machine."""
        return next(iter(self.edges.values())).shape

    def gaps_of(self, shape: EdgeShape | None) -> Sequence[Gap]:
        """The gaps of the edge with this line, none where there is no such edge."""
        return next((edge.gaps for edge in self.edges.values() if edge.shape is shape), ())

    def to_stand(self, x: Any, y: Any) -> tuple[Array, Array]:
        """World points in the stand frame."""
        c, s = self._turn
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        return c * x + s * y, c * y - s * x

    def ensure(self, x: Any, y: Any, radius_m: float) -> None:
        """Bring the pages within the radius of one or more points into memory."""
        u, v = (np.atleast_1d(a) for a in self.to_stand(x, y))
        _check_near(u, v)
        if not 0.0 <= radius_m <= 1e4:
            raise InputError("radius_m", radius_m, "expected 0 to 10000 m")
        side, keys = self.maker.side, {}
        for cu, cv in zip(u.tolist(), v.tolist(), strict=True):
            i = np.arange(int((cu - radius_m) // side), int((cu + radius_m) // side) + 1)
            j = np.arange(int((cv - radius_m) // side), int((cv + radius_m) // side) + 1)
            du = np.maximum(np.maximum(i * side - cu, cu - (i + 1) * side), 0.0)
            dv = np.maximum(np.maximum(j * side - cv, cv - (j + 1) * side), 0.0)
            jj, ii = np.nonzero(du**2 + dv[:, None] ** 2 <= radius_m**2)
            keys.update(dict.fromkeys(zip(i[ii].tolist(), j[jj].tolist(), strict=True)))
        self.store.need(list(keys))

    def prepare(self) -> bool:
        """Make one page in advance that may be needed next: a run in step with a clock has time for that.

        1 to 5 ms of work that changes no result; False where there is nothing to do.
        """
        return self.store.prepare()

    def compile(self) -> None:
        """Load compiled code that is first needed on the way: before a run is in step with a clock."""
        self._straw.is_done()

    def covers(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True where the field is: inside its boundary and its terrain map, where it has them."""
        inside = np.ones(np.broadcast_shapes(np.shape(x), np.shape(y)), dtype=bool)
        if self.boundary is not None:
            inside &= self.boundary.contains(x, y)
        return inside & self.terrain.covers(x, y) if isinstance(self.terrain, HasExtent) else inside

    def why_outside(self, x: Any, y: Any) -> str:
        """Why none of these world points [m] is in the field, empty where one is: `beyond its boundary`."""
        return self.each_outside(np.reshape(x, (1, -1)), np.reshape(y, (1, -1)))[0]

    def each_outside(self, x: Any, y: Any) -> list[str]:
        """The same of each row of world points, (n, m)."""
        maps = [(part, what) for part, what in ((self.stand, "stand"), (self.terrain, "terrain"))
                if isinstance(part, HasExtent)]  # fmt: skip
        known = [(part.covers(x, y), f"beyond the map of its {what}") for part, what in maps]
        if self.boundary is not None:
            known.append((self.boundary.contains(x, y), "beyond its boundary"))
        found = [""] * len(x)
        for inside, why in known:
            for row in np.flatnonzero(~inside.any(axis=1)).tolist():
                found[row] = why
        return found

    def ground_height(self, x: Any, y: Any) -> Array:
        """Height of the soil [m], bilinear on the lattice that rays hit, in the shape of x and y."""
        if self.profile is not None and np.size(x) <= FEW:
            return self.ground_at(x, y)
        u, v = (a / self.maker.node for a in self._points(x, y))
        iu, iv = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
        slot = self._slots(iu // PAGE_NODES, iv // PAGE_NODES)
        a, b, fu, fv = iu % PAGE_NODES, iv % PAGE_NODES, u - iu, v - iv
        z = self.pages.ground
        z00, z10 = z[slot, b, a].astype(np.float64), z[slot, b, a + 1].astype(np.float64)
        z01, z11 = z[slot, b + 1, a].astype(np.float64), z[slot, b + 1, a + 1].astype(np.float64)
        low, high = z00 + (z10 - z00) * fu, z01 + (z11 - z01) * fu
        return np.asarray(low + (high - low) * fv)

    def ground_at(self, x: Any, y: Any) -> Array:
        """As `ground_height`, to the bit, without pages; the time grows with the square of the points."""
        u, v = self._points(x, y)
        u, v = u / self.maker.node, v / self.maker.node
        iu, iv = np.floor(u), np.floor(v)
        near, far = np.arange(u.size).reshape(u.shape), np.arange(u.size, 2 * u.size).reshape(u.shape)
        columns = self.maker.node * np.concatenate([iu, iu + 1.0], axis=None)
        rows = self.maker.node * np.concatenate([iv, iv + 1.0], axis=None)
        z = self.terrain.lattice(columns, rows, self.stand_yaw).astype(np.float32).astype(np.float64)
        low = z[near, near] + (z[near, far] - z[near, near]) * (u - iu)
        high = z[far, near] + (z[far, far] - z[far, near]) * (u - iu)
        return np.asarray(low + (high - low) * (v - iv))

    def footprint(self, points: Any) -> Footprint:
        """The ground under points (n, 2) [m] of a body that moves through the field, for kernels."""
        return Footprint(points, self._turn, self.maker.node, self._nodes)

    def cut(self, polygon: Any, height_m: float) -> Cut:
        """Cut the crop within a convex polygon (n, 2) [m] at a height above the ground [m].

        Takes whole cells, by their centre, each once whatever was cut before; rounds the height to 1 cm;
        what is lower already stays.
        """
        if not 0.0 <= height_m <= 2.54:
            raise InputError("height_m", height_m, "expected 0 to 2.54 m")
        if self.profile is not None:
            return self.profile.cut(np.array(corners_of(polygon)), round(100.0 * height_m))
        return self._cutter.cut(_corners_near(polygon), round(100.0 * height_m))

    def lend(self, tasks: Tasks, world: int) -> None:
        """Let compiled code do what polygons of a world ask for, as far as memory is there."""
        if self.profile is None:
            tasks.know(world, self._land, self._cutter.stems)
        else:
            tasks.count(world, self.profile.straw)

    def standing_area(self, polygon: Any) -> float:
        """Area of standing crop within a convex polygon (n, 2) [m2]."""
        if self.profile is not None:
            return self.profile.standing_area(np.array(corners_of(polygon)))
        corners = _corners_near(polygon)
        try:
            return self._cutter.cut(corners, STANDING).area
        except InputError:  # too many corners, or too wide
            cells = cells_inside(np.stack(self.to_stand(*np.array(corners).T), axis=1) / self.maker.cell)
            return int(np.count_nonzero(self._stands(*cells))) * self.maker.cell**2

    def standing_areas(self, triangles: Array) -> Array:
        """Areas of standing crop in several triangles, (n, 3, 2), (n,)."""
        if self.profile is None:
            return np.array([self.standing_area(own) for own in triangles])
        sides = triangles[:, 1:] - triangles[:, :1]
        turns = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
        return self.profile.standing_areas(
            np.where(turns[:, None, None] < 0.0, triangles[:, ::-1], triangles)
        )

    def standing(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True where crop stands, in the shape of x and y."""
        if self.profile is not None:
            return self.profile.stands(x, y)
        return self._stands(*(np.floor(a / self.maker.cell).astype(np.int64) for a in self._points(x, y)))

    def standing_along(self, starts: Sequence[Corner], step: Corner, count: int) -> NDArray[np.bool_]:
        """As `standing`, compiled, at middles of `count` steps from starts on [m]: (n, count)."""
        (c, s), cell, (dx, dy) = self._turn, self.maker.cell, step
        _check_near(*np.array([*starts, *((x + count * dx, y + count * dy) for x, y in starts)]).T)
        if self.profile is not None:
            return self.profile.standing_along(starts, step, count)
        places = [((c * x + s * y) / cell, (c * y - s * x) / cell) for x, y in starts]
        crop = self._cutter.standing(places, (c * dx + s * dy) / cell, (c * dy - s * dx) / cell, count)
        if crop is None:  # some of the pages are not in memory
            middle, (x, y) = np.arange(count) + 0.5, np.array(starts).T[:, :, None]
            return self.standing(x + dx * middle, y + dy * middle)
        return crop

    def left_height(self, x: Any, y: Any) -> Array:
        """What is left of the crop [m], in the shape of x and y: inf = it stands, 0 = the ground is bare."""
        code, has_stems = self._codes(
            *(np.floor(a / self.maker.cell).astype(np.int64) for a in self._points(x, y))
        )
        return np.where(code == STANDING, np.where(has_stems, np.inf, 0.0), 0.01 * code)

    def _stands(self, u: NDArray[np.int64], v: NDArray[np.int64]) -> NDArray[np.bool_]:
        """True where crop stands, for columns and rows of cells."""
        code, has_stems = self._codes(u, v)
        return np.asarray((code == STANDING) & has_stems)

    def _codes(
        self, u: NDArray[np.int64], v: NDArray[np.int64]
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Codes of columns and rows of cells, and whether stems are there at all."""
        slot = self._slots(u // PAGE_CUT_CELLS, v // PAGE_CUT_CELLS)
        p, u, v = self.pages, u % PAGE_CUT_CELLS, v % PAGE_CUT_CELLS
        row = p.cut_slot[slot]
        code = np.where(row < 0, -1 - row, 0).astype(np.uint8)
        dense = row >= 0
        if dense.any():
            code[dense] = p.cut[row[dense], v[dense], u[dense]]
        return code, np.asarray(p.tile_stand[slot, v // 64, u // 64, 3] > 0.0)

    @property
    def is_firm(self) -> bool:
        """Whether the ground stays as it is."""
        return self.soil is None or not self.soil.has_ruts

    def press(self, strips: Sequence[Strip]) -> None:
        """Let wheels leave ruts in soil that gives way; rays and `ground_height` meet them from now on."""
        if self.soil is not None and not self.is_firm and self.profile is None:
            touched = self.ruts.press(strips, self._to_nodes, self.soil.pass_exponent)
            self.ruts.show(self.store, touched)

    def _to_nodes(self, x: Any, y: Any) -> tuple[Array, Array]:
        u, v = self._points(x, y)
        return u / self.maker.node, v / self.maker.node

    def deposit_straw(self, polygon: Any, mass_kg: float, *, heading: float | None = None) -> None:
        """Lay straw on the ground within a convex polygon (n, 2) [m].

        Even, or with a heading [rad] as a ridge along it: depth falls as a parabola to both sides. The mass
        on all nodes adds up to what was laid; depth is mass / (straw_density * node area).
        """
        if not 0.0 <= mass_kg < np.inf:
            raise InputError("mass_kg", mass_kg, "expected >= 0")
        if self.profile is not None:
            self.profile.straw += mass_kg
            return
        self._straw.lay(_corners_near(polygon), mass_kg, heading)

    def deposit_grain(self, x: float, y: float, mass_kg: float) -> None:
        """Lay grain [kg] on the ground at a world point [m]. It is counted; rays do not meet it."""
        _check_near(np.asarray(x), np.asarray(y))
        self.grain.add(x, y, mass_kg)

    def receive(self, mass_kg: float, place: Any) -> None:
        """Grain [kg] that falls onto the ground right below a world point (3,) [m]: a `GrainReceiver`."""
        self.deposit_grain(float(place[0]), float(place[1]), mass_kg)

    @property
    def ground_grain_kg(self) -> float:
        """Mass of all grain laid on the ground since the start [kg]: without what the header shed."""
        return self.grain.total - self._begun_grain

    @property
    def straw_kg(self) -> float:
        """Mass of all straw laid on the field [kg]."""
        if self.profile is not None:
            return float(self.profile.straw[0])
        return fsum(float(m.sum()) for m in self.store.all_straw().values())

    def recount(self) -> Cut:
        """What is missing now against the start, stem by stem from the codes alone."""
        if self.profile is not None:
            return self.profile.taken()
        pages = {} if (begun := self._begun) is None else dict(zip(_keys(begun), begun["codes"], strict=True))
        return recount_pages(self.store, self.stems, pages)

    def save(self) -> dict[str, Any]:
        """What was changed: packed codes and straw of changed pages, grain on the ground."""
        changes = self.store.changes()
        return {
            "keys": np.array(list(changes), dtype=np.int64).reshape(-1, 2),
            "codes": [c.codes for c in changes.values()],
            "straw": [c.straw for c in changes.values()],
            "grain": self.grain.save(),
            **({"ruts": self.ruts.save()} if self.ruts.depth else {}),
            **({} if self.profile is None else {"profile": self.profile.save()}),
        }

    def load(self, state: dict[str, Any]) -> None:
        """Take over a saved state; everything else is as at the start."""
        self.ruts.load(state.get("ruts"))
        changes = zip(_keys(state), state["codes"], state["straw"], strict=True)
        self.store.restore({key: Change(codes, straw) for key, codes, straw in changes})
        self.grain.load(state["grain"])
        if self.profile is not None and "profile" in state:
            self.profile.load(state["profile"])

    def profiled(self, shape: EdgeShape) -> Profile:
        """From now on the field is looked at and cut as profiles along an edge.

        InputError where these cannot carry it.
        """
        if self._begun is not None:
            raise refused("start on what an earlier run left")
        if self.profile is None:
            self.profile = Profile(self, next(e for e in self.edges.values() if e.shape is shape))
        if self.profile.edge.shape is not shape:
            raise refused("machine at another edge")
        return self.profile

    def keep_pages(self) -> None:
        """Keep what pages hold at the start, for another run on this field, some 30 MB."""
        self.store.make = KeptPages(self.maker.make)

    def reset(self) -> None:
        """Back to the start: nothing cut, no straw, no grain, unless it starts from what earlier runs left.

        Pages that were not cut are not made again.
        """
        if self.ruts.depth:
            self.ruts.load(None)
            self.store.restore({})
        self.store.reset()
        self.grain = GrainPiles()
        if self.profile is not None:
            self.profile.reset()
        if self._begun is not None:
            self.load(self._begun)
        self._begun_grain = self.grain.total

    def start_from(self, state: dict[str, Any] | None) -> None:
        """From now on the start is a saved state; None: the untouched field."""
        if state is not self._begun:
            self._begun = state
            self.reset()

    @property
    def _depth_per_kg(self) -> float:
        return 1.0 / (self.straw_density * self.maker.node**2)

    @property
    def _sway(self) -> float:
        """The most that wind leans stems aside per height."""
        return 0.0 if self.wind is None else bare(self.wind).slope_max

    def _points(self, x: Any, y: Any) -> tuple[Array, Array]:
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        _check_near(x, y)
        return self.to_stand(x, y)

    def _slots(self, i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
        """Slots of pages, made where they are missing."""
        slot = self.pages.slots_at(i, j)
        if (slot >= 0).all():
            return slot
        self.store.need_at(i.ravel(), j.ravel())
        return self.pages.slots_at(i, j)

    def _nodes(self, u: float, v: float, room: float, turn: tuple[float, float]) -> Block:
        """Heights of the lattice nodes around a place, as `Footprint` asks for them: of whole pages with
        their far border, or of as many as a profile needs, for which no page is made. Without ruts.
        """
        at, n = np.array([[u, u], [v, v]]), PAGE_NODES
        way = 0.0 if self.profile is None else PROFILED / self.maker.node
        reach = at + [-room, room] + [[min(way * to, 0.0), max(way * to, 0.0)] for to in turn]
        _check_near(*(self.maker.node * reach))
        low, high = np.floor(reach).astype(int).T
        if self.profile is not None or not self.is_firm:
            x, y = (self.maker.node * np.arange(k, m + 2) for k, m in zip(low, high, strict=True))
            held: Array = self.terrain.lattice(x, y, self.stand_yaw).astype(np.float32).astype(np.float64)
            return int(low[0]), int(low[1]), held
        i, j = (np.arange(k // n, m // n + 1) for k, m in zip(low, high, strict=True))
        slots = self._slots(*np.meshgrid(i, j))
        heights = np.empty((PAGE_NODES * len(j) + 1, PAGE_NODES * len(i) + 1))
        for b, row in enumerate(slots.tolist()):
            for a, slot in enumerate(row):
                v, u = PAGE_NODES * b, PAGE_NODES * a
                heights[v : v + PAGE_NODES + 1, u : u + PAGE_NODES + 1] = self.pages.ground[slot]
        return n * int(i[0]), n * int(j[0]), heights


def _finish(
    store: PageStore, keys: list[Key], *, library: PlantLibrary, sway: float, depth_per_kg: float, ruts: Ruts
) -> None:
    """Pages came into memory: what follows from their codes and straw.

    Holds no field, which holds the store: what nobody uses any more then goes at once.
    """
    if ruts.depth:
        ruts.show(store, keys)
    update_tops(store, library, keys, sway=sway)
    write_depth(store, keys, depth_per_kg)


def _felt_wind(wind: Wind | None, row_heading: float, weather: SiteWeather | None) -> Sway | None:
    """What a wind does to the stand; who looks at it asks for the keys that it is made of."""
    sway, tell = gathered(lambda: make_sway(wind, row_heading, weather))
    return None if sway is None else telling(sway, {own.name: tell for own in fields(sway)})


def make_field(
    terrain: Terrain,
    stand: Stand,
    edges: BrokenEdge | Edges,
    *,
    crop: Crop,
    library: PlantLibrary | None = None,
    stream: Stream,
    boundary: Region | None = None,
    page_limit: int = 1024,
    weather: SiteWeather | None = None,
    is_cut: bool = True,
) -> Field:
    """A field from resolved levels. The library is made from the crop when none is given.

    edges: one, which gets the name `edge`, or several by name. Raises InputError when an edge does not pass
    through the boundary, the terrain's map, or any crop, unless nothing is cut (`is_cut`).
    """
    from swath.field.prototypes import make_library

    named = named_edges(edges)
    if is_cut:
        check_edges(named, terrain, stand, boundary)
    if library is None:
        library = make_library(
            crop,
            density_max=stand.density_max,
            row_spacing=stand.row_spacing,
            seed=stream.child("library"),
            weeds=None if stand.weeds is None else weed_crop(stand.weeds),
            detail=getattr(stand, "detail", "full"),
        )
    return Field(
        terrain,
        stand,
        named,
        library,
        stream=stream,
        boundary=boundary,
        crop_height=crop.stand.height,
        seen_height=crop.stand.seen_height or crop.stand.height,
        straw_exponent=crop.yields.straw_exponent,
        straw_density=crop.yields.swath_density,
        page_limit=page_limit,
        weather=weather,
    )


def _keys(state: dict[str, Any]) -> list[Key]:
    return [(int(i), int(j)) for i, j in state["keys"]]


def _check_near(x: Array, y: Array) -> None:
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise InputError("position", None, "expected finite x and y")
    if x.size and max(np.abs(x).max(), np.abs(y).max()) > FAR:
        raise InputError("position", None, f"expected within {FAR:g} m of the origin of the field")


def _corners_near(polygon: Any) -> list[Corner]:
    """As `corners_of`; they are not too far."""
    corners = corners_of(polygon)
    _check_near(*np.array(corners).T)
    return corners
