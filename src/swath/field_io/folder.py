"""A field folder: one real field as rasters and vectors that any GIS opens, and back into local metres.

docs/how-to/field.md describes the files.
"""

import base64
import html
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, reason_of
from swath.core.files.output_folder import check_folder, held
from swath.core.files.place import move, own_folder, remove, remove_tree
from swath.core.files.whole_file import PART, write_whole
from swath.documents.text_file import read_bytes
from swath.documents.yaml_document import dump
from swath.field.maps.band import CROP_HEIGHT, GRAIN, GROUND, MOISTURE, STEMS
from swath.field.maps.projection import Origin, known_crs
from swath.field.maps.raster import Raster
from swath.field_io.folder_files import (
    FORMAT,
    VERSION,
    Boundary,
    Head,
    Info,
    Obstacles,
    Passes,
    read_features,
    read_info,
)
from swath.field_io.passes import Track, to_geojson, track_of

Array = NDArray[np.float64]
OPTIONAL = ("moisture",)  # maps that may be without a single number: not every log measures it
RASTERS = {
    "terrain": "terrain.tif",
    "stems": "density.tif",
    "height": "height.tif",
    "moisture": "moisture.tif",
    "grain": "yield.tif",
}
BANDS = {  # name and unit, as GDAL and QGIS show them
    "terrain": ("height of the ground", "m"),
    "stems": ("stems", "1/m2"),
    "height": ("height of the crop", "m"),
    "moisture": ("grain moisture", "1"),
    "grain": ("yield", "kg/m2"),
}
QUANTITIES = {"terrain": GROUND, "stems": STEMS, "height": CROP_HEIGHT, "moisture": MOISTURE, "grain": GRAIN}
PICTURE = "overview.png"
HEAD = "field.yaml"  # the last file that a folder gets: with it, it is whole
FILES = (*RASTERS.values(), "boundary.geojson", "tracks.geojson", "obstacles.geojson", PICTURE, HEAD)
MADE = ("scenario.yaml", "passes.yaml")  # of a field, beside it
STAGED = f"field{PART}"  # a folder in it, of what is being made


@dataclass(frozen=True)
class FieldFolder:
    """A field in its local frame: x east, y north [m] from the origin, z up from the origin's height.

    boundary: counter-clockwise, not closed, shape (n, 2) [m]
    holes: areas inside without crop, same form
    row_azimuth: main driving direction, clockwise from north [rad], in [0, pi)
    tracks: driven passes in driven order
    terrain: height above the origin [m]
    stems: ears per m2
    height: of the crop [m]
    moisture: of the grain, share of wet mass
    grain: yield as harvested [kg/m2]; nan where there is none (no crop, or not known)
    obstacles: GeoJSON geometry (local metres) and properties of each, empty when there is no such file
    info: field.yaml as read
    """

    path: Path
    origin: Origin
    boundary: Array
    holes: tuple[Array, ...]
    row_azimuth: float
    tracks: tuple[Track, ...]
    terrain: Raster
    stems: Raster
    height: Raster
    moisture: Raster
    grain: Raster
    obstacles: tuple[tuple[dict[str, Any], dict[str, Any]], ...]
    info: dict[str, Any]

    def _repr_html_(self) -> str:
        """Overview of the field for a notebook."""
        file = self.path / PICTURE
        data = (
            base64.b64encode(read_bytes(file, "field", "a picture")).decode() if os.path.isfile(file) else ""
        )
        return f'<b>{html.escape(self.path.name)}</b><br/><img src="data:image/png;base64,{data}"/>'

    @property
    def crop(self) -> str:
        """Data sheet of the crop: a bundled one, or a file as seen from the folder."""
        return str((self.info.get("crop") or {}).get("name", "wheat"))


def read_origin(path: Path) -> Origin:
    """Only where the local metres of a field folder count from."""
    return _origin(read_info(path, Head)[0])


def read(path: Path | str) -> FieldFolder:
    """Read a field folder. Raises InputError naming the file that is missing or wrong, and the key in it."""
    path = Path(path)
    head, info = read_info(path, Info)
    origin = _origin(head)
    corner = (origin.easting, origin.northing)
    rasters = {}
    for key, name in RASTERS.items():
        of, may_be_empty = QUANTITIES[key], key in OPTIONAL
        raster = Raster.from_geotiff(path / name, corner, quantity=of, may_be_empty=may_be_empty)
        if raster.epsg != origin.epsg:
            expected = f"expected EPSG {origin.epsg} of field.yaml"
            raise InputError("raster.crs", raster.epsg, expected, file=path / name)
        rasters[key] = raster
    terrain = rasters["terrain"]
    rasters["terrain"] = replace(terrain, values=(terrain.values - np.float32(origin.height)))
    boundary, *holes = _local_rings(path / "boundary.geojson", origin)
    tracks = path / "tracks.geojson"
    return FieldFolder(
        path=path,
        origin=origin,
        boundary=boundary,
        holes=tuple(holes),
        row_azimuth=float(np.radians(head.row_azimuth_deg)),
        tracks=tuple(track_of(found, origin, tracks) for found in read_features(tracks, Passes).features),
        obstacles=_read_obstacles(path / "obstacles.geojson", origin),
        info=info,
        **rasters,
    )


