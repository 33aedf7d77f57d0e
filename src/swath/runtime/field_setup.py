"""The field of a scenario: its parts made by their levels, or taken from a field folder, and put together."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swath.core.asked import ALL, Asked, asking, made_of
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.edges.boundary import Region
from swath.field.edges.edge import TrackEdge, make_boundary, make_edge
from swath.field.field import Field, make_field
from swath.field.field_setup import FieldSetup
from swath.field.ground.soil import Soil, make_soil
from swath.field.maps.projection import Origin, origin_at
from swath.field.maps.raster import Raster
from swath.field.memory_layout import Solids
from swath.field.moisture import Moisture
from swath.field.solid.obstacles import Thing, things_of
from swath.field.solid.solids import merge
from swath.field.stand.maps import Maps
from swath.field.stand.maps import Params as MapsParams
from swath.field.terrain.dem import Dem
from swath.field.terrain.dem import Params as DemParams
from swath.field.weather import SiteWeather, Weather
from swath.scenario.resolved import FieldSection, LevelChoice
from swath.scenario.sections import SoilSection
from swath.signals import F64

if TYPE_CHECKING:
    from swath.field_io.folder import FieldFolder

SOIL = {
    "index": "cone_index_kpa", "raster": "file", "spots": "wet_spots", "has_ruts": "ruts",
    "pass_exponent": "pass_exponent",
}  # fmt: skip
"""Field of `Soil` -> the key that it is made of."""
FAR_M = (
    100_000.0  # no field is so far from the zero of its own metres: such a map counts from a zone's corner
)


@dataclass(frozen=True)
class Ground:
    """field; things: its obstacles; driven: the real pass that the first edge follows, (n, 2) world [m],
    if it does
    asked: who asks for the keys of the field
    origin: where on Earth the world's origin lies, of an imported field or of maps in a known system.
    """

    field: Field
    things: tuple[Thing, ...]
    driven: F64 | None
    asked: Asked
    origin: Origin | None = None

    @cached_property
    def obstacles(self) -> Solids:
        """All obstacles that stand, together: one object, whoever asks."""
        return merge(*(thing.in_world for thing in self.things if thing.way is None))


def build_field(section: FieldSection, *, stream: Stream, base: Path, is_cut: bool = True) -> Ground:
    """The field and what stands on it.

    base: folder that relative file names start from
    is_cut: by some machine, so that the edges must lie in it
    """
    asked = Asked()
    with asking(ALL):
        made = _build(watched_field(section, asked), asked, stream, base, is_cut=is_cut)
    asked.begin()
    return made


def watched_field(section: FieldSection, asked: Asked) -> FieldSection:
    """The section with parameters that tell what is read of them."""

    def level(name: str, choice: LevelChoice | None, each: Sequence[str] = ()) -> LevelChoice | None:
        return choice and replace(choice, params=asked.watched(choice.params, f"field.{name}", each))

    is_one = list(section.edges) == ["edge"]
    edges = {
        name: asked.watched(edge, "field.edge" if is_one else f"field.edges.{name}")
        for name, edge in section.edges.items()
    }
    obstacles = [asked.watched(o, f"field.obstacles.{i}") for i, o in enumerate(section.obstacles)]
    return replace(
        section,
        terrain=level("terrain", section.terrain),
        stand=level("stand", section.stand, ["wind", *(own.name for own in fields(Moisture))]),
        edges=edges,
        obstacles=tuple(obstacles),
        boundary=asked.watched(section.boundary, "field.boundary"),
        weather=asked.watched(section.weather, "field.weather", [own.name for own in fields(Weather)]),
    )


def _build(section: FieldSection, asked: Asked, stream: Stream, base: Path, *, is_cut: bool) -> Ground:
    folder = None if section.folder is None else _read(section.folder)
    mapped = _origin_of_maps(section, base) if folder is None else None
    stated = stated_origin(section)
    if stated is not None and mapped is not None:
        raise InputError("field.origin", None, "expected no origin beside maps that say where they lie")
    setup = _setup(folder, stream, base, mapped)
    if stated is not None:
        setup = replace(setup, to_local=stated.to_local)
    stand = section.stand.make(setup) if section.stand is not None else _stand_of(folder, setup)
    region = make_boundary(section.boundary)
    if region is None and folder is not None:
        region = Region(folder.boundary, folder.holes)
    origin = stated if folder is None else folder.origin
    if mapped is not None:
        origin = mapped
    weather = None if section.weather is None else SiteWeather(section.weather, origin, base)
    field = make_field(
        section.terrain.make(setup) if section.terrain is not None else _terrain_of(folder),
        stand,
        {name: make_edge(edge, setup, name) for name, edge in section.edges.items()},
        crop=load_crop(stand.crop, setup.folder),
        stream=stream,
        boundary=region,
        weather=weather,
        is_cut=is_cut,
    )
    field.soil = _soil(section, asked, setup)
    driven = None
    first = next(iter(section.edges.values()))
    if isinstance(first, TrackEdge) and first.file is None:
        driven = setup.tracks[first.track]
    if mapped is not None:
        origin = replace(mapped, height=float(getattr(field.terrain, "datum", 0.0)))
    return Ground(field, things_of(section.obstacles, field), driven, asked, origin)


def _soil(section: FieldSection, asked: Asked, setup: FieldSetup) -> Soil | None:
    """Soil that asks for its keys when it is read."""
    said = section.common.soil
    if said is None or (soil := make_soil(said, setup)) is None:
        return None
    return made_of(soil, asked.watched(said, "field.soil", list(SoilSection.model_fields)), SOIL)


def stated_origin(section: FieldSection) -> Origin | None:
    """The origin that the scenario states. MissingExtra without a map projection."""
    place = section.common.origin
    return None if place is None else origin_at(place.latitude_deg, place.longitude_deg, place.height_m)


def _read(path: Path) -> "FieldFolder":
    from swath.field_io.folder import read

    return read(path)


def _origin_of_maps(section: FieldSection, base: Path) -> Origin | None:
    """The middle of the first map that a scenario without a field folder names, whole metres; None without
    maps, and of a map near the zero of its own system, which then is the world's.

    Raises InputError when the maps are in different systems.
    """
    names = [
        (f"field.{part}.{key}", str(name))
        for part, choice in (("terrain", section.terrain), ("stand", section.stand))
        for key in ("file", "density_file", "height_file")
        if choice is not None
        and isinstance(choice.params, DemParams | MapsParams)
        and (name := getattr(choice.params, key, None)) is not None
    ]
    maps = [(key, name, Raster.from_geotiff(base / name)) for key, name in names]
    if not maps or max(abs(edge) for edge in maps[0][2].bounds) < FAR_M:
        return None
    first = maps[0][2]
    for key, name, raster in maps[1:]:
        if raster.epsg != first.epsg:
            raise InputError(
                key, f"EPSG:{raster.epsg}", f"expected EPSG:{first.epsg} as in {names[0][1]}", file=name
            )
    if first.epsg is None:
        raise InputError(
            names[0][0], names[0][1], "expected a map in a system with an EPSG code (gdalwarp -t_srs)"
        )
    west, south, east, north = first.bounds
    return Origin(first.epsg, float(round(0.5 * (west + east))), float(round(0.5 * (south + north))))


def _setup(folder: "FieldFolder | None", stream: Stream, base: Path, mapped: Origin | None) -> FieldSetup:
    if folder is None and mapped is not None:
        corner = (mapped.easting, mapped.northing)
        return FieldSetup(stream=stream, folder=base, origin=corner, to_local=mapped.to_local)
    if folder is None:
        return FieldSetup(stream=stream, folder=base)
    return FieldSetup(
        stream=stream,
        folder=folder.path,
        origin=(folder.origin.easting, folder.origin.northing),
        to_local=folder.origin.to_local,
        tracks=tuple(np.asarray(track.line) for track in folder.tracks),
    )


def _terrain_of(folder: "FieldFolder | None") -> Dem:
    assert folder is not None  # the reader asks for a terrain where there is no folder
    return Dem.from_raster(folder.terrain)


def _stand_of(folder: "FieldFolder | None", setup: FieldSetup) -> Maps:
    assert folder is not None
    params = MapsParams(crop=folder.crop, row_azimuth_deg=float(np.degrees(folder.row_azimuth)))
    return Maps.from_rasters(params, setup, folder.stems, folder.height)
