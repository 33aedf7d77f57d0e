"""A machine and a bus of its own for tests of the CAN parts."""

import itertools
from pathlib import Path

import numpy as np

from swath.core.component import Port
from swath.core.frames import Pose
from swath.link.can.bus import Where
from swath.signals import CropEdge, Odometry, SteerCommand
from swath.signals.setup import ControlSetup, LinkSetup, MachineGeometry

MS, NS = 1_000_000, 1_000_000_000
GEOMETRY = MachineGeometry(3.9, 3.2, 3.0, 0.6, 12.0, 4.0, 0.0, 1.0, 1.0, (-6.0, 2.0, 1.6, 0.5, 3.9))
PORTS = (Port("edge", CropEdge, optional=True), Port("odometry", Odometry, optional=True))
_count = itertools.count()


def own_bus():
    """A virtual bus that no other test is on."""
    return Where("virtual", f"test-{next(_count)}")


def setup(slot="steer", period=0.02):
    control = ControlSetup(GEOMETRY, {"scan": Pose.from_euler((4.0, 0.0, 2.0))}, "left", period)
    outputs = (Port("command", SteerCommand),)
    return LinkSetup("combine", slot, PORTS, outputs, control, Path.cwd())


def way(count, period_ms=20, seed=1):
    """(t [ns], inputs) of a drive along an edge that wanders; an edge every 40 ms, none for a while."""
    rng = np.random.default_rng(seed)
    edge, offset = None, 6.0
    for k in range(count):
        t = k * period_ms * MS
        offset += 0.01 * rng.normal()
        if k % 2 == 0:
            bend = 0.002 * float(np.sin(0.02 * k))
            lost = 120 < k < 140
            edge = CropEdge(
                t + period_ms * MS - 33_300_000,
                float("nan") if lost else float(offset),
                float("nan") if lost else float(0.02 * rng.normal()),
                bend,
                9.0,
                0.0 if lost else 0.8,
                0.9,
                0.15,
            )
        speed = 1.9 + 0.1 * float(np.sin(0.05 * k))
        yield t, {"edge": edge, "odometry": Odometry(t + period_ms * MS, speed, 0.01 * rng.normal(), 0.0)}
