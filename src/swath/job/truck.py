"""Where the truck of a job stands: beside the place where carts empty, parallel to how they stand there."""

import math

from swath.job.path import Pose
from swath.machine.machine_sheet import MachineSheet

NAME = "truck"
REACH = 3.5  # m from the middle of a cart to that of the truck under its auger, an estimate


def truck_pose(place: Pose, sheet: MachineSheet) -> Pose:
    """Pose of the truck's fixed axle: its body abreast of a cart's place, REACH to the right of it."""
    rear, front, *_ = sheet.body
    back, c, s = 0.5 * (rear + front), math.cos(place.heading), math.sin(place.heading)
    return Pose(place.x - back * c + REACH * s, place.y - back * s - REACH * c, place.heading)
