"""The crop edge and the boundary as a scenario describes them.

Of several edges together: crop stands where it stands on the crop side of every one.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen
from numpy.typing import NDArray
from pydantic import Field as PydanticField

from swath.core.errors import InputError
from swath.core.units import DEG
from swath.documents.geojson import lines_of, read_shapes
from swath.field.edges.boundary import Region
from swath.field.edges.edge_defects import BrokenEdge, Gap, Teeth
from swath.field.edges.track import EdgeShape, Piece, curve, polyline, shifted_left, straight
from swath.field.field_setup import FieldSetup, HasExtent, Stand, Terrain
from swath.field.memory_layout import STANDING

Array = NDArray[np.float64]

Edges = Mapping[str, BrokenEdge]
ONLY = "edge"  # name of the edge of a field that has one
INWARDS = 5.0, 0.25  # where beside an edge the stand, and the crop side of the other edges, are asked for [m]
SAMPLES = 256  # along an edge


def named_edges(edges: BrokenEdge | Edges) -> dict[str, BrokenEdge]:
    """Edges by name; a single one has the name `edge`. Raises InputError when there are none."""
    named = {ONLY: edges} if isinstance(edges, BrokenEdge) else dict(edges)
    if not named:
        raise InputError("field.edges", None, "expected at least one edge")
    return named


def edge_key(name: str) -> str:
    """Key of an edge in a scenario."""
    return "field.edge" if name == ONLY else f"field.edges.{name}"


def code_at(edges: Edges, x: Array, y: Array) -> NDArray[np.int16]:
    """Code of world points [m] of one shape: STANDING where every edge says so.

    Where several edges say otherwise: what the nearest of them left there, of two as near the first.
    """
    first, *others = edges.values()
    codes = first.code(x, y)
    if not others:
        return codes
    nearest = np.where(codes == STANDING, np.inf, np.abs(first.shape.signed_distance(x, y)))
    for edge in others:
        code = edge.code(x, y)
        away = np.where(code == STANDING, np.inf, np.abs(edge.shape.signed_distance(x, y)))
        codes = np.where(away < nearest, code, codes)
        nearest = np.minimum(away, nearest)
    return codes


def code_within(edges: Edges, x: Array, y: Array, radius: float) -> NDArray[np.int16]:
    """The one code of all points within the radius [m] of world points, -1 where there may be several."""
    each = np.stack([edge.code_within(x, y, radius) for edge in edges.values()])
    lowest = each.min(axis=0)  # -1 is the lowest of all, STANDING the highest
    gone = np.where(each == STANDING, lowest, each)
    return np.where(gone.max(axis=0) == lowest, lowest, -1).astype(np.int16)


def check_edges(edges: Edges, terrain: Terrain, stand: Stand, boundary: Region | None) -> None:
    """InputError for an edge that does not pass through the boundary, the terrain's map, or any crop."""
    for name, edge in edges.items():
        _check_edge(edge.shape, edge_key(name), terrain, stand, boundary)
        x, y = _beside(edge.shape, INWARDS[1])
        inside = [other.shape.signed_distance(x, y) > 0.0 for other in edges.values()]
        if not np.all(inside, axis=0).any():
            expected = "expected an edge with some of its crop on the crop side of all other edges"
            raise InputError(edge_key(name), None, expected)


def _check_edge(edge: EdgeShape, key: str, terrain: Terrain, stand: Stand, boundary: Region | None) -> None:
    x, y = edge.point_at(np.linspace(0.0, edge.length, SAMPLES)).T
    if boundary is not None and not boundary.contains(x, y).any():
        raise InputError(key, None, "expected an edge inside the boundary of the field")
    if isinstance(terrain, HasExtent) and not terrain.covers(x, y).any():
        raise InputError(key, None, "expected an edge on the map of the terrain")
    if not (stand.density(*_beside(edge, INWARDS[0])) > 0.0).any():
        raise InputError(key, None, "expected an edge with crop beside it on the map of the stand")


