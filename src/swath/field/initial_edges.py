"""The initial edges of a field together: crop stands where it stands on the crop side of every edge."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field.boundary import Region
from swath.field.edge_defects import BrokenEdge
from swath.field.field_setup import HasExtent, Stand, Terrain
from swath.field.memory_layout import STANDING
from swath.field.track import EdgeShape

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
