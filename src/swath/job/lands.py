"""Plan of a field from its boundary: opening rounds on the headland, then parallel passes in lands.

Opening rounds follow the boundary from outside inward, side by side: at a corner the machine cuts to the end,
reverses and goes on along the next side. Passes inside are parallel, a width apart. Clockwise rounds and
lands worked round and round clockwise keep standing crop on the right, where no pipe is.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.job.plan import FieldPlan, PlannedPass, checked_ring, shapely_here, with_ground

Array = NDArray[np.float64]
CORNER = math.radians(35.0)  # a sharper bend of the boundary ends a side


@dataclass(frozen=True)
class PlanSettings:
    """headland_rounds: opening rounds; headland: direction in which they are driven, clockwise keeps the crop
    on the right; direction_deg: of the passes, counter-clockwise from east (default: along the longest side);
    overlap_m: of neighbouring passes; order: of the passes inside: `adjacent` one after the other, `lands`
    round and round in lands of `land_passes`, `skip` with one left out, for the way back; land_passes: of
    each land
    """

    headland_rounds: Annotated[int, Ge(0), Le(12)] = 2
    headland: Literal["clockwise", "counterclockwise"] = "clockwise"
    direction_deg: Annotated[float, Ge(-360), Le(360)] | None = None
    overlap_m: Annotated[float, Ge(0), Le(3)] = 0.3
    order: Literal["adjacent", "lands", "skip"] = "lands"
    land_passes: Annotated[int, Gt(1), Le(200)] = 12


def plan_field(
    boundary: Any,
    header: float,
    settings: PlanSettings,
    *,
    holes: tuple[Array, ...] = (),
    pipe: float = 8.0,
    abreast: int = 1,
    teams: int = 1,
) -> FieldPlan:
    """The plan of a field. boundary: ring (n, 2) [m]; header: its width [m]; pipe: see `with_ground`.

    abreast: combines in echelon, whose passes follow each other in the order; teams: that work on their own,
    each in a land of its own
    """
    shapely = shapely_here()
    ring = checked_ring(boundary)
    width = header - settings.overlap_m
    if width < 0.5 * header:
        raise InputError("plan.overlap_m", settings.overlap_m, "expected less than half the header")
    field = shapely.Polygon(ring, holes)
    rounds = _rounds(field, width, settings, abreast)
    headland = settings.headland_rounds * width
    inner = field.buffer(-headland, join_style="mitre") if headland else field
    inside = _parallel(inner, width, _direction(ring, settings.direction_deg))
    ordered = _ordered(inside, settings, abreast, teams)
    if not rounds and not ordered:
        raise InputError("plan", None, "expected a field that is wider than the header")
    passes = with_ground([*rounds, *ordered], ring, header, holes=holes, pipe=pipe)
    passes = tuple(p for p in passes if p.area > 0.02 * header * max(p.length, 1.0))
    return FieldPlan(ring, passes, width, headland, float(field.area), holes)


def _direction(ring: Array, stated: float | None) -> float:
    """Direction of the passes [rad]: as stated, or that of the longest side."""
    if stated is not None:
        return math.radians(stated)
    sides = np.diff(np.concatenate([ring, ring[:1]]), axis=0)
    x, y = sides[np.hypot(sides[:, 0], sides[:, 1]).argmax()].tolist()
    return math.atan2(y, x)


def _rounds(field: Any, width: float, settings: PlanSettings, abreast: int) -> list[PlannedPass]:
    """The opening rounds; `abreast` of them side by side."""
    count = settings.headland_rounds
    done: list[PlannedPass] = []
    for first in range(0, count, abreast):
        together = [
            _round(field, width, i, settings.headland) for i in range(first, min(first + abreast, count))
        ]
        if len({len(r) for r in together}) == 1:
            done += [side for row in zip(*together, strict=True) for side in row]
        else:
            done += [side for r in together for side in r]
    return done


def _round(field: Any, width: float, index: int, turning: str) -> list[PlannedPass]:
    """The sides of an opening round, each as far as the ground reaches."""
    shapely = shapely_here()
    around = field.buffer(-(index + 0.5) * width, join_style="mitre")
    outside = field.buffer(-index * width, join_style="mitre")
    passes: list[PlannedPass] = []
    for part in sorted(getattr(around, "geoms", [around]), key=lambda g: -g.area):
        if part.is_empty:
            continue
        ring = np.asarray(shapely.geometry.polygon.orient(part).exterior.coords)[:-1]
        if turning == "clockwise":
            ring = ring[::-1]
        for n, side in enumerate(_sides(ring)):
            line = _lengthened(side, outside, 0.5 * width)
            passes.append(PlannedPass(line, "headland", index, is_corner=n > 0))
    return passes


def _sides(ring: Array) -> list[Array]:
    """A ring split at its corners, from its sharpest on."""
    step = np.diff(np.concatenate([ring[-1:], ring, ring[:1]]), axis=0)
    angle = np.array([math.atan2(y, x) for x, y in step.tolist()])
    bend = np.abs((np.diff(angle) + math.pi) % (2.0 * math.pi) - math.pi)
    corners = np.flatnonzero(bend > CORNER)
    if not len(corners):
        return [np.concatenate([ring, ring[:1]])]
    loop = np.concatenate([ring, ring])
    ends = [*corners.tolist(), int(corners[0]) + len(ring)]
    return [loop[a : b + 1] for a, b in pairwise(ends)]


def _lengthened(side: Array, ground: Any, most: float) -> Array:
    """A side drawn out at its end until the ground of its round is cut, by half a width at an even corner."""
    shapely = shapely_here()
    (ax, ay), (bx, by) = side[-2].tolist(), side[-1].tolist()
    length = math.hypot(bx - ax, by - ay)
    ux, uy = (bx - ax) / length, (by - ay) / length
    beyond = shapely.LineString([(bx, by), (bx + 2.0 * most * ux, by + 2.0 * most * uy)]).intersection(ground)
    extra = min(float(beyond.length), 2.0 * most)
    side = side.copy()
    side[-1] = (bx + extra * ux, by + extra * uy)
    return side


def _parallel(inner: Any, width: float, direction: float) -> list[list[PlannedPass]]:
    """Lines across the inner ground, a width apart from left to right, each with its pieces.

    They are laid so that the rest, narrower than a width, is at the right.
    """
    shapely = shapely_here()
    if inner.is_empty:
        return []
    turned = shapely.affinity.rotate(inner, -math.degrees(direction), origin=(0.0, 0.0))
    west, south, east, north = turned.bounds
    count = max(1, math.ceil((north - south) / width - 1e-6))
    c, s = math.cos(direction), math.sin(direction)
    lines: list[list[PlannedPass]] = []
    for i in range(count):
        y = north - (i + 0.5) * width
        band = turned.intersection(shapely.box(west - 1, y - 0.5 * width, east + 1, y + 0.5 * width))
        pieces = []
        for part in sorted(getattr(band, "geoms", [band]), key=lambda g: g.bounds[0]):
            if part.geom_type != "Polygon" or part.area < 1.0:
                continue
            x0, _, x1, _ = part.bounds
            ends = np.array([[x0, y], [x1, y]])
            line = np.stack([c * ends[:, 0] - s * ends[:, 1], s * ends[:, 0] + c * ends[:, 1]], axis=1)
            pieces.append(PlannedPass(line))
        if pieces:
            lines.append(pieces)
    return lines


def _in_order(lines: list[list[PlannedPass]], groups: list[list[int]], land: int = 0) -> list[PlannedPass]:
    """Groups of lines in order, there and back in turn; the lines of a group are driven the same way."""
    done = []
    for n, group in enumerate(groups):
        for i in group:
            pieces = lines[i] if n % 2 == 0 else [p.reversed() for p in reversed(lines[i])]
            done += [PlannedPass(p.line, land=land) for p in pieces]
    return done


def _ordered(
    lines: list[list[PlannedPass]], settings: PlanSettings, abreast: int, teams: int
) -> list[PlannedPass]:
    """Passes in order; with several teams in as many lands, or more."""
    order, share = ORDERS[settings.order], max(2, math.ceil(len(lines) / teams))
    if settings.order == "lands":
        return order(lines, min(settings.land_passes, share), abreast)
    done: list[PlannedPass] = []
    for land, first in enumerate(range(0, len(lines), share)):
        made = order(lines[first : first + share], share, abreast)
        done += [replace(p, land=land) for p in made]
    return done


def _grouped(indices: list[int], abreast: int) -> list[list[int]]:
    return [indices[i : i + abreast] for i in range(0, len(indices), abreast)]


def adjacent(lines: list[list[PlannedPass]], _land_passes: int, abreast: int = 1) -> list[PlannedPass]:
    """One after the other; in a group, the one beside cut ground on the left is first."""
    groups = _grouped(list(range(len(lines))), abreast)
    return _in_order(lines, [g if n % 2 == 0 else g[::-1] for n, g in enumerate(groups)])


def skip(lines: list[list[PlannedPass]], _land_passes: int, abreast: int = 1) -> list[PlannedPass]:
    """Every other one there, those between on the way back."""
    groups = _grouped(list(range(len(lines))), abreast)
    there = [i for i in range(len(groups)) if i % 2 == 0]
    back = [i for i in reversed(range(len(groups))) if i % 2 == 1]
    return _in_order(lines, [groups[i] for i in there + back])


def lands(lines: list[list[PlannedPass]], land_passes: int, abreast: int = 1) -> list[PlannedPass]:
    """Round and round in lands, clockwise: leftmost there, rightmost back, and inward."""
    done: list[PlannedPass] = []
    for land, first in enumerate(range(0, len(lines), land_passes)):
        own = list(range(first, min(first + land_passes, len(lines))))
        order = []
        while own:
            order.append([own.pop(0) for _ in range(min(abreast, len(own)))])
            if own:
                order.append([own.pop() for _ in range(min(abreast, len(own)))])
        done += _in_order(lines, order, land)
    return done


ORDERS = {"adjacent": adjacent, "skip": skip, "lands": lands}
