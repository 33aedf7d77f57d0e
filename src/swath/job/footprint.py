"""The ground that a machine's bodies cover, seen from above: rectangles from its data sheet."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.job.path import Pose
from swath.machine.machine_sheet import MachineSheet

Array = NDArray[np.float64]
Corners = tuple[tuple[float, float], ...]
Carrier = tuple[float, float, float, float]  # x, y [m], cosine and sine of its heading
BAR = 0.15  # m, half width of a trailer's drawbar, as its body in scans has it
WHEELS = 1.1  # m, from a trailer's axle to the ends of its wheels and frame, as there
WALL = 0.05  # m, of a box, as there


@dataclass(frozen=True)
class Rectangle:
    """rear, front: ahead of the origin of what carries it; right, left: leftward of it [m]."""

    rear: float
    front: float
    right: float
    left: float

    def at(self, x: float, y: float, c: float, s: float) -> Corners:
        """Its corners [m], counter-clockwise. c, s: cosine and sine of its carrier's heading at (x, y)."""
        r, f, p, q = self.rear, self.front, self.right, self.left
        return (
            (x + r * c - p * s, y + r * s + p * c),
            (x + f * c - p * s, y + f * s + p * c),
            (x + f * c - q * s, y + f * s + q * c),
            (x + r * c - q * s, y + r * s + q * c),
        )

    def box(self, x: float, y: float, c: float, s: float) -> tuple[float, ...]:
        """As a row of `Footprint.sweep`, its carrier at (x, y) with a heading's cosine and sine."""
        u, v = 0.5 * (self.rear + self.front), 0.5 * (self.right + self.left)
        half = 0.5 * (self.front - self.rear), 0.5 * (self.left - self.right)
        return (x + u * c - v * s, y + u * s + v * c, c, s, *half)


@dataclass(frozen=True)
class Footprint:
    """own: body and header, from the fixed axle; towed: wheels, drawbar and box, from the trailer's axle;
    hitch: the pin ahead of the fixed axle; drawbar: from the pin to the trailer's axle; reach: of all that
    around the fixed axle [m]
    """

    own: tuple[Rectangle, ...]
    towed: tuple[Rectangle, ...]
    hitch: float
    drawbar: float
    reach: float

    @property
    def count(self) -> int:
        """Of its rectangles."""
        return len(self.own) + len(self.towed)

    @property
    def wide(self) -> float:
        """Half of its greatest width [m]."""
        return max(max(r.left, -r.right) for r in (*self.own, *self.towed))

    def at(self, pose: Pose, trailer: float) -> list[Corners]:
        """Corners of all rectangles with the fixed axle at a pose. trailer: its heading [rad]."""
        return [r.at(*carrier) for carrier, parts in self._carried(pose, trailer) for r in parts]

    def sweep(self, places: Sequence[tuple[Pose, float]]) -> Array:
        """Boxes of all its rectangles at places (pose, heading of the trailer), shape (n, 6): middle [m],
        direction (cosine, sine), half length and half width [m].
        """
        made = [
            r.box(*carrier)
            for pose, trailer in places
            for carrier, parts in self._carried(pose, trailer)
            for r in parts
        ]
        return np.array(made).reshape(-1, 6)

    def _carried(self, pose: Pose, trailer: float) -> list[tuple[Carrier, tuple[Rectangle, ...]]]:
        """The machine and its trailer, each with its rectangles."""
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        own = (pose.x, pose.y, c, s), self.own
        if not self.towed:
            return [own]
        u, v = math.cos(trailer), math.sin(trailer)
        x = pose.x + self.hitch * c - self.drawbar * u
        y = pose.y + self.hitch * s - self.drawbar * v
        return [own, ((x, y, u, v), self.towed)]


