"""Writes replay.html: after a run, or from its folder.

What a page carries in itself is one text of arrays and plain values: a JSON head (length as uint32, little
endian, then UTF-8) that names type, shape and place of every array, then the arrays. Bytes of equal weight
lie together (all first bytes of a float32 array, then all second ones ...), which deflates better than the
plain order. All of it is deflated once and written as base64.

`collect` takes all of it from the world of a run and its folder.
"""

import base64
import html
import json
import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.foreign_code import code_unread
from swath.judge.summary import read_summary
from swath.record.charts import Columns, path_of
from swath.record.tracks import SHOWN_ROWS, EvenRows, read_tracks, track_pieces
from swath.replay.layers import Area, Arrays, Layers, Values, area_about
from swath.replay.machines import derived
from swath.replay.moments import events_of, telling_rows, worst_moments
from swath.replay.scans import recorded
from swath.replay.things import things_of
from swath.runtime.folder import check_run_folder
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.world import World
from swath.signals import F64
from swath.terminal.outcome import NOT_JUDGED, result_of

EVERY = 10  # rows of the tracks that decide which part of the field is shown


@dataclass
class Driven:
    """Tracks of a machine. rows: spread evenly; telling: those at which something happened."""

    rows: EvenRows = field(default_factory=lambda: EvenRows(SHOWN_ROWS))
    telling: EvenRows = field(default_factory=EvenRows)


def driven(world: World, file: Path, summary: Mapping[str, Any]) -> dict[str, Driven]:
    """What machines did, from a tracks.parquet of any length."""
    found: dict[str, Driven] = {}
    limits = [entry for entry in summary.get("expect") or [] if result_of(entry) == "fail"]
    for piece in track_pieces(file):
        names = piece.pop("machine")
        for name in dict.fromkeys(names.tolist()):
            own = derived({c: v[names == name] for c, v in piece.items()}, world.machines[name].edge_side)
            at = telling_rows(own, limits)
            machine = found.setdefault(name, Driven())
            machine.rows.add(own)
            machine.telling.add({c: v[at] for c, v in own.items()})
    return found


def collect(world: World, folder: Path, summary: Mapping[str, Any]) -> tuple[Values, Arrays]:
    """Values and arrays of the page of a run folder. InputError for a run without any rows."""
    found = driven(world, folder / "tracks.parquet", summary)
    if not found:
        raise InputError("tracks.parquet", None, "expected rows of at least one machine")
    moved = {name: own.rows.columns() for name, own in found.items()}
    telling = {name: own.telling.columns() for name, own in found.items()}
    duration = max(float(own["t_s"][-1]) for own in moved.values())
    layers = Layers(world, moved, origin_of(moved))
    area = area_of(layers)
    if area.until_s < np.inf:
        layers.notes.append(f"the field is shown as it was after the first {area.until_s:.0f} s went")
    layers.add_field(area, duration)
    layers.add_machines()
    layers.add_recorded(recorded(folder, {n: m.slots_of("lidar") for n, m in layers.machines.items()}))
    changed = summary.get("events", [])
    things, layers.arrays["mesh"], left_out = things_of(world, changed, layers.origin, moved)
    layers.notes += [left_out] if left_out else []
    if world.field.wind is not None:
        layers.notes.append("stems stand still, the wind is not drawn")
    worst = [m for n, own in telling.items() for m in worst_moments(n, own, cuts=layers.machines[n].cuts)]
    results = [result_of(entry) for entry in summary.get("expect") or []]
    about = {
        "name": str(summary.get("name", world.scenario.name)),
        "about": str(summary.get("summary") or world.scenario.summary),
        "limits": [results.count(each) for each in ("pass", "fail", "not measured", NOT_JUDGED)],
        "incomplete": bool(summary.get("incomplete")),
        "duration": duration,
        "origin": layers.origin.tolist(),
        "things": things,
        "events": events_of(summary, telling),
        "moments": worst,
        "notes": [*summary.get("notes", []), *layers.notes],
    }
    return {**about, **layers.values}, layers.arrays


def origin_of(tracks: Mapping[str, Columns]) -> F64:
    """A world point near the start [m], whole metres."""
    first = next(iter(tracks.values()))
    return np.array([round(float(first["x_m"][0])), round(float(first["y_m"][0])), 0.0])


def area_of(layers: Layers) -> Area:
    """The part of the field around the paths of all machines: of their header ends, else of their origin."""
    field, times, points = layers.world.field, [], []
    for name, own in layers.tracks.items():
        sheet = layers.machines[name].sheet
        ends = [sheet.header_end(side) for side in ("left", "right")] if sheet.has_header else [(0.0, 0.0)]
        for x, y in ends:
            path = path_of(own, x, y)[::EVERY]
            points.append(np.stack(field.to_stand(path[:, 0], path[:, 1]), axis=1))
            times.append(own["t_s"][::EVERY])
    when = np.concatenate(times)
    order = np.argsort(when, kind="stable")
    return area_about(field.library.tile_size, when[order], np.concatenate(points)[order])


KINDS = ("uint8", "int8", "uint16", "int16", "uint32", "float32")  # a typed array of the browser each
LEVEL = 6  # of deflate: 9 takes three times as long for 1 % less


