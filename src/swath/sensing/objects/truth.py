"""Objects level `truth`: every obstacle and machine within reach, exactly, and how much of it is hidden."""

from dataclasses import dataclass, field
from math import cos, hypot, sin
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.frames import wrap_angle
from swath.core.portable import arctan2
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.units import DEG
from swath.field.site_setup import Body, SiteSetup
from swath.rays.engine import RayCaster
from swath.sensing.mount import Length, LevelMount
from swath.signals import F64, OBSTACLE_KINDS, MachineState, Objects, objects_of

ROWS, COLUMNS = 20, 3  # points on a thing that are looked at from the sensor
WIDE = 0.6  # of half its width, how far out the outer ones lie
SKIN = 0.03  # off the thing, so that it does not hide itself [m]


@dataclass(frozen=True)
class RoofMount(LevelMount):
    """The front edge of the cab's roof.

    x_m: forward
    z_m: above ground
    """

    x_m: Length = 1.5
    z_m: Length = 3.6


@dataclass(frozen=True)
class Params:
    """The true objects.

    mount: place from which objects are seen, for what is hidden
    reach_m: greatest distance from there in the plane
    sector_deg: field of view to both sides of the direction in which the mount looks
    """

    mount: RoofMount = field(default_factory=RoofMount)
    reach_m: Annotated[float, Gt(0), Le(200)] = 40.0
    sector_deg: Annotated[float, Ge(1), Le(180)] = 90.0


class TruthObjects(KeepsState):
    """Looks at the scene. mounting: pose_machine_sensor of the point it looks from."""

    inputs = (Port("state", MachineState),)
    outputs = (Port("objects", Objects),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._p, self._setup = params, setup
        self.mounting = params.mount.pose(setup.machine, setup.edge_side)
        self._caster = RayCaster(setup.field)
        self._look = self.mounting.euler()[2]

    def reset(self, stream: Stream) -> Outputs:
        """Nothing before the first step."""
        return {"objects": objects_of(0, [])}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The objects at t + dt."""
        return {"objects": objects_of(t + dt, self.rows(t + dt, inputs["state"]))}

    def rows(self, t: int, state: MachineState) -> list[list[float]]:
        """A row per object as `objects_of` takes it; its number is its place in the scene."""
        bodies = self._setup.bodies.around(self._setup.name)
        seen = [(k, row) for k, body in enumerate(bodies) if (row := self._row(k, body, state)) is not None]
        hidden = self._hidden(t, [bodies[k] for k, _ in seen], state)
        return [[*row, share] for (_, row), share in zip(seen, hidden, strict=True)]

    def _row(self, number: int, body: Body, state: MachineState) -> list[float] | None:
        """All but the hidden share; None for what is out of reach."""
        inverse = state.pose.inverse()
        x, y, z = inverse.apply(body.pose.apply(body.middle)).tolist()
        dx, dy = x - float(self.mounting.position[0]), y - float(self.mounting.position[1])
        bearing = float(wrap_angle(float(arctan2(dy, dx)) - self._look))
        if hypot(dx, dy) > self._p.reach_m or abs(bearing) > self._p.sector_deg * DEG:
            return None
        turned = inverse.turn(body.velocity)
        heading = float(wrap_angle(body.pose.euler()[2] - state.pose.euler()[2]))
        length, width, height = (2.0 * body.half).tolist()
        kind = float(OBSTACLE_KINDS.index(body.kind))
        velocity = float(turned[0]), float(turned[1])
        return [float(number), kind, x, y, heading, length, width, z + 0.5 * height, *velocity, 1.0]

    def _hidden(self, t: int, bodies: list[Body], state: MachineState) -> list[float]:
        """Share of the points of each body that crop or another solid hides from the sensor."""
        if not bodies:
            return []
        eye = state.pose.apply(self.mounting.position)
        points = np.stack([_points(body, eye) for body in bodies])
        ground = self._setup.field.ground_height(points[..., 0], points[..., 1])
        above = points[..., 2] > ground
        start = points.copy()
        start[..., 2] = np.maximum(start[..., 2], ground + 1e-3)
        away = eye - start
        length = np.linalg.norm(away, axis=-1)
        self._setup.field.ensure(float(eye[0]), float(eye[1]), self._p.reach_m + 10.0)
        hits = self._caster.cast(
            start.reshape(-1, 3),
            (away / length[..., None]).reshape(-1, 3),
            range_max=float(length.max()),
            solids=self._setup.solids(),
            t=t,
        )
        distance = hits.distance.astype(np.float64).reshape(length.shape)
        covered = distance < length
        counts = above.sum(axis=1)
        return [
            float(np.count_nonzero(c & a) / n) if n else 1.0
            for c, a, n in zip(covered, above, counts, strict=True)
        ]


def _points(body: Body, eye: F64) -> F64:
    """Points on the side of a body's box that faces an eye, (ROWS * COLUMNS, 3) in the world."""
    middle = body.pose.apply(body.middle)
    toward = (eye - middle)[:2]
    far = max(hypot(*toward.tolist()), 1e-6)
    ux, uy = (toward / far).tolist()
    yaw = body.pose.euler()[2]
    # Half the box's extent along the sight, and across it.
    along = abs(cos(yaw) * ux + sin(yaw) * uy), abs(-sin(yaw) * ux + cos(yaw) * uy)
    depth = min(float(body.half[0]) / max(along[0], 1e-6), float(body.half[1]) / max(along[1], 1e-6))
    across = float(body.half[0]) * along[1] + float(body.half[1]) * along[0]
    heights = np.linspace(-1.0, 1.0, 2 * ROWS + 1)[1::2] * float(body.half[2])
    sides = np.linspace(-WIDE, WIDE, COLUMNS) * across
    z, side = (a.ravel() for a in np.meshgrid(heights, sides, indexing="ij"))
    out = depth + SKIN
    return np.stack(
        [middle[0] + out * ux - side * uy, middle[1] + out * uy + side * ux, middle[2] + z], axis=1
    )


LEVEL = Level(
    TruthObjects,
    Params,
    summary="every obstacle and machine in reach, exactly, with the share that is hidden",
    cost="1 ms per look",
    tolerance="exact; hidden share of a box within 5 %",
    sees_truth=True,
)
