"""The job: a pass of 60 m with the header, and a cart's way around the crop that stands beside it."""

import math

import numpy as np

from swath.control.job.passes import Pass
from swath.machine.machine_sheet import load_machine
from swath.signals import (
    HeapState,
    MachineLoad,
    Odometry,
    PeerState,
    Phase,
    PoseEstimate,
    Station,
)
from swath.signals.setup import ControlSetup
from tests.levels.limits import each_level, make
from tests.machine.machine_fakes import STREAM

CART, COMBINE = load_machine("tractor-grain-cart"), load_machine("lexion-700")
STEP = 100_000_000  # ns
LINE = ((0.0, 0.0), (0.0, 60.0))
FIELD = ((-15.0, 0.0), (40.0, 0.0), (40.0, 60.0), (-15.0, 60.0))


def pose_at(t, x, y, heading=0.5 * math.pi):
    return PoseEstimate(t, x, y, heading, 1.5, 0.0, np.eye(4) * 1e-4, 0.0)


@each_level("job")
def test_a_pass_and_the_way_to_it(level, limit):
    if level == "harvest":
        off = header_off_by()
        assert off <= limit
        return
    radius, away = way_to_the_combine()
    assert radius >= 9.0 * 0.99
    assert away >= limit


def header_off_by():
    """Where the header goes down and up, against 3 m before the crop and 0.5 m behind it [m]."""
    passes = (Pass(LINE), Pass(((12.0, 60.0), (12.0, 0.0))))
    part = make("job", "harvest", ControlSetup(COMBINE, {}, "left", 0.1), passes=passes)
    part.reset(STREAM)
    rows = []
    for i, north in enumerate(np.arange(-6.0, 63.0, 0.1)):
        t = i * STEP
        inputs = {
            "pose": pose_at(t, 0.0, north - COMBINE.knife_x), "odometry": Odometry(t, 1.0, 0.0, 0.0),
            "load": MachineLoad(t, 0, 0, 0, 0, 0, 0, 0),
        }  # fmt: skip
        rows.append((north, part.step(t, STEP, inputs)["header"].is_down))
    down = [north for north, is_down in rows if is_down]
    return max(abs(down[0] + 3.0), abs(down[-1] - 60.5))


def way_to_the_combine():
    """Least radius of the way, and least distance of its points to crop [m]."""
    passes = (Pass(((-9.0, 0.0), (-9.0, 60.0))), Pass(LINE))
    params = {"passes": passes, "boundary_m": FIELD, "truck_m": (50.0, -10.0), "header_m": 12.0}
    part = make("job", "shuttle", ControlSetup(CART, {}, "left", 0.1), **params)
    part.reset(STREAM)
    # beside the truck, looking north; the combine cuts 20 m up the second pass
    peer = PeerState(
        0, True, 0.1, 26.0, 50.0, 0.0, 1.5, 0.0, phase=int(Phase.CUTS), task=1, remaining=44.0,
        may_unload=True, calls=True, header_width=12.0,
    )  # fmt: skip
    none = np.zeros(1)
    inputs = {
        "pose": pose_at(0, 50.0, -10.0), "odometry": Odometry(0, 0.0, 0.0, 0.0), "peer": peer,
        "heap": HeapState(0, 0.0, 0.0, 0.0, 0.0, none, none),
        "station": Station(0, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False),
    }  # fmt: skip
    out = part.step(0, STEP, inputs)
    assert out["job"].phase == Phase.DRIVES
    x, y = out["path"].x, out["path"].y
    kept = np.append(True, np.hypot(np.diff(x), np.diff(y)) > 0.01)
    x, y = x[kept], y[kept]
    steps = np.hypot(np.diff(x), np.diff(y))
    turned = np.abs(np.diff(np.unwrap(np.arctan2(np.diff(y), np.diff(x)))))
    radius = (0.5 * (steps[1:] + steps[:-1]) / np.maximum(turned, 1e-9)).min()
    # crop: east of the second pass, and ahead of the combine
    inside = (y > -20.0) & (y < 60.0) & (x < 60.0)
    east = np.maximum(6.0 - x, x - 40.0)
    away = np.maximum(np.maximum(east, -y), 0.0)
    return radius, away[inside].min()