def packed(values: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Plain values and named arrays as bytes. TypeError for an array that browsers have no type for."""
    places: dict[str, Any] = {}
    parts: list[bytes] = []
    at = 0
    for name, array in arrays.items():
        if str(array.dtype) not in KINDS:
            raise TypeError(f"{name}: {array.dtype} is none of {', '.join(KINDS)}")
        data = shuffled(array)
        places[name] = {"type": str(array.dtype), "shape": list(array.shape), "at": at}
        parts.append(data)
        at += len(data)
    head = json.dumps({**values, "arrays": places}, allow_nan=False, separators=(",", ":")).encode()
    return zlib.compress(b"".join([len(head).to_bytes(4, "little"), head, *parts]), LEVEL)


def as_text(data: bytes) -> str:
    """Base64, for a page."""
    return base64.b64encode(data).decode("ascii")


def shuffled(array: NDArray[Any]) -> bytes:
    """The bytes of an array, those of equal weight together."""
    flat = np.ascontiguousarray(array.astype(array.dtype.newbyteorder("<"), copy=False)).reshape(-1)
    return flat.view(np.uint8).reshape(-1, array.dtype.itemsize).T.tobytes()


def unpacked(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What `packed` took, for whoever reads a page without a browser."""
    plain = zlib.decompress(data)
    length = int.from_bytes(plain[:4], "little")
    values = json.loads(plain[4 : 4 + length])
    arrays = {}
    for name, place in values.pop("arrays").items():
        kind = np.dtype(place["type"]).newbyteorder("<")
        count = int(np.prod(place["shape"], dtype=int))
        start = 4 + length + place["at"]
        rows = np.frombuffer(plain, np.uint8, count * kind.itemsize, start).reshape(kind.itemsize, count)
        arrays[name] = np.ascontiguousarray(rows.T).view(kind).reshape(place["shape"])
    return values, arrays


PAGE = Path(__file__).parent / "page"
SCRIPTS = (
    "data", "matrix", "gl", "ground", "stand", "shapes", "machines", "things", "scans", "cameras", "charts",
    "timeline", "app",
)  # fmt: skip
FILE = "replay.html"


class ReplayWriter(RunHook):
    """Writes replay.html once a run is complete."""

    def begin(self, run: ActiveRun) -> None:
        """Keep the run in mind; nothing is done while it goes on."""
        self._run = run

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the page; an incomplete run gets none, `swath view` makes it."""
        has_rows = any(tracks.row_count for tracks in self._run.recorder.tracks.values())
        if self._run.out is not None and has_rows and not summary["incomplete"]:
            write_replay(self._run.world, self._run.out, summary)


def write_replay(world: World, folder: Path, summary: Mapping[str, Any], *, out: Path | None = None) -> Path:
    """The page of a run folder. world: of its scenario, as it is now; it is not changed.

    out: where to write; default: `replay.html` in the folder. Returns the path.
    """
    values, arrays = collect(world, folder, summary)
    return write_whole(out or folder / FILE, render(values["name"], packed(values, arrays)))


def view(folder: Path, *, out: Path | None = None) -> Path:
    """The page of a finished run, from its folder alone. InputError where it is none."""
    from swath.runtime.assembly import assemble
    from swath.scenario.scenario import load_scenario, slot_names, slots_without_code

    check_run_folder(folder, "scenario.yaml", "tracks.parquet")
    file = folder / "summary.json"
    summary = read_summary(file) if os.path.isfile(file) else {"incomplete": True}
    with code_unread():
        scenario = load_scenario(folder / "scenario.yaml")
    made, every = slots_without_code(scenario), slot_names(scenario)
    world = assemble(scenario, only=None if len(made) == len(every) else made)
    try:
        return write_replay(world, folder, summary, out=out)
    finally:
        world.close()


def tracks_of(folder: Path) -> dict[str, Columns]:
    """Columns of tracks.parquet by machine."""
    table = read_tracks(folder / "tracks.parquet")
    names = table.pop("machine")
    return {str(n): {k: v[names == n] for k, v in table.items()} for n in dict.fromkeys(names.tolist())}


def render(
    name: str,
    data: bytes,
    *,
    more: tuple[str, ...] = (),
    body: str = "page",
    scripts: tuple[str, ...] = SCRIPTS,
) -> str:
    """The whole page. more: further scripts of it; body, scripts: of another one, with styles of its own."""
    script = "".join((PAGE / f"{part}.js").read_text(encoding="utf-8") for part in (*scripts, *more))
    styles = "".join(
        (PAGE / f"{part}.css").read_text(encoding="utf-8") for part in dict.fromkeys(("page", body))
    )
    page = (PAGE / "frame.html").read_text(encoding="utf-8")
    parts = {
        "BODY": (PAGE / f"{body}.html").read_text(encoding="utf-8"),
        "NAME": html.escape(name),
        "STYLE": styles,
        "SCRIPT": f'"use strict";(() => {{\n{script}}})();\n',
        "DATA": as_text(data),
    }
    for key, text in parts.items():
        page = page.replace(f"%{key}%", text)
    return page
