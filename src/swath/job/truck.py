"""Where the truck of a job stands: beside the place where carts empty, parallel to how they stand there."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.job.footprint import footprint_of
from swath.job.path import Path, Pose
from swath.job.states import DONE
from swath.machine.machine_sheet import MachineSheet

Array = NDArray[np.float64]
NAME = "truck"
KEEP = 3.0  # m from its body to the middle of a cart in a bend: half the cart's width and its off-tracking
IN_LANE = 0.5  # m beside the line of the place where carts empty, along which they drive past it
REACH = 3.5  # m from the middle of a cart to that of the truck under its auger, an estimate


def truck_pose(place: Pose, sheet: MachineSheet) -> Pose:
    """Pose of the truck's fixed axle: its body abreast of a cart's place, REACH to the right of it."""
    rear, front, *_ = sheet.body
    back, c, s = 0.5 * (rear + front), math.cos(place.heading), math.sin(place.heading)
    return Pose(place.x - back * c + REACH * s, place.y - back * s - REACH * c, place.heading)


def standing(place: Pose, sheet: MachineSheet) -> tuple[Pose, float]:
    """Pose and heading of the truck that stands on the field's side of the first place where carts empty."""
    stands = truck_pose(Pose(place.x, place.y, place.heading + math.pi), sheet)
    return stands, stands.heading


def bodies(job: Any) -> dict[str, Array]:
    """Boxes of the truck's body while it stands there, as `Footprint.sweep`; none without carts."""
    if not job.carts or job.away > DONE:
        return {}
    return {NAME: footprint_of(job.fleet.truck).sweep([standing(job.places[0], job.fleet.truck)])}


def is_clear(path: Path, place: Pose, sheet: MachineSheet, keep: float = KEEP) -> bool:
    """Whether the way of a cart, or of a machine that is to keep so far away [m], leads clear of the truck
    that stands at the place where carts empty.
    """
    stands, _ = standing(place, sheet)
    rear, front, half = sheet.body[0], sheet.body[1], max(r[3] for r in sheet.outline)
    c, s = math.cos(stands.heading), math.sin(stands.heading)
    dx, dy = (path.points - stands[:2]).T
    ahead, left = dx * c + dy * s, dy * c - dx * s
    away = np.hypot(
        np.maximum(np.maximum(rear - ahead, ahead - front), 0.0), np.maximum(np.abs(left) - half, 0.0)
    )
    lane = (place.y - stands.y) * c - (place.x - stands.x) * s
    return bool((away[np.abs(left - lane) > IN_LANE] > keep).all())
