"""The unloading pipe of a grain tank: where grain that leaves the tank comes out."""

import numpy as np

from swath.core.frames import Array
from swath.field.site_setup import SiteSetup
from swath.signals import MachineState

BESIDE_HEADER = 1.5  # of the pipe's end, leftward beyond the header [m]: the middle of a cart; an estimate


class UnloadingPipe:
    """Pours grain out at its end: to the left of the header, over the fixed axle, at the top of the body."""

    def __init__(self, setup: SiteSetup) -> None:
        machine = setup.machine
        left = machine.header_y + 0.5 * machine.header_width + BESIDE_HEADER
        self._setup = setup
        self.end: Array = np.array([0.0, left, machine.body[4]])

    def pour(self, mass_kg: float, state: MachineState) -> None:
        """Hand grain [kg] over to whatever is below the end of the pipe."""
        if mass_kg > 0.0:
            self._setup.receiver.receive(mass_kg, state.pose.apply(self.end))
