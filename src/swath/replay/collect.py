"""Everything that the page of a run holds, collected from its world and its folder."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.record.tracks import SHOWN_ROWS, EvenRows, track_pieces
from swath.replay.area import Area, area_about
from swath.replay.charts import events_of, telling_rows, worst_moments
from swath.replay.layers import Arrays, Layers, Values
from swath.replay.machines import Columns, derived, path_of
from swath.replay.scans import recorded
from swath.replay.things import things_of
from swath.runtime.world import World
from swath.signals import F64
from swath.terminal.outcome import NOT_JUDGED, result_of

EVERY = 10  # rows of the tracks that decide which part of the field is shown


@dataclass
class Driven:
    """Tracks of a machine. rows: spread evenly; telling: those at which something happened"""

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
    """The part of the field about the ways of all machines, of their header ends where they have a header."""
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
