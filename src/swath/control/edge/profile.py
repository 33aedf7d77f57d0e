"""What detectors share: the side of the crop.

Detectors work in (x, u, z): x forward, u TOWARD THE CROP, z up from the machine's ground plane. With the edge
at the left header end the crop lies to the right, so u = -y; with the edge at the right end u = +y. All later
arithmetic is the same for both sides, so left and right give mirrored results exactly.
"""

from math import sqrt

EVENLY = sqrt(12.0)  # width of an even spread over its standard deviation
TOLERANCE = 0.10  # m, of the confidence
LEAST_SURE = 0.01  # confidence of an edge that is reported
TUKEY, MAD = 4.685, 1.4826  # of robust fits: where a weight becomes none, deviation over median
UNSURE = 0.45  # the greatest one of an edge that is held, not seen


def crop_sign(edge_side: str) -> float:
    """+1 when the crop lies to the left of the edge (y grows into it), -1 when it lies to the right."""
    return -1.0 if edge_side == "left" else 1.0
