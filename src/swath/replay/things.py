"""Obstacles of a run as simple bodies with the time that they are there, and their ways."""

import json
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.foreign_code import through
from swath.field.edges.track import Way
from swath.field.memory_layout import Solids
from swath.field.solid.contact import bounds, frames_along, parts_of
from swath.field.solid.obstacles import Path, Thing
from swath.field.solid.obstacles import things_of as things_in
from swath.record.charts import Columns
from swath.runtime.changes import OBSTACLES
from swath.runtime.world import World
from swath.scenario.scenario import parse_scenario
from swath.signals import F64

MOST_TRIANGLES = 4000  # of all meshes together
EVERY_S = 0.25  # between two places of a thing that goes
MOST_PLACES = 4000  # of one; in a longer run they are further apart
Item = dict[str, Any]
Event = Mapping[str, Any]


def things_of(
    world: World, events: Sequence[Event], origin: F64, tracks: Mapping[str, Columns] | None = None
) -> tuple[list[Item], np.ndarray, str]:
    """Bodies, triangles of meshes (n, 3, 3) float32 [m], and what is left out of them.

    events: as in summary.json; what they take away or put in has its times; origin: places count from it [m]
    tracks: by machine. A body of a thing that goes has its `way`, rows of t, x, y, z, yaw, and its place in
    the frame that goes.
    """
    items: list[Item] = []
    triangles: list[np.ndarray] = []
    for thing, begin, end in _there(world, events):
        about: Item = {"name": thing.name, "what": thing.kind, "from": begin, "to": end}
        if thing.path is None or thing.way is None:
            bodies = _bodies(thing.in_world, origin, triangles, is_post=thing.kind == "post")
        else:
            about["way"] = _rows(thing.path, thing.way, begin, world, origin, tracks or {})
            bodies = _bodies(_simple(thing.solids), np.zeros(3), [], is_post=thing.kind == "post")
        items += [{**about, **body} for body in bodies]
    total, left = sum(len(t) for t in triangles), ""
    if total > MOST_TRIANGLES:
        every = -(-total // MOST_TRIANGLES)
        triangles = [t[::every] for t in triangles]
        left = f"of meshes of obstacles one triangle in {every} is drawn"
    return items, np.concatenate([*triangles, np.zeros((0, 3, 3))]).astype(np.float32), left


def _there(world: World, events: Sequence[Event]) -> Iterator[tuple[Thing, float, float | None]]:
    """Every thing that was around, with its begin and end [s] (None = to the end)."""
    changes = [(str(e["set"]), float(e["t_s"]), e["value"]) for e in events]
    changes = [c for c in changes if c[0].startswith(OBSTACLES + ".")]

    times: dict[str, list[float]] = {}
    for key, t, _ in sorted(changes, key=lambda change: change[1]):
        times.setdefault(key, []).append(t)

    def end_of(key: str, begin: float) -> float | None:
        of = times.get(key, [])
        return of[after] if (after := bisect_right(of, begin)) < len(of) else None

    for index, thing in enumerate(things_in(world.scenario.field.obstacles, world.field)):
        yield thing, 0.0, end_of(f"{OBSTACLES}.{index}", -1.0)
    added = [change for change in changes if change[2] not in (None, "")]
    texts = [value if isinstance(value, str) else json.dumps(value) for _, _, value in added]
    if not added:
        return
    file, sets = world.scenario.file, [f"field.obstacles=[{', '.join(texts)}]"]
    with through(world.scenario.gate):
        wanted = parse_scenario(world.scenario.resolved(), base=file and file.parent, sets=sets)
    if len(wanted.field.obstacles) != len(added):
        raise InputError("events", None, "expected one obstacle in each that puts one in")
    for (key, begin, _), thing in zip(added, things_in(wanted.field.obstacles, world.field), strict=True):
        yield replace(thing, name=key), begin, end_of(key, begin)


def _rows(
    path: Path, way: Way, since: float, world: World, origin: F64, tracks: Mapping[str, Columns]
) -> list[list[float]]:
    """t, x, y, z, yaw of a thing that is there since a time [s], EVERY_S or more apart while it goes."""
    times = np.unique(np.concatenate([[0.0], *(own["t_s"] for own in tracks.values())]))
    places = [np.stack([own["x_m"], own["y_m"]], axis=1) for own in tracks.values()]
    near = np.full(len(times), path.start_within_m is None)
    for own, place in zip(tracks.values(), places, strict=True):
        away = np.hypot(*(place - way.points[0]).T)
        near |= np.interp(times, own["t_s"], away) <= (path.start_within_m or 0.0)
    begun = times[near & (times >= max(path.start_s, since))]
    begin, end = (float(begun[0]) if len(begun) else np.inf), float(times[-1])
    stop = end if way.returns else min(end, begin + way.length / way.speed)
    every = max(EVERY_S, (stop - begin) / MOST_PLACES)
    moments = [0.0] if begin >= end else [0.0, *np.arange(begin, stop, every), stop]
    rows = []
    for t in moments:
        x, y, yaw, _ = way.after(t - begin if np.isfinite(begin) else -1.0)
        z = float(world.field.ground_height(x, y))
        rows.append([round(float(v), 3) for v in (t, x - origin[0], y - origin[1], z - origin[2], yaw)])
    return rows


def _simple(solids: Solids) -> Solids:
    """Solids whose meshes are boxes: a thing that goes is drawn without its triangles."""
    if not solids.mesh_shape:
        return solids
    middle, half = bounds(parts_of(solids))
    return Solids(box_centre=middle[None], box_axes=np.eye(3)[None], box_half=half[None])


def _bodies(solids: Solids, origin: F64, triangles: list[np.ndarray], *, is_post: bool) -> Iterator[Item]:
    """Its simple bodies; the triangles of its meshes are added to `triangles`."""
    boxes = zip(solids.box_centre - origin, solids.box_axes, solids.box_half, strict=True)
    yield from (_body("box", *box) for box in boxes)
    stones = zip(solids.ellipsoid_centre - origin, solids.ellipsoid_axes, solids.ellipsoid_half, strict=True)
    yield from (_body("ellipsoid", *stone) for stone in stones)
    ends = solids.capsule_b - solids.capsule_a, solids.capsule_a + solids.capsule_b, solids.capsule_radius
    for along, both, radius, axes in zip(*ends, frames_along(ends[0]), strict=True):
        half = [radius, radius, 0.5 * float(np.linalg.norm(along)) + radius]
        yield _body("post" if is_post else "rod", 0.5 * both - origin, axes, half)
    for mesh, centre, axes in zip(solids.mesh_shape, solids.mesh_centre, solids.mesh_axes, strict=True):
        triangles.append(mesh.corners.astype(float) @ axes.T + centre - origin)


def _body(kind: str, centre: Any, axes: Any, half: Any) -> Item:
    """axes: columns are its axes in the world; half: half sizes along them [m]."""
    return {
        "kind": kind,
        "centre": [round(float(v), 4) for v in centre],
        "axes": [round(float(v), 6) for v in np.ravel(axes)],
        "half": [round(float(v), 4) for v in half],
    }
