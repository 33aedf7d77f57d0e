"""Obstacles of a run as simple bodies with the time that they stand there."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from swath.field.memory_layout import Solids
from swath.field.solids import named_obstacles
from swath.runtime.changes import OBSTACLES
from swath.runtime.world import World
from swath.scenario.scenario import parse_scenario
from swath.signals import F64

MOST_TRIANGLES = 4000  # of all meshes together
Thing = dict[str, Any]
Event = Mapping[str, Any]


def things_of(world: World, events: Sequence[Event], origin: F64) -> tuple[list[Thing], np.ndarray, str]:
    """Bodies, triangles of meshes (n, 3, 3) float32 [m], and what is left out of them.

    events: as in summary.json; what they take away or put in has its times; origin: places count from it [m]
    """
    things: list[Thing] = []
    triangles: list[np.ndarray] = []
    for name, solids, begin, end in _standing(world, events):
        bodies = [
            {"name": name, "from": begin, "to": end, **body} for body in _bodies(solids, origin, triangles)
        ]
        things += bodies
    total, left = sum(len(t) for t in triangles), ""
    if total > MOST_TRIANGLES:
        every = -(-total // MOST_TRIANGLES)
        triangles = [t[::every] for t in triangles]
        left = f"of meshes of obstacles one triangle in {every} is drawn"
    return things, np.concatenate([*triangles, np.zeros((0, 3, 3))]).astype(np.float32), left


def _standing(world: World, events: Sequence[Event]) -> Iterator[tuple[str, Solids, float, float | None]]:
    """Name, solids, begin and end [s] (None = to the end) of everything that stood around."""
    changes = [(str(e["set"]), float(e["t_s"]), e["value"]) for e in events]
    changes = [c for c in changes if c[0].startswith(OBSTACLES + ".")]

    def end_of(key: str, begin: float) -> float | None:
        return next((t for k, t, _ in changes if k == key and t > begin), None)

    fixed = world.scenario.field.obstacles
    for index, (name, solids) in enumerate(named_obstacles(fixed, world.field).items()):
        yield name, solids, 0.0, end_of(f"{OBSTACLES}.{index}", -1.0)
    for key, begin, value in changes:
        if value not in (None, ""):
            text = value if isinstance(value, str) else json.dumps(value)
            file = world.scenario.file
            wanted = parse_scenario(
                world.scenario.resolved(), base=file and file.parent, sets=[f"field.obstacles=[{text}]"]
            )
            for solids in named_obstacles(wanted.field.obstacles, world.field).values():
                yield key.partition(".")[2], solids, begin, end_of(key, begin)


def _bodies(solids: Solids, origin: F64, triangles: list[np.ndarray]) -> Iterator[Thing]:
    """Its simple bodies; the triangles of its meshes are added to `triangles`."""
    boxes = zip(solids.box_centre - origin, solids.box_axes, solids.box_half, strict=True)
    yield from (_body("box", *box) for box in boxes)
    stones = zip(solids.ellipsoid_centre - origin, solids.ellipsoid_axes, solids.ellipsoid_half, strict=True)
    yield from (_body("ellipsoid", *stone) for stone in stones)
    for a, b, radius in zip(solids.capsule_a, solids.capsule_b, solids.capsule_radius, strict=True):
        half = [radius, radius, 0.5 * float(np.linalg.norm(b - a)) + radius]
        yield _body("post", 0.5 * (a + b) - origin, np.eye(3), half)
    for mesh, centre, axes in zip(solids.mesh_shape, solids.mesh_centre, solids.mesh_axes, strict=True):
        triangles.append(mesh.corners.astype(float) @ axes.T + centre - origin)


def _body(kind: str, centre: Any, axes: Any, half: Any) -> Thing:
    """axes: columns are its axes in the world; half: half sizes along them [m]."""
    return {
        "kind": kind,
        "centre": [round(float(v), 4) for v in centre],
        "axes": [round(float(v), 6) for v in np.ravel(axes)],
        "half": [round(float(v), 4) for v in half],
    }