def _beside(edge: EdgeShape, inwards: float) -> tuple[Array, Array]:
    """World points along an edge, this far [m] towards its crop."""
    s = np.linspace(0.0, edge.length, SAMPLES)
    x, y = edge.point_at(s).T
    left = inwards if edge.crop_side == "left" else -inwards
    heading = edge.heading_at(s)
    return x - left * np.sin(heading), y + left * np.cos(heading)


Metres = Annotated[float, Ge(-1e5), Le(1e5)]
Length = Annotated[float, Gt(0.0), Le(1e5)]
Height = Annotated[float, Ge(0.0), Le(2.0)]
Heading = Annotated[float, Ge(-360.0), Le(360.0)]


@dataclass(frozen=True, kw_only=True)
class GapParams:
    """Crop missing from start_m to end_m along the edge, depth_m deep; stubble_height_m: left there."""

    start_m: Metres
    end_m: Metres
    depth_m: Length
    stubble_height_m: Height = 0.0

    def __post_init__(self) -> None:
        if self.end_m <= self.start_m:
            raise InputError("end_m", self.end_m, f"expected > start_m = {self.start_m:g}")


@dataclass(frozen=True, kw_only=True)
class TeethParams:
    """Bites out of the crop, 0 to amplitude_m deep, every wavelength_m along the edge."""

    amplitude_m: Annotated[float, Ge(0.0), Le(100.0)]
    wavelength_m: Annotated[float, Ge(0.05), Le(1e4)]
    kind: Literal["sawtooth", "random"] = "random"


@dataclass(frozen=True, kw_only=True)
class EdgeCommon:
    """crop_side: of the edge as it is driven; stubble_height_m: on its other side, and on the headland.

    crop_begins_m: where along the edge the crop begins, before it lies the headland; none = everywhere.
    """

    crop_side: Literal["left", "right"] = "right"
    crop_begins_m: Metres | None = 0.0
    stubble_height_m: Height = 0.15
    gaps: tuple[GapParams, ...] = ()
    teeth: TeethParams | None = None


@dataclass(frozen=True, kw_only=True)
class StraightEdge(EdgeCommon):
    """A straight edge from x_m, y_m. heading_deg: from east to the left."""

    shape: Literal["straight"] = "straight"
    x_m: Metres = 0.0
    y_m: Metres = 0.0
    heading_deg: Heading = 90.0
    length_m: Length = 500.0


@dataclass(frozen=True, kw_only=True)
class CurveEdge(EdgeCommon):
    """Straight, bend, straight. angle_deg: of the bend, > 0 to the left."""

    shape: Literal["curve"] = "curve"
    x_m: Metres = 0.0
    y_m: Metres = 0.0
    heading_deg: Heading = 90.0
    run_in_m: Annotated[float, Ge(0.0), Le(1e5)] = 40.0
    radius_m: Annotated[float, Ge(1.0), Le(1e5)] = 40.0
    angle_deg: Annotated[float, Ge(-270.0), Le(270.0)] = 60.0
    run_out_m: Annotated[float, Ge(0.0), Le(1e5)] = 200.0


@dataclass(frozen=True, kw_only=True)
class PolylineEdge(EdgeCommon):
    """Lines between points_m, corners rounded to corner_radius_m as far as the lines are long enough.

    With the last point on the first one the edge is closed, around a block or an island; the corner there
    stays sharp.
    """

    shape: Literal["polyline"] = "polyline"
    points_m: Annotated[tuple[tuple[Metres, Metres], ...], MinLen(2)]
    corner_radius_m: Annotated[float, Ge(0.0), Le(1e4)] = 0.0


