"""A trailer that follows its hitch without slip, and how it stands on the ground.

The hitch pin is pulled along a straight piece of length s at an angle a against the drawbar of length D; the
axle rolls where it points, so tan(a / 2) falls to tan(a / 2) exp(-s / D) (the tractrix). On a circle of
radius R of the machine's axle with the pin h behind it the trailer's axle runs on sqrt(R^2 + h^2 - D^2).
"""

from math import atan, atan2, cos, exp, hypot, sin, tan

from swath.core.component import KeepsState, Port
from swath.core.errors import InputError
from swath.core.frames import Pose, wrapped
from swath.field.site_setup import SiteSetup
from swath.machine.machine_sheet import MachineSheet, Trailer
from swath.machine.tyre import GRAVITY
from swath.signals import EngineState, HeapState, MachineState, SpeedCommand, SteerState, TrailerState

NAN = float("nan")
DRIVEN = (  # what every level of motion takes
    Port("steering", SteerState),
    Port("speed", SpeedCommand),
    Port("drive", EngineState, optional=True),
)


class Towed(KeepsState):
    """The trailer of a machine: its heading, and its load. The pin's way over a step is a straight piece."""

    kept = ("yaw", "_pin", "grain")

    def __init__(self, trailer: Trailer, setup: SiteSetup) -> None:
        self.sheet, self._setup = trailer, setup
        box = setup.machine.box
        self.grain_x = box.x if box is not None else 0.0  # ahead of the axle [m]

    def place(self, x: float, y: float, yaw: float) -> None:
        """Straight behind a machine at a place [m] and heading [rad], empty."""
        self.yaw, self.grain = yaw, 0.0
        self._pin = self.pin(x, y, yaw)

    def pin(self, x: float, y: float, yaw: float) -> tuple[float, float]:
        """Where the hitch pin of a machine is [m]."""
        return x + self.sheet.hitch_x * cos(yaw), y + self.sheet.hitch_x * sin(yaw)

    def carry(self, heap: HeapState | None) -> None:
        """The load that the heap now holds."""
        if heap is not None:
            self.grain = heap.grain

    @property
    def mass(self) -> float:
        """Mass with its load [kg]."""
        return self.sheet.empty + self.grain

    @property
    def cg_ahead(self) -> float:
        """Centre of gravity ahead of the axle, with the load [m]."""
        return (self.sheet.empty * self.sheet.cg_ahead + self.grain * self.grain_x) / self.mass

    def follow(self, x: float, y: float, yaw: float) -> None:
        """The machine drove on to a place [m] and heading [rad]."""
        px, py = self.pin(x, y, yaw)
        dx, dy = px - self._pin[0], py - self._pin[1]
        self._pin = px, py
        distance = hypot(dx, dy)
        if distance > 0.0:
            towards = atan2(dy, dx)
            angle = wrapped(self.yaw - towards)
            left = 2.0 * atan(tan(0.5 * angle) * exp(-distance / self.sheet.drawbar))
            self.yaw += left - angle

    def state(
        self, t: int, machine: Pose, machine_yaw: float, loads: tuple[float, float, float] | None = None
    ) -> TrailerState:
        """Where the trailer is behind a machine. loads: of axle and pin, pull [N], where known."""
        s, ground = self.sheet, self._setup.field
        px, py = self.pin(float(machine.position[0]), float(machine.position[1]), machine_yaw)
        c, n = cos(self.yaw), sin(self.yaw)
        x, y = px - s.drawbar * c, py - s.drawbar * n
        half = 0.5 * s.track
        left, right, front = (
            float(z)
            for z in ground.ground_height([x - half * n, x + half * n, px], [y + half * c, y - half * c, py])
        )
        z = 0.5 * (left + right)
        pitch = atan((z - front) / s.drawbar)
        if loads is None:
            pin = self.mass * GRAVITY * self.cg_ahead / s.drawbar
            loads = self.mass * GRAVITY - pin, pin, NAN
        return TrailerState(
            t, x, y, z, self.yaw, pitch, atan((left - right) / s.track * cos(pitch)),
            self.yaw - machine_yaw, self.mass, *loads,
        )  # fmt: skip


def pose_of(trailer: TrailerState) -> Pose:
    """pose_world_trailer."""
    return Pose.from_euler((trailer.x, trailer.y, trailer.z), trailer.roll, trailer.pitch, trailer.yaw)


def towed_by(setup: SiteSetup) -> Towed | None:
    """The trailer of a machine, None where its data sheet has none."""
    machine = setup.machine
    trailer = machine.trailer if isinstance(machine, MachineSheet) else None
    return Towed(trailer, setup) if trailer is not None else None


def ports_of(towed: Towed | None) -> tuple[Port, ...]:
    """What a level of motion gives: the machine's state, and that of its trailer."""
    state = Port("state", MachineState)
    return (state,) if towed is None else (state, Port("trailer", TrailerState))


def refuse_reverse(wanted: float) -> None:
    """InputError for a wanted speed below 0: a trailer that is pushed folds, which no level knows."""
    if wanted < 0.0:
        expected = "expected >= 0: reversing with a trailer is not simulated"
        raise InputError("speed command", wanted, expected)
