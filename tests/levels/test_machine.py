"""Header, process, powertrain and steering: even crop, a charge of it, a full load, a step of the angle."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.machine.powertrain.power_balance import governed_speed
from swath.machine.threshing.model import coupled
from swath.signals import CropStream, FeedReading, LossReading, MachineLoad, MachineState, OrganWork
from swath.signals.settings import own_settings
from tests.field.made_field import made_field
from tests.levels.limits import each_level, make
from tests.machine.machine_fakes import STREAM, Ground, site
from tests.machine.process_rig import Row, flow, state
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
    setup = site(ground, period=0.1)
    process = Row(setup) if level == "organs" else make("process", level, setup)
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
    assert low - 1e-9 <= moment / last - 29.95 <= high + 1e-9


def worked(slot, level, steps, **given):
    """What an organ sends in 20 s with a crop of 2.4 kg of grain and 1.54 of straw in steps of 0.1 s."""
    organ = make(slot, level, site(period=0.1))
    organ.reset(STREAM)
    here = {port.name: () for port in organ.inputs} | {
        "engine": None,
        "settings": None,
        "state": state(0, 0.0, 2.0),
    }
    made = []
    for k in range(200):
        fed = {name: (sample,) for name, sample in given.items()} if k < steps else {}
        made.append(organ.step(k * STEP, STEP, {**here, **fed}))
    return made


@each_level("feeder")
def test_mean_time_to_the_drum(level, limit):
    out = [o["fed"].grain for o in worked("feeder", level, 100, flow=flow(0, 2.4, 1.54, 0.1))]
    assert sum(out) == pytest.approx(240.0, rel=1e-6)
    low, high = limit
    assert low - 1e-9 <= np.dot(out, np.arange(200)) / sum(out) * 0.1 - 4.95 <= high + 1e-9


@each_level("threshing")
def test_grain_behind_the_drum(level, limit):
    d = DRIVETRAIN.threshing
    layer = (15.4 / d.straw) ** -d.drum_exponent
    ear, free = coupled(2.4, 0.0, d.drum_threshing * layer, d.drum_separation * layer)
    over = worked("threshing", level, 200, fed=CropStream(0, 2.4, straw=1.54))[-1]["over"]
    expected = (0.0, 0.0) if level == "ideal" else (0.9 * ear, free)  # a tenth falls through
    assert (over.unthreshed, over.free) == pytest.approx(expected, rel=limit)


@each_level("separation")
def test_grain_behind_the_separation(level, limit):
    d = DRIVETRAIN.threshing
    work = OrganWork(0, 2.4, 1.54, 0.1)
    made = worked("separation", level, 200, fed=CropStream(0, 0.05, 0.6, straw=1.155), drum=work)[-1]
    over = made["over"]
    expected = coupled(0.05, 0.6, d.rotor_threshing, d.rotor_separation)
    assert over.straw + made["through"].short == pytest.approx(1.155)
    if level == "ideal":
        expected = 0.0, 0.0
    if level == "walkers":
        expected = 0.05, 0.6 * math.exp(-d.rotor_separation)
    assert (over.unthreshed, over.free) == pytest.approx(expected, rel=limit)


@each_level("cleaning")
def test_grain_behind_the_shoe(level, limit):
    made = worked("cleaning", level, 200, pan=CropStream(0, free=2.415, chaff=0.385))[-1]
    c, dirt = DRIVETRAIN.cleaning, 0.0  # at the nominal flow of all and of chaff
    lost, back = (0.0, 0.0) if level == "ideal" else (c.loss, c.returns)
    assert made["over"].free == pytest.approx(2.415 * lost, rel=limit)
    assert made["returned"].free == pytest.approx(2.415 * (1.0 - lost) * back, rel=limit)
    if level == "model":
        dirt = 0.005 * made["clean"].free
    assert made["clean"].chaff == pytest.approx(dirt, rel=limit)
    assert made["over"].chaff + made["returned"].chaff + dirt == pytest.approx(0.385)


@each_level("settings")
def test_what_is_set(level, limit):
    """In SI what was said, nan or the manual's what was not."""
    part = make("settings", level, site(), **({} if level == "table" else {"drum_rpm": 900.0}))
    part.reset(STREAM)
    read = {"loss": LossReading(0, 0.1, 0.1), "feed": FeedReading(0, 30.0)}
    made = part.step(0, STEP, read)["settings"]
    drum = math.nan if level == "table" else 900.0 * math.pi / 30.0
    assert made.drum == pytest.approx(drum, rel=limit, nan_ok=True)
    own = own_settings(site().machine.works, "wheat")["upper"]
    assert made.upper == pytest.approx(own if level == "climb" else math.nan, nan_ok=True)


@each_level("returns")
def test_delay_of_the_returns(level, limit):
    out = [o["back"].free for o in worked("returns", level, 1, fed=CropStream(0, free=0.3))]
    late = 0.0 if level == "ideal" else DRIVETRAIN.transport.returns
    assert np.dot(out, np.arange(200)) / 0.3 * 0.1 == pytest.approx(late, abs=limit + 1e-9)


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
