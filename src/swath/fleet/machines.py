"""The machines of a job, in SI, from data sheets and its file: bodies, turns, speeds, flows, loads."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.number_text import num
from swath.core.units import KMH
from swath.fleet.files import CartSettings, CombineSettings, JobFile
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.heap.open_box import largest_heap, slope_of
from swath.machine.machine_sheet import MachineSheet, dynamics_of, load_machine
from swath.signals.setup import Pipe

Array = NDArray[np.float64]
BAR = 0.15  # m, half width of a trailer's drawbar, as its body in scans has it
WHEELS = 1.1  # m, from a trailer's axle to the ends of its wheels and frame, as there
WALL = 0.05  # m, of a box, as there


@dataclass(frozen=True)
class Params:
    """gap_m: that a body is wider all round than its data sheet says where ground is granted, for what a
    machine steers off; search_m: where a way is searched; near_m: more than both gaps between two bodies, for
    what lies between the samples of a way; all estimates. repose_deg: of wheat, published 22 to 27;
    backwards_m_s, shift_s: reversing, estimates; sideways_m_s2: acceleration that drivers of carts keep in
    bends, 0.8 in job reports, an estimate; drop_m: of grain below the pipe's mouth where it meets the heap,
    an estimate; off_m: most that the stream's impact may be off the middle of the box, of which a heap loses
    15 % (COOPERATION: 83 to 86 % of a box); steered: of the steering's rate that ways take, the rest is for
    what a machine is off its way.
    """

    gap_m: float = 0.18
    search_m: float = 0.15
    near_m: float = 0.04
    repose_deg: float = 25.0
    backwards_m_s: float = 1.0
    shift_s: float = 2.0
    sideways_m_s2: float = 0.8
    drop_m: float = 1.0
    off_m: float = 0.5
    steered: float = 0.75

    @property
    def beside_m(self) -> float:
        """Between the strip of a header and a cart beside it: no less is granted."""
        return self.lane_m + self.near_m

    @property
    def lane_m(self) -> float:
        """That a cart beside is off crop and closed ground: its gap and that of the combine."""
        return 2.0 * self.gap_m

    @property
    def rim_m(self) -> float:
        """Kept off holes, and around who waits: the gap of a search, and as much for what cells are off."""
        return 2.0 * self.search_m


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


@dataclass(frozen=True, order=True)
class Body:
    """own: from the fixed axle; towed: from the trailer's axle; raised: number of the rectangle in `own` that
    reaches over standing crop on ways, the header, -1 for none; hitch: the pin ahead of the fixed axle;
    drawbar: from the pin to the trailer's axle, 0 without [m].
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
        """Half the width of the widest rectangle [m]."""
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


@dataclass(frozen=True, order=True)
class Drive:
    """How a machine drives on ways.

    radius: of its tightest turn [m]
    turning, straight, backwards: speeds [m/s], 0 where it does not reverse
    accel: of its speed, up and down [m/s2]
    shift: from forwards to backwards or back [s]
    steering: how fast its curvature changes [1/(m s)]
    """

    radius: float
    turning: float
    straight: float
    backwards: float
    accel: float
    shift: float
    steering: float = math.inf


@dataclass(frozen=True)
class Combine:
    """width, knife: of the header and ahead of the fixed axle [m]; speed: in the crop [m/s]; flow: most grain
    [kg/s]; tank [kg]; auger [kg/s]; swing: until the pipe is out [s]; pipe_x: of its mouth ahead of the axle;
    pipe_y: where the stream lands, leftward [m]; call: level of the tank from which a cart may come; start:
    at the start [kg].
    """

    name: str
    sheet: MachineSheet
    body: Body
    drive: Drive
    width: float
    knife: float
    speed: float
    flow: float
    tank: float
    auger: float
    swing: float
    pipe_x: float
    pipe_y: float
    call: float
    start: float = 0.0

    def speed_in(self, grain: float) -> float:
        """Speed [m/s] in a crop with so much grain per metre of pass [kg/m]."""
        return self.speed if grain <= 0.0 else min(self.speed, self.flow / grain)


@dataclass(frozen=True)
class Cart:
    """load: at which it is full [kg]; leave: from which it drives to the truck [kg]; out: its auger [kg/s].

    box_x: middle of its box ahead of the tractor's fixed axle, in line [m]
    """

    name: str
    sheet: MachineSheet
    body: Body
    drive: Drive
    load: float
    leave: float
    out: float
    box_x: float


M = TypeVar("M", Combine, Cart)


@dataclass(frozen=True)
class Machines:
    """combines, carts: by what they can do, the most first, so that neither names nor the order of a file
    decide anything; density: of the grain in bulk [kg/m3]; listed: names in the order of the file.
    """

    combines: tuple[Combine, ...]
    carts: tuple[Cart, ...]
    truck: MachineSheet
    density: float
    listed: tuple[str, ...]

    @property
    def by_name(self) -> dict[str, Combine | Cart]:
        """All machines that move, in the order of the file."""
        named: dict[str, Combine | Cart] = {m.name: m for m in self.combines}
        named |= {k.name: k for k in self.carts}
        return {name: named[name] for name in self.listed if name in named}


