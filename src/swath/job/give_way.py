"""Carts give way: one stops before ground that a combine, or a cart of a lower number, drives over next.

Combines never wait for carts on their way, and of two carts only one gives way, so that no two wait for each
other. What stands and is waited for itself, a combine that is full or behind its leader, is not waited for.
"""

import math
from dataclasses import dataclass

from swath.job.drive import DrivenMachine, Follower
from swath.job.footprint import Corners, Footprint, clearance
from swath.job.path import Pose

AHEAD, STEPS = 6.0, 6  # s that others are looked ahead, in so many steps
SPACING = 2.0  # m between the places of the own way that are held against theirs
ROOM = 3.0  # m that it stops before them
ROOM_ASIDE = 0.1  # m
BRAKE = 0.4  # m/s2, that it can rely on
REACTION = 0.8  # s
MOVES = 0.2  # m/s, from which a machine is driving


@dataclass(frozen=True)
class Traffic:
    """A machine on its way. follower: of its path, None where it stands; speed: that it will drive [m/s]"""

    machine: DrivenMachine
    footprint: Footprint
    follower: Follower | None
    speed: float

    def sweep(self, lengths: list[float]) -> list[tuple[Pose, float]]:
        """Its place and its trailer's heading now, and after so many metres of its way."""
        found = [(self.machine.pose, self.machine.trailer)]
        if self.follower is None:
            return found
        path, at, drawbar = self.follower.path, self.follower.at, self.footprint.drawbar
        for length in lengths:
            behind = path.at(at + length - drawbar).heading if length > drawbar else self.machine.trailer
            found.append((path.at(at + length), behind))
        return found


def must_stop(own: Traffic, others: list[Traffic]) -> bool:
    """True where one of the others will soon drive over what lies ahead within the way to stop."""
    near = [o for o in others if _apart(own.machine.pose, o.machine.pose) < _reach(own, o)]
    if not near:
        return False
    way = own.machine.speed * (REACTION + 0.5 * own.machine.speed / BRAKE) + ROOM
    now, *ahead = own.sweep([SPACING * (i + 1) for i in range(math.ceil(way / SPACING))])
    for other in near:
        swept = other.sweep([AHEAD * other.speed * (i + 1) / STEPS for i in range(STEPS)])
        if _meet(own.footprint, [now], other.footprint, swept):
            continue  # it stands there already: the sooner it is gone the better
        if _meet(own.footprint, ahead, other.footprint, swept):
            return True
    return False


def _meet(
    a: Footprint, mine: list[tuple[Pose, float]], b: Footprint, theirs: list[tuple[Pose, float]]
) -> bool:
    """Whether a body at any of its places comes near another one at any of those."""
    bodies: dict[int, list[Corners]] = {}
    for place in mine:
        own: list[Corners] = []
        for i, there in enumerate(theirs):
            if _apart(place[0], there[0]) > a.reach + b.reach:
                continue
            own = own or a.at(*place)
            if i not in bodies:
                bodies[i] = b.at(*there)
            if clearance(own, bodies[i]) <= ROOM_ASIDE:
                return True
    return False


def _apart(a: Pose, b: Pose) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def _reach(a: Traffic, b: Traffic) -> float:
    ways = 2.0 * ROOM + a.machine.speed * (REACTION + 0.5 * a.machine.speed / BRAKE) + AHEAD * b.speed
    return a.footprint.reach + b.footprint.reach + ways
