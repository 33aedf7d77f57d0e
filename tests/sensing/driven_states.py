"""True states of a machine that moves as a formula says, handed to a sensor step by step."""

from types import SimpleNamespace

import numpy as np

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.field.site_setup import Bodies
from swath.signals import MachineState

STATE_STEP = 5_000_000  # the motion runs at 200 Hz


def setup_of(origin=None, start=None, period=0.1):
    start = Pose.identity() if start is None else start
    return SimpleNamespace(
        origin=origin, machine=None, edge_side="left", start=start, period=period, bodies=Bodies()
    )


def standing(**angles):
    pose = Pose.from_euler((10.0, 20.0, 0.5), **angles)
    return lambda s: pose


def straight(speed, yaw=0.0):
    way = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    return lambda s: Pose.from_euler(speed * s * way, yaw=yaw)


def circle(speed, radius):
    """To the left, from the origin eastward."""

    def pose(s):
        a = speed * s / radius
        return Pose.from_euler((radius * np.sin(a), radius * (1.0 - np.cos(a)), 0.0), yaw=a)

    return pose


def rolling(amplitude, frequency):
    return lambda s: Pose.from_euler((0.0, 0.0, 0.0), roll=amplitude * np.sin(2 * np.pi * frequency * s))


def state(pose_of, t):
    return MachineState(t, pose_of(t / NS), 0.0, 0.0, 0.0, 0.0, 0.0)


def feed(sensor, pose_of, steps, *, step=100_000_000, first=0, state_step=STATE_STEP):
    """Outputs of `steps` steps from the step number `first` on; the state at t = 0 comes with the first."""
    found = []
    for k in range(first, first + steps):
        begin, end = k * step, (k + 1) * step
        times = list(range(begin // state_step * state_step + state_step, end + 1, state_step))
        times = [0, *times] if k == 0 else times
        states = tuple(state(pose_of, t) for t in times)
        (sample,) = sensor.step(begin, step, {"state": states}).values()
        found.append(sample)
    return found


def column(samples, name):
    return np.array([getattr(s, name) for s in samples])