def write(field: FieldFolder, picture: Callable[[FieldFolder, Path], None] | None = None) -> None:
    """Write a field folder to field.path, whole or not at all.

    It is made in a folder there, and its files then take the places of those of the field before; a folder of
    something else is an InputError. picture: called as picture(field, file) to draw the overview.
    """
    out = field.path
    check_target(out)
    try:
        with held(out, FILES[:-1], "field", alone=False):
            staged = out / STAGED
            remove_tree(staged)
            try:
                own_folder(staged)
                _write_parts(field, staged)
                if picture is not None:
                    picture(field, staged / PICTURE)
                _take_places(staged, out)
            finally:
                remove_tree(staged)
    except OSError as error:
        raise InputError(
            "out", str(out), f"expected a folder that can be written: {reason_of(error)}"
        ) from error


def check_target(out: Path) -> None:
    """InputError unless out is free, empty, or a field folder, of which others may use the place, too."""
    if not any(os.path.isfile(out / name) for name in (HEAD, f"{HEAD}{PART}")):
        check_folder(out, (*FILES, STAGED.removesuffix(PART)), "field")


def _take_places(staged: Path, out: Path) -> None:
    """Put the files of a folder in the places of those of the field that was there.

    Between the first and the last there is no field.yaml, so nobody takes half of each for a field.
    """
    if os.path.isfile(out / HEAD):
        move(out / HEAD, out / f"{HEAD}{PART}")
    for name in (*FILES, *MADE):
        if os.path.isfile(staged / name):
            move(staged / name, out / name)
        else:
            remove(out / name)
    remove(out / f"{HEAD}{PART}")


def _write_parts(field: FieldFolder, folder: Path) -> None:
    origin = field.origin
    for key, name in RASTERS.items():
        raster: Raster = getattr(field, key)
        if key == "terrain":
            raster = replace(raster, values=raster.values + np.float32(origin.height))
        corner = (origin.easting, origin.northing)
        raster.to_geotiff(folder / name, origin.epsg, corner, name=BANDS[key][0], unit=BANDS[key][1])
    closed = [np.vstack([ring, ring[:1]]) for ring in (field.boundary, *field.holes)]
    polygon = {"type": "Polygon", "coordinates": [np.round(origin.to_lon_lat(r), 9).tolist() for r in closed]}
    feature = {"type": "Feature", "geometry": polygon, "properties": {}}
    _write_json(folder / "boundary.geojson", {"type": "FeatureCollection", "features": [feature]})
    _write_json(folder / "tracks.geojson", to_geojson(field.tracks, origin))
    if field.obstacles:
        features = [
            {"type": "Feature", "geometry": _map_geometry(g, origin.to_lon_lat), "properties": p}
            for g, p in field.obstacles
        ]
        _write_json(folder / "obstacles.geojson", {"type": "FeatureCollection", "features": features})
    head = {
        "format": FORMAT,
        "version": VERSION,
        "crs": f"EPSG:{origin.epsg}",
        "origin": {"easting_m": origin.easting, "northing_m": origin.northing, "height_m": origin.height},
        "row_azimuth_deg": round(float(np.degrees(field.row_azimuth)), 4),
    }
    rest = {k: v for k, v in field.info.items() if k not in head}
    text = dump({**head, **rest}, width=110)
    write_whole(folder / HEAD, text)


def _write_json(path: Path, data: dict[str, Any]) -> None:
    write_whole(path, json.dumps(data, allow_nan=False, separators=(",", ":")) + "\n")


def _origin(head: Head) -> Origin:
    at = head.origin
    origin = Origin(int(head.crs.removeprefix("EPSG:")), at.easting_m, at.northing_m, at.height_m)
    known_crs(head.crs)
    return origin


def _local_rings(path: Path, origin: Origin) -> list[Array]:
    features = read_features(path, Boundary).features
    if not features:
        raise InputError("boundary.features", [], "expected one feature with a Polygon", file=path)
    rings = features[0].geometry.coordinates
    loops = [origin.to_local([place[:2] for place in ring[:-1]]) for ring in rings]
    if not all(np.isfinite(loop).all() for loop in loops):
        raise InputError("boundary", None, "expected longitude and latitude in degrees", file=path)
    return loops


def _read_obstacles(path: Path, origin: Origin) -> tuple[tuple[dict[str, Any], dict[str, Any]], ...]:
    if not os.path.isfile(path):
        return ()
    found = read_features(path, Obstacles).features
    return tuple((_map_geometry(f.geometry.model_dump(), origin.to_local), f.properties or {}) for f in found)


def _map_geometry(geometry: dict[str, Any], to: Callable[[Any], Array]) -> dict[str, Any]:
    """A GeoJSON geometry with its coordinates moved by `to`, which takes and gives shape (n, 2)."""

    def walk(coordinates: Any) -> Any:
        if coordinates and isinstance(coordinates[0], int | float):
            return to([coordinates[:2]])[0].tolist()
        return [walk(c) for c in coordinates]

    return {"type": geometry["type"], "coordinates": walk(geometry["coordinates"])}
