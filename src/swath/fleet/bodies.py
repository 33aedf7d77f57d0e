"""What machines are on the ground: rectangles from their data sheets, how they turn, how fast they drive."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.machine.machine_sheet import MachineSheet

Array = NDArray[np.float64]
BAR = 0.15  # m, half width of a trailer's drawbar, as its body in scans has it
WHEELS = 1.1  # m, from a trailer's axle to the ends of its wheels and frame, as there
WALL = 0.05  # m, of a box, as there


@dataclass(frozen=True)
class Params:
    """gap_m: that a body is wider all round than its data sheet says where ground is granted, for what a
    machine steers off; search_m: where a way is searched; near_m: more than both gaps between two bodies, for
    what lies between the samples of a way. Estimates.
    """

    gap_m: float = 0.18
    search_m: float = 0.15
    near_m: float = 0.04

    @property
    def beside_m(self) -> float:
        """Between the strip of a header and a cart beside it: no less is granted."""
        return 2.0 * self.gap_m + self.near_m


PARAMS = Params()


class Place(NamedTuple):
    """Where a machine's fixed axle is [m], its heading and that of its trailer [rad] from the x axis."""

    x: float
    y: float
    heading: float
    trailer: float

    def ahead(self, distance: float, left: float = 0.0) -> "Place":
        """So far straight ahead and to the left [m], a trailer in line."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return Place(
            self.x + distance * c - left * s, self.y + distance * s + left * c, self.heading, self.heading
        )


class Rectangle(NamedTuple):
    """rear, front: ahead of the origin of what carries it; right, left: leftward of it [m]."""

    rear: float
    front: float
    right: float
    left: float


@dataclass(frozen=True)
class Body:
    """own: from the fixed axle; towed: from the trailer's axle; raised: number of the rectangle in `own` that
    reaches over standing crop on ways, the header, -1 for none; hitch: the pin ahead of the fixed axle;
    drawbar: from the pin to the trailer's axle, 0 without [m]
    """

    own: tuple[Rectangle, ...]
    towed: tuple[Rectangle, ...] = ()
    raised: int = -1
    hitch: float = 0.0
    drawbar: float = 0.0

    @property
    def has_trailer(self) -> bool:
        """Whether it tows one."""
        return self.drawbar > 0.0

    @property
    def length_behind(self) -> float:
        """From the fixed axle to the rear end of all, in line [m]."""
        own = -min(r.rear for r in self.own)
        return max([own, *(self.drawbar - self.hitch - r.rear for r in self.towed)])

    @property
    def half_width(self) -> float:
        """Of the widest rectangle [m]."""
        return max(max(r.left, -r.right) for r in (*self.own, *self.towed))

    @property
    def reach(self) -> float:
        """No part is farther from the fixed axle [m]."""
        own = max(math.hypot(max(-r.rear, r.front), max(r.left, -r.right)) for r in self.own)
        far = [math.hypot(max(-r.rear, r.front), max(r.left, -r.right)) for r in self.towed]
        return max(own, abs(self.hitch) + self.drawbar + max(far, default=0.0))

    def mirrored(self) -> "Body":
        """Left and right exchanged."""
        own, towed = (
            tuple(Rectangle(r.rear, r.front, -r.left, -r.right) for r in parts)
            for parts in (self.own, self.towed)
        )
        return replace(self, own=own, towed=towed)

    def outlines(self, places: Array, gap: float = 0.0) -> Array:
        """Corners of all rectangles, each wider by a gap all round [m], shape (n, rectangles, 4, 2).

        places: rows x, y, heading, heading of the trailer, shape (n, 4)
        """
        x, y, heading, trailer = places.T
        own = _corners(x, y, heading, self.own, gap)
        if not self.towed:
            return own
        tx = x + self.hitch * np.cos(heading) - self.drawbar * np.cos(trailer)
        ty = y + self.hitch * np.sin(heading) - self.drawbar * np.sin(trailer)
        return np.concatenate([own, _corners(tx, ty, trailer, self.towed, gap)], axis=1)

    def points(self, spacing: float, gap: float) -> Array:
        """Points along the sides of all rectangles, at most `spacing` apart, and in them, each wider by a gap
        [m]: x, y, whether on the trailer, whether raised over crop; shape (n, 4).
        """
        rows = []
        for towed, part in ((0.0, self.own), (1.0, self.towed)):
            for i, r in enumerate(part):
                raised = float(not towed and i == self.raised)
                x = _steps(r.rear - gap, r.front + gap, spacing)
                y = _steps(r.right - gap, r.left + gap, spacing)
                sides = [(u, v) for u in x for v in (y[0], y[-1])] + [
                    (u, v) for u in (x[0], x[-1]) for v in y
                ]
                inner = [(u, v) for u in x[1:-1:3] for v in y[1:-1:3]]
                rows.append(np.array([(u, v, towed, raised) for u, v in sides + inner]))
        return np.concatenate(rows)


def _steps(low: float, high: float, spacing: float) -> Array:
    return np.linspace(low, high, max(2, math.ceil((high - low) / spacing) + 1))


def _corners(x: Array, y: Array, heading: Array, parts: tuple[Rectangle, ...], gap: float) -> Array:
    c, s = np.cos(heading)[:, None, None], np.sin(heading)[:, None, None]
    r = np.array(parts)
    u = np.stack([r[:, 0] - gap, r[:, 1] + gap, r[:, 1] + gap, r[:, 0] - gap], axis=1)
    v = np.stack([r[:, 2] - gap, r[:, 2] - gap, r[:, 3] + gap, r[:, 3] + gap], axis=1)
    return np.stack([x[:, None, None] + u * c - v * s, y[:, None, None] + u * s + v * c], axis=-1)


def body_of(sheet: MachineSheet) -> Body:
    """Chassis, header, drawbar and box of a data sheet. Pipes are left out: they pass above."""
    own = [Rectangle(*r) for r in sheet.outline]
    if sheet.hitch is None or sheet.trailer is None:
        return Body(tuple(own), raised=len(own) - 1 if sheet.has_header else -1)
    trailer, box = sheet.trailer, sheet.box
    half = 0.5 * trailer.width
    towed = [Rectangle(-WHEELS, WHEELS, -half, half), Rectangle(0.0, trailer.drawbar, -BAR, BAR)]
    if box is not None:
        wide = 0.5 * box.width + WALL
        towed.append(Rectangle(box.x - 0.5 * box.length, box.x + 0.5 * box.length, -wide, wide))
    return Body(tuple(own), tuple(towed), -1, sheet.hitch.x, sheet.hitch.drawbar)


@dataclass(frozen=True)
class Drive:
    """How a machine drives on ways. radius: of its tightest turn [m]; turning, straight, backwards: speeds
    [m/s], 0 where it does not reverse; accel: of its speed, up and down [m/s2]; shift: from forwards to
    backwards or back [s]; steering: how fast its curvature changes [1/(m s)]
    """

    radius: float
    turning: float
    straight: float
    backwards: float
    accel: float
    shift: float
    steering: float = math.inf
