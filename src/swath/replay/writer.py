"""Writes replay.html: after a run, or from its folder."""

import html
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swath.core.foreign_code import code_unread
from swath.core.whole_file import write_whole
from swath.judge.summary import read_summary
from swath.record.tracks import read_tracks
from swath.replay.collect import collect
from swath.replay.machines import Columns
from swath.replay.pack import as_text, packed
from swath.runtime.folder import check_run_folder
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.world import World

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