@dataclass(frozen=True, kw_only=True)
class TrackEdge(EdgeCommon):
    """Along a driven pass.

    track: its number in the field folder, or in `file`, GeoJSON with longitude and latitude
    offset_m: of the edge to the left of the pass, e.g. half a header
    """

    shape: Literal["track"] = "track"
    track: Annotated[int, Ge(0)] = 0
    file: str | None = None
    offset_m: Annotated[float, Ge(-100.0), Le(100.0)] = 0.0
    is_reversed: bool = False
    corner_radius_m: Annotated[float, Ge(0.0), Le(1e4)] = 50.0


Edge = Annotated[StraightEdge | CurveEdge | PolylineEdge | TrackEdge, PydanticField(discriminator="shape")]


@dataclass(frozen=True, kw_only=True)
class Boundary:
    """points_m: corners of the field. Nothing grows outside."""

    points_m: Annotated[tuple[tuple[Metres, Metres], ...], MinLen(3)]


def make_boundary(params: Boundary | None) -> Region | None:
    """The region of a boundary."""
    return None if params is None else Region(params.points_m, key="field.boundary.points_m")


def make_edge(params: Any, setup: FieldSetup, name: str = ONLY) -> BrokenEdge:
    """The edge of one of the shapes above. name: of the edge in its field, decides where its teeth are."""
    key = edge_key(name)
    stream = setup.stream.child(key.removeprefix("field."))
    gaps = tuple(Gap(g.start_m, g.end_m, g.depth_m, _code(g.stubble_height_m)) for g in params.gaps)
    teeth = None
    if params.teeth is not None and params.teeth.amplitude_m > 0.0:
        t = params.teeth
        teeth = Teeth(t.amplitude_m, t.wavelength_m, t.kind, stream.child("teeth").integer())
    shape = EdgeShape(_pieces(params, setup, key), params.crop_side)
    begin = -np.inf if params.crop_begins_m is None else params.crop_begins_m
    return BrokenEdge(shape, _code(params.stubble_height_m), gaps, teeth, begin)


def _code(height: float) -> int:
    return round(100.0 * height)


def _pieces(p: Any, setup: FieldSetup, key: str) -> list[Piece]:
    if isinstance(p, StraightEdge):
        return straight(p.x_m, p.y_m, p.heading_deg * DEG, p.length_m)
    if isinstance(p, CurveEdge):
        if p.angle_deg == 0.0:
            return straight(p.x_m, p.y_m, p.heading_deg * DEG, max(p.run_in_m + p.run_out_m, 1.0))
        return curve(
            p.x_m,
            p.y_m,
            p.heading_deg * DEG,
            run_in=p.run_in_m,
            radius=p.radius_m,
            angle=p.angle_deg * DEG,
            run_out=p.run_out_m,
        )
    if isinstance(p, PolylineEdge):
        return polyline(p.points_m, p.corner_radius_m, key=f"{key}.points_m")
    if isinstance(p, TrackEdge):
        points = _track(p, setup, key)[:: -1 if p.is_reversed else 1]
        return polyline(shifted_left(points, p.offset_m, key=key), p.corner_radius_m, key=key)
    raise InputError(f"{key}.shape", type(p).__name__, "expected straight, curve, polyline or track")


def _track(params: TrackEdge, setup: FieldSetup, key: str) -> Array:
    tracks = setup.tracks if params.file is None else read_lines(setup.folder / params.file, setup, key)
    if params.track >= len(tracks):
        what = f"expected less than the {len(tracks)} tracks there are"
        raise InputError(f"{key}.track", params.track, what, file=params.file)
    return np.asarray(tracks[params.track])


def read_lines(path: Path, setup: FieldSetup, key: str = "field.edge") -> tuple[Array, ...]:
    """World points (n, 2) [m] of every line of a GeoJSON file (longitude, latitude)."""
    if setup.to_local is None:
        raise InputError(f"{key}.file", str(path), "expected a field folder, which says where the field is")
    shapes, _ = read_shapes(path, f"{key}.file", "GeoJSON with LineStrings")
    return tuple(np.asarray(setup.to_local(line)) for line in lines_of(shapes, path, f"{key}.file"))
