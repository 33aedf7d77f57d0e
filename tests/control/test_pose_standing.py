"""The pose of a machine that stands for minutes, sets off, creeps, and whose wheels say nothing."""

import math

import numpy as np
import pytest

from swath.control.pose.ekf import EkfPose
from swath.control.pose.ekf import Params as EkfParams
from swath.control.pose.raw import Params as RawParams
from swath.control.pose.raw import RawPose
from swath.control.pose.standing import Standing
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.sensing.gnss.antenna import Place
from swath.sensing.gnss.error import ErrorGnss
from swath.sensing.gnss.error import Params as GnssParams
from swath.sensing.imu.error import ErrorImu
from swath.sensing.imu.error import Params as ImuParams
from swath.sensing.odometry.error import ErrorOdometry
from swath.sensing.odometry.error import Params as OdometryParams
from swath.signals import MachineState, Odometry, SteerState
from swath.signals.setup import ControlSetup
from tests.control.path_drive import COMBINE, TRACTOR
from tests.sensing import driven_states

PERIOD = 50_000_000  # ns
STAND = (20.0, 80.0)  # s: the heading of one antenna is known before
SECOND = Place(y_m=-0.75, z_m=3.9)


def speed_then(t, pace=2.0, rise=0.6):
    """Drives, stands, sets off again [m/s]."""
    if t < 50.0:
        return min(max(STAND[0] - t, 0.0), pace)
    return min(max(rise * (t - STAND[1]), 0.0), pace)


class Bench:
    """A kinematic machine with a receiver, wheels and an inertial unit. rows: t [s], error east and north
    [m], of heading [rad], sd of position [m] and heading [rad], NEES; known poses only

    speed, bend: of the time [s], in m/s and 1/m; dead: of the time, whether the wheels read 0
    """

    def __init__(
        self, seed, speed, *, machine=COMBINE, level=EkfPose, bend=None, gnss=None, dead=None, period=PERIOD
    ):
        site = driven_states.setup_of()
        self.speed, self.bend, self.dead = speed, bend or (lambda t: 0.0), dead or (lambda t: False)
        self.base = machine.wheelbase * (1.0 if machine.steers_ahead else -1.0)
        fixes = ErrorGnss(GnssParams(antenna=Place(y_m=0.75, z_m=3.9), **(gnss or {})), site)
        unit = ErrorImu(ImuParams(), site)
        wheels = ErrorOdometry(OdometryParams(), site)
        mountings = {"fix": fixes.mounting, "inertial": unit.mounting}
        params = EkfParams() if level is EkfPose else RawParams()
        pose = level(params, ControlSetup(machine, mountings, "left", period * 1e-9))
        self.period = period
        self.parts = {"gnss": fixes, "imu": unit, "odometry": wheels, "pose": pose}
        found = {name: part.reset(Stream(seed, name)) for name, part in self.parts.items()}
        self.fix, self.i, self.at, self.rows = found["gnss"]["fix"], 0, [0.0, 0.0, 0.4], []
        self.states = []

    def run(self, seconds):
        """Until then [s]: the rows so far."""
        while self.i * self.period * 1e-9 < seconds:
            self._step()
        return np.array(self.rows)

    def after(self, seconds):
        """Rows from a time [s] on."""
        return np.array([row for row in self.rows if row[0] > seconds])

    def worst(self, until, since):
        """Largest error of position [m] and heading [rad], and in standard deviations, between times [s]."""
        self.run(until)
        rows = np.array([row for row in self.rows if row[0] > since])
        place, turn = np.hypot(rows[:, 1], rows[:, 2]), np.abs(rows[:, 3])
        return place.max(), turn.max(), (place / rows[:, 4]).max(), (turn / rows[:, 5]).max()

    def _step(self):
        before, self.i, h = self.i * self.period, self.i + 1, self.period * 1e-9
        t = self.i * self.period
        v, bend = self.speed(t * 1e-9), self.bend(t * 1e-9)
        x, y, psi = self.at
        middle = psi + 0.5 * v * bend * h
        x, y, psi = self.at = [x + v * h * math.cos(middle), y + v * h * math.sin(middle), psi + v * bend * h]
        angle = math.atan(bend * abs(self.base))
        state = MachineState(t, Pose.from_euler((x, y, 0.0), yaw=psi), v, 0.0, v * bend, angle, 0.0)
        self.states.append(state)
        inertial = self.parts["imu"].step(before, self.period, {"state": tuple(self.states[-2:])})["inertial"]
        seen = {"state": state, "steering": SteerState(t, angle, 0.0), "wheels": None}
        wheels = self.parts["odometry"].step(before, self.period, seen)["odometry"]
        if self.dead(t * 1e-9):
            wheels = Odometry(t, 0.0, wheels.yaw_rate, wheels.steer_angle)
        if t % 100_000_000 == 0:
            took = {"state": tuple(self.states[-10:])}
            self.fix = self.parts["gnss"].step(t - 100_000_000, 100_000_000, took)["fix"]
            del self.states[:-10]
        inputs = {"fix": self.fix, "odometry": (wheels,), "inertial": (inertial,)}
        pose = self.parts["pose"].step(before, self.period, inputs)["pose"]
        if math.isfinite(pose.x):
            turn = math.remainder(pose.heading - psi, 2.0 * math.pi)
            off = np.array([pose.x - x, pose.y - y, turn, pose.speed - v])
            nees = off @ np.linalg.solve(pose.covariance, off)
            sd = math.sqrt(pose.covariance[2, 2])
            self.rows.append((t * 1e-9, *off[:3], pose.position_sd, sd, nees))


