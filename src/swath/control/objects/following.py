"""What all levels that follow things share: dead reckoning, the strip that is looked at, and the sample."""

from dataclasses import replace
from math import cos, sin
from typing import ClassVar

import numpy as np

from swath.control.objects.track import Track, Tracks
from swath.core.component import KeepsState, Outputs
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.signals import Objects, Odometry, objects_of
from swath.signals.setup import ControlSetup

FREE = 0.3  # ahead of the knife nothing is looked for, there the header moves [m]


def on_ground(x: float, y: float, place: tuple[float, float, float]) -> tuple[float, float]:
    """Where a point ahead and to the left of a machine lies. place: of that, x, y [m] and yaw [rad]."""
    px, py, yaw = place
    c, s = cos(yaw), sin(yaw)
    return px + c * x - s * y, py + s * x + c * y


class Following(KeepsState):
    """Follows things in the frame of its own dead reckoning since the start.

    port: of the sensor that it takes the mounting of
    """

    kept: ClassVar[tuple[str, ...]] = ("_tracks", "_pose", "_seen")

    def __init__(
        self, setup: ControlSetup, port: str, side: float, confirm: int, keep: float, doubt: float = 0.0
    ) -> None:
        own = {name: pose for name, pose in setup.mountings.items() if name == port}
        self._mounting, self._knife = replace(setup, mountings=own).mounting, setup.machine.knife_x
        ends = [setup.machine.header_end(end)[1] for end in ("right", "left")]
        self._strip = ends[0] - side, ends[1] + side
        self._tracks = Tracks(confirm, keep, doubt)

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._tracks.clear()
        self._pose = (0.0, 0.0, 0.0)  # x, y [m], yaw [rad]
        self._seen = -1
        return {"objects": objects_of(0, [])}

    def _go(self, odometry: Odometry | None, seconds: float) -> tuple[float, float]:
        """Drive on; speed [m/s] and yaw rate [rad/s], 0 without odometry."""
        speed, turn = (0.0, 0.0) if odometry is None else (odometry.speed, odometry.yaw_rate)
        self._pose = self._moved(speed, turn, seconds)
        return speed, turn

    def _moved(self, speed: float, turn: float, seconds: float) -> tuple[float, float, float]:
        """The pose so much later, or earlier."""
        x, y, yaw = self._pose
        middle = yaw + 0.5 * turn * seconds
        travel = speed * seconds
        return x + travel * cos(middle), y + travel * sin(middle), yaw + turn * seconds

    def _ahead(self, track: Track) -> tuple[float, float]:
        """Where a thing was when last seen, in the machine's frame [m]."""
        px, py, yaw = self._pose
        dx, dy, c, s = track.place[0] - px, track.place[1] - py, cos(yaw), sin(yaw)
        return c * dx + s * dy, -s * dx + c * dy

    def _sample(self, now: int) -> Objects:
        px, py, yaw = self._pose
        c, s, rows = cos(yaw), sin(yaw), []
        for track in self._tracks.confirmed():
            x, y = track.at(now / NS)
            dx, dy = x - px, y - py
            vx, vy = track.velocity
            moved = c * vx + s * vy, -s * vx + c * vy
            box = 0.0, track.heap.length, track.heap.width, track.heap.top
            place = c * dx + s * dy, -s * dx + c * dy
            rows.append((track.number, 0.0, *place, *box, *moved, track.confidence, np.nan))
        return objects_of(now, rows)
