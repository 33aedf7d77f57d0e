"""The folder of a field in AgOpenGPS: origin, boundary, islands, headland, AB and curve tracks.

Text files, one value or point a line, in metres east and north of the origin on AgOpenGPS's own plane.
Source: `SourceCode/GPS/IO/*Files.cs` and `AgOpenGPS.Core/Models/Base/LocalPlane.cs` of
github.com/AgOpenGPS-Official/AgOpenGPS.
"""

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.files.output_folder import held
from swath.core.files.whole_file import write_whole
from swath.core.number_text import num
from swath.core.units import digits_in
from swath.documents.text_file import read_text
from swath.field_io.folder import FieldFolder
from swath.field_io.passes import STRAIGHT_TOLERANCE
from swath.field_io.task_data.taskdata import AB, CURVE, POINT_A, POINT_B, Part, Pattern, Polygon

Array = NDArray[np.float64]
FIELD, BOUNDARY, HEADLAND, TRACKS = "Field.txt", "Boundary.txt", "Headland.txt", "TrackLines.txt"
OLDER = "ABLines.txt", "CurveLines.txt"  # of versions before 6.4
MODES = {2: AB, 4: CURVE}
NAMED = {8: "outer boundary track", 16: "inner boundary track", 32: "boundary curve", 64: "water pivot"}
HEADLAND_LINE = "headland"  # name of a track that is one
MOST_POINTS = 1_000_000
FARTHEST_M = 20e3  # from the origin of its plane to a field
WRITTEN = "2026-July-15 10:00:00 AM"  # nothing reads it


@dataclass(frozen=True)
class Plane:
    """AgOpenGPS's plane at an origin [deg]: a scale along the meridian there, one along each parallel."""

    latitude: float
    longitude: float

    @property
    def _north(self) -> float:
        """Metres per degree of latitude."""
        at = math.radians(self.latitude)
        return 111132.92 - 559.82 * math.cos(2 * at) + 1.175 * math.cos(4 * at) - 0.0023 * math.cos(6 * at)

    @staticmethod
    def _east(latitude: Array) -> Array:
        """Metres per degree of longitude on a parallel [deg]."""
        at = np.radians(latitude)
        return np.asarray(111412.84 * np.cos(at) - 93.5 * np.cos(3 * at) + 0.118 * np.cos(5 * at))

    def to_lon_lat(self, points: Array) -> Array:
        """East and north [m] as lon/lat [deg], (n, 2) each."""
        lat = self.latitude + points[:, 1] / self._north
        return np.column_stack([self.longitude + points[:, 0] / self._east(lat), lat])

    def from_lon_lat(self, places: Array) -> Array:
        """Lon/lat [deg] as east and north [m], (n, 2) each."""
        east = (places[:, 0] - self.longitude) * self._east(places[:, 1])
        return np.column_stack([east, (places[:, 1] - self.latitude) * self._north])


@dataclass(frozen=True)
class Line:
    """A track. kind: AB or CURVE of task data; points: of the plane [m], (n, 2)."""

    name: str
    kind: str
    points: Array


@dataclass(frozen=True)
class AgOpenGpsField:
    """A field in metres of its plane, (n, 2) each.

    rings: the boundary, then islands in it
    headlands: their inner lines
    notes: what was not used
    """

    plane: Plane
    rings: tuple[Array, ...]
    headlands: tuple[Array, ...]
    lines: tuple[Line, ...]
    notes: tuple[str, ...]

    def part(self, name: str) -> Part:
        """The same as a field of task data, lon/lat [deg]."""
        outer, *islands = [self.plane.to_lon_lat(ring) for ring in self.rings]
        part = Part(name, "")
        part.polygons["field"] = [Polygon("boundary", [outer], [])]
        part.polygons["bare"] = [Polygon("island", [ring], []) for ring in islands]
        for line in self.lines:
            types = (POINT_A, POINT_B) if line.kind == AB else ("",) * len(line.points)
            part.guidance.append(Pattern(line.kind, types, self.plane.to_lon_lat(line.points)))
        for ring in self.headlands:
            closed = self.plane.to_lon_lat(np.vstack([ring, ring[:1]]))
            part.guidance.append(Pattern(CURVE, ("",) * len(closed), closed, name=HEADLAND_LINE))
        return part


def is_agopengps(path: Path) -> bool:
    """Whether it is the folder of a field in AgOpenGPS."""
    return os.path.isdir(path) and os.path.isfile(path / FIELD)


