"""What a radar detected in one look."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from swath.core.frozen import frozen
from swath.core.signal import About, Message, Quantity, Signal, TrackColumn
from swath.signals.arrays import F64
from swath.signals.ranges import ANGLE, DEVIATION, HEADING, MEASURED_SPEED, RECEIVED, SIGHT
from swath.signals.scan import beam_directions

_N = ("target_count",)
_COUNT = (TrackColumn("radar_target_count", "-", "detections of a look", lambda x: float(len(x))),)
_MESSAGES = (
    Message("swath_msgs/RadarTargets"),
    Message(
        "sensor_msgs/PointCloud2",
        "x, y, z, radial_speed, rcs, snr, azimuth_angle, elevation_angle, range",
        "/machine/slot/output_points",
    ),
    Message(
        "radar_msgs/RadarScan",
        "range, azimuth, elevation (0 where it is not measured), doppler_velocity, amplitude = SNR in dB",
        "/machine/slot/output_returns",
    ),
)


@frozen
class RadarTargets(
    Signal, about=About("sensor", _MESSAGES, seen_as="points in run.mcap; a column counts them")
):
    """Detections of one look of a radar at the time t, the nearest first; it comes out later.

    Radial speeds are those that the radar measures: against itself, its own motion is in them.
    """

    range: Annotated[F64, Quantity("m", "measured distance", _N, columns=_COUNT, span=SIGHT)]
    azimuth: Annotated[F64, Quantity("rad", "from the x axis of the sensor, > 0 left", _N, span=HEADING)]
    elevation: Annotated[
        F64, Quantity("rad", "above its x-y plane", _N, "the radar does not measure it", span=ANGLE)
    ]
    radial_speed: Annotated[
        F64, Quantity("m/s", "change of the distance, > 0 goes away", _N, "not reported", span=MEASURED_SPEED)
    ]
    rcs: Annotated[
        F64,
        Quantity(
            "",
            "radar cross section as from the echo's power, 10 lg of m2 [dBsm]",
            _N,
            "not reported",
            span=RECEIVED,
        ),
    ]
    snr: Annotated[F64, Quantity("", "signal to noise [dB]", _N, "not known", span=RECEIVED)]
    range_sd: Annotated[F64, Quantity("m", "1 sigma", _N, "not known", span=DEVIATION)]
    azimuth_sd: Annotated[F64, Quantity("rad", "1 sigma", _N, "not known", span=DEVIATION)]
    speed_sd: Annotated[F64, Quantity("m/s", "1 sigma of the radial speed", _N, "not known", span=DEVIATION)]

    def points(self) -> F64:
        """Detections in the sensor frame [m], (target_count, 3); in its plane where no elevation is known."""
        return self.range[:, None] * beam_directions(self.azimuth, np.nan_to_num(self.elevation))


def radar_targets_of(t: int, rows: Sequence[Sequence[float]]) -> RadarTargets:
    """A sample from a row per detection, with its numbers in the order of the fields."""
    return RadarTargets(
        t, *np.array(sorted(tuple(row) for row in rows), dtype=np.float64).reshape(-1, 9).T.copy()
    )
