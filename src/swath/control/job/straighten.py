"""A way with fewer bends: the steps of a search lead straight on only in a few directions.

Between places along the way the shortest direct ones (Dubins) are tried, the farthest place first, and at the
places that are left other directions: those of the straights before and behind them.
"""

from math import fsum

from swath.control.job.cells import Cells, Way
from swath.control.turns.dubins import Place, moved, shortest

SPACING = 6.0  # m between places that are tried, at least
BEND = 5.0  # m, that a radian of bends is worth
ROUNDS = 3


def straightened(cells: Cells, start: Place, way: Way, radius: float) -> Way:
    """A way to the same place with fewer bends, over open ground; parts for which there is none stay as they
    are. radius: of bends [m]
    """
    places, between = _places(start, way, radius)
    joints, parts = [0], []
    while joints[-1] < len(places) - 1:
        own, then, part = joints[-1], joints[-1] + 1, between[joints[-1]]
        for far in range(len(places) - 1, own, -1):
            direct = shortest(places[own], places[far], radius)
            if cells.is_free(places[own], direct, radius):
                then, part = far, direct
                break
        joints.append(then)
        parts.append(part)
    return _turned(cells, [places[i] for i in joints], parts, radius)


def _places(start: Place, way: Way, radius: float) -> tuple[list[Place], list[Way]]:
    """Places along a way, SPACING apart at least, and the parts of it between them."""
    places: list[Place] = [start]
    parts: list[Way] = [[]]
    gone = 0.0
    here = start
    for word, size in way:
        if gone >= SPACING:
            places.append(here)
            parts.append([])
            gone = 0.0
        here = moved(here, word, size, radius)
        parts[-1].append((word, size))
        gone += size
    return [*places, here], parts


def _turned(cells: Cells, joints: list[Place], parts: list[Way], radius: float) -> Way:
    """With other directions at the joints, where the way then bends less."""
    for _ in range(ROUNDS):
        has_changed = False
        for i in range(1, len(joints) - 1):
            best = _size(parts[i - 1], radius) + _size(parts[i], radius)
            for heading in (
                *_straights(joints[i - 1], parts[i - 1], radius),
                *_straights(joints[i], parts[i], radius),
            ):
                joint = joints[i]._replace(heading=heading)
                both = shortest(joints[i - 1], joint, radius), shortest(joint, joints[i + 1], radius)
                size = _size(both[0], radius) + _size(both[1], radius)
                if size >= best - 0.01:
                    continue
                if cells.is_free(joints[i - 1], both[0], radius) and cells.is_free(joint, both[1], radius):
                    best, has_changed = size, True
                    joints[i], parts[i - 1], parts[i] = joint, *both
        if not has_changed:
            break
    return [piece for part in parts for piece in part]


def _size(way: Way, radius: float) -> float:
    """Length of a way, its bends dearer [m]."""
    return fsum(size if word == "S" else size * (1.0 + BEND / radius) for word, size in way)


def _straights(here: Place, way: Way, radius: float) -> list[float]:
    """Directions of its straights [rad]."""
    found = []
    for word, size in way:
        if word == "S":
            found.append(here.heading)
        here = moved(here, word, size, radius)
    return found
