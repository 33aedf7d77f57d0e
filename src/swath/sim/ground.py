"""The field of a scenario: its parts made by their levels, or taken from a field folder, and put together."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swath.core.random import Stream
from swath.core.signals import F64
from swath.field.boundary import Region
from swath.field.crop import load_crop
from swath.field.edge import TrackEdge, make_boundary, make_edge
from swath.field.field import Field, make_field
from swath.field.io.folder import FieldFolder, read
from swath.field.io.project import Origin
from swath.field.layout import Solids
from swath.field.setup import FieldSetup
from swath.field.solids import make_obstacles
from swath.field.stand.maps import Maps
from swath.field.stand.maps import Params as MapsParams
from swath.field.terrain.dem import Dem
from swath.sim.choices import FieldSection


@dataclass(frozen=True)
class Ground:
    """field; obstacles on it; driven: the real pass that the edge follows, (n, 2) world [m], if it does.

    origin: where on Earth the world's origin lies, of an imported field
    """

    field: Field
    obstacles: Solids
    driven: F64 | None
    origin: Origin | None = None


def build_field(section: FieldSection, *, stream: Stream, base: Path) -> Ground:
    """The field and what stands on it. base: folder that relative file names start from."""
    folder = None if section.folder is None else read(section.folder)
    setup = _setup(folder, stream, base)
    stand = section.stand.make(setup) if section.stand is not None else _stand_of(folder, setup)
    region = make_boundary(section.boundary)
    if region is None and folder is not None:
        region = Region(folder.boundary, folder.holes)
    field = make_field(
        section.terrain.make(setup) if section.terrain is not None else _terrain_of(folder),
        stand,
        make_edge(section.edge, setup),
        crop=load_crop(stand.crop),
        stream=stream,
        boundary=region,
    )
    driven = None
    if isinstance(section.edge, TrackEdge) and section.edge.file is None:
        driven = setup.tracks[section.edge.track]
    origin = None if folder is None else folder.origin
    return Ground(field, make_obstacles(section.obstacles, field), driven, origin)


def _setup(folder: FieldFolder | None, stream: Stream, base: Path) -> FieldSetup:
    if folder is None:
        return FieldSetup(stream=stream, folder=base)
    return FieldSetup(
        stream=stream,
        folder=folder.path,
        origin=(folder.origin.easting, folder.origin.northing),
        to_local=folder.origin.to_local,
        tracks=tuple(np.asarray(track.line) for track in folder.tracks),
    )


def _terrain_of(folder: FieldFolder | None) -> Dem:
    assert folder is not None  # the reader asks for a terrain where there is no folder
    return Dem.from_raster(folder.terrain)


def _stand_of(folder: FieldFolder | None, setup: FieldSetup) -> Maps:
    assert folder is not None
    params = MapsParams(row_azimuth_deg=float(np.degrees(folder.row_azimuth)))
    return Maps.from_rasters(params, setup, folder.stems, folder.height)
