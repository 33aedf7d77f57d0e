"""Crop that another combine is to cut before: where a cart comes beside a pass, and where passes overlap."""

from collections.abc import Sequence
from math import cos, sin

import numpy as np

from swath.control.job.ground import Point, beside
from swath.control.job.passes import Pass, place_at_end, way_along
from swath.job.machines import Combine
from swath.tools.fleet.order import LANDS, WIDE, Mask, Samples, Ways

BEHIND, AHEAD, EVERY = 10.0, 35.0, 5.0  # m of the line beside a combine, from its axle, that have to be cut
EDGE = 0.1  # m within the strip of a pass
OVERLAP = 3.0  # m of its own strip on either side, that may be another one's
LAST = 15.0  # m before the end of a combine's last pass, from where on a cart has to be able to come
ALONG = 0.87  # cosine of the angle between two passes, which is 30 degrees: at corners they overlap anyway


def uncut_before(ways: Ways, combines: Sequence[Combine], first: int, then: int) -> Mask:
    """Which pairs of samples (n, m) of two combines have crop on the line beside one of them, or before its
    header, that the other one cuts in a pass which is begun before; at the end of a last pass, in any: it
    stands there until a cart has come.
    """
    return _uncut(ways, combines, first, then) | _uncut(ways, combines, then, first).T


def _uncut(ways: Ways, combines: Sequence[Combine], first: int, then: int) -> Mask:
    """Likewise, beside and before the second one."""
    passes, mine, its = ways.passes, ways.samples[first], ways.samples[then]
    uncut = np.zeros((len(mine.way), len(its.way)), dtype=bool)
    width, x, y, heading = combines[first].sheet.header_width, *its.place.T
    places = {
        j: _places(its, j, combines[then], has_cart=passes[its.task[j]].has_cart)
        for j in np.flatnonzero(~its.turns).tolist()
    }
    last = max(ways.routes[then])
    ends = (its.task == last) & (its.way > ways.routes[then][last].length - LAST) & passes[last].cart_standing
    for i, work in enumerate(passes):
        if work.combine != first:
            continue
        end = place_at_end(work.line_m)
        c, s = cos(end.heading), sin(end.heading)
        near = np.abs(c * (y - end.y) - s * (x - end.x)) < width + combines[then].pipe + LANDS
        near &= ~its.turns & ((its.task > i) | ends) & (np.abs(np.cos(heading - end.heading)) > ALONG)
        for j in np.flatnonzero(near).tolist():
            need = _until(work, places[j], width)
            if need is not None:
                uncut[:, j] |= (mine.task < i) | ((mine.task == i) & (mine.way < need))
    return uncut


def _places(of: Samples, j: int, combine: Combine, *, has_cart: bool) -> list[Point]:
    """Points before the header of a combine, and beside it where a cart drives, or comes while it stands, a
    little behind it and ahead of it [m].
    """
    x, y, heading = of.place[j].tolist()
    middle, side = combine.sheet.header_y, 0.5 * combine.sheet.header_width - OVERLAP
    found = [beside(x, y, heading, combine.sheet.knife_x, middle + left) for left in (-side, 0.0, side)]
    if has_cart:
        along = np.arange(-BEHIND, AHEAD + EVERY, EVERY).tolist()
        wheels = [combine.pipe + LANDS + left for left in (-0.5 * WIDE, 0.0, 0.5 * WIDE)]
        found += [beside(x, y, heading, ahead, left) for ahead in along for left in wheels]
    return found


def _until(work: Pass, points: Sequence[Point], width: float) -> float | None:
    """How far along a pass the last of some points lies in its strip [m]; None where none does."""
    (x, y), end = work.line_m[0], place_at_end(work.line_m)
    c, s, length = cos(end.heading), sin(end.heading), way_along(work.line_m)
    found = None
    for px, py in points:
        along, left = c * (px - x) + s * (py - y), c * (py - y) - s * (px - x)
        if 0.0 <= along <= length and abs(left) < 0.5 * width - EDGE:
            found = along if found is None else max(found, along)
    return found
