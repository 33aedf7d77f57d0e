"""Crop that another combine is to cut before: where a cart comes beside a pass, and where passes overlap."""

from collections.abc import Sequence
from itertools import product
from math import cos, inf, sin

import numpy as np

from swath.control.job.passes import Pass, place_at_end, way_along
from swath.job.machines import Combine
from swath.signals import F64
from swath.tools.fleet.order import LANDS, WIDE, Mask, Ways

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
    width, points = combines[first].sheet.header_width, _points(ways, combines, then)
    x, y, heading = its.place.T
    last = max(ways.routes[then])
    ends = (its.task == last) & (its.way > ways.routes[then][last].length - LAST) & passes[last].cart_standing
    for i, work in enumerate(passes):
        if work.combine != first:
            continue
        end = place_at_end(work.line_m)
        c, s = cos(end.heading), sin(end.heading)
        near = np.abs(c * (y - end.y) - s * (x - end.x)) < width + combines[then].pipe + LANDS
        near &= ~its.turns & ((its.task > i) | ends) & (np.abs(np.cos(heading - end.heading)) > ALONG)
        columns = np.flatnonzero(near)
        until = _until(work, points[columns], width)
        columns, until = columns[until >= 0.0], until[until >= 0.0]
        before, cuts = (mine.task < i)[:, None], (mine.task == i)[:, None]
        uncut[:, columns] |= before | (cuts & (mine.way[:, None] < until))
    return uncut


def _points(ways: Ways, combines: Sequence[Combine], number: int) -> F64:
    """Points (n, k, 2) before the header of a combine at each of its samples, and beside it where a cart
    drives, or comes while it stands, a little behind it and ahead of it [m]; NaN there where no cart comes
    """
    combine, of = combines[number], ways.samples[number]
    middle, side = combine.sheet.header_y, 0.5 * combine.sheet.header_width - OVERLAP
    before = [(combine.sheet.knife_x, middle + left) for left in (-side, 0.0, side)]
    wheels = [combine.pipe + LANDS + left for left in (-0.5 * WIDE, 0.0, 0.5 * WIDE)]
    ahead, left = np.array([*before, *product(np.arange(-BEHIND, AHEAD + EVERY, EVERY), wheels)]).T
    x, y, heading = of.place.T[:, :, None]
    c, s = np.cos(heading), np.sin(heading)
    points = np.stack([x + c * ahead - s * left, y + s * ahead + c * left], axis=-1)
    has_cart = np.array([work.has_cart for work in ways.passes])[of.task]
    points[~has_cart, len(before) :] = np.nan
    return points


def _until(work: Pass, points: F64, width: float) -> F64:
    """How far along a pass the last of some points (n, k, 2) lies in its strip [m], (n,); -inf: none does."""
    (x, y), end = work.line_m[0], place_at_end(work.line_m)
    c, s, length = cos(end.heading), sin(end.heading), way_along(work.line_m)
    along = c * (points[..., 0] - x) + s * (points[..., 1] - y)
    left = c * (points[..., 1] - y) - s * (points[..., 0] - x)
    is_inside = (along >= 0.0) & (along <= length) & (np.abs(left) < 0.5 * width - EDGE)
    until: F64 = np.max(np.where(is_inside, along, -inf), axis=1)
    return until
