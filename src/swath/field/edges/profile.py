"""The field beside one edge as profiles along it: what the levels `profile` of lidar and header see and cut.

Stations every metre along the edge's line, each with columns 1.5 m apart across it, know the ground (a plane)
and the stand; bins of 5 cm know from where inwards crop grows and between where the header cut it. All is
sampled once from the field's own terrain, stand and edge, the ground as far as somebody looks. s [m] runs
along the line, inside is > 0 towards the crop.
"""

from collections.abc import Sequence
from math import ceil, inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core import portable
from swath.core.component import KeepsState, State
from swath.core.errors import InputError
from swath.core.units import DEG
from swath.field.crop_sheet import Weeds
from swath.field.cutting.cut_result import Cut
from swath.field.edges.edge_defects import BrokenEdge
from swath.field.memory_layout import STANDING
from swath.kernels import filled, of_worlds, repeatable, shared, start_warp

Array = NDArray[np.float64]
STATION, BIN = 1.0, 0.05  # spacing along the line [m], our choice; kernels take stations to be 1 m apart
BEYOND = 60.0  # the profile goes on so far before and after the line [m]
COLUMN, COLUMNS = 1.5, 21  # spacing across the line [m], the middle one on it
NEARBY = 10.0  # along the line: a beam goes through crop for no longer a way [m]
LODGED = 20.0 * DEG  # mean lean from which on crop is lodged, as `empirical` has it
SCALES = 17  # lengths of plants for which masses are summed up; between them straight
REACH = 8.0  # to both sides: what a profile cannot carry must not be there [m]


