"""One case through all levels of motion: what the cheaper ones may be off."""

import math

import numpy as np
import pytest

from swath.machine.machine_sheet import load_machine, with_grain
from swath.machine.motion import kinematic, single_track
from swath.machine.motion.multibody import Multibody, Params
from swath.signals import SpeedCommand, SteerState
from tests.machine.machine_fakes import STREAM, drive, site, slope

pytest.importorskip("mujoco", reason="needs the extra `multibody`")
SHEET = load_machine("lexion-700")
G = 9.81


def levels(speed, grain=0.0, ground=None):
    """The three levels, rolling straight on at a speed [m/s], with grain [kg] in the tank."""
    start = speed * 3.6
    loaded = with_grain(SHEET, grain)
    found = (
        Multibody(Params(start_speed_kmh=start, grain_kg=grain), site(ground, SHEET)),
        single_track.SingleTrack(single_track.Params(start_speed_kmh=start), site(ground, loaded)),
        kinematic.Kinematic(kinematic.Params(start_speed_kmh=start), site(ground, loaded)),
    )
    for motion in found:
        motion.reset(STREAM)
    return found


def run(motion, seconds, steer, speed, dt=0.01):
    return drive(motion, seconds, dt=dt, steering=SteerState(0, steer, 0.0), speed=SpeedCommand(0, speed))


def turn(motion, speed, steer):
    """Step of the steering angle: curvature in the end; sideways way after 30 deg of turn [m]."""
    first = run(motion, 0.5, 0.0, speed)[-1]
    _, _, yaw = first.pose.euler()
    seconds = 1.2 * math.pi / 6 * SHEET.wheelbase / math.tan(steer) / speed + 4.0
    states = run(motion, seconds, steer, speed)
    turned = np.unwrap([s.pose.euler()[2] - yaw for s in states])
    way = np.array([s.pose.position[:2] - first.pose.position[:2] for s in states])
    aside = way @ [-math.sin(yaw), math.cos(yaw)]
    end = np.mean([s.yaw_rate / s.speed for s in states[-100:]])
    return end, float(np.interp(math.pi / 6, turned, aside))


@pytest.mark.parametrize("grain", [0.0, 8000.0])
@pytest.mark.parametrize(
    ("degrees", "speed"), [(3.0, 2.5), (11.0, 1.0), (11.0, 2.5), (28.0, 1.0), (28.0, 2.5)]
)
def test_single_track_turns_like_the_multibody(degrees, speed, grain):
    (gain, aside), (single_gain, single_aside), (plain_gain, plain_aside) = (
        turn(m, speed, math.radians(degrees)) for m in levels(speed, grain)
    )
    print(
        f"{degrees:.0f} deg, {speed} m/s, {grain:.0f} kg: "
        f"single track {single_gain / gain - 1:+.2%} yaw gain, {single_aside / aside - 1:+.2%} aside; "
        f"kinematic {plain_gain / gain - 1:+.2%}, "
        f"{plain_aside / aside - 1:+.2%}"
    )
    assert single_gain == pytest.approx(gain, rel=0.015)
    assert single_aside == pytest.approx(aside, rel=0.05)
    assert plain_gain > 1.02 * gain


def test_a_straight_line_stays_straight():
    for motion in levels(2.0):
        state = run(motion, 6.0, 0.0, 2.0)[-1]
        assert abs(state.pose.position[1]) < 1e-9
        assert state.pose.position[0] == pytest.approx(12.0, rel=5e-3)


def test_slalom_keeps_together():
    """0.25 Hz at 2 m/s: single track stays by the multibody, the kinematic level swings wider."""
    ways = []
    for motion in levels(2.0):
        places = []
        for i in range(1200):
            steer = math.radians(8.0) * math.sin(2 * math.pi * 0.25 * 0.01 * i)
            places.append(run(motion, 0.01, steer, 2.0)[-1])
        ways.append(np.array([s.yaw_rate for s in places]))
    full, single, plain = (np.abs(w[400:]).max() for w in ways)
    assert single == pytest.approx(full, rel=0.02)
    lag = [int(np.argmax(np.correlate(w[400:], ways[0][400:], "full"))) - 799 for w in ways]
    assert abs(lag[1]) <= 2
    assert lag[2] < -20  # the tyres' lag of some 0.3 s is missing
    assert abs(plain / full - 1.0) < 0.1


@pytest.mark.parametrize("speed", [1.0, 2.0, 4.0])
def test_crabs_alike_on_a_side_slope(speed):
    """10 %: the centre of gravity drifts by g sin(slope) over the stiffness per load, at any speed."""
    crabs, turns = [], []
    for motion in levels(speed, ground=slope(0.0, 0.1))[:2]:
        state = run(motion, 6.0 / min(speed, 1.5) + 3.0, 0.0, speed)[-1]
        behind = SHEET.dynamics.cg_behind
        crabs.append(-(state.lateral_speed - behind * state.yaw_rate) / state.speed)
        turns.append(state.yaw_rate)
    expected = math.sin(math.atan(0.1)) / SHEET.dynamics.stiffness
    assert crabs[0] == pytest.approx(expected, rel=0.10)
    assert crabs[0] == pytest.approx(math.radians(1.53), rel=0.03)  # the same number at every speed
    assert crabs[1] == pytest.approx(crabs[0], rel=0.02)
    assert turns[1] == pytest.approx(turns[0], rel=0.06)


@pytest.mark.parametrize("grain", [0.0, 8000.0])
def test_brakes_to_a_stop_alike(grain):
    ways = []
    for motion in levels(4.0, grain):
        start = run(motion, 0.5, 0.0, 4.0)[-1].distance
        states = run(motion, 14.0, 0.0, 0.0)
        ways.append(states[-1].distance - start)
        assert abs(states[-1].speed) < 1e-3
    assert ways[1] == pytest.approx(ways[2], rel=1e-6)
    assert ways[0] == pytest.approx(ways[1], rel=0.02)  # the braked wheels slip
