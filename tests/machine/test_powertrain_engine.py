import math

import numpy as np
import pytest

from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import dynamics_of
from swath.machine.powertrain.hydrostat import HydrostatPowertrain, Params
from swath.machine.powertrain.ideal import IdealPowertrain
from swath.machine.powertrain.ideal import Params as IdealParams
from swath.machine.powertrain.power_balance import (
    Powers,
    fuel_rate,
    full_torque,
    governed_speed,
    governed_torque,
    powers,
    propulsion_power,
)
from swath.machine.traction import pull
from swath.signals import MachineLoad
from tests.machine.machine_fakes import STREAM, site
from tests.machine.process_rig import state

SITE = site(period=0.05)
DRIVETRAIN, DYNAMICS = drivetrain_of(SITE.machine), dynamics_of(SITE.machine)
E = DRIVETRAIN.engine
ROLLING = DYNAMICS.rolling_resistance
STEP = 50_000_000


def load_of(**flows):
    return MachineLoad(0, *[0.0] * 7, **flows)


def settle(component, load, speed, seconds=30.0):
    component.reset(STREAM)
    for i in range(round(seconds / 0.05)):
        inputs = {"state": state(i * STEP, 0.05 * speed * i, speed), "load": load}
        engine = component.step(i * STEP, STEP, inputs)["engine"]
    return engine


def settle_at(grade):
    """The ideal powertrain on a slope, uphill positive."""
    drive = IdealPowertrain(IdealParams(), SITE)
    drive.reset(STREAM)
    here = state(STEP, 0.0, 2.0, pitch=-math.atan(grade))
    return drive.step(STEP, STEP, {"state": here, "load": load_of(drum_flow=20.0)})["engine"]


def test_full_load_curve_has_constant_power_down_to_the_largest_torque():
    rated = E.rated_power / E.rated_speed
    assert full_torque(E.rated_speed, E) == pytest.approx(rated)
    assert full_torque(E.torque_speed, E) == pytest.approx(1.3 * rated)
    assert full_torque(E.idle_speed, E) == pytest.approx(0.85 * rated)
    speeds = np.linspace(E.torque_speed, E.rated_speed, 30)
    torques = np.array([full_torque(n, E) for n in speeds])
    assert np.all(np.diff(torques) < 0.0)
    assert np.ptp(torques * speeds) / E.rated_power < 0.06
    assert max(torques * speeds) == pytest.approx(E.rated_power, rel=0.01)


def test_governor_holds_five_percent_of_droop():
    assert governed_speed(0.0, E) / E.rated_speed == pytest.approx(1.05)
    rated = E.rated_power / E.rated_speed
    for share in (0.1, 0.5, 0.9, 1.0):
        assert governed_torque(governed_speed(share * rated, E), E) == pytest.approx(share * rated)
    assert governed_torque(1.2 * E.rated_speed, E) == 0.0
    assert governed_torque(0.8 * E.rated_speed, E) == full_torque(0.8 * E.rated_speed, E)


def test_fuel_is_that_of_a_modern_diesel():
    """About 200 g/kWh at full load, more at part load, in a straight line (Willans)."""

    def specific(share):
        return fuel_rate(share * E.rated_power, E.rated_speed, E) / (share * E.rated_power) * 3.6e9

    assert specific(1.0) == pytest.approx(201.3, abs=0.1)
    assert specific(0.5) == pytest.approx(202.6, abs=0.1)
    assert specific(1.0) < specific(0.5) < specific(0.2)


def test_pull_is_rolling_grade_and_acceleration():
    weight = DYNAMICS.mass * 9.81
    assert pull(state(0, 0.0, 2.0), 0.0, 0.0, DYNAMICS) == pytest.approx(ROLLING * weight, rel=1e-3)
    uphill = pull(state(0, 0.0, 2.0, pitch=-0.1), 0.0, 0.0, DYNAMICS)
    assert uphill == pytest.approx(weight * (ROLLING + math.sin(0.1)), rel=1e-3)
    assert pull(state(0, 0.0, 2.0), 0.3, 5000.0, DYNAMICS) == pytest.approx(
        (DYNAMICS.mass + 5000.0) * (ROLLING * 9.81 + 0.3), rel=1e-3
    )
    assert pull(state(0, 0.0, 0.0), 0.0, 0.0, DYNAMICS) == 0.0
    assert propulsion_power(25_000 * 9.81 * 0.08, 2.0, 0.7) == pytest.approx(56e3, rel=0.01)
    assert propulsion_power(-1e4, 2.0, 0.7) == pytest.approx(-14e3)  # of 20 kW at the wheels


