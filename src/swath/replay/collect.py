"""Everything that the page of a run holds, collected from its world and its folder."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.replay.area import Area, area_about
from swath.replay.charts import events_of, worst_moments
from swath.replay.layers import Arrays, Layers, Values
from swath.replay.machines import Columns, derived, path_of
from swath.replay.scans import recorded
from swath.replay.things import things_of
from swath.runtime.world import World
from swath.signals import F64
from swath.terminal.outcome import NOT_JUDGED, result_of

EVERY = 10  # rows of the tracks that decide which part of the field is shown


def collect(
    world: World, folder: Path, summary: Mapping[str, Any], tracks: Mapping[str, Columns]
) -> tuple[Values, Arrays]:
    """Values and arrays of a page. tracks: by machine, not thinned. InputError for a run without any rows."""
    moved = {
        name: derived(own, world.machines[name].edge_side) for name, own in tracks.items() if len(own["t_s"])
    }
    if not moved:
        raise InputError("tracks.parquet", None, "expected rows of at least one machine")
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
    worst = [m for n, own in moved.items() for m in worst_moments(n, own, cuts=layers.machines[n].cuts)]
    results = [result_of(entry) for entry in summary.get("expect") or []]
    about = {
        "name": str(summary.get("name", world.scenario.name)),
        "about": str(summary.get("summary") or world.scenario.summary),
        "limits": [results.count(each) for each in ("pass", "fail", "not measured", NOT_JUDGED)],
        "incomplete": bool(summary.get("incomplete")),
        "duration": duration,
        "origin": layers.origin.tolist(),
        "things": things,
        "events": events_of(summary, moved),
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
