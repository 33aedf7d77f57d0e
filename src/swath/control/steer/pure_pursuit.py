"""Pure pursuit of the crop edge: the circle through a point of the target ahead.

The fixed axle drives the circle through the point of the target's tangent that lies the preview distance
ahead of the header end, kappa = 2 y / (x^2 + y^2) (Coulter 1992, CMU-RI-TR-92-01), with y how far that point
lies beside where the header end is carried. The circle is the fixed axle's, wherever the machine steers.
It cuts bends: a rival of `preview`, with the same prediction and slip observer.
"""

from swath.control.steer.plant_model import PURE_PURSUIT
from swath.control.steer.preview import Params, Preview
from swath.core.registry import Level


class PurePursuit(Preview):
    """The machine drives the circle through a point of the target."""

    law = PURE_PURSUIT


LEVEL = Level(
    PurePursuit,
    Params,
    summary="the circle through a point of the edge ahead (Coulter 1992), with prediction and slip observer",
    cost="some 20 us per step",
    tolerance="3 cm RMS at 7 km/h on a straight edge known to 3 cm; cuts bends",
)
