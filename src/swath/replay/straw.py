"""Where straw lies behind a machine and how deep, station by station along its way."""

from typing import Any

import numpy as np

from swath.replay.machines import Columns
from swath.runtime.world import Machine
from swath.signals import F64

STEP = 0.5  # between stations [m]
WIDTH = 1.4  # of a swath where the scenario does not say one [m]


def swath_width(machine: Machine) -> tuple[float, bool]:
    """Width [m] on which straw is laid, and whether it is chopped and spread over the header's width."""
    for slot in machine.slots_of("process"):
        said: dict[str, Any] = machine.section.slots[slot].plain()
        if str(said.get("straw", "swath")) != "swath":
            return machine.sheet.header_width, True
        return float(said.get("swath_width_m", WIDTH)), False
    return WIDTH, False


def stations(columns: Columns, straw: F64, width: float, density: float) -> F64:
    """(n, 2): time [s] and mean depth [m] of the straw laid since the station before.

    straw: (m, 2) time [s] and mass on the ground so far [kg]; density: of straw on the ground [kg/m3]
    """
    distance = np.maximum.accumulate(np.nan_to_num(columns["distance_m"]))
    marks = np.arange(0.0, float(distance[-1]) if len(distance) else 0.0, STEP)
    times = np.interp(marks, distance, columns["t_s"])
    if len(times) < 2 or not len(straw):
        return np.zeros((0, 2))
    mass = np.interp(times, straw[:, 0], straw[:, 1])
    depth = np.diff(mass, prepend=mass[0]) / (STEP * width * density)
    return np.stack([times, np.maximum(depth, 0.0)], axis=1)
