"""Far ways of combines between their passes, on ground that is cut then: around standing crop and passes that
others cut meanwhile.
"""

from collections.abc import Sequence

from swath.control.job.ground import Ground, Point
from swath.control.job.ways import Search
from swath.control.turns.clothoid import bends_of
from swath.control.turns.dubins import Place
from swath.job.combine_ways import is_far
from swath.job.machines import Combine
from swath.job.path import Piece
from swath.job.plan import FieldPlan
from swath.tools.fleet.combine_turns import axle_at, following

RADIUS = 10.0  # m, of bends that begin at once: wider than the tightest turn
LINE_UP = 9.0  # m on the line of the next pass before its begin
CLEAR, NEAR = 0.6, 3.0  # m from the header's ends to crop; from its middle, about begin and end of the way
OVERLAP = 0.3  # m on both sides, that the ground of a pass counts wider: no strip is left by rounding
SHORTEST = 1e-6  # m


def far_ways(
    plan: FieldPlan, by: Sequence[int], combines: Sequence[Combine], ends: Sequence[float]
) -> dict[int, list[Piece]]:
    """Way behind a pass to a far one of the same combine, by the number of the pass, where there is one.

    plan: passes in the order in which they are begun; by: number of the combine of each; ends: when each is
    cut [s]
    """
    field = Ground([_point(p) for p in plan.boundary.tolist()])
    width = max(c.sheet.header_width for c in combines)
    found = {}
    for i, k in following(by):
        p, then = plan.passes[i], plan.passes[k]
        if not is_far(p.end, then.start):
            continue
        ground = field.copy()
        for other, end in zip(plan.passes, ends, strict=True):
            if end <= ends[i]:
                ground.cut([_point(q) for q in other.line.tolist()], width + 2.0 * OVERLAP)
        combine = combines[by[i]]
        here, there = axle_at(p.end, combine), axle_at(then.start, combine, LINE_UP)
        half = 0.5 * combine.sheet.header_width + CLEAR
        search = Search(ground, ground.clear_of(half), ground.clear_of(NEAR), RADIUS)
        way = search.way(Place(*here), [Place(*there)])
        if way is not None:
            bends = [b for b in bends_of(way, RADIUS) if b.length > SHORTEST]
            found[i] = [*(Piece(b.begin, b.end, b.length) for b in bends), Piece(0.0, 0.0, LINE_UP)]
    return found


def _point(place: Sequence[float]) -> Point:
    return float(place[0]), float(place[1])
