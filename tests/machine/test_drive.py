"""The drive alone: the loop of its rims, and the slip of the wheels that they turn, on drawn cases."""

from dataclasses import replace
from math import atan, sqrt

import numpy as np
import pytest

from swath.machine.loops import SpeedLoop
from swath.machine.machine_sheet import load_machine
from swath.machine.traction import DrivenWheels, Traction
from swath.machine.tyre import GRAVITY

DYNAMICS = load_machine("lexion-700-class").dynamics
SEEDS = range(20)


def drawn_loop(seed):
    """(loop, its lag, limits, a speed, a wanted one)."""
    draw = np.random.default_rng(seed)
    lag, accel, decel = draw.uniform(0.1, 2.0), draw.uniform(0.2, 2.0), draw.uniform(0.2, 2.0)
    d = replace(DYNAMICS, speed_lag=lag, accel=accel, decel=decel, max_speed=4.0)
    return SpeedLoop(d), lag, (accel, decel), *draw.uniform(-4.0, 6.0, 2).tolist(), draw


@pytest.mark.parametrize("seed", SEEDS)
def test_a_loop_solves_its_equation(seed):
    """Of first order, the rate limited: by `accel` where the speed grows, by `decel` where it falls."""
    loop, lag, (accel, decel), speed, wanted, draw = drawn_loop(seed)
    target, count, seconds = min(max(wanted, -4.0), 4.0), 100_000, draw.uniform(0.1, 3.0)
    limit = accel if abs(target) > abs(speed) and target * speed >= 0.0 else decel
    v, way, h = speed, 0.0, seconds / count
    for _ in range(count):
        way += h * v
        v += h * min(max((target - v) / lag, -limit), limit)
    assert loop.advance(speed, wanted, seconds) == pytest.approx((v, way), abs=1e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_where_a_loop_ends_does_not_depend_on_the_steps_it_is_taken_in(seed):
    loop, _, _, speed, _, draw = drawn_loop(seed)
    wanted = speed * draw.choice([0.0, 0.5, 1.0, 1.5])  # toward one side: its limit is one throughout
    first, then = draw.uniform(0.01, 2.0, 2).tolist()
    middle, way = loop.advance(speed, wanted, first)
    end, more = loop.advance(middle, wanted, then)
    assert loop.advance(speed, wanted, first + then) == pytest.approx((end, way + more), abs=1e-12)


def drawn_wheels(seed):
    """(wheels, their traction, a speed)."""
    draw = np.random.default_rng(seed)
    stiffness, friction = draw.uniform(5.0, 20.0), draw.uniform(0.4, 0.9)
    traction = Traction(stiffness, friction, draw.uniform(0.2, 1.0), draw.uniform(0.5, 0.9), 0.7, 0.3)
    wheels, speed = DrivenWheels(DYNAMICS), float(draw.uniform(0.5, 3.0))
    wheels.reset(speed)
    return wheels, traction, speed, draw


@pytest.mark.parametrize("seed", SEEDS)
def test_wheels_slip_until_the_brush_carries_the_slope(seed):
    """mu (1 - (1 - x)^3), x = stiffness |slip| / (3 mu), over the load that the slope leaves them."""
    wheels, t, speed, draw = drawn_wheels(seed)
    grade = draw.uniform(-0.8, 0.8) * t.friction * 0.5
    ways = [wheels.advance(speed, 0.05, -atan(grade), t) for _ in range(1000)]
    x = t.stiffness * abs(wheels.slip) / (3.0 * t.friction)
    carried = (1.0 - (1.0 - x) ** 3) * t.friction * (0.7 - 0.3 * grade)
    assert np.sign(grade) * carried == pytest.approx(grade, rel=1e-9)
    assert wheels.speed == pytest.approx(speed / (1.0 + wheels.slip), rel=1e-12)
    assert ways[-1] == pytest.approx((wheels.speed, 0.05 * wheels.speed), rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_wheels_give_no_more_than_they_grip_and_the_drive_pushes(seed):
    """Braked downhill, sped up uphill, steeper than what holds it."""
    wheels, t, speed, draw = drawn_wheels(seed)
    t, sense = t._replace(**{draw.choice(["friction", "thrust"]): 0.05}), draw.choice([-1.0, 1.0])
    grade = sense * draw.uniform(0.1, 0.3)
    level = 1.0 / sqrt(1.0 + grade**2)
    most = min(t.friction * (0.7 - 0.3 * grade) * level, t.thrust)
    _, way = wheels.advance(0.0 if sense < 0.0 else 5.0, 0.02, -atan(grade), t)
    assert wheels.speed == pytest.approx(speed + 0.02 * GRAVITY * (sense * most - grade * level), rel=1e-12)
    assert way == pytest.approx(0.01 * (speed + wheels.speed), rel=1e-12)
    assert wheels.rim == pytest.approx(wheels.speed * (1.0 + wheels.slip), rel=1e-15)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_way_of_wheels_is_that_of_many_short_steps(seed):
    """To the second order, while the slip grows, by 2e-4 and more, and the speed changes."""
    wheels, t, speed, draw = drawn_wheels(seed)
    fine, _, _, _ = drawn_wheels(seed)
    pitch, wanted = -atan(0.2 * t.friction), speed * draw.uniform(0.9, 1.1)
    middle, way = wheels.advance(wanted, 0.02, pitch, t)
    ways = [fine.advance(wanted, 0.0002, pitch, t)[1] for _ in range(100)]
    assert way == pytest.approx(sum(ways), rel=7e-5)
    assert middle == pytest.approx(sum(ways[45:55]) / 0.002, rel=1e-4)


def test_wheels_go_on_from_a_saved_moment():
    wheels, t, speed, _ = drawn_wheels(1)
    wheels.advance(speed, 0.1, 0.1, t)
    kept = wheels.save()
    first = [wheels.advance(0.0, 0.1, 0.1, t) for _ in range(5)]
    wheels.load(kept)
    assert [wheels.advance(0.0, 0.1, 0.1, t) for _ in range(5)] == first