def test_a_descent_relieves_the_engine_but_never_drives_it():
    down = settle_at(-0.05)
    assert down.propulsion_power < 0.0
    assert down.power < settle_at(0.0).power - 5e3
    steep = Powers(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -50e3, 20e3)
    assert steep.total == 0.0


def test_another_engine_in_the_same_machine_burns_and_gives_in_proportion():
    small, large = (
        settle(IdealPowertrain(IdealParams(rated_power_kw=kw), SITE), load_of(drum_flow=20.0), 2.0)
        for kw in (None, 2e-3 * E.rated_power)
    )
    assert large.load == pytest.approx(0.5 * small.load)
    assert large.fuel - small.fuel == pytest.approx(E.fuel_idle)


def test_every_consumer_counts_its_own_flow():
    load = load_of(header_flow=39.2, drum_flow=40.0, rotor_flow=15.4, chopper_flow=15.4, unload_flow=1.0)
    p = powers(load, 56e3, 12.0, DRIVETRAIN)
    assert p == Powers(63.2e3, 94e3, 46.2e3, 12e3, 51.2e3, 28e3, 56e3, 97.1e3)
    assert p.total == pytest.approx(447.7e3)
    idle = powers(load_of(), 0.0, 12.0, DRIVETRAIN)
    assert (idle.chopper, idle.unloading, idle.threshing) == (0.0, 0.0, 0.0)


def test_the_whole_machine_is_near_the_asabe_line():
    """20 kW + 3.6 kWh/t of straw for header, threshing, separation and cleaning (ASAE D497, +-50 %)."""
    load = load_of(header_flow=39.2, drum_flow=39.2, rotor_flow=15.4)
    p = powers(load, 0.0, 12.0, DRIVETRAIN)
    rotary = p.header + p.threshing + p.separation + p.cleaning
    assert 0.5 < rotary / (20e3 + 3.6 * 3.6e6 / 1e3 * 15.4) < 1.5


@pytest.mark.parametrize("feed", [0.0, 10.0, 30.0, 45.0, 60.0, 66.0])
def test_engine_speed_settles_where_the_torques_balance(feed):
    """Belts ask for torque, the governor or the full-load curve gives it: solved by bisection beside."""
    load = load_of(header_flow=feed, drum_flow=feed, rotor_flow=0.4 * feed)
    engine = settle(HydrostatPowertrain(Params(), SITE), load, 2.0)
    force = pull(state(0, 0.0, 2.0), 0.0, 0.0, DYNAMICS)
    p = powers(load, propulsion_power(force, 2.0, DRIVETRAIN.hydrostat.efficiency), 12.0, DRIVETRAIN)
    low, high = 100.0, 1.05 * E.rated_speed
    for _ in range(80):
        middle = 0.5 * (low + high)
        if governed_torque(middle, E) > p.belts / E.rated_speed + p.propulsion / middle:
            low = middle
        else:
            high = middle
    assert engine.speed == pytest.approx(low, rel=1e-6)
    assert engine.power == pytest.approx(governed_torque(low, E) * low, rel=1e-6)
    taken = [getattr(engine, f"{n}_power") for n in Powers.__dataclass_fields__]
    assert sum(taken) == pytest.approx(engine.power, rel=1e-6)
    asked = sum(taken) / engine.speed
    assert engine.load == pytest.approx(asked / full_torque(min(low, E.rated_speed), E), rel=1e-6)


