"""What the text files of a field folder have to hold: `field.yaml` and GeoJSON in lon/lat (RFC 7946)."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from swath.core.errors import InputError, absence_of
from swath.documents.json_file import read_json
from swath.documents.validation import checked
from swath.documents.yaml_document import Document, Place, read_document

FORMAT, VERSION = "swath field", 1
T = TypeVar("T")


class _Open(BaseModel):
    """Keys that are not known are left alone: a GIS adds its own."""

    model_config = ConfigDict(strict=True, extra="ignore", allow_inf_nan=False, frozen=True)


class OriginKeys(_Open):
    """Where local (0, 0, 0) lies."""

    easting_m: Annotated[float, Field(ge=-1e8, le=1e8)]
    northing_m: Annotated[float, Field(ge=-1e8, le=1e8)]
    height_m: Annotated[float, Field(ge=-1e4, le=1e4)]


class Head(_Open):
    """The keys of field.yaml that say where the field is."""

    format: Literal["swath field"]
    version: Literal[1]
    crs: Annotated[str, Field(pattern=r"^EPSG:[0-9]{1,6}$")]
    origin: OriginKeys


class _CropFacts(_Open):
    name: str = "wheat"
    grain_g_per_stem: Annotated[float, Field(gt=0.0)] | None = None


class _Rows(_Open):
    broken: dict[str, int] | None = None


class _Histogram(_Open):
    top_t_ha: Annotated[float, Field(gt=0.0)]
    kept: list[int]
    removed: list[int]


class Info(Head):
    """All of field.yaml that is read back; what the overview draws may be left out."""

    row_azimuth_deg: float
    source: dict[str, Any] | None = None
    crop: _CropFacts | None = None
    rows: _Rows | None = None
    removed: dict[str, int] | None = None
    yield_histogram: _Histogram | None = None


Position = Annotated[list[float], Field(min_length=2)]
Line = Annotated[list[Position], Field(min_length=2)]
Rings = Annotated[list[Annotated[list[Position], Field(min_length=4)]], Field(min_length=1)]
Kind = TypeVar("Kind")
Coordinates = TypeVar("Coordinates")


class Geometry(_Open, Generic[Kind, Coordinates]):
    """A geometry of GeoJSON; rings are closed, the outer one first."""

    type: Kind
    coordinates: Coordinates


AnyGeometry = Annotated[
    Geometry[Literal["Point"], Position]
    | Geometry[Literal["MultiPoint"], list[Position]]
    | Geometry[Literal["LineString"], Line]
    | Geometry[Literal["MultiLineString"], list[Line]]
    | Geometry[Literal["Polygon"], Rings]
    | Geometry[Literal["MultiPolygon"], list[Rings]],
    Field(discriminator="type"),
]


class StraightProperties(_Open):
    """A straight window of a pass."""

    first: Annotated[int, Field(ge=0)]
    last: Annotated[int, Field(ge=0)]
    azimuth_deg: float
    lateral_sd_m: float


class PassProperties(_Open):
    """What a pass says of itself."""

    machine: str
    number: int = Field(alias="pass")
    header_width_m: Annotated[float, Field(ge=0.0)]
    mean_speed_kmh: float
    start_time_s: float
    azimuth_deg: float
    length_m: Annotated[float, Field(ge=0.0)]
    straights: list[StraightProperties] = []


class Feature(_Open, Generic[Kind, T]):
    """A feature: where it is, and what it says of itself."""

    geometry: Kind
    properties: T


class Features(_Open, Generic[T]):
    """A file of features."""

    features: list[T]


Boundary = Features[Feature[Geometry[Literal["Polygon"], Rings], Any]]
Pass = Feature[Geometry[Literal["LineString"], Line], PassProperties]
Passes = Features[Pass]
Obstacles = Features[Feature[AnyGeometry, dict[str, Any] | None]]


def read_info(folder: Path, kind: type[T]) -> tuple[T, dict[str, Any]]:
    """What field.yaml says, checked as `kind`, and all of it. InputError names key, file and line."""
    path = folder / "field.yaml"
    if not os.path.isdir(folder):
        what = "this is a file" if os.path.exists(folder) else absence_of(folder, "there is none")
        raise InputError("field folder", str(folder), f"expected a folder, {what}")
    if not os.path.isfile(path):
        what = absence_of(path, "it has no field.yaml")
        raise InputError("field folder", str(folder), f"expected a field folder, {what}")
    document = replace(read_document(path), kind="field folder")
    made: T = checked(kind, document)
    return made, document.data


def read_features(path: Path, kind: type[T]) -> T:
    """A GeoJSON file, checked as `kind`. InputError names the key within it."""
    data = read_json(path, path.stem, "GeoJSON")
    made: T = checked(kind, Document(data, path, {(): Place(str(path))}, kind=path.stem))
    return made
