"""What the other machine says, brought forward to now.

Both sides of a link know what the other one does in silence: a cart stops, within STOPS of where it was heard
last; a combine cuts on to the end of its pass, or until its tank is full.
"""

from math import isfinite

from swath.control.cooperate.peer_track import OTHERS, PeerTrack
from swath.core.component import Inputs, KeepsState
from swath.core.frozen import changed
from swath.signals import Odometry, PeerState

SILENT = 3.0  # s without a message, from which on nothing is known of a machine but that
STOPS = 25.0  # m


class Heard(KeepsState):
    """The track of a machine. One that is silent stays where it was SILENT after its last message."""

    kept = ("_track",)

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Nothing heard."""
        self._track = PeerTrack()

    def update(self, t: int, dt: int, said: PeerState, own: Odometry) -> PeerState:
        """The message with relative pose, speed and age of t [ns], a step of dt [ns] on."""
        if not said.is_heard:
            return said
        if not isfinite(said.acceleration):
            said = changed(said, acceleration=0.0)
        track = self._track
        if track.age > SILENT:
            track.speed = track.yaw_rate = track.acceleration = 0.0
        track.update(t, dt, said, own)
        x, y, heading, speed = track.x, track.y, track.heading, track.speed
        return changed(said, t=t, age=track.age, x=x, y=y, heading=heading, speed=speed)


class AllHeard(KeepsState):
    """The tracks of all machines that are heard, by the input of each."""

    kept = ("_tracks",)

    def __init__(self) -> None:
        self._tracks = {name: Heard() for name in ("peer", *OTHERS)}

    def reset(self) -> None:
        """Nothing heard."""
        for track in self._tracks.values():
            track.reset()

    def update(self, t: int, dt: int, inputs: Inputs) -> dict[str, PeerState]:
        """The messages that have come, as of t [ns], a step of dt [ns] on."""
        said = {name: message for name in self._tracks if (message := inputs.get(name)) is not None}
        return {n: self._tracks[n].update(t, dt, m, inputs["odometry"]) for n, m in said.items()}
