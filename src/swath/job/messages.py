"""What combines tell of themselves where passes are shared out before the job: as by radio with sensors, but
heard at once and without error.
"""

import math
from collections.abc import Sequence

from swath.control.job.abreast import own_passes
from swath.control.job.passes import Pass, way_along
from swath.core.schedule import NS
from swath.job.combine_ways import axle_pose
from swath.job.path import Pose
from swath.job.states import CombineState, at
from swath.signals import PeerState, Phase

PHASES = {"cut": Phase.CUTS, "way": Phase.TURNS, "stand": Phase.STANDS, "done": Phase.DONE}


class Messages:
    """passes: as machines are told them"""

    def __init__(self, passes: Sequence[Pass]) -> None:
        self._passes, self._lengths = passes, [way_along(work.line_m) for work in passes]
        self._own = {work.combine: own_passes(passes, work.combine) for work in passes}

    def own(self, c: CombineState) -> list[int]:
        """Numbers of the passes of a combine, in its order."""
        return self._own[c.number]

    def length(self, task: int) -> float:
        """Of a pass [m]."""
        return self._lengths[task]

    def come(self, c: CombineState) -> tuple[int, float]:
        """Number of its pass, or of the one behind which it turns, and how far it has come from its begin
        [m].
        """
        if c.index < 0:  # behind its last one
            last = self._own[c.number][-1]
            return last, self._lengths[last]
        if c.phase != "way":
            return c.index, self._lengths[c.index] - c.left
        if c.before < 0:
            return c.index, -c.left
        turn = self._passes[c.before].turn_length
        return c.before, self._lengths[c.before] + max(turn - c.left, 0.0)

    def progress(self, time: float, c: CombineState) -> PeerState:
        """How far it has come at a time [s]."""
        task, come = self.come(c)
        t, phase, nan = round(time * NS), _phase(c), math.nan
        return PeerState(t, True, 0.0, nan, nan, nan, c.speed, 0.0, phase=int(phase), task=task, come=come)

    def to_cart(self, c: CombineState, here: Pose) -> PeerState:
        """As a cart at a place hears it: where the combine is, its outline, and the rest of its pass. In its
        turn it is taken to be at the end of the pass before.
        """
        (task, come), phase, sheet = self.come(c), _phase(c), c.spec.sheet
        if phase == Phase.TURNS and c.before < 0:  # before its first pass
            phase, come = Phase.CUTS, 0.0
        (rear, front, half, *_), axle = sheet.body, axle_pose(at(c), sheet.knife_x)
        cos, sin = math.cos(here.heading), math.sin(here.heading)
        dx, dy = axle.x - here.x, axle.y - here.y
        turned = math.remainder(axle.heading - here.heading, 2.0 * math.pi)
        return PeerState(
            0, True, 0.0, cos * dx + sin * dy, cos * dy - sin * dx, turned, c.speed, 0.0,
            phase=int(phase), task=task, come=come,
            remaining=math.nan if phase == Phase.TURNS else self._lengths[task] - come,
            body_rear=rear, body_front=front, body_width=2.0 * half,
            header_front=sheet.knife_x, header_left=sheet.header_y, header_width=sheet.header_width,
        )  # fmt: skip


def _phase(c: CombineState) -> Phase:
    if c.phase == "cut" and c.left <= 0.0:
        return Phase.TURNS
    return PHASES.get(c.phase, Phase.STANDS)
