"""A function test for a field folder: along many of its real passes."""

from collections import Counter
from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.number_text import num
from swath.field_io.folder import FieldFolder, read
from swath.field_io.pass_scenario import edge_offset, speed_of, straight_stretches
from swath.field_io.passes import Track

LENGTH_M = 80.0  # driven along each pass
RUN_OFF_M = 15.0  # of straight pass beyond the last metre that is driven
STEP_M = 5.0  # between the places that are tried as the common start
MOST = 20  # passes
FEWEST = 3
TEMPLATE = """\
# Along {count} straight passes of this field, from {start:.0f} m behind the begin of each on: the edge lies
# where the real machine's left header end went, stand and ground are those of the import.
format: swath test case 1
objective: keeps its line on this field, along the passes that were driven
source: lateral RMS of five logged combines 2.8-3.5 cm (RTK); the limits are estimated
tags: [steering, real field]
scenario: scenario.yaml
set:
  run.distance_m: {length:.0f}
  field.edge: {{shape: track, track: {first}, offset_m: {offset:.3f}, crop_begins_m: {start:.1f}}}
  combine.header_width_m: {width:.3f}
  combine.start.along_edge_m: {start:.1f}
  combine.speed.speed_kmh: {speed:.1f}
  combine.motion.start_speed_kmh: {speed:.1f}
vary:
  pass: {{key: field.edge.track, at: {passes}}}
seeds: 1
expect:
  lateral_rms_m: {{max: 0.06}}
  lateral_p95_m: {{max: 0.12}}
  sure_wrong_share: {{max: 0}}
  edge_lost_count: {{max: 0}}
  distance_m: {{min: {reached:.1f}}}
"""


def write_pass_case(folder: Path) -> Path:
    """Write `passes.yaml` into a field folder that has a `scenario.yaml`, and return its path.

    `swath test run FOLDER/passes.yaml` drives the first LENGTH_M of up to MOST passes, spread over the field
    in driven order, all from the same distance behind their begin: that at which most of them are straight.
    Raises InputError where there are fewer than FEWEST.
    """
    field = read(folder)
    start, tracks = _passes(field)
    if len(tracks) < FEWEST:
        straight = f"{num(LENGTH_M + RUN_OFF_M)} m of straight way inside the field"
        expected = f"expected at least {FEWEST} passes with {straight}"
        raise InputError("tracks", len(tracks), expected, file=field.path)
    picked = [tracks[i] for i in np.unique(np.linspace(0, len(tracks) - 1, MOST).round().astype(int))]
    text = TEMPLATE.format(
        count=len(picked), start=start, length=LENGTH_M, first=picked[0].index, offset=edge_offset(picked[0]),
        width=picked[0].header_width, speed=float(np.median([speed_of(t) for t in picked])),
        passes=[t.index for t in picked], reached=LENGTH_M - 0.5,
    )  # fmt: skip
    path = folder / "passes.yaml"
    write_whole(path, text)
    return path


def _passes(field: FieldFolder) -> tuple[float, list[Track]]:
    """The common start [m], and the passes with the commonest header that are straight from there on."""
    found = straight_stretches(field)
    if not found:
        return 0.0, []
    width = Counter(track.header_width for track, _, _ in found).most_common(1)[0][0]
    found = [row for row in found if row[0].header_width == width]
    best: tuple[float, list[Track]] = 0.0, []
    for start in np.arange(0.0, max(end for _, _, end in found), STEP_M).tolist():
        needed = start + LENGTH_M + RUN_OFF_M
        straight = [track for track, begin, end in found if begin <= start and needed <= end]
        if len(straight) > len(best[1]):
            best = start, straight
    return best
