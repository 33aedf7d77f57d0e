"""Small fields for tests: a few prototypes of real wheat, any terrain, stand and edge."""

from functools import cache

from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.edges.boundary import Region
from swath.field.edges.edge import StraightEdge, make_edge
from swath.field.field import Field, make_field
from swath.field.field_setup import FieldSetup
from swath.field.prototypes import make_library
from swath.field.stand import maps, uniform
from swath.field.terrain import formula, plane

STREAM = Stream(7, "field")
SETUP = FieldSetup(STREAM)
CROP = load_crop("wheat")


@cache
def library(density=500.0, row_spacing=0.125):
    """Four tiles of wheat."""
    return make_library(
        CROP, density_max=density, row_spacing=row_spacing, seed=STREAM.child("library"), tile_count=4
    )


def made_field(*, terrain=None, stand=None, edge=None, boundary=None, seed=7, page_limit=1024) -> Field:
    """A field from parameters; plane, uniform and straight to the north through the origin by default.

    edge: parameters of one, or several made ones by name
    """
    setup = FieldSetup(Stream(seed, "field"))
    terrain = terrain or plane.Params()
    stand = stand or uniform.Params()
    ground = plane.Plane if isinstance(terrain, plane.Params) else formula.Formula
    plants = maps.Maps if isinstance(stand, maps.Params) else uniform.Uniform
    grown = plants(stand, setup)
    return make_field(
        ground(terrain, setup),
        grown,
        edge if isinstance(edge, dict) else make_edge(edge or StraightEdge(), setup),
        crop=CROP,
        library=library(grown.density_max, grown.row_spacing),
        stream=setup.stream,
        boundary=None if boundary is None else Region(boundary),
        page_limit=page_limit,
    )


def rectangle(x0, y0, x1, y1):
    """Corners of a rectangle along the axes."""
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
