"""What all measured data look like to the builder: sweeps of echoes, and a track of poses."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose
from swath.tools.height_map.poses import PoseTrack

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Echoes:
    """Some echoes, in the sensor frame. time [s] on the clock of the poses, (n,); points (n, 3) [m];
    intensity (n,), nan = not known; scan_count: scans they are of; silent_count: beams of these without echo

    silent: how far beams went without meeting anything, (m, 3) [m], as far as that is known; silent_time (m,)
    """

    time: Array
    points: Array
    intensity: Array
    silent_count: int = 0
    scan_count: int = 1
    silent: Array = field(default_factory=lambda: np.zeros((0, 3)))
    silent_time: Array = field(default_factory=lambda: np.zeros(0))


@dataclass
class Source:
    """name: for messages; track: of the machine (or of the sensor itself); mounting: pose_machine_sensor

    sweeps: starts a new pass through the echoes; notes: what was left out, grows while reading
    frame_is_world: points are in the map already
    """

    name: str
    track: PoseTrack
    mounting: Pose
    sweeps: Callable[[], Iterator[Echoes]]
    notes: dict[str, int] = field(default_factory=dict)
    frame_is_world: bool = False

    def note(self, what: str, count: int = 1) -> None:
        """Count something that was left out."""
        if count:
            self.notes[what] = self.notes.get(what, 0) + count


@dataclass(frozen=True)
class Wanted:
    """What the user says about a source; None = find out.

    scans, poses: topics; mount: pose_machine_sensor
    range_min, range_max [m]: other ranges are no echo
    to_local: longitude, latitude, height to local metres, None = the plane at the first fix
    antenna: x, y, z of the receiver on the machine [m], None = by /tf_static
    """

    scans: str | None = None
    poses: str | None = None
    mount: Pose | None = None
    range_min: float = 0.05
    range_max: float = 200.0
    to_local: Callable[[Array], Array] | None = None
    antenna: tuple[float, float, float] | None = None


def polar_points(ranges: Array, azimuth: Array, elevation: Array | float = 0.0) -> Array:
    """Points in the sensor frame [m], (n, 3)."""
    flat = ranges * np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), ranges * np.sin(elevation)], axis=-1)
