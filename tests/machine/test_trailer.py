"""A trailer behind its tractor: the tractrix, circles, its load and its pull."""

import math

import pytest

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.machine.machine_sheet import load_machine
from swath.machine.motion import articulated, kinematic, single_track
from swath.signals import HeapState, SpeedCommand, SteerState
from tests.machine.machine_fakes import STREAM, site, slope

SHEET = load_machine("tractor-grain-cart")
HITCH, TRAILER = SHEET.hitch, SHEET.trailer


def make(level, speed=1.0, ground=None, machine=SHEET):
    motion = level.LEVEL.component(level.Params(start_speed_kmh=3.6 * speed), site(ground, machine))
    motion.reset(STREAM)
    return motion


def run(motion, seconds, steer=0.0, speed=1.0, grain=None, dt=0.02):
    step = round(dt * NS)
    heap = None if grain is None else HeapState(0, grain, 0.0, 0.0, 0.0, None, None)
    inputs = {"steering": SteerState(0, steer, 0.0), "speed": SpeedCommand(0, speed), "cargo": heap}
    outputs = [motion.step(i * step, step, inputs) for i in range(round(seconds / dt))]
    return [(o["state"], o["trailer"]) for o in outputs]


def test_off_tracking_on_a_circle_of_15_m():
    """R - sqrt(R^2 + h^2 - D^2) = 0.672 m, and the angle of the trailer to it."""
    state, trailer = run(make(kinematic), 90.0, steer=math.atan(SHEET.wheelbase / 15.0))[-1]
    x, y, _ = state.pose.position
    yaw = state.pose.euler()[2]
    inner = math.hypot(trailer.x - x + 15.0 * math.sin(yaw), trailer.y - y - 15.0 * math.cos(yaw))
    assert 15.0 - inner == pytest.approx(0.67, abs=0.01)
    assert 15.0 - inner == pytest.approx(15.0 - math.sqrt(15.0**2 + 1.2**2 - 4.6**2), abs=1e-3)
    assert trailer.hitch_angle == pytest.approx(-math.atan(1.2 / 15.0) - math.atan(4.6 / inner), abs=1e-3)


@pytest.mark.parametrize("level", [kinematic, single_track, articulated])
def test_straightens_by_63_percent_in_a_drawbar_length(level):
    motion = make(level)
    if level is articulated:
        x, y, yaw, *_ = motion._q
        motion._q = (x, y, yaw, 0.0, 0.0, yaw + 0.1, *motion._q[6:])
    towed = motion._towed if level is articulated else motion.towed
    towed.yaw += 0.1
    start = towed.yaw
    states = run(motion, TRAILER.drawbar)
    left = math.tan(0.5 * states[-1][1].hitch_angle) / math.tan(0.5 * (start - 0.0))
    assert left == pytest.approx(math.exp(-1.0), abs=0.02 if level is not articulated else 0.06)


def test_loads_follow_the_grain():
    motion = make(articulated)
    _, empty = run(motion, 1.0)[-1]
    _, full = run(motion, 1.0, grain=20000.0)[-1]
    weight = 27500.0 * 9.81
    behind = (7500.0 * TRAILER.cg_ahead + 20000.0 * SHEET.box.x) / 27500.0
    assert empty.axle_load + empty.drawbar_load == pytest.approx(7500.0 * 9.81)
    assert full.axle_load + full.drawbar_load == pytest.approx(weight)
    assert full.drawbar_load == pytest.approx(weight * behind / TRAILER.drawbar)


def test_pull_of_rolling_resistance_and_of_acceleration():
    motion = make(articulated, speed=1.0)
    _, rolling = run(motion, 5.0, grain=20000.0)[-1]
    assert rolling.drawbar_pull == pytest.approx(
        SHEET.dynamics.rolling_resistance * rolling.axle_load, rel=1e-3
    )
    (a, _), (b, pulled) = run(motion, 0.2, grain=20000.0, speed=3.0)[-2:]
    rate = (b.speed - a.speed) / 0.02
    assert rate > 0.3
    assert pulled.drawbar_pull == pytest.approx(rolling.drawbar_pull + 27500.0 * rate, rel=0.02)


def test_a_loaded_trailer_pushes_the_tractor_out_of_its_curve():
    """The heavy trailer's drag pulls at the rear: at the same steering the tractor turns less."""
    turn = [run(make(articulated), 12.0, 0.2, grain=g)[-1][0].yaw_rate for g in (0.0, 20000.0)]
    assert 0.7 * turn[0] < turn[1] < 0.98 * turn[0]


def test_stands_on_a_slope():
    _, trailer = run(make(kinematic, speed=0.0, ground=slope(0.05, 0.03)), 1.0, speed=0.0)[-1]
    assert trailer.pitch == pytest.approx(-math.atan(0.05), rel=1e-6)
    assert math.tan(trailer.roll) == pytest.approx(0.03 * math.cos(trailer.pitch), rel=1e-6)


@pytest.mark.parametrize("level", [kinematic, single_track, articulated])
def test_reversing_is_refused(level):
    with pytest.raises(InputError, match="reversing with a trailer is not simulated"):
        run(make(level), 0.1, speed=-0.5)


@pytest.mark.parametrize("level", [kinematic, single_track, articulated])
def test_saved_and_loaded(level):
    motion, other = make(level), make(level)
    run(motion, 3.0, 0.15, grain=5000.0)
    other.load(motion.save())
    gone_on, again = (run(one, 1.0, 0.1, grain=6000.0)[-1][1] for one in (motion, other))
    assert repr(gone_on) == repr(again)  # nan is as it was, too


def test_articulated_needs_a_trailer():
    with pytest.raises(InputError, match="expected a tractor with a trailer"):
        make(articulated, machine=load_machine("lexion-700"))