def machines_of(job: JobFile, base: Path | None = None) -> Machines:
    """The machines of a job. InputError for one that cannot do its part."""
    for name, combine in job.combines.items():
        if job.is_mirrored and combine.pipe == "left":
            expected = "expected right, as the pipes of other combines, beside which the same carts drive"
            raise InputError(f"combines.{name}.pipe", combine.pipe, expected)
    combines = _ranked(_combine(n, s, base) for n, s in job.combines.items())
    density = drivetrain_of(combines[0].sheet).bulk.density
    carts = _ranked(_cart(n, s, base, density, job.is_mirrored) for n, s in job.carts.items())
    truck = load_machine(job.truck.machine, base=base)
    if truck.box is None:
        raise InputError("truck.machine", job.truck.machine, "expected a machine with a box")
    machines = Machines(combines, carts, truck, density, (*job.combines, *job.carts))
    for c in combines:
        for cart in carts:
            beside(c, cart)
    return machines


def _ranked(machines: Iterable[M]) -> tuple[M, ...]:
    """Machines by their numbers, the highest first; those alike as they come."""
    return tuple(sorted(machines, key=_numbers, reverse=True))


def _numbers(m: Combine | Cart) -> list[Any]:
    cuts = m.width * m.speed if isinstance(m, Combine) else m.load
    return [cuts, *(v for key, v in vars(m).items() if key not in ("name", "sheet"))]


def _combine(name: str, s: CombineSettings, base: Path | None) -> Combine:
    sheet = load_machine(s.machine, base=base, header_width_m=s.header_width_m)
    if not sheet.has_header or sheet.pipe is None:
        raise InputError(f"combines.{name}.machine", s.machine, "expected a machine with a header and a pipe")
    train = drivetrain_of(sheet)
    if train.tank <= 0.0 or train.unloading <= 0.0:
        raise InputError(f"combines.{name}.machine", s.machine, "expected a grain tank and an auger")
    drive = Drive(
        s.turn_radius_m, s.turn_speed_kmh * KMH, max(s.transport_speed_kmh, s.turn_speed_kmh) * KMH,
        PARAMS.backwards_m_s, dynamics_of(sheet).accel, PARAMS.shift_s, _steering(sheet),
    )  # fmt: skip
    pipe = sheet.pipe
    return Combine(
        name, sheet, _body(sheet, s.pipe == "right"), drive, sheet.header_width, sheet.knife_x,
        s.speed_kmh * KMH, flow=s.grain_kg_s or train.transport.grain_feed, tank=train.tank,
        auger=train.unloading, swing=pipe.swing / pipe.rate,
        pipe_x=pipe.x, pipe_y=pipe.y + pipe.length + _thrown(pipe),
        call=s.call_percent / 100.0 * train.tank, start=s.tank_start_percent / 100.0 * train.tank,
    )  # fmt: skip


def _body(sheet: MachineSheet, is_mirrored: bool) -> Body:
    return body_of(sheet).mirrored() if is_mirrored else body_of(sheet)


def _steering(sheet: MachineSheet) -> float:
    """How fast the curvature of a machine's way changes, going straight: less than in any bend [1/(m s)]."""
    return PARAMS.steered * dynamics_of(sheet).steer_rate / abs(sheet.wheelbase)


def _thrown(pipe: Pipe) -> float:
    """How far beyond the mouth the stream lands [m]: thrown at its speed and angle, fallen by `drop_m`."""
    down, out = pipe.exit_speed * math.sin(pipe.fall), pipe.exit_speed * math.cos(pipe.fall)
    g = 9.81
    return out * (math.sqrt(down**2 + 2.0 * g * PARAMS.drop_m) - down) / g


def _cart(name: str, s: CartSettings, base: Path | None, density: float, is_mirrored: bool) -> Cart:
    sheet = load_machine(s.machine, base=base)
    if sheet.box is None or sheet.hitch is None:
        raise InputError(f"carts.{name}.machine", s.machine, "expected a tractor with a box on a trailer")
    most = largest_heap(sheet.box, slope_of(math.radians(PARAMS.repose_deg))) * density
    load = s.fill_percent / 100.0 * most
    speed = s.speed_kmh * KMH
    bend = min(speed, math.sqrt(PARAMS.sideways_m_s2 * s.turn_radius_m))
    drive = Drive(
        s.turn_radius_m, bend, speed, 0.0, dynamics_of(sheet).accel, PARAMS.shift_s, _steering(sheet)
    )
    return Cart(
        name, sheet, _body(sheet, is_mirrored), drive, load, min(s.leave_percent / 100.0, 1.0) * load,
        s.unload_l_s / 1000.0 * density, sheet.hitch.x - sheet.hitch.drawbar + sheet.box.x,
    )  # fmt: skip


def beside(combine: Combine, cart: Cart) -> tuple[float, float]:
    """Where a cart's fixed axle is while it is poured into, seen from the combine's: ahead and leftward [m].

    The middle of its box is under the stream, or so far off that its strip is clear of the header's.
    InputError where the stream does not reach the box then.
    """
    clear = 0.5 * combine.width + cart.body.half_width + PARAMS.beside_m
    if clear > combine.pipe_y + PARAMS.off_m:
        most = 2.0 * (combine.pipe_y + PARAMS.off_m - cart.body.half_width - PARAMS.beside_m)
        expected = (
            f"expected a header of at most {num(most)} m, the pipe does not reach {cart.name} beside it"
        )
        raise InputError(f"combines.{combine.name}.header_width_m", combine.width, expected)
    return combine.pipe_x - cart.box_x, max(clear, combine.pipe_y)
