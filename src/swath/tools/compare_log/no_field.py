"""The site of a machine that is driven by a log, which has no field."""

from math import floor
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from swath.core.frames import Pose
from swath.field.cutting.land import Tasks
from swath.field.field import Field
from swath.field.ground.footprint import Footprint
from swath.field.moisture import Moisture
from swath.field.site_setup import SiteSetup
from swath.machine.machine_sheet import MachineSheet
from swath.signals import F64

NODE_M = 1000.0  # m between nodes of flat ground


class NoField:
    """Flat, firm ground that forgets the straw; the crop is the machine's."""

    stand = SimpleNamespace(crop="")
    moisture, soil = Moisture(), None

    def footprint(self, points: Any) -> Footprint:
        """Ground height under points: 0."""

        def around(u: float, v: float, room: float, turn: tuple[float, float]) -> tuple[int, int, F64]:
            return floor(u) - 1, floor(v) - 1, np.zeros((4, 4))

        return Footprint(points, (1.0, 0.0), NODE_M, around)

    def deposit_straw(self, polygon: Any, mass: float, /, *, heading: float | None = None) -> None:
        """Nothing to do."""

    def lend(self, tasks: Tasks, world: int, /) -> None:
        """Compiled code does not know it."""


def site_of(machine: MachineSheet, period: float) -> SiteSetup:
    """What a part of the machine is given. period: of its steps [s]."""
    return SiteSetup(cast(Field, NoField()), machine, Pose.identity(), "left", period)
