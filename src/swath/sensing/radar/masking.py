"""What echoes nearer and farther add to the threshold of a detector that averages cells (CFAR).

The training bins, half a resolution cell each, lie to both sides in distance behind a guard; the power of
an echo in them counts there with the window of its place, azimuth and speed (detector.py). So what is longer
than the guard raises its own threshold, and a wall that of a person some cells before it.
"""

import numpy as np

from swath.sensing.radar.detector import GUARD, window
from swath.signals import F64

TRAINING = 16  # bins on both sides together, as level `rays` has by default


def in_training(places: F64, cell: tuple[float, float, float]) -> F64:
    """Mean power in the training bins of each echo, from each other one of power 1: (n, n), row: whose bins.

    places: distance [m], azimuth [rad] and radial speed [m/s] of the echoes, (n, 3)
    """
    apart = (places[None, :, :] - places[:, None, :]) / np.array(cell)
    reach = GUARD + TRAINING // 2
    bins = 0.5 * np.array([k for k in range(-reach, reach + 1) if abs(k) > GUARD])
    along = (window(apart[:, :, :1] - bins) ** 2).sum(axis=2) / TRAINING
    beside = window(apart[:, :, 1]) ** 2 * window(apart[:, :, 2]) ** 2
    slope = (places[None, :, 0] / places[:, None, 0]) ** 4  # the detector levels the echo of flat ground
    return np.asarray(along * beside * slope * (1.0 - np.eye(len(places))))
