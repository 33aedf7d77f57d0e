"""A scenario for a field folder: along the longest straight stretch of its real passes."""

from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.field.boundary import Array, Region
from swath.field_io.folder import FieldFolder, read
from swath.field_io.passes import Track

OVERLAP_M = 0.10  # of the header end over the cut ground: what the steering aims at by default
LENGTH_M = 150.0
SHORTEST_M = 60.0
INSET_M = 2.0  # kept off the ends of a stretch: an outline made from the passes ends where they do
TEMPLATE = """\
# yaml-language-server: $schema=scenario.schema.json
# Along pass {index} of this field, machine {machine}: the edge lies where the real machine's left header end
# went, and the real track is drawn beside the simulated one.
format: swath scenario 2
name: {name}-pass-{index}
summary: {length:.0f} m along a real pass, on the imported terrain and crop
seed: 1
run: {{distance_m: {distance:.0f}, max_duration_s: {duration:.0f}}}
field:
  folder: .
  edge: {{shape: track, track: {index}, offset_m: {offset:.3f}, crop_begins_m: {start:.1f}}}
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


def write_pass_scenario(folder: Path) -> Path:
    """Write `scenario.yaml` into a field folder and return its path; `swath run FOLDER` then drives it."""
    field = read(folder)
    track, start, length = _longest_straight(field)
    path = folder / "scenario.yaml"
    distance = min(LENGTH_M, length - 20.0)
    text = TEMPLATE.format(
        index=track.index,
        machine=track.machine,
        name=folder.resolve().name,
        length=distance,
        distance=distance,
        duration=2.0 * distance / max(track.mean_speed, 0.5) + 20.0,
        offset=0.5 * track.header_width - OVERLAP_M,
        start=start,
        width=track.header_width,
        speed=float(np.clip(3.6 * track.mean_speed, 2.0, 12.0)),
    )
    path.write_text(text, encoding="utf-8")
    return path


def _longest_straight(field: FieldFolder) -> tuple[Track, float, float]:
    """The pass, where its longest straight stretch begins, and how long that is [m]."""
    best: tuple[Track, float, float] | None = None
    ground = Region(field.boundary, field.holes)
    for track in field.tracks:
        steps = np.hypot(*np.diff(track.line, axis=0).T)
        at = np.concatenate([[0.0], np.cumsum(steps)])
        for straight in track.straights:
            first, last = straight.first, min(straight.last, len(at) - 1)
            begin, end = _inside(field, ground, track, at, first, last)
            if best is None or end - begin > best[2]:
                best = track, begin, end - begin
    if best is None or best[2] < SHORTEST_M:
        expected = f"expected a straight stretch of at least {SHORTEST_M:.0f} m inside the field"
        raise InputError("tracks", None, expected, file=field.path)
    return best


def _inside(
    field: FieldFolder, ground: Region, track: Track, at: Array, first: int, last: int
) -> tuple[float, float]:
    """Where along a track [m] the longest part of a straight stretch begins and ends whose swath, from the
    left end of the header to the right one, lies inside the field.
    """
    (x0, y0), (x1, y1) = track.line[first], track.line[last]
    heading = np.arctan2(y1 - y0, x1 - x0)
    s = np.arange(at[first], at[last], 0.5)
    middle = np.stack([np.interp(s, at, track.line[:, k]) for k in range(2)], axis=1)
    left = np.array([-np.sin(heading), np.cos(heading)])
    covered = np.ones(len(s), dtype=bool)
    for across in (0.5 * track.header_width - OVERLAP_M, -0.5 * track.header_width - OVERLAP_M):
        points = middle + across * left
        covered &= ground.contains(points[:, 0], points[:, 1])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], covered, [False]]).astype(int)))
    if not len(edges):
        return 0.0, 0.0
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return float(s[begins[longest]]) + INSET_M, float(s[ends[longest] - 1]) - INSET_M
