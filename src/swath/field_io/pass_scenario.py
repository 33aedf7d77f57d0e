"""A scenario for a field folder: along the longest straight stretch of its real passes."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.number_text import num
from swath.documents.validation import as_name
from swath.field.edges.boundary import Array, Region
from swath.field_io.folder import FieldFolder, read
from swath.field_io.passes import Track

OVERLAP_M = 0.10  # of the header end over the cut ground: what the steering aims at by default
LENGTH_M = 150.0
SHORTEST_M = 60.0
LONGEST = 50  # name of a field in that of its scenario
INSET_M = 2.0  # kept off the ends of a stretch: an outline made from the passes ends where they do
TEMPLATE = """\
# yaml-language-server: $schema=scenario.schema.json
{remark}
format: swath scenario 2
name: {name}
summary: {length:.0f} m along {along}, on the imported terrain and crop
seed: 1
run: {{distance_m: {distance:.0f}, max_duration_s: {duration:.0f}}}
field:
  folder: .
  edge: {{{edge}, crop_begins_m: {start:.1f}}}
machines:
  combine:
    machine: lexion-700-class
    header_width_m: {width:.3f}
    edge_side: left
    start: {{along_edge_m: {start:.1f}}}
    motion: {{level: single_track, start_speed_kmh: {speed:.1f}}}
    lidar: {{level: plants, sensor: sick-lms511-hr, sub_rays: 19, sector_deg: [-60, 60]}}
    edge: likelihood_ratio
    steer: preview
    speed: {{speed_kmh: {speed:.1f}}}
expect:
  mass_balance_error: {{max: 1.0e-9}}
"""


REMARK = """\
# Along pass {index} of this field, machine {machine}: the edge lies where the real machine's left header end
# went, and the real track is drawn beside the simulated one."""
REMARK_MIDDLE = """\
# Through the middle of this field, along its rows: nothing says how it was driven. The ground left of the
# edge counts as cut."""
USUAL_WIDTH_M, USUAL_SPEED_KMH = 7.5, 6.0


def write_pass_scenario(folder: Path) -> Path:
    """Write `scenario.yaml` into a field folder and return its path; `swath run FOLDER` then drives it.

    Along the longest straight stretch of a pass, else through the middle of the field. Raises InputError
    where there is no stretch of SHORTEST_M.
    """
    field = read(folder)
    name = as_name(folder.resolve().name, "field", LONGEST)
    found = _longest_straight(field)
    if found is None:
        start, width, speed = INSET_M, _header_width(field), USUAL_SPEED_KMH
        x, y, length = _middle(field, width)
        if length < SHORTEST_M:
            raise _no_stretch(field, width)
        heading = 90.0 - np.degrees(field.row_azimuth)
        edge = f"shape: straight, x_m: {x:.1f}, y_m: {y:.1f}, heading_deg: {heading:.2f}"
        said = {"remark": REMARK_MIDDLE, "along": "the middle of the field", "name": f"{name}-middle"}
    else:
        track, start, length = found
        width, speed = track.header_width, speed_of(track)
        edge = f"shape: track, track: {track.index}, offset_m: {edge_offset(track):.3f}"
        remark = REMARK.format(index=track.index, machine=track.machine)
        said = {"remark": remark, "along": "a real pass", "name": f"{name}-pass-{track.index}"}
    path = folder / "scenario.yaml"
    distance = min(LENGTH_M, length - 20.0)
    duration = 2.0 * distance / (speed / 3.6) + 20.0
    text = TEMPLATE.format(
        length=distance, distance=distance, duration=duration, edge=edge, start=start, width=width,
        speed=speed, **said,
    )  # fmt: skip
    write_whole(path, text)
    return path


def speed_of(track: Track) -> float:
    """Mean speed of a pass [km/h], as far as an automatic drives."""
    return float(np.clip(3.6 * track.mean_speed, 2.0, 12.0))


def edge_offset(track: Track) -> float:
    """Distance from a pass to the edge that its left header end went along [m], to the left."""
    return 0.5 * track.header_width - OVERLAP_M


def _header_width(field: FieldFolder) -> float:
    """Width of the header that worked here [m]."""
    machines = field.info.get("machines") or []
    return next((float(m["header_width_m"]) for m in machines if m.get("header_width_m")), USUAL_WIDTH_M)


