"""Control: a straight edge to detect and to steer along, even crop to drive into, a stand to look through."""

import math

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.units import KMH
from swath.scenario.slots import CATALOGUE
from swath.signals import Fix, MachineState, Odometry, Station
from swath.signals.setup import ControlSetup
from tests.control.closed_loop import Loop, setup_of
from tests.control.edge_drive import drive, errors
from tests.control.feed_rig import STEP, Bench
from tests.control.path_drive import COMBINE, PERIOD, PathDrive
from tests.control.test_feed_rate import even, random_stand
from tests.field.made_field import made_field
from tests.levels.limits import each_level, keys_of, make
from tests.machine.machine_fakes import site

EVEN = 1.6  # crop [kg/m2]


def component(slot, level):
    return CATALOGUE.registry.get(slot, level).component


@each_level("edge")
def test_offset_of_a_straight_edge(level, limit):
    """Driven past wheat of 500 stems/m2; the one that sees the truth looks at the field itself."""
    if level != "truth":
        found = CATALOGUE.registry.get("edge", level)
        rows = drive(level=found.component, kind=found.params, scans=150, roll_sd=np.radians(1.0))
        share, rmse, *_ = errors(rows)
        assert share == 1.0
        assert rmse < limit
        return
    truth = make("edge", level, site(made_field()))
    for aside in (6.0, 6.1, 6.37):  # from the axle's middle to the edge, which runs north through x = 0
        pose = Pose.from_euler((aside, 5.0, 0.0), yaw=np.pi / 2)
        edge = truth.step(0, STEP, {"state": MachineState(0, pose, 0.0, 0.0, 0.0, 0.0, 0.0)})["edge"]
        assert edge.offset == pytest.approx(aside, abs=limit)


@pytest.mark.parametrize("extinction", [1.0, 2.0, 4.0, 8.0])
@pytest.mark.parametrize("ragged", [0.0, 0.05])
@each_level("ahead")
def test_extinction_of_a_random_stand(level, limit, extinction, ragged):
    """The mean over 20 scans of 400 beams: unbiased although the top is ragged."""
    found = []
    for seed in range(20):
        scan, pose = random_stand(extinction, 0.85, count=400, seed=seed, ragged=ragged)
        sight = make("ahead", level, setup_of(mounting=pose))
        sight.reset(Stream(1, "ahead"))
        found.append(sight.step(0, STEP, {"scan": scan})["ahead"].extinction)
    assert np.mean(found) == pytest.approx(extinction, rel=limit)
    assert np.std(found) / np.mean(found) < 0.2


@each_level("pose")
def test_pose_of_a_machine_that_drives_straight_on(level, limit):
    """With an antenna ahead of its axle and to the left, 50 ms late; heading 0.5 rad."""
    antenna = Pose.from_euler((2.0, 0.5, 3.9))
    part = make("pose", level, ControlSetup(COMBINE, {"fix": antenna}, "left", PERIOD * 1e-9))
    part.reset(Stream(1, "pose"))
    c, s, found = math.cos(0.5), math.sin(0.5), None
    for i in range(1, 500):
        t = i * PERIOD
        late = max(t - 50_000_000, 0) * 2e-9
        x, y = c * late + 2.0 * c - 0.5 * s, s * late + 2.0 * s + 0.5 * c
        fix = Fix(max(t - 50_000_000, 0), x, y, 3.9, 2.0, 0.5, 0.01, 0.02, 0.03, 4)
        inputs = {"fix": fix, "odometry": (Odometry(t, 2.0, 0.0, 0.0),), "inertial": ()}
        found = part.step(t - PERIOD, PERIOD, inputs)["pose"]
    way = 2e-9 * found.t
    assert (found.x, found.y) == pytest.approx((c * way, s * way), abs=limit)
    assert found.heading == pytest.approx(0.5, abs=limit)
    assert found.speed == pytest.approx(2.0, abs=limit)


@each_level("steer")
def test_error_along_a_straight_edge(level, limit):
    """An open loop stays on the line on which it starts; a closed one is given an edge known to 3 cm."""
    found = CATALOGUE.registry.get("steer", level)
    if level == "station":
        assert largest_difference(found, aside=1.0) < limit
        return
    if level == "path":
        params = found.params(points_m=((0.0, 0.0), (100.0, 0.0)))
        error = PathDrive(params, seed=2).run(25.0)[0][500:, 2]
        assert np.sqrt(np.mean(error**2)) < limit
        return
    loop = Loop(speed=7 * KMH, law=found.component, law_params=found.params())
    error = loop.run(60)
    assert np.sqrt(np.mean(error[error[:, 0] > 10.0, 1] ** 2)) < limit


@each_level("speed")
def test_speed_in_even_crop(level, limit):
    """36 kg/s on 12 m of 1.6 kg/m2, or the speed that was set."""
    wanted = 36.0 / (12.0 * EVEN)
    if level == "station":
        assert closes_up(CATALOGUE.registry.get("speed", level)) < limit
        return
    by_flow = "throughput_kg_s" in keys_of("speed", level)
    params = {"throughput_kg_s": 36.0} if by_flow else {"speed_kmh": wanted / KMH}
    found = CATALOGUE.registry.get("speed", level)
    bench = Bench(found.component, found.params(**params), even(EVEN), sight=10.0, chart=even(EVEN))
    assert bench.run(100.0)[-1][2] == pytest.approx(wanted, rel=limit)


def largest_difference(found, aside, speed=2.0, h=0.01):
    """A kinematic machine that starts `aside` of its path, against e'' + 2 z e' / d + e / d^2 = 0, [m]."""
    law = found.component(found.params(), setup_of())
    law.reset(Stream(1, "steer"))
    d, e, heading, worst = 4.0, aside, 0.0, 0.0
    root = math.sqrt(1.0 - 0.9**2)
    for i in range(1500):
        station = Station(i, True, 0.0, e, -heading, 0.0, speed, 0.0, 0.0, False)
        inputs = {"station": station, "odometry": Odometry(i, speed, 0.0, 0.0)}
        curvature = law.step(i, 1, inputs)["command"].curvature
        middle = heading + 0.5 * speed * h * curvature
        e -= speed * h * math.sin(middle)
        heading += speed * h * curvature
        s = speed * h * (i + 1) / d
        exact = aside * math.exp(-0.9 * s) * (math.cos(root * s) + 0.9 / root * math.sin(root * s))
        worst = max(worst, abs(e - exact))
    return worst


def closes_up(found, behind=1.0, h=0.01):
    """A drive with a lag of 1 s, 1 m behind its place, against T d'' + d' + k d = 0, [m]."""
    law = found.component(found.params(), setup_of())
    law.reset(Stream(1, "speed"))
    gap, speed, worst = behind, 1.2, 0.0
    half = math.sqrt(0.4 - 0.25)
    for i in range(2000):
        station = Station(i, True, gap, 0.0, 0.0, 0.0, 1.2, 0.0, 0.0, False)
        wanted = law.step(i, 1, {"station": station})["command"].speed
        faster = wanted + (speed - wanted) * math.exp(-h)
        gap += h * (1.2 - 0.5 * (speed + faster))
        speed = faster
        t = h * (i + 1)
        exact = behind * math.exp(-0.5 * t) * (math.cos(half * t) + 0.5 / half * math.sin(half * t))
        worst = max(worst, abs(gap - exact))
    return worst
