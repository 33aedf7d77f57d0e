"""Where the other machine is now: its newest message, brought forward to the present."""

from collections.abc import Mapping
from math import cos, inf, isfinite, sin

from swath.core.component import Inputs, KeepsState, Port
from swath.core.schedule import NS
from swath.signals import Odometry, PeerState

TRUSTED = 1.0  # longest time over which an acceleration is carried on [s]
OTHERS = "other_1", "other_2", "other_3", "other_4"  # inputs: machines beside the one that `peer` names
OTHER_PORTS = tuple(Port(name, PeerState, optional=True) for name in OTHERS)


class PeerTrack(KeepsState):
    """Relative pose of the other machine's origin in the own frame, kept up by dead reckoning.

    The own odometry and the other one's last speed, acceleration and yaw rate carry it on between messages,
    through their delay, and through silence. compensated: False takes the place of every message as that of
    now.
    x, y [m], heading [rad], speed [m/s], yaw_rate [rad/s], acceleration [m/s2]; age: of what it rests on [s],
    inf before the first message
    """

    kept = ("x", "y", "heading", "speed", "yaw_rate", "acceleration", "age", "_valid", "_left")

    def __init__(self, *, compensated: bool = True) -> None:
        self._compensated = compensated
        self.reset()

    def reset(self) -> None:
        """Nothing heard."""
        self.x = self.y = self.heading = self.speed = self.yaw_rate = self.acceleration = 0.0
        self.age, self._valid, self._left = inf, -1, 0.0

    @property
    def curvature(self) -> float:
        """Curvature of the other machine's path, > 0 left [1/m]; 0 at a crawl."""
        return self.yaw_rate / self.speed if self.speed > 0.3 else 0.0

    def update(self, t: int, dt: int, peer: PeerState, own: Odometry) -> None:
        """A step of dt [ns] up to t [ns] passed; peer: the newest message."""
        if not peer.has_place:
            if self.age < inf:
                self.age += dt / NS
                self._carry_on(dt / NS, own)
            return
        valid = peer.t - round(peer.age * NS)
        self.age = (t - valid) / NS
        if valid != self._valid:
            self._valid = valid
            self.x, self.y, self.heading = peer.x, peer.y, peer.heading
            self.speed, self.yaw_rate, self._left = peer.speed, peer.yaw_rate, TRUSTED
            is_told = self._compensated and isfinite(peer.acceleration)
            self.acceleration = peer.acceleration if is_told else 0.0
            self._carry_on(self.age, own)
        else:
            self._carry_on(dt / NS, own)

    def to_own(self, x: float, y: float) -> tuple[float, float]:
        """A point of the other one's frame in the own one [m]."""
        c, s = cos(self.heading), sin(self.heading)
        return self.x + c * x - s * y, self.y + s * x + c * y

    def to_peer(self, x: float, y: float) -> tuple[float, float]:
        """A point of the own frame in the other one's [m]."""
        c, s = cos(self.heading), sin(self.heading)
        return c * (x - self.x) + s * (y - self.y), -s * (x - self.x) + c * (y - self.y)

    def _carry_on(self, h: float, own: Odometry) -> None:
        """Both machines drive on for h [s]."""
        pushed = min(h, self._left)
        self._left -= pushed
        faster = max(self.speed + self.acceleration * pushed, 0.0)
        travel = 0.5 * (self.speed + faster) * pushed + faster * (h - pushed) if self._compensated else 0.0
        self.speed = faster
        turned = self.yaw_rate * h if self._compensated else 0.0
        middle = self.heading + 0.5 * turned
        x, y = self.x + travel * cos(middle), self.y + travel * sin(middle)
        heading = self.heading + turned
        turn = own.yaw_rate * h
        x -= own.speed * h * cos(0.5 * turn)
        y -= own.speed * h * sin(0.5 * turn)
        c, s = cos(turn), sin(turn)
        self.x, self.y, self.heading = c * x + s * y, c * y - s * x, heading - turn


def heard(tracks: Mapping[str, PeerTrack], now: int, dt: int, inputs: Inputs) -> dict[str, PeerState]:
    """What machines say by the input of each, of those that have ever; their tracks go on by dt [ns]."""
    said = {name: message for name in tracks if (message := inputs.get(name)) is not None}
    for name, message in said.items():
        tracks[name].update(now, dt, message, inputs["odometry"])
    return said