def test_engine_and_flywheel_keep_the_energy():
    """Work of the engine less what is taken is the change of the turning energy, through a step of load."""
    drive = HydrostatPowertrain(Params(substep_ms=1.0), site(period=0.002))
    speed = drive.reset(STREAM)["engine"].speed
    load, before, work = load_of(drum_flow=60.0), 0.5 * E.inertia * speed**2, 0.0
    for i in range(1500):
        engine = drive.step(i * 2_000_000, 2_000_000, {"state": state(0, 0.0, 0.0), "load": load})["engine"]
        taken = sum(getattr(engine, f"{n}_power") for n in Powers.__dataclass_fields__)
        work += 0.002 * (engine.power - taken)
    assert engine.speed < 0.99 * speed
    assert 0.5 * E.inertia * engine.speed**2 - before == pytest.approx(work, rel=0.02)


def test_integration_step_does_not_matter():
    load = load_of(header_flow=55.0, drum_flow=55.0, rotor_flow=20.0)
    speeds = [
        settle(HydrostatPowertrain(Params(substep_ms=s), SITE), load, 2.0, 0.8).speed for s in (25.0, 1.0)
    ]
    assert speeds[0] == pytest.approx(speeds[1], rel=5e-5)


def test_an_overloaded_engine_takes_the_speed_away_and_gives_it_back():
    drive = HydrostatPowertrain(Params(), SITE)
    drive.reset(STREAM)
    assert settle(drive, load_of(drum_flow=60.0), 2.0).speed_limit > 5.0
    overload, speed = load_of(drum_flow=190.0), 2.0
    limits = []
    for i in range(600):
        here = state(i * STEP, 0.0, speed)
        engine = drive.step(i * STEP, STEP, {"state": here, "load": overload})["engine"]
        limits.append(engine.speed_limit)
    assert engine.speed < DRIVETRAIN.hydrostat.relief_start
    assert limits[-1] == 0.0
    for i in range(600):
        engine = drive.step(i * STEP, STEP, {"state": state(0, 0.0, 0.0), "load": load_of()})["engine"]
    assert engine.speed_limit == pytest.approx(min(0.2 * 30, DYNAMICS.max_speed), rel=0.1)


def test_the_drive_has_its_own_limits():
    flat = settle(HydrostatPowertrain(Params(), SITE), load_of(), 2.0)
    assert flat.speed_limit == pytest.approx(DYNAMICS.max_speed, rel=1e-6)
    for pitch, expected in ((-0.3, None), (-0.6, 0.0)):
        drive = HydrostatPowertrain(Params(), SITE)
        drive.reset(STREAM)
        for i in range(20):
            here = state(i * STEP, 0.0, 1.0, pitch=pitch)
            limit = drive.step(i * STEP, STEP, {"state": here, "load": load_of()})["engine"].speed_limit
        force = pull(here, 0.0, 0.0, DYNAMICS)
        assert limit == pytest.approx(DRIVETRAIN.hydrostat.power / force if expected is None else expected)


def test_ideal_adds_up_the_same_powers_at_rated_speed():
    load = load_of(header_flow=39.2, drum_flow=39.2, rotor_flow=15.4, chopper_flow=15.4)
    ideal = settle(IdealPowertrain(IdealParams(), SITE), load, 2.0)
    real = settle(HydrostatPowertrain(Params(), SITE), load, 2.0)
    assert ideal.speed_ratio == 1.0
    assert ideal.power == pytest.approx(real.power, rel=0.05 * 0.2)
    assert ideal.fuel_used == pytest.approx(real.fuel_used, rel=0.02)
    over = settle(IdealPowertrain(IdealParams(), SITE), load_of(drum_flow=160.0), 2.0)
    assert over.load > 1.2
    assert over.speed_limit == DYNAMICS.max_speed


@pytest.mark.parametrize(
    "make", [lambda: HydrostatPowertrain(Params(), SITE), lambda: IdealPowertrain(IdealParams(), SITE)]
)
def test_saved_powertrains_go_on_exactly(make):
    one, two = make(), make()
    one.reset(STREAM)
    two.reset(STREAM)

    def go(component, first, count):
        for i in range(first, first + count):
            here = state(i * STEP, 0.1 * i, 2.0 + 0.1 * math.sin(i))
            load = load_of(drum_flow=60.0 + 20.0 * math.sin(0.1 * i))
            engine = component.step(i * STEP, STEP, {"state": here, "load": load})["engine"]
        return engine

    go(one, 0, 123)
    two.load(one.save())
    assert go(one, 123, 77) == go(two, 123, 77)
