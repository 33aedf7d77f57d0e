"""Header, process, powertrain and steering: even crop, a charge of it, a full load, a step of the angle."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.machine.powertrain.power_balance import governed_speed
from swath.signals import MachineLoad, MachineState
from tests.field.made_field import made_field
from tests.levels.limits import each_level, make
from tests.machine.machine_fakes import STREAM, Ground, site
from tests.machine.process_rig import flow, state
from tests.machine.test_powertrain_engine import DRIVETRAIN, settle
from tests.machine.test_steering import curvature, run

STEP = 100_000_000


@each_level("header")
def test_flow_from_even_crop_on_level_ground(level, limit):
    """0.8 kg/m2 of grain on 12 m at 2 m/s; what is not taken is a loss at the header."""
    if level == "profile":  # it cuts a field of its own kind alone
        assert grain_of("profile") == pytest.approx(grain_of("fixed_height"), rel=limit)
        return
    header = make("header", level, site(Ground(), period=0.02))
    header.reset(STREAM)
    grain, dt = 0.0, NS // 50
    for k in range(101):
        here = state((k + 1) * dt, 0.04 * k, 2.0)
        grain += header.step(k * dt, dt, {"state": (here,)})["flow"].grain
    assert grain == pytest.approx(0.8 * 12.0 * 4.0, rel=limit + 1e-9)


def grain_of(level):
    """What a header takes of wheat on 4 m along its edge [kg]."""
    field = made_field()
    header = make("header", level, replace(site(field, period=0.02), edge=field.first_edge))
    end = site().machine.header_end("left")
    header.reset(STREAM)
    grain, dt = 0.0, NS // 50
    for k in range(101):
        pose = Pose.from_euler([-end[1], 10.0 - end[0] + 0.04 * k, 0.0], yaw=math.pi / 2)
        here = MachineState((k + 1) * dt, pose, 2.0, 0.0, 0.0, 0.0, 0.04 * k)
        grain += header.step(k * dt, dt, {"state": (here,)})["flow"].grain
    return grain


@each_level("process")
def test_mass_and_mean_time_of_a_charge(level, limit):
    """60 s of 2 kg/s of grain and 1.3 kg/s of straw: all of it comes out, this much later."""
    ground = Ground()
    process = make("process", level, site(ground, period=0.1))
    process.reset(STREAM)
    moment = last = 0.0
    for i in range(1500):
        grain, straw = (0.2, 0.13) if i < 600 else (0.0, 0.0)
        inputs = {"flow": (flow(i * STEP, grain, straw, 0.1),), "state": state(i * STEP, 0.2 * i, 2.0)}
        load = process.step(i * STEP, STEP, {**inputs, "engine": None})["load"]
        moment += (load.tank_grain - last) * 0.1 * i
        last = load.tank_grain
    assert load.tank_grain + load.lost_grain + load.held_grain == pytest.approx(120.0, rel=1e-12)
    assert load.dropped_straw + load.held_straw == pytest.approx(78.0, rel=1e-12)
    assert load.held_grain < 1e-3
    low, high = limit
    assert low <= moment / last - 29.95 <= high + 1e-9


@each_level("powertrain")
def test_speed_and_power_under_a_steady_load(level, limit):
    """Against the governor's line at the torque that is taken."""
    load = MachineLoad(0, *[0.0] * 7, header_flow=39.2, drum_flow=39.2, rotor_flow=15.4, chopper_flow=15.4)
    engine = settle(make("powertrain", level, site(period=0.05)), load, 2.0)
    balanced = governed_speed(engine.power / engine.speed, DRIVETRAIN.engine)
    assert engine.speed == pytest.approx(balanced, rel=limit)
    dearest = settle(make("powertrain", "hydrostat", site(period=0.05)), load, 2.0)
    assert engine.power == pytest.approx(dearest.power, rel=limit)


@each_level("steering")
def test_answer_to_a_step_of_the_angle(level, limit):
    """5 deg: at once, or after the dead time at 15 deg/s down to 3 deg and then with a lag of 0.2 s."""
    params = {"dead_time_s": 0.15, "lag_s": 0.2, "dead_band_percent": 0.0} if level == "actuator" else {}
    steering = make("steering", level, site(), **params)
    steering.reset(STREAM)
    dt = 20_000_000
    angles = run(steering, [(0, 0.0), (100_000_000, curvature(5 * DEG))], dt, NS)
    gone = np.arange(1, len(angles) + 1) * dt * 1e-9 - 0.1
    expected = np.where(gone > -1e-9, 5.0, 0.0)
    if level == "actuator":
        late, ramp = gone - 0.15, (5 - 3) / 15
        expected = np.where(late < ramp, 15 * late, 5 - 3 * np.exp(-(late - ramp) / 0.2))
        expected[late <= 0.0] = 0.0
    np.testing.assert_allclose(angles, expected * DEG, atol=limit)
    assert math.isclose(angles[-1], 5 * DEG, rel_tol=0.05)
