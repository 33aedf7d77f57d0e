"""The multibody machine over ditches: how long wheels are in the air, against a half-car of our own."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.machine.machine_sheet import load_machine, masses_of
from swath.machine.motion.multibody import Multibody, Params
from swath.signals import SpeedCommand, SteerState
from tests.machine.machine_fakes import STREAM, Ground, drive, site

pytest.importorskip("mujoco", reason="needs the extra `multibody`")
SHEET = load_machine("lexion-700")
D, M = SHEET.dynamics, masses_of(SHEET)
G, DEPTH = 9.81, 0.25
ROLLING = 0.08  # stubble, over load; the flight times below were found with it
AHEAD, BEHIND = D.cg_behind, SHEET.wheelbase - D.cg_behind  # axles from the centre of gravity


def make(ground, machine=SHEET, **params):
    motion = Multibody(Params(rolling_resistance=ROLLING, **params), site(ground, machine))
    motion.reset(STREAM)
    return motion


def run(motion, seconds, *, speed=2.0, dt=0.01):
    steering, wanted = SteerState(0, 0.0, 0.0), SpeedCommand(0, speed)
    return drive(motion, seconds, dt=dt, steering=steering, speed=wanted)


def section(width):
    """Depth of a ditch at x = 6 m, cosine."""
    return lambda s: np.where(
        np.abs(s - 6.0) < 0.5 * width, -0.5 * DEPTH * (1 + np.cos(2 * np.pi * (s - 6.0) / width)), 0.0
    )


def ditch(width, skew=0.0):
    return Ground(lambda x, y: section(width)(x + skew * y))


def cross(motion, speed=2.0):
    """Longest time in the air [s] of the front and of the rear wheels; place and forward speed of the way."""
    air, way, pace = np.zeros(4), [], []
    centre = np.array([-D.cg_behind, 0.0, D.cg_height])
    for _ in range(round(1300 / speed)):
        state = run(motion, 0.01, speed=speed)[-1]
        air = np.maximum(air, motion.wheels.air_times)
        way.append(state.pose.position[0])
        pace.append((state.pose.position + state.pose.rotation @ centre)[0])
    assert way[-1] > 11.0
    return air[:2].max(), air[2:].max(), np.array(way), np.array(pace)


@pytest.mark.parametrize(("skew", "suspension"), [(0.0, True), (0.5, False)])
def test_no_wheel_flies_over_a_wide_ditch(skew, suspension):
    motion = make(ditch(4.0, skew), start_speed_kmh=7.2, suspension=suspension)
    low, air = 0.0, 0.0
    for _ in range(600):
        state = run(motion, 0.01)[-1]
        air, low = max(air, *motion.wheels.air_times), min(low, state.pose.position[2])
    assert air < 0.3
    assert low < -0.12


@pytest.mark.parametrize("width", [1.0])
def test_at_an_angle_no_wheel_flies(width):
    front, rear, *_ = cross(make(ditch(width, 0.5), start_speed_kmh=7.2))
    assert max(front, rear) < 0.3


def half_car(ground, way, accel, h):
    """Longest time in the air [s] of the rear axle: one rigid body, two vertical tyres, along a given way.

    way: of the front axle [m], accel: of the centre of gravity [m/s2], every h [s]. The force that slows it
    acts on the ground.
    """
    inertia, axles = M.pitch_inertia, []
    for arm, other, axle, deflection in (
        (AHEAD, BEHIND, D.front, M.front_deflection),
        (-BEHIND, AHEAD, D.rear, M.rear_deflection),
    ):
        load, radius = D.mass * G * other / SHEET.wheelbase, axle.radius + deflection
        s = 0.65 * radius * np.linspace(-1.0, 1.0, 31)
        down = np.sqrt(radius**2 - s**2)
        rate = load / np.maximum(down - axle.radius, 0.0).sum()
        damper = 2.0 * M.tyre_damping * load * math.sqrt(1.5 / (G * deflection))
        axles.append((arm, axle.radius, s, down, rate, damper, load))
    z = pitch = rise = turn = air = longest = 0.0
    for x, before, push in zip(way[1:], way, accel[1:], strict=False):
        up, moment = -D.mass * G, D.mass * push * D.cg_height
        for arm, radius, s, down, rate, damper, load in axles:
            under = ground(x + arm - AHEAD + s)
            sunk = np.maximum(under - z - radius - arm * pitch + down, 0.0)
            spring, force = rate * sunk.sum(), 0.0
            if spring > 0.0:
                climb = float(sunk @ np.gradient(under, s)) / sunk.sum() * (x - before) / h
                damping = damper * np.cbrt(spring / load) * (climb - rise - arm * turn)
                force = max(spring + damping, 0.0)
            if arm < 0.0:
                air = 0.0 if spring > 0.0 else air + h
                longest = max(longest, air)
            up, moment = up + force, moment + force * arm
        rise, turn = rise + h * up / D.mass, turn + h * moment / inertia
        z, pitch = z + h * rise, pitch + h * turn
    return longest


@pytest.mark.parametrize(("width", "rear_s"), [(1.0, 0.33), (2.0, 0.52), (4.0, 0.17)])
def test_square_on_the_rear_axle_is_thrown_up_as_bodies_are(width, rear_s):
    """The half-car flies as long or longer: it has no pendulum axle and no rear wheels of their own mass."""
    front, rear, way, x = cross(make(ditch(width), start_speed_kmh=7.2))
    t, h = 0.01 * np.arange(len(way)), 0.002
    fine = np.arange(0.0, t[-1], h)
    accel = np.convolve(np.gradient(np.gradient(x, 0.01), 0.01), np.ones(5) / 5, "same")
    accel[:50] = accel[-50:] = 0.0
    by_hand = half_car(section(width), np.interp(fine, t, way), np.interp(fine, t, accel), h)
    print(f"{width} m: rear {rear:.2f} s, half-car {by_hand:.2f} s, front {front:.2f} s")
    assert front < 0.1
    assert rear == pytest.approx(rear_s, abs=0.04)
    assert 0.6 * by_hand < rear < 1.1 * by_hand


def test_neither_tyres_nor_springs_keep_it_down_but_the_lever_does():
    """k2 > a b: a blow at the front axle lifts the rear one, which then falls at a third of g."""
    k2 = M.pitch_inertia / D.mass
    assert 1.0 - AHEAD * BEHIND / k2 == pytest.approx(
        0.70, abs=0.01
    )  # speed of the rear per that of the middle
    assert AHEAD * SHEET.wheelbase / (k2 + AHEAD**2) == pytest.approx(
        0.35, abs=0.01
    )  # fall of the rear over g
    damped = replace(SHEET, masses=replace(M, tyre_damping=0.6))
    assert cross(make(ditch(2.0), damped, start_speed_kmh=7.2))[1] > 0.3
    assert cross(make(ditch(2.0), start_speed_kmh=7.2, suspension=True))[1] > 0.3
    assert cross(make(ditch(2.0), start_speed_kmh=7.2, header=False))[1] < 0.1


def test_the_tyre_bridges_a_slot():
    """A slot 0.2 m wide and 0.3 m deep under the wheels lowers the machine by less than 4 cm."""
    slot = Ground(lambda x, y: np.where(np.abs(x - 4.0) < 0.1, -0.3, 0.0))
    states = run(make(slot, start_speed_kmh=3.6), 6.0, speed=1.0)
    heights = [s.pose.position[2] for s in states]
    assert -0.04 < min(heights) < -0.002
