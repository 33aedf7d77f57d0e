"""Files of kinds that swath does not read, known by how they begin: refused by name, with what to export."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from swath.core.errors import InputError
from swath.core.files.read_file import open_to_read
from swath.documents.packed import is_archive, member_names

BYTES = 4096  # of a file, that show its kind
OUTLINE, TABLE = "GeoJSON, KML or a polygon shapefile", "CSV with columns for position, time and yield"
EITHER = f"{OUTLINE} for an outline, {TABLE} for a log"
TEXTS = {  # what its beginning holds -> its kind, what to export instead
    rb'"esriGeometry|"wkid"|"rings"\s*:|"attributes"\s*:.*"geometry"\s*:\s*\{\s*"[xp]': ("Esri JSON", EITHER),
    rb'"type"\s*:\s*"Topology"': ("TopoJSON", OUTLINE),
    rb"<gpx\b": ("GPX, which knows no yield and no areas", EITHER),
    rb"<([a-z]+:)?FeatureCollection|<gml:|xmlns:gml": ("GML", OUTLINE),
    rb"\A\W*(SRID=\d+;)?(MULTI)?(POLYGON|LINESTRING|POINT) ?Z?M? ?\(": ("WKT", EITHER),
    rb"\ASQLite format 3": ("a database such as a GeoPackage", EITHER),
    rb"<kml\b": ("KML", TABLE),
}  # fmt: skip
MEMBERS = {  # a name in an archive -> as above
    r"xl/workbook\.xml": ("an Excel workbook", "CSV, saved from it"),
    r"content\.xml": ("an OpenDocument sheet", "CSV, saved from it"),
    r".*\.shp|.*taskdata\.xml": ("", ""),
    r".*\.kml": ("KMZ", TABLE),
    r".*\.(csv|txt|tsv)": ("a zip archive with a table in it", "the table, unpacked or as .csv.gz"),
    r".*\.(geo)?json": ("a zip archive with GeoJSON in it", "the file in it, unpacked"),
}


def refuse_foreign(path: Path, key: str, allowed: Sequence[str] = ()) -> None:
    """InputError for a file of another kind that is known. allowed: kinds that are read here."""
    kind, export = _kind_of(path, key) if os.path.isfile(path) else ("", "")
    if kind and kind not in allowed:
        raise InputError(key, None, f"this is {kind}: export {export}", file=path)


def _kind_of(path: Path, key: str) -> tuple[str, str]:
    if is_archive(path):
        names = [name.lower() for name in member_names(path)]
        return next(
            (of for word, of in MEMBERS.items() if any(re.fullmatch(word, n) for n in names)), ("", "")
        )
    with open_to_read(path, key, "a file that can be read") as file:
        head = file.read(BYTES)
    return next((of for word, of in TEXTS.items() if re.search(word, head, re.I | re.S)), ("", ""))