class Profile(KeepsState):
    """The profile of a field along an edge. field: a `field.Field`.

    s0: of the first station [m]; x, y: stations in the stand frame, (n,); cosine, sine, curvature [1/m] of
    the line. Of columns, (n, COLUMNS): z of their plane at the station, its slope_x, slope_y, after `lay`
    reach: crop grows from there inwards [m], inf = nowhere; near, far: it is cut between [m]; inner: code of
    what is there instead of crop inside of the line, outer: outside; cut_code: of what the header leaves
    straw: laid on the ground [kg], (1,)
    """

    kept = ("near", "far", "straw")

    def __init__(self, field: Any, edge: BrokenEdge) -> None:
        _check(field, edge)
        self.field, self.edge = field, edge
        self.is_left = edge.shape.crop_side == "left"
        self.s0 = -BEYOND
        stations = int(np.ceil((edge.shape.length + 2.0 * BEYOND) / STATION)) + 1
        s = np.asarray(self.s0 + STATION * np.arange(stations), dtype=np.float64)
        self._lay_line(s)
        count = round((len(s) - 0.5) * STATION / BIN)
        bins = np.asarray(self.s0 + BIN * (np.arange(count) + 0.5), dtype=np.float64)
        self.reach, self.inner = _reach(edge, bins)
        self.outer, self.cut_code = edge.stubble, np.full(1, STANDING, np.int32)
        is_even = edge.teeth is None and not edge.gaps
        self.bite = np.zeros(len(s), np.float32) if is_even else _bite(self.reach, len(s))
        self.near, self.far = np.full(len(bins), inf, np.float32), np.full(len(bins), -inf, np.float32)
        self.straw = np.zeros(1)
        self._per_m2: tuple[Array, ...] = ()
        self._struct: Any = None
        self.lines: dict[tuple[int, ...], Lines] = {}
        self.station = 0  # beside which a line was looked at last

    def _lay_line(self, s: Array) -> None:
        shape, field = self.edge.shape, self.field
        at, heading = self._line = shape.point_at(s), shape.heading_at(s)
        self.x, self.y = field.to_stand(at[:, 0], at[:, 1])
        direction = heading - field.stand_yaw
        self.cosine, self.sine = np.cos(direction), np.sin(direction)
        turn = np.gradient(np.unwrap(heading), STATION)
        self.curvature = np.where(np.abs(turn) < 1e-9, 0.0, turn).astype(np.float32)  # as kernels have it
        self.is_straight, self._laid = bool(np.ptp(heading) == 0.0), 0
        self.z = np.zeros((len(s), COLUMNS))
        self.slope_x, self.slope_y = np.zeros((2, len(s), COLUMNS), np.float32)
        left: Array = COLUMN * np.arange(-(COLUMNS // 2), COLUMNS // 2 + 1, dtype=np.float64)
        self._inside = left if self.is_left else -left

    def stand(self) -> Array:
        """Scale and lean of the plants, stems per m2, (n, COLUMNS, 4); looked up twice, not kept."""
        left = self._inside if self.is_left else -self._inside
        found = np.ascontiguousarray(self.field.maker.stand_at(*_beside(*self._line, left)))
        found[..., 3] *= self.field.library.density_max
        return found

    def lay(self, stations: int) -> None:
        """Know the ground of at least the first so many stations."""
        first, last = self._laid, min(stations, len(self.x))
        if first >= last:
            return
        begin = max(first - 1, 0)  # slopes need the neighbours
        at, heading = (a[begin : last + 1] for a in self._line)
        left: Array = COLUMN * np.arange(-(COLUMNS // 2) - 1, COLUMNS // 2 + 2, dtype=np.float64)
        if self.is_straight:  # a lattice, for which terrain takes a tenth of the time
            c, r = np.cos(heading[0]), np.sin(heading[0])
            ahead, aside = c * at[:, 0] + r * at[:, 1], c * self._line[0][0, 1] - r * self._line[0][0, 0]
            z = np.ascontiguousarray(self.field.terrain.lattice(ahead, aside + left, float(heading[0])).T)
        else:
            z = np.asarray(self.field.terrain.height(*_beside(at, heading, left)))
        along, across = np.gradient(z, STATION, COLUMN)
        z, along, across = (a[first - begin : last - begin, 1:-1] for a in (z, along, across))
        new = slice(first, last)
        c, r = self.cosine[new, None], self.sine[new, None]
        self.z[new] = z - across * left[1:-1]
        self.slope_x[new], self.slope_y[new] = along * c - across * r, along * r + across * c
        self._laid = last

    def lay_around(self, x: float, y: float, reach: float) -> None:
        """Know the ground within a reach [m] of a world point [m]."""
        s, _ = self.edge.shape.project(x, y)
        self.lay(ceil((float(s) + reach - self.s0) / STATION) + 2 if self.is_straight else len(self.x))

    def place(self, x: Any, y: Any) -> tuple[Array, NDArray[np.int64]]:
        """How far inside of the line world points [m] are, and their bins."""
        s, offset = self.edge.shape.project(x, y)
        bins = np.clip(np.floor((s - self.s0) / BIN), 0, len(self.reach) - 1)
        return np.asarray(offset if self.is_left else -offset), bins.astype(np.int64)

    def rise(self, places: tuple[Array, Array], steps: tuple[Array, Array]) -> Array:
        """How far the ground rises on steps at world points [m]."""
        s, offset = self.edge.shape.project(*places)
        station = np.clip(np.rint((s - self.s0) / STATION), 0, len(self.x) - 1).astype(int)
        self.lay(int(station.max(initial=0)) + 1)
        column = np.clip(np.rint(offset / COLUMN) + COLUMNS // 2, 0, COLUMNS - 1).astype(int)
        u, v = self.field.to_stand(*steps)
        return np.asarray(self.slope_x[station, column] * u + self.slope_y[station, column] * v)

    def stands(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """True where crop stands, at world points [m]."""
        inside, bins = self.place(x, y)
        is_cut = (inside >= self.near[bins]) & (inside < self.far[bins])
        return np.asarray((inside >= self.reach[bins]) & ~is_cut)

    def standing_along(self, starts: Any, step: Any, count: int) -> NDArray[np.bool_]:
        """As `stands`, compiled, at middles of `count` steps from world points on [m]: (n, count)."""
        return standing_beside([self], starts, step, count, of=[0] * len(starts))

    def standing_area(self, polygon: Array) -> float:
        """Area of standing crop within a convex anticlockwise polygon (n, 2) [m2]."""
        return float(self.standing_areas(polygon[None])[0])

    def standing_areas(self, polygons: Array) -> Array:
        """Areas of standing crop in several triangles, (m, n, 2), (m,)."""
        from swath.field.edges.profile_kernel import standing_cells

        wp, counts = start_warp(), np.zeros(len(polygons), np.int32)
        inputs = [shared(np.ascontiguousarray(polygons), wp.float64), shared(counts, wp.int32)]
        repeatable(standing_cells, [self.struct(), *inputs, BIN]).launch()
        return np.asarray(counts * BIN * BIN)

    def per_m2(self, width: float) -> tuple[Array, ...]:
        """Grain and straw [kg] that a header takes from a square metre, stems on it, grain that it leaves on
        ears below the knife and straw that it leaves as stubble [kg], by station.

        width: of the header, whose one end is at the edge [m]
        """
        library, code = self.field.library, 0.01 * float(self.cut_code[0])
        crop = ~library.is_weed
        grain, straw = library.grain_kg[crop], library.straw_kg[crop]
        tall, ear = library.stem_height[crop].astype(np.float64), np.asarray(library.ear_height)[crop]
        columns = np.flatnonzero((self._inside > -0.5 * COLUMN) & (self._inside < width))
        stand = self.stand()[:, columns]
        scales = np.unique(stand[..., 0])
        if len(scales) > SCALES:
            scales = np.linspace(scales[0], scales[-1], SCALES)
        of_scale = np.zeros((4, len(scales)))  # of a mean stem [kg]
        for k, scale in enumerate(scales.tolist()):
            share = np.clip(1.0 - code / np.maximum(scale * tall, 1e-6), 0.0, 1.0)
            of_scale[0, k] = ((scale * ear > code) * grain).mean()
            above = portable.power(share, self.field.stems.straw_exponent)
            of_scale[1, k], of_scale[3, k] = (above * straw).mean(), ((1.0 - above) * straw).mean()
            of_scale[2, k] = ((scale * ear <= code) * grain).mean()
        each = [np.interp(stand[..., 0], scales, values) for values in of_scale]
        length, density = np.sqrt((stand[..., :3] ** 2).sum(axis=-1)), stand[..., 3]
        parts = (
            density * each[0],
            density * length * each[1],
            density,
            density * each[2],
            density * length * each[3],
        )
        self._per_m2 = tuple(np.ascontiguousarray(part.mean(axis=1)) for part in parts)
        return self._per_m2

    def set_height(self, code: int) -> None:
        """What the header leaves [cm]. InputError where it left something else before."""
        if self.cut_code[0] not in (STANDING, code):
            raise refused("header whose height changes")
        self.cut_code[0] = code

    def cut(self, polygon: Array, code: int) -> Cut:
        """Cut crop within a convex anticlockwise polygon (n, 2) [m], where it is over the middles of bins.

        InputError where that does not go on from what was cut there before: a second pass.
        """
        self.set_height(code)
        s, offset = self.edge.shape.project(polygon[:, 0], polygon[:, 1])
        inside = offset if self.is_left else -offset
        if not self._per_m2:
            self.per_m2(float(inside.max()))
        along = (s - self.s0) / BIN - 0.5
        first, last = max(int(np.ceil(along.min())), 0), min(int(np.floor(along.max())), len(self.near) - 1)
        if last < first:
            return Cut()
        bins = np.arange(first, last + 1)
        low, high = np.full(len(bins), inf), np.full(len(bins), -inf)
        for a, b, u, v in zip(along, np.roll(along, -1), inside, np.roll(inside, -1), strict=True):
            over = (bins >= min(a, b)) & (bins <= max(a, b))
            at = u + (v - u) * (bins - a) / (b - a) if a != b else np.where(over, u, 0.0)
            low, high = np.where(over, np.minimum(low, at), low), np.where(over, np.maximum(high, at), high)
        near, far = self.near[bins], self.far[bins]
        if ((low > far + BIN) | (high < near - BIN))[near < far].any():
            raise refused("second pass")
        before = self._missing(bins)
        self.near[bins], self.far[bins] = np.minimum(near, low), np.maximum(far, high)
        after = self._missing(bins)
        grain, straw, stems, left, _, area = (a - b for a, b in zip(after, before, strict=True))
        return Cut(grain, straw, int(stems), area, left)

    def taken(self) -> Cut:
        """What is missing now against the start, from the bins alone."""
        grain, straw, stems, left, stubble, area = self._missing(np.arange(len(self.near)))
        return Cut(grain, straw, stems, area, left, stubble)

    def _missing(self, bins: NDArray[np.int64]) -> tuple[float, float, int, float, float, float]:
        """Grain and straw [kg], stems, grain left and stubble [kg] and area [m2] cut in some bins."""
        where = bins[(self.far[bins] > self.near[bins]) & np.isfinite(self.reach[bins])]
        if not len(where):
            return 0.0, 0.0, 0, 0.0, 0.0, 0.0
        low = np.maximum(self.near[where], self.reach[where]).astype(np.float64)
        wide = np.maximum(self.far[where].astype(np.float64) - low, 0.0)
        station = np.minimum(((where + 0.5) * BIN / STATION + 0.5).astype(int), len(self.x) - 1)
        bent = self.curvature[station].astype(np.float64) * (1.0 if self.is_left else -1.0)
        area = wide * BIN * (1.0 - bent * (low + 0.5 * wide))
        grain, straw, stems, left, stubble = (float((area * q[station]).sum()) for q in self._per_m2)
        return grain, straw, round(stems), left, stubble, float(area.sum())

    def struct(self) -> Any:
        """As kernels read it, the same memory."""
        if self._struct is None:
            from swath.field.edges.profile_kernel import Profile as Struct

            held = {
                name: np.ascontiguousarray(getattr(self, name), dtype)
                for name, dtype in (
                    *((n, np.float64) for n in ("x", "y", "z")),
                    *((n, np.float32) for n in ("cosine", "sine", "curvature", "bite")),
                    *((n, np.float32) for n in ("slope_x", "slope_y", "reach", "near", "far")),
                    ("inner", np.int32),
                )
            }
            self.near, self.far = held["near"], held["far"]
            held |= {name: held[name].ravel() for name in ("z", "slope_x", "slope_y")}
            held["stand"] = self.stand().reshape(-1, 4).astype(np.float32)
            turn = self.field.to_stand([1.0, 0.0], [0.0, 1.0])
            self._struct = filled(
                Struct,
                **held,
                turn=(float(turn[0][0]), float(turn[0][1])),
                tile_size=self.field.library.tile_size,
                columns=COLUMNS,
                column=COLUMN,
                bins_per_m=1.0 / BIN,
                outer=self.outer,
                cut=self.cut_code,
                is_left=int(self.is_left),
                begin=self.edge.begin - self.s0,
                reflectance=np.ascontiguousarray(self.field.library.reflectance, np.float32),
            )
        return self._struct

    def reset(self) -> None:
        """Nothing cut, no straw."""
        self.near[:], self.far[:], self.straw[:] = inf, -inf, 0.0

    def load(self, state: State) -> None:
        """Take on a state that `save` gave, in the same memory."""
        self.near[:], self.far[:], self.straw[:] = state["near"], state["far"], state["straw"]


def _reach(edge: BrokenEdge, s: Array) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """From where inwards crop grows [m], and the code of what is there instead, as `BrokenEdge.code`."""
    reach = np.zeros(len(s)) if edge.teeth is None else np.asarray(edge.teeth.depth(s))
    inner = np.full(len(s), edge.stubble, np.int32)
    for gap in edge.gaps:
        within = (s >= gap.start) & (s < gap.end)
        reach[within], inner[within] = np.maximum(reach[within], gap.depth), gap.code
    reach[s < edge.begin] = inf
    return reach.astype(np.float32), inner


def _bite(reach: NDArray[np.float32], stations: int) -> NDArray[np.float32]:
    """How far `reach` differs within NEARBY of each station, where crop grows."""
    per, far = round(STATION / BIN), round(NEARBY / BIN)
    padded = np.full(stations * per + 2 * far, np.nan, np.float32)
    padded[far : far + len(reach)] = np.where(np.isfinite(reach), reach, np.nan)
    near = np.lib.stride_tricks.sliding_window_view(padded, 2 * far)[: stations * per : per]
    known = ~np.isnan(near)
    most, least = np.where(known, near, -inf).max(axis=1), np.where(known, near, inf).min(axis=1)
    return np.asarray(np.where(known.any(axis=1), most - least, 0.0), dtype=np.float32)


def _beside(at: Array, heading: Array, left: Array) -> tuple[Array, Array]:
    """World points [m] to the left of points (n, 2) of a line, (n, len(left)) each."""
    return at[:, :1] - np.sin(heading)[:, None] * left, at[:, 1:] + np.cos(heading)[:, None] * left


def _check(field: Any, edge: BrokenEdge) -> None:
    """InputError for a field that a profile cannot carry."""
    for what in _too_much(field, edge):
        raise refused(what)


def refused(what: str) -> InputError:
    """A run that needs more than profiles."""
    return InputError(
        "level", "profile", f"expected no {what}; the level empirical of lidar, with fixed_height, has it"
    )


def _too_much(field: Any, edge: BrokenEdge) -> list[str]:
    shape = edge.shape
    found = []
    if field.wind is not None:
        found.append("wind")
    if isinstance(field.stand.weeds, Weeds):
        found.append("weeds")
    if len(field.edges) > 1:
        found.append("second edge of the field")
    if shape.is_closed:
        found.append("edge around a block")
    if len(shape.pieces) > 1 and not _is_smooth(shape):
        found.append("edge with corners, or with bends of less than 15 m")
    if edge.teeth is not None and edge.teeth.wavelength < 10.0 * BIN:
        found.append(f"teeth of less than {10.0 * BIN:g} m")
    s = np.arange(0.0, shape.length, STATION)
    at, heading = shape.point_at(s), shape.heading_at(s)
    across = np.arange(-REACH, REACH + 0.5, 1.0)[:, None]
    x, y = at[:, 0] - across * np.sin(heading), at[:, 1] + across * np.cos(heading)
    if field.boundary is not None and not field.boundary.contains(x, y).all():
        found.append(f"boundary of the field within {REACH:g} m of the edge")
    if field.stand.may_be_bare(x, y, 0.71).any():
        found.append("tramlines")
    if (field.stand.lean(x, y)[0] > LODGED).any():
        found.append("lodged crop")
    return found


def _is_smooth(shape: Any) -> bool:
    """Whether a place beside the line has one place on it, as far as beams and the header go."""
    corners = max(abs(p.turn_in - p.heading) for p in shape.pieces)
    bends = max(abs(p.curvature) for p in shape.pieces)
    return bool(corners < 1e-6 and bends < 1.0 / 15.0 and isfinite(shape.length))


class Lines:
    """Whether crop stands along lines beside profiles, looked up by compiled code at once.

    structs: of the profiles; of: which of them each line is beside; count: of the steps of a line
    stations: beside which a line was looked at last, of each profile
    """

    def __init__(self, structs: Sequence[Any], of: Sequence[int], count: int) -> None:
        from swath.field.edges import profile_kernel as kernel

        self._structs = structs
        self.starts, self.steps = np.zeros((2, len(of), 2))
        self.crop, self.stations = np.zeros((len(of), count), np.bool_), np.zeros(len(structs), np.int32)
        arrays = np.array(of, np.int32), self.starts, self.steps, self.crop, self.stations
        inputs = [of_worlds(kernel.Profile, structs), *map(shared, arrays)]
        self.launch = repeatable(kernel.stands_along, inputs).launch


def standing_beside(
    profiles: Sequence[Profile], starts: Any, steps: Any, count: int, of: Sequence[int] = ()
) -> NDArray[np.bool_]:
    """Whether crop stands at middles of `count` steps from world points on [m], (n, count).

    of: which profile each line is beside, by default one beside each; steps: of each (n, 2), or of all (2,)
    """
    structs, of = [profile.struct() for profile in profiles], of or range(len(profiles))
    key = (*map(id, structs), *of, count)
    lines = profiles[0].lines.get(key)
    if lines is None:
        lines = profiles[0].lines[key] = Lines(structs, of, count)
    lines.starts[:], lines.steps[:] = starts, steps
    lines.stations[:] = [profile.station for profile in profiles]
    lines.launch()
    for profile, station in zip(profiles, lines.stations.tolist(), strict=True):
        profile.station = station
    found: NDArray[np.bool_] = lines.crop.copy()
    return found