def _middle(field: FieldFolder, width: float) -> tuple[float, float, float]:
    """Where a stretch along the rows near the middle of the field begins, and its length [m], 0 = none.

    It and the header on its right lie inside.
    """
    ground = Region(field.boundary, field.holes)
    along = np.array([np.sin(field.row_azimuth), np.cos(field.row_azimuth)])
    across = np.array([along[1], -along[0]])
    best = 0.0, 0.0, 0.0
    for offset in (0.0, *(side * step for step in range(10, 200, 10) for side in (1, -1))):
        s = np.arange(-2000.0, 2000.0, 1.0)
        points = field.boundary.mean(axis=0) + offset * across + s[:, None] * along
        sides = [points + shift * across for shift in (0.0, 0.5 * width, width)]
        begin, end = _longest_run(np.all([ground.contains(*p.T) for p in sides], axis=0))
        if end - begin > best[2]:
            best = (*points[begin].tolist(), float(end - begin))
        if best[2] >= LENGTH_M + 20.0:
            break
    return best


def _no_stretch(field: FieldFolder, width: float) -> InputError:
    """Why there is nothing to drive along; width: of the header [m]."""
    lengths = [np.hypot(*(t.line[s.last] - t.line[s.first])) for t in field.tracks for s in t.straights]
    least = SHORTEST_M + 2.0 * INSET_M
    inside = f"{num(SHORTEST_M)} m of straight way with a header of {num(width)} m inside the field"
    if not field.tracks:
        return InputError("boundary", None, f"expected {inside}", file=field.path)
    if max(lengths, default=0.0) < least:
        cause = f"none of its passes is straight for {num(least)} m"
    else:
        cause = (
            f"passes are straight for {num(max(lengths))} m, but the field is no wider than the header there"
        )
    return InputError("tracks", len(field.tracks), f"expected {inside}: {cause}", file=field.path)


def _longest_straight(field: FieldFolder) -> tuple[Track, float, float] | None:
    """The pass, where its longest straight stretch begins, and its length [m]; None below SHORTEST_M."""
    found = max(straight_stretches(field), key=lambda s: s[2] - s[1], default=None)
    return None if found is None else (found[0], found[1], found[2] - found[1])


def straight_stretches(field: FieldFolder) -> list[tuple[Track, float, float]]:
    """Pass, begin and end along it [m] of the straight stretches of SHORTEST_M or more that lie inside."""
    found = []
    ground = Region(field.boundary, field.holes)
    for track in field.tracks:
        steps = np.hypot(*np.diff(track.line, axis=0).T)
        at = np.concatenate([[0.0], np.cumsum(steps)])
        for straight in track.straights:
            first, last = straight.first, min(straight.last, len(at) - 1)
            begin, end = _inside(track, ground, at, first, last)
            if end - begin >= SHORTEST_M:
                found.append((track, begin, end))
    return found


def _inside(track: Track, ground: Region, at: Array, first: int, last: int) -> tuple[float, float]:
    """Where along a track [m] the longest part of a straight stretch begins and ends whose swath, from the
    left end of the header to the right one, lies inside the field.
    """
    (x0, y0), (x1, y1) = track.line[first], track.line[last]
    heading = np.arctan2(y1 - y0, x1 - x0)
    s = np.arange(at[first], at[last], 0.5)
    middle = np.stack([np.interp(s, at, track.line[:, k]) for k in range(2)], axis=1)
    left = np.array([-np.sin(heading), np.cos(heading)])
    covered = np.ones(len(s), dtype=bool)
    for across in (edge_offset(track), edge_offset(track) - track.header_width):
        points = middle + across * left
        covered &= ground.contains(points[:, 0], points[:, 1])
    begin, end = _longest_run(covered)
    return (float(s[begin]) + INSET_M, float(s[end - 1]) - INSET_M) if end > begin else (0.0, 0.0)


def _longest_run(inside: NDArray[np.bool_]) -> tuple[int, int]:
    """First and behind the last index of the longest run of true; 0, 0 without one."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    if not len(edges):
        return 0, 0
    longest = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * longest]), int(edges[2 * longest + 1])
