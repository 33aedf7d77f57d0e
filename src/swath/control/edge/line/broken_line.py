"""Where an edge goes on that broke off: along the line or the bend that its last blocks show.

The blocks just before a break were already wrong: rays see into a hole before the middle of their block is
there. Several explanations are compared: how many of the last blocks were wrong, and whether the edge
begins or ends to bend, once at most. Each costs the logarithm of its probability; how well it fits the blocks
counts for it.
"""

from dataclasses import replace
from math import atan

import numpy as np

from swath.control.edge.arc_track import Arc
from swath.control.edge.line.near_line import DISTANCE, VARIANCE
from swath.control.edge.line.ragged_line import fitted, last_of, seen_from
from swath.core.portable import exp, product
from swath.signals import F64

STRETCH, FEWEST = 6.0, 4  # m of the edge that count; blocks at least
FREE, MOST = 3, 6  # blocks that may be wrong, by the reach of their rays; and at most
POINT = 0.03  # m, standard deviation of a block
TURN, BEND = 1.0, 0.05  # rad from the track, 1/m: prior standard deviations
WRONG, BENDS = 6.0, 8.0  # twice the nat that one more wrong block costs, and a change of bend
APART = 2  # blocks from one place where the bend may change to the next


def carried_on(rows: F64, arc: Arc, scatter: float) -> tuple[Arc, float]:
    """The track as it goes on from its place, and the distance along the edge behind which it breaks off [m].

    The result is the mean of all explanations by their likelihood. rows: of `EdgePoints`; scatter: of
    blocks about the track, beyond their own variance [m2]
    """
    used = last_of(rows, arc.distance, STRETCH)
    (one, along, _), beside = seen_from(used, arc, arc.angle)
    weight = 1.0 / np.maximum(used[:, VARIANCE] + scatter, POINT**2)
    costs, states, covariances, lasts = [], [], [], []
    for count in range(len(used), max(len(used) - MOST, FEWEST) - 1, -1):
        t, v, w = along[:count], beside[:count], weight[:count]
        for changes, since, begins in _changes(t):
            away = np.maximum(t - since, 0.0) if begins else np.minimum(t - since, 0.0)
            bent = 0.5 * min(changes, 1) * away * away
            p, covariance = fitted((one[:count], t, bent), v, w, (1.0 / TURN, 1.0 / BEND))
            off = v - (p[0] + p[1] * t + p[2] * bent)
            cost = float((w * off * off).sum()) + (p[1] / TURN) ** 2 + (p[2] / BEND) ** 2
            costs.append(cost + WRONG * max(len(used) - count - FREE, 0) + BENDS * changes)
            now = float(begins)
            to = np.array([[1.0, 0.0, 0.5 * now * since**2], [0.0, 1.0, -now * since], [0.0, 0.0, now]])
            states.append(product(to, np.array(p)))
            covariances.append(product(product(to, np.array(covariance)), to.T))
            lasts.append(float(used[count - 1, DISTANCE]))
    if not costs:
        return replace(arc, bend=0.0), arc.distance
    best = min(costs)
    chance = exp(-0.5 * (np.array(costs) - best))
    chance /= float(chance.sum())
    state = (chance[:, None] * np.array(states)).sum(axis=0)
    apart = np.array(states) - state
    spread = np.array(covariances) + apart[:, :, None] * apart[:, None, :]
    (x, u), (_, slope, bend) = arc.beside(float(state[0])), state.tolist()
    covariance = (chance[:, None, None] * spread).sum(axis=0)
    moved = replace(arc, x=x, u=u, angle=arc.angle + atan(slope), bend=bend, covariance=covariance)
    return moved, lasts[costs.index(best)]


def _changes(t: F64) -> list[tuple[int, float, bool]]:
    """The explanations: (changes of the bend, where along the track [m], whether a bend begins there)."""
    places = t[:-APART:APART].tolist()
    return [(0, 0.0, True), *((1, at, True) for at in places), *((2, at, False) for at in places)]
