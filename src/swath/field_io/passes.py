"""The driven passes of a field as tracks, and what they say together: row direction and spacing."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.units import DEG, KMH
from swath.field.maps.projection import Origin
from swath.field_io.clean import Cleaned
from swath.field_io.folder_files import Pass

Array = NDArray[np.float64]
STRAIGHT_TOLERANCE = 0.3  # m: a straight window keeps this close to its chord
STRAIGHT_LENGTH = 60.0  # m at least


@dataclass(frozen=True)
class Straight:
    """A straight window of a track.

    first, last: numbers of its records, the last one included
    azimuth: direction, clockwise from north [rad]
    lateral_sd: standard deviation of the records about the fitted line [m]
    """

    first: int
    last: int
    azimuth: float
    lateral_sd: float


@dataclass(frozen=True)
class Track:
    """One driven pass. line: positions as logged (antenna), local east and north [m], shape (n, 2).

    index: in driven order
    header_width: of the machine, all sections [m]; mean_speed [m/s]
    start_time: from the machine's first record [s]
    azimuth: mean direction, clockwise from north [rad]; length [m]
    straights: its straight windows
    """

    line: Array
    machine: str
    index: int
    header_width: float
    mean_speed: float
    start_time: float
    azimuth: float
    length: float
    straights: tuple[Straight, ...]

    @property
    def heading(self) -> float:
        """Mean direction counter-clockwise from east [rad], in (-pi, pi]."""
        return float(np.angle(np.exp(1j * (0.5 * np.pi - self.azimuth))))


def make_tracks(cleaned: Cleaned, origin: Origin) -> tuple[Track, ...]:
    """The passes of a cleaned log in driven order."""
    log = cleaned.log
    order = np.flatnonzero(cleaned.pass_id >= 0)
    order = order[np.argsort(cleaned.pass_id[order], kind="stable")]
    pieces = np.split(order, np.flatnonzero(np.diff(cleaned.pass_id[order])) + 1) if len(order) else []
    local = log.position - (origin.easting, origin.northing)
    own = [log.width[log.machine == m] for m in range(len(log.machine_names))]
    headers = [float(np.percentile(w, 95)) if len(w) else 0.0 for w in own]
    tracks = []
    for index, rows in enumerate(pieces):
        line = local[rows]
        steps = np.diff(line, axis=0)
        length = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        step_sum = np.exp(1j * cleaned.course[rows]).sum()
        tracks.append(
            Track(
                line=line,
                machine=log.machine_names[int(log.machine[rows[0]])],
                index=index,
                header_width=headers[int(log.machine[rows[0]])],
                mean_speed=length / max(float(log.time[rows[-1]] - log.time[rows[0]]), 1e-9),
                start_time=float(log.time[rows[0]]),
                azimuth=float((0.5 * np.pi - np.angle(step_sum)) % (2.0 * np.pi)),
                length=length,
                straights=straight_windows(line),
            )
        )
    return tuple(tracks)


def straight_windows(line: Array) -> tuple[Straight, ...]:
    """Stretches of at least STRAIGHT_LENGTH that keep within STRAIGHT_TOLERANCE of their chord.

    Split at the farthest point until all keep the tolerance (Douglas and Peucker 1973,
    DOI 10.3138/FM57-6770-U75U-7727).
    """
    windows, stack = [], [(0, len(line) - 1)]
    while stack:
        first, last = stack.pop()
        chord = line[last] - line[first]
        length = float(np.hypot(*chord))
        part = line[first : last + 1] - line[first]
        if length < 1e-6:
            off = np.hypot(part[:, 0], part[:, 1])
        else:
            off = np.abs(part @ np.array([-chord[1], chord[0]])) / length
        worst = int(off.argmax())
        if off[worst] > STRAIGHT_TOLERANCE:
            stack += [(first + worst, last), (first, first + worst)]
        elif length >= STRAIGHT_LENGTH:
            azimuth = float(np.arctan2(chord[0], chord[1]) % (2.0 * np.pi))
            windows.append(Straight(first, last, azimuth, lateral_sd(line[first : last + 1])))
    return tuple(windows)


def lateral_sd(line: Array) -> float:
    """Standard deviation of points about their fitted line [m]."""
    centred = line - line.mean(axis=0)
    smallest = float(np.linalg.eigvalsh(centred.T @ centred / len(line))[0])
    return float(np.sqrt(max(smallest, 0.0)))


def row_azimuth(tracks: tuple[Track, ...]) -> float:
    """Dominant direction of the straight windows, clockwise from north [rad], in [0, pi).

    Mode of the azimuths modulo pi weighted by length, in bins of 2 degrees, refined by the circular mean of
    what lies within 5 degrees. Without a straight window: of the whole passes.
    """
    azimuth = np.array([w.azimuth for t in tracks for w in t.straights])
    weight = np.array([_length(t, w) for t in tracks for w in t.straights])
    if not len(azimuth):
        azimuth, weight = np.array([t.azimuth for t in tracks]), np.array([t.length for t in tracks])
    if not len(azimuth):
        return 0.0
    mean = np.zeros(180)
    bins = np.degrees(azimuth % np.pi).astype(int) % 180
    np.add.at(mean, bins, weight)
    mode = np.radians(float((mean + np.roll(mean, 1)).argmax()))
    near = np.abs(np.angle(np.exp(2j * (azimuth - mode)))) < 2 * np.radians(5.0)
    doubled = (weight[near] * np.exp(2j * azimuth[near])).sum()
    return float(0.5 * np.angle(doubled) % np.pi)


def pass_spacing(tracks: tuple[Track, ...], azimuth: float) -> tuple[float, float, int]:
    """(median, robust standard deviation, count) of the distance between neighbouring parallel passes [m].

    Straight windows within 3 degrees of the azimuth are cut by lines across it every 20 m; distances from
    0.5 to 1.5 header widths count. nan, nan, 0 when there is none.
    """
    along = np.array([np.sin(azimuth), np.cos(azimuth)])
    across = np.array([np.cos(azimuth), -np.sin(azimuth)])
    crossings: dict[int, list[float]] = {}
    for track in tracks:
        for w in track.straights:
            if abs(np.angle(np.exp(2j * (w.azimuth - azimuth)))) > 2 * np.radians(3.0):
                continue
            line = track.line[w.first : w.last + 1]
            s, n = line @ along, line @ across
            order = np.argsort(s)
            stations = np.arange(np.ceil(s.min() / 20.0), np.floor(s.max() / 20.0) + 1)
            for station, offset in zip(stations, np.interp(stations * 20.0, s[order], n[order]), strict=True):
                crossings.setdefault(int(station), []).append(float(offset))
    gaps = np.concatenate([np.diff(np.sort(c)) for c in crossings.values()] or [np.zeros(0)])
    header = float(np.median([t.header_width for t in tracks])) if tracks else 0.0
    gaps = gaps[(gaps > 0.5 * header) & (gaps < 1.5 * header)]
    if not len(gaps):
        return float("nan"), float("nan"), 0
    middle = float(np.median(gaps))
    return middle, float(1.4826 * np.median(np.abs(gaps - middle))), len(gaps)


def _length(track: Track, window: Straight) -> float:
    return float(np.hypot(*(track.line[window.last] - track.line[window.first])))


TRACK_PROPERTIES = {
    "header_width": ("header_width_m", 1.0, 3),
    "mean_speed": ("mean_speed_kmh", KMH, 3),
    "start_time": ("start_time_s", 1.0, 2),
    "azimuth": ("azimuth_deg", DEG, 3),
    "length": ("length_m", 1.0, 2),
}
STRAIGHT_PROPERTIES = {"azimuth": ("azimuth_deg", DEG, 4), "lateral_sd": ("lateral_sd_m", 1.0, 4)}
"""Field of Track or Straight -> property of the GeoJSON, its unit in SI, digits."""


def to_geojson(tracks: tuple[Track, ...], origin: Origin) -> dict[str, Any]:
    """Tracks as a FeatureCollection in lon/lat (RFC 7946); lengths in m, angles in degrees."""
    return {"type": "FeatureCollection", "features": [_feature(t, origin) for t in tracks]}


def _feature(track: Track, origin: Origin) -> dict[str, Any]:
    places = np.round(origin.to_lon_lat(track.line), 9).tolist()
    straights = [
        {"first": w.first, "last": w.last, **_written(w, STRAIGHT_PROPERTIES)} for w in track.straights
    ]
    properties = {"machine": track.machine, "pass": track.index, **_written(track, TRACK_PROPERTIES)}
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": places},
        "properties": {**properties, "straights": straights},
    }


def track_of(found: Pass, origin: Origin, file: Path) -> Track:
    """One track of the GeoJSON. Raises InputError where it lies nowhere on earth, or a window outside it."""
    p = found.properties
    line = origin.to_local([place[:2] for place in found.geometry.coordinates])
    if not np.isfinite(line).all():
        raise InputError("tracks", p.number, "expected longitude and latitude in degrees", file=file)
    if any(not w.first < w.last < len(line) for w in p.straights):
        raise InputError(
            "straights", p.number, "expected first and last among the points of the pass", file=file
        )
    straights = tuple(Straight(w.first, w.last, **_read(w, STRAIGHT_PROPERTIES)) for w in p.straights)
    return Track(line, p.machine, p.number, straights=straights, **_read(p, TRACK_PROPERTIES))


def _written(of: Any, table: dict[str, tuple[str, float, int]]) -> dict[str, float]:
    return {name: round(getattr(of, k) / unit, digits) for k, (name, unit, digits) in table.items()}


def _read(properties: Any, table: dict[str, tuple[str, float, int]]) -> dict[str, float]:
    return {k: getattr(properties, name) * unit for k, (name, unit, _) in table.items()}