def read_agopengps(path: Path) -> AgOpenGpsField:
    """Read a folder. InputError with file and line where it is not as AgOpenGPS writes it."""
    plane = _read_plane(path / FIELD)
    if not os.path.isfile(path / BOUNDARY):
        raise InputError("boundary", None, f"expected {BOUNDARY} in it", file=path)
    drives, rings = _read_boundary(path / BOUNDARY)
    if not rings:
        raise InputError("boundary", None, "expected a boundary, it has none", file=path / BOUNDARY)
    notes = [f"shape: {drives} islands that may be driven through are islands"] if drives else []
    if (away := max(float(np.abs(ring).max()) for ring in rings)) > FARTHEST_M:
        notes.append(f"place: the boundary lies {num(away / 1e3)} km from the origin in {FIELD}")
    headlands = _read_headlands(path / HEADLAND, len(rings)) if os.path.isfile(path / HEADLAND) else []
    lines: list[Line] = []
    if os.path.isfile(path / TRACKS):
        lines, left_out = _read_tracks(path / TRACKS)
        notes += [f"unused: {name}" for name in left_out]
    elif older := [name for name in OLDER if os.path.isfile(path / name)]:
        notes.append(f"unused: {', '.join(older)} of an older version, open the field in a newer one")
    return AgOpenGpsField(plane, tuple(rings), tuple(headlands), tuple(lines), tuple(notes))


class _Lines:
    """Lines of a file with their numbers, blank ones left out."""

    def __init__(self, file: Path) -> None:
        self.file = file
        text = read_text(file, file.stem, "a file of AgOpenGPS")
        rows = enumerate(text.splitlines(), 1)
        self._rows: Iterator[tuple[int, str]] = iter([(n, row.strip()) for n, row in rows if row.strip()])
        self.number = 0
        self._kept: tuple[int, str] | None = None

    def next(self, what: str) -> str:
        """The next line. InputError where there is none."""
        row = self.maybe()
        if row is None:
            raise InputError(what, None, "expected more lines, the file ends here", file=self.file)
        return row

    def maybe(self) -> str | None:
        """The next line, None at the end."""
        found = self._kept or next(self._rows, None)
        self._kept = None
        if found is None:
            return None
        self.number, row = found
        return row

    def back(self, row: str) -> None:
        """A line that is read again."""
        self._kept = (self.number, row)

    def numbers(self, what: str, *counts: int) -> list[float]:
        """Numbers of the next line, as many as one of the counts: decimal commas make more of them."""
        row = self.next(what)
        try:
            found = [float(word) for word in row.split(",")]
        except ValueError:
            found = []
        if len(found) not in counts or not all(map(math.isfinite, found)):
            wanted = " or ".join(map(str, counts))
            raise self.error(what, row, f"expected {wanted} numbers between commas, with decimal points")
        return found

    def count(self, what: str) -> int:
        """A whole number, of points."""
        row = self.next(what)
        if not 0 <= (count := digits_in(row)) <= MOST_POINTS:
            raise self.error(what, row, "expected how many points follow")
        return count

    def points(self, what: str) -> Array:
        """Points behind their number, (n, 2) [m]."""
        rows = [self.numbers(what, 2, 3)[:2] for _ in range(self.count(what))]
        return np.array(rows, dtype=float).reshape(-1, 2)

    def error(self, key: str, value: str, expected: str) -> InputError:
        """About the line read last."""
        return InputError(key, value, expected, file=self.file, line=self.number)


def _read_plane(file: Path) -> Plane:
    lines = _Lines(file)
    while (row := lines.maybe()) is not None:
        if row.casefold().startswith("startfix"):
            latitude, longitude = lines.numbers("StartFix", 2)
            if not (abs(latitude) < 90.0 and abs(longitude) <= 180.0):
                raise lines.error("StartFix", f"{latitude},{longitude}", "expected latitude and longitude")
            return Plane(latitude, longitude)
    raise InputError("StartFix", None, "expected the origin of the field", file=file)


def _read_boundary(file: Path) -> tuple[int, list[Array]]:
    """How many islands may be driven through, and the rings, those with an area."""
    lines, drives = _Lines(file), 0
    rings: list[Array] = []
    while (row := lines.maybe()) is not None:
        if row.startswith("$"):
            continue
        is_driven = False
        while row.casefold() in ("true", "false"):  # older versions wrote it twice
            is_driven = row.casefold() == "true"
            row = lines.next("boundary")
        lines.back(row)
        ring = lines.points("boundary")
        if len(ring) >= 3:
            drives += is_driven and bool(rings)
            rings.append(ring)
    return drives, rings


