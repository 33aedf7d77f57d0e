"""Stanley's law for rear steering: heading error plus the cross-track error over the speed.

delta = angle + atan(k e / v), Hoffmann et al. 2007 (doi:10.1109/ACC.2007.4282788, eq. 5), is meant for the
steered front axle of a car. A machine that steers behind a fixed front axle turns about the same point as a
car whose steered axle lies one wheelbase AHEAD of the fixed one; error and angle are taken there, at that
mirror image of the steered axle, against the line that it draws when the header end is on its target. v / k
is the preview distance. A rival of `preview`, which takes both at the header end, with the same prediction.
"""

from swath.control.steer.plant_model import STANLEY
from swath.control.steer.preview import Params, Preview
from swath.core.registry import Level


class Stanley(Preview):
    """The mirror image of the steered axle is aimed along the edge."""

    law = STANLEY


LEVEL = Level(
    Stanley,
    Params,
    summary="Stanley's law (Hoffmann et al. 2007) at the mirror image of the steered axle",
    cost="some 20 us per step",
    tolerance="3 cm RMS at 7 km/h on a straight edge known to 3 cm",
)
