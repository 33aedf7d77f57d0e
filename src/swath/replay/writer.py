"""Writes replay.html: after a run, or from its folder.

Arrays and plain values as one text: what a page carries in itself.

A JSON head (length as uint32, little endian, then UTF-8) that names type, shape and place of every array,
then the arrays. Bytes of equal weight lie together (all first bytes of a float32 array, then all second ones
...), which deflates better than the plain order. All of it is deflated once and written as base64.
"""

import base64
import html
import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.foreign_code import code_unread
from swath.core.whole_file import write_whole
from swath.judge.summary import read_summary
from swath.record.tracks import read_tracks
from swath.replay.collect import collect
from swath.replay.machines import Columns
from swath.runtime.folder import check_run_folder
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.world import World

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
    from swath.scenario.code import slots_without_code
    from swath.scenario.scenario import load_scenario
    from swath.scenario.slot_names import slot_names

    check_run_folder(folder, "scenario.yaml", "tracks.parquet")
    file = folder / "summary.json"
    summary = read_summary(file) if file.is_file() else {"incomplete": True}
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
    """The whole page. more: further scripts of it; body, scripts: of another one, with styles of its own"""
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
