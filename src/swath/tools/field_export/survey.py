"""A virtual survey: pulses of a scanner that flies over the field, each to what it meets first."""

from math import pi

import numpy as np

from swath.core.frames import rotation_matrix
from swath.field.memory_layout import Organ
from swath.field.solids import merge
from swath.rays.engine import RayCaster
from swath.runtime.world import World
from swath.signals import F64, U8
from swath.tools.field_export.scene import known_ground
from swath.tools.scan.point_cloud import RECORD, Cloud

HEIGHT_M = 40.0  # of the scanner above the ground in the middle
SPEED_M_S = 5.0  # of the flight, for the time of a pulse
OTHER, GROUND, LOW, MEDIUM, HIGH = 1, 2, 3, 4, 5  # classes of ASPRS LAS 1.4; the last three are vegetation
LOW_M, MEDIUM_M = 0.5, 2.0  # tops of low and medium vegetation above the ground
GOLDEN = (
    0.7548776662466927,
    0.5698402909980532,
)  # low-discrepancy steps in the plane: 1/g, 1/g2 with g3 = g + 1
HARD = {Organ.GROUND: GROUND, Organ.SOLID: OTHER}


def pulse_count(side: float, per_m2: float) -> int:
    """Pulses of a survey of a square [m]."""
    return int(side**2 * per_m2)


def survey(world: World, place: F64, *, side: float, per_m2: float) -> tuple[Cloud, U8]:
    """Points of one line flown over the middle of a square, along the rows, and their ASPRS classes.

    place: middle, (2,) [m]; per_m2: pulses on level ground. Exact places, no noise; intensity is reflectance
    times the cosine of incidence. Pulses go to known ground alone; InputError where there is none.
    """
    field, number = world.field, np.arange(1, pulse_count(side, per_m2) + 1)
    aim = place + side * ((number[:, None] * np.array(GOLDEN)) % 1.0 - 0.5)
    aim = aim[known_ground(field, *aim.T)]
    field.ensure(float(place[0]), float(place[1]), 0.5 * side * 2**0.5 + HEIGHT_M)
    along = rotation_matrix(0.0, 0.0, field.stand_yaw)[:2, 0]
    way = (aim - place) @ along
    order = np.argsort(way, kind="stable")
    aim, way = aim[order], way[order]
    ground = np.asarray(field.ground_height(*aim.T), dtype=float)
    top = float(np.nanmax(ground)) + HEIGHT_M
    origins = np.column_stack([place + way[:, None] * along, np.full(len(aim), top)])
    to = np.column_stack([aim, ground]) - origins
    directions = to / np.linalg.norm(to, axis=1)[:, None]
    solids = merge(*(body.solids for body in world.bodies.in_sight("")))
    hits = RayCaster(field).cast(origins, directions, range_max=2.0 * side + 2.0 * HEIGHT_M, solids=solids)
    seen = hits.is_hit
    points = origins[seen] + hits.distance[seen, None].astype(float) * directions[seen]
    cloud = np.zeros(int(seen.sum()), RECORD)
    for k, axis in enumerate("xyz"):
        cloud[axis] = points[:, k]
    across = (aim - place) @ np.array([-along[1], along[0]])
    cloud["intensity"] = (hits.reflectance * hits.cosine)[seen]
    cloud["time"] = (way[seen] - way[0]) / SPEED_M_S
    cloud["azimuth"] = np.clip(np.arctan2(across, top - ground), -pi, pi)[seen]
    cloud["beam"] = np.flatnonzero(seen)
    cloud["echo_count"] = 1
    above = points[:, 2] - np.asarray(field.ground_height(points[:, 0], points[:, 1]), dtype=float)
    return cloud, _classes(hits.organ[seen], above)


def _classes(organs: U8, above: F64) -> U8:
    """ASPRS classes of what was hit, so many metres above the ground; straw and stubble are low
    vegetation.
    """
    found = np.where(above < LOW_M, LOW, np.where(above < MEDIUM_M, MEDIUM, HIGH)).astype(np.uint8)
    for organ, number in HARD.items():
        found[organs == organ] = number
    return found