def overlap(a: Array, b: Array, gap: float = 0.0) -> bool:
    """Whether any box of `a` is within a gap [m] of one of `b`, (n, 6) and (m, 6) as `Footprint.sweep`; at
    corners the gap is up to 1.4 times as wide (separating axis theorem).
    """
    ax, ay, ac, as_, al, aw = (a[:, i, None] for i in range(6))
    bx, by, bc, bs, bl, bw = b.T
    dx, dy = bx - ax, by - ay
    along, across = np.abs(ac * bc + as_ * bs), np.abs(ac * bs - as_ * bc)
    al, aw = al + gap, aw + gap
    meet = np.abs(dx * ac + dy * as_) < al + bl * along + bw * across
    meet &= np.abs(dy * ac - dx * as_) < aw + bl * across + bw * along
    meet &= np.abs(dx * bc + dy * bs) < bl + al * along + aw * across
    meet &= np.abs(dy * bc - dx * bs) < bw + al * across + aw * along
    return bool(meet.any())


def footprint_of(sheet: MachineSheet) -> Footprint:
    """Body with the feeder as far as the header, header, drawbar and box of a trailer.

    Pipes are left out: they pass above. InputError for a sheet that tows without saying what.
    """
    own = [Rectangle(*r) for r in sheet.outline]
    _, front, half, _, _ = sheet.body
    behind = own[-1].rear
    if sheet.has_header and behind > front:
        own.append(Rectangle(front, behind, -0.5 * half, 0.5 * half))
    if sheet.hitch is None:
        return Footprint(tuple(own), (), 0.0, 0.0, _reach(own, 0.0))
    t, box = sheet.trailer, sheet.box
    if t is None:
        raise InputError("machine", sheet.name, "expected a section `trailer`")
    towed = [
        Rectangle(-WHEELS, WHEELS, -0.5 * t.width, 0.5 * t.width),
        Rectangle(0.0, t.drawbar, -BAR, BAR),
    ]
    if box is not None:
        wide = 0.5 * box.width + WALL
        towed.append(Rectangle(box.x - 0.5 * box.length, box.x + 0.5 * box.length, -wide, wide))
    back = abs(t.hitch_x) + t.drawbar + max(math.hypot(r.rear, r.left) for r in towed)
    return Footprint(tuple(own), tuple(towed), t.hitch_x, t.drawbar, _reach(own, back))


def _reach(own: list[Rectangle], back: float) -> float:
    corners = [(x, y) for r in own for x in (r.rear, r.front) for y in (r.right, r.left)]
    return max(back, *(math.hypot(x, y) for x, y in corners))


def distance(a: Corners, b: Corners) -> float:
    """Least distance between two rectangles [m]; 0 where they overlap (separating axis theorem)."""
    if not _apart(a, b) and not _apart(b, a):
        return 0.0
    return min(_to_edges(a, b), _to_edges(b, a))


def _apart(a: Corners, b: Corners) -> bool:
    """True where a side of `a` divides the two."""
    for i in (0, 1):
        px, py = a[i]
        qx, qy = a[i + 1]
        ux, uy = qx - px, qy - py
        size = math.sqrt(ux * ux + uy * uy)
        if size <= 0.0:
            continue
        ux, uy = ux / size, uy / size
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = b
        d0, d1 = (x0 - px) * ux + (y0 - py) * uy, (x1 - px) * ux + (y1 - py) * uy
        d2, d3 = (x2 - px) * ux + (y2 - py) * uy, (x3 - px) * ux + (y3 - py) * uy
        if max(d0, d1, d2, d3) < 0.0 or min(d0, d1, d2, d3) > size:
            return True
    return False


def _to_edges(a: Corners, b: Corners) -> float:
    """Least distance of the corners of `a` from the sides of `b`."""
    least = math.inf
    for i in range(4):
        (px, py), (qx, qy) = b[i], b[(i + 1) % 4]
        ux, uy = qx - px, qy - py
        size = ux * ux + uy * uy
        for x, y in a:
            t = min(max(((x - px) * ux + (y - py) * uy) / size, 0.0), 1.0) if size > 0.0 else 0.0
            dx, dy = x - px - t * ux, y - py - t * uy
            least = min(least, dx * dx + dy * dy)
    return math.sqrt(least)


def clearance(a: list[Corners], b: list[Corners]) -> float:
    """Least distance between the bodies of two machines [m]; 0 where they overlap."""
    return min(distance(p, q) for p in a for q in b)