def sets_off(t, pace=3.0):
    """Stands from the start, with the scale of its wheels unknown [m/s]."""
    return min(max(0.6 * (t - 150.0), 0.0), pace)


@pytest.mark.draws
@pytest.mark.parametrize(("machine", "seed"), [(COMBINE, 41), (TRACTOR, 42)])
def test_after_a_long_stand_the_pose_goes_off_with_the_machine(machine, seed):
    """The scale of the wheels is learned while they turn, not from the noise of a speed of 0."""
    bench = Bench(seed, sets_off, machine=machine, gnss={"second_antenna": SECOND}, period=20_000_000)
    place, turn, place_sd, turn_sd = bench.worst(165.0, 148.0)
    assert place < 0.06
    assert turn < math.radians(0.25)
    assert place_sd < 3.0
    assert turn_sd < 4.0  # the largest of 850


@pytest.mark.parametrize(("machine", "seed"), [(COMBINE, 51), (TRACTOR, 52)])
def test_a_stand_measures_the_gyroscope(machine, seed):
    """One antenna: the heading that was known before the stand is known after it, and into a bend."""
    bend = 0.05 if machine.steers_ahead else 0.0
    bench = Bench(
        seed,
        speed_then,
        machine=machine,
        bend=lambda t: bend * min(max((t - STAND[1] - 2.0) / 5.0, 0.0), 1.0),
    )
    _, before, *_ = bench.worst(30.0, 25.0)
    _, after, *_ = bench.worst(STAND[1], 75.0)
    assert after - before < math.radians(0.3)  # 0.1 deg/s over 60 s would be 6
    place, turn, place_sd, turn_sd = bench.worst(95.0, STAND[1])
    assert place < 0.08
    assert turn < math.radians(1.2)
    assert max(place_sd, turn_sd) < 3.0


def test_a_creep_is_no_stand():
    """0.1 m/s round a bend: the gyroscope is right, and so is the heading after 60 s."""
    bench = Bench(61, lambda t: max(0.1, min(2.0, 20.0 - t)), bend=lambda t: 0.1 if t > 22.0 else 0.0)
    place, turn, place_sd, turn_sd = bench.worst(80.0, 25.0)
    assert place < 0.06
    assert turn < math.radians(1.2)
    assert max(place_sd, turn_sd) < 3.0


@pytest.mark.parametrize("pace", [2.0, 0.3])
def test_wheels_that_read_nothing_are_not_believed_for_ever(pace):
    """From 20 s on they read 0, while the machine drives a bend: it is off for less than a second."""
    bench = Bench(71, lambda t: pace if t > 12 else 2.0, bend=lambda t: 0.03, dead=lambda t: 20.0 < t < 45.0)
    place, _, *_ = bench.worst(50.0, 19.0)
    assert place < 0.7 * pace + 0.05
    rows = bench.after(21.0)
    assert np.hypot(rows[:, 1], rows[:, 2]).max() < 0.1
    assert np.abs(rows[:, 3]).max() < math.radians(1.0)


def test_level_raw_does_not_turn_while_it_stands():
    bench = Bench(81, speed_then, level=RawPose)
    bench.run(30.0)
    before = bench.rows[-1][3]
    bench.run(STAND[1])
    assert abs(bench.rows[-1][3] - before) < math.radians(0.02)


def test_what_counts_as_a_stand():
    standing = Standing()
    assert standing.take(0.0, 0.02)
    assert standing.take(0.09, 0.02)  # noise of a sample
    assert not standing.take(0.11, 0.02)
    found = [standing.take(0.03, 0.02) for _ in range(200)]
    assert not found[-1]  # a creep
    found = [standing.take(0.0, 0.02) for _ in range(50)]
    assert found[-1]