def _read_headlands(file: Path, most: int) -> list[Array]:
    lines = _Lines(file)
    found: list[Array] = []
    while (row := lines.maybe()) is not None and len(found) < most:
        if row.startswith("$"):
            continue
        lines.back(row)
        found.append(lines.points("headland"))
    return [ring for ring in found if len(ring) >= 3]


def _read_tracks(file: Path) -> tuple[list[Line], list[str]]:
    lines = _Lines(file)
    head = lines.next("tracks")
    if not head.startswith("$"):
        raise lines.error("tracks", head, "expected $TrackLines")
    found: list[Line] = []
    left_out: list[str] = []
    while (name := lines.maybe()) is not None:
        lines.numbers("heading", 1)
        a, b = lines.numbers("A", 2), lines.numbers("B", 2)
        lines.numbers("nudge", 1)
        row = lines.next("mode")
        if (mode := digits_in(row.removeprefix("-"))) < 0:
            raise lines.error("mode", row, "expected a whole number")
        lines.next("visible")
        points = lines.points("curve")
        if head == "$TwolTracks":  # of a tool, two lines more
            lines.next("tool"), lines.next("tool")
        kind = MODES.get(-mode if row.startswith("-") else mode)
        if kind == AB and a != b:
            found.append(Line(name, AB, np.array([a, b])))
        elif kind == CURVE and len(points) >= 2:
            found.append(Line(name, CURVE, points))
        else:
            left_out.append(f"track {name}, {NAMED.get(int(row), 'without points')}")
    return found, left_out


def write_agopengps(field: FieldFolder, out: Path) -> None:
    """Write a field folder as a field of AgOpenGPS, into a new or empty folder, or one of AgOpenGPS.

    A pass that is straight to 0.3 m becomes an AB line, another a curve; passes named `headland` become the
    headland. InputError where the folder is of something else.
    """
    longitude, latitude = field.origin.to_lon_lat([[0.0, 0.0]])[0].tolist()
    plane = Plane(latitude, longitude)

    def placed(local: Array) -> Array:
        return plane.from_lon_lat(field.origin.to_lon_lat(local))

    rings = [placed(ring) for ring in (field.boundary, *field.holes)]
    headlands = [placed(t.line) for t in field.tracks if t.machine == HEADLAND_LINE]
    passes = [(t, placed(t.line)) for t in field.tracks if t.machine != HEADLAND_LINE]
    head = [WRITTEN, "$FieldDir", "FieldNew", "$Offsets", "0,0", "Convergence", "0", "StartFix"]
    inner = [_points(_opened(ring), True) for ring in headlands[: len(rings)]]
    inner += [["0"]] * (len(rings) - len(inner)) if inner else []
    rows = ["$TrackLines"]
    for track, line in passes:
        across = line[-1] - line[0]
        is_straight = _is_straight(line)
        heading = math.atan2(across[0], across[1]) % (2.0 * math.pi)
        rows += [f"pass {track.index}", repr(heading), _place(line[0]), _place(line[-1]), "0"]
        rows += ["2" if is_straight else "4", "True", *(["0"] if is_straight else _points(line, False))]
    files = {
        FIELD: [*head, f"{latitude!r},{longitude!r}"],
        BOUNDARY: ["$Boundary", *(r for ring in rings for r in ("False", *_points(ring, True)))],
        HEADLAND: ["$Headland", *(row for one in inner for row in one)],
        TRACKS: rows,
    }
    with held(out, tuple(files), "field of AgOpenGPS", alone=not is_agopengps(out)):
        for name, lines in files.items():
            write_whole(out / name, "\r\n".join([*lines, ""]))


def _opened(ring: Array) -> Array:
    return ring[:-1] if len(ring) > 3 and np.allclose(ring[0], ring[-1], atol=1e-3) else ring


def _is_straight(line: Array) -> bool:
    across = line[-1] - line[0]
    length = float(np.hypot(*across))
    if length < 1e-3:
        return False
    off = (line - line[0]) @ np.array([-across[1], across[0]]) / length
    return bool(np.abs(off).max() <= STRAIGHT_TOLERANCE)


def _points(line: Array, is_closed: bool) -> list[str]:
    """How many, then each with its heading from north to the next one."""
    ahead = np.roll(line, -1, axis=0) if is_closed else np.vstack([line[1:], 2 * line[-1:] - line[-2:-1]])
    heading = np.arctan2(*(ahead - line).T) % (2.0 * np.pi)
    return [str(len(line)), *(f"{_place(p)},{h:.5f}" for p, h in zip(line, heading, strict=True))]


def _place(point: Array) -> str:
    return f"{point[0]:.3f},{point[1]:.3f}"
