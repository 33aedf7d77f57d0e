"""A step of `single_track` in Python, substep by substep: what its kernel is compared with."""

from math import ceil

import warp as wp

from swath.core.schedule import NS
from swath.core.units import MS
from swath.kernels import Row, repeatable
from swath.machine.attitude import TerrainFollower
from swath.machine.loops import SpeedLoop
from swath.machine.machine_sheet import dynamics_of
from swath.machine.motion.single_track_kernel import Car, Drive, Moment, Track, held, integrated
from swath.machine.traction import DrivenWheels
from swath.signals import MachineState

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.kernel
def advance(
    cars: wp.array(dtype=Car),
    drives: wp.array(dtype=Drive),
    moments: wp.array(dtype=Moment),
    tracks: wp.array(dtype=Track),
):
    m = held(cars[0], drives[0])
    tracks[0] = integrated(tracks[0], drives[0], cars[0], m)
    moments[0] = m


class PlainSingleTrack:
    """Of a part as it was reset."""

    def __init__(self, part, setup):
        self._part, self._follower = part, TerrainFollower(setup.field, setup.machine)
        self._wheels = DrivenWheels(SpeedLoop(dynamics_of(setup.machine)))
        self._wheels.reset(part.start_speed)
        rows = tuple(Row(struct) for struct in (Car, Drive, Moment, Track))
        self._car, self._drive, self._moment, self._q = rows
        self._traction, numbers = part.weighed(0.0)
        self._car.write(*numbers)
        self._ahead = numbers[0]
        self._q.write(*part.start, *[0.0] * 5)
        self._follower.at(*part.start)
        self._advance = repeatable(advance, [row.array for row in rows]).launch

    def step(self, t, dt, steer, wanted):
        count = max(1, ceil(dt / NS / (self._part.params.substep_ms * MS) - 1e-9))
        h, read = dt / NS / count, self._q.read
        for _ in range(count):
            start = self._wheels.speed
            middle, _ = self._wheels.advance(wanted, h, self._follower.stance.pitch, self._traction)
            held_now = start, middle, self._wheels.speed, self._part.sense * steer, *self._follower.stance[1:]
            self._drive.write(h, *held_now)
            self._advance()
            self._follower.at(*read()[:3])
        _, _, _, side, turn, _, _, distance = read()
        lateral = side + self._ahead * turn
        return MachineState(t + dt, self._follower.pose(), self._wheels.speed, lateral, turn, steer, distance)

    @property
    def axle_loads(self):
        _, _, fixed, steered, _, _ = self._moment.read()
        return fixed, steered
