"""Fuel of machines whose engines are not simulated, against the sums of a notebook."""

import pytest

from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.fuel import DIESEL, combine_fuel, tractor_fuel
from swath.machine.machine_sheet import dynamics_of, load_machine

COMBINE, TRACTOR = load_machine("lexion-700"), load_machine("tractor-grain-cart")
TRAIN = drivetrain_of(COMBINE)
STANDS = {"tank": 0.0, "speed": 0.0, "grain": 0.0, "cuts": False, "out": 0.0}


def test_a_tractor_that_stands_burns_three_litres_an_hour():
    assert 3600.0 * tractor_fuel(TRACTOR, 0.0, 0.0) / DIESEL == pytest.approx(3.0, abs=0.01)


def test_a_tractor_burns_for_the_work_of_rolling():
    """230 g/kWh over rolling resistance times weight times way, at 75 %."""
    mass = dynamics_of(TRACTOR).mass + TRACTOR.trailer.empty + 12_000.0
    work = dynamics_of(TRACTOR).rolling_resistance * mass * 9.80665 * 1000.0 / 0.75 / 3.6e6  # kWh a kilometre
    per_km = (tractor_fuel(TRACTOR, 12_000.0, 4.0) - tractor_fuel(TRACTOR, 12_000.0, 0.0)) * 250.0
    assert per_km == pytest.approx(0.230 * work, rel=1e-3)


def test_a_combine_burns_more_the_more_it_does():
    steps = [STANDS, {**STANDS, "speed": 2.0}, {**STANDS, "speed": 2.0, "tank": 9000.0}]
    steps.append({**steps[-1], "cuts": True})
    steps.append({**steps[-1], "grain": 10.0})
    steps.append({**steps[-1], "out": 90.0})
    rates = [combine_fuel(COMBINE, TRAIN, **s) for s in steps]
    assert rates == sorted(rates)
    assert len(set(rates)) == len(rates)
    assert combine_fuel(COMBINE, TRAIN, **STANDS) > TRAIN.engine.fuel_idle


def test_a_combine_in_wheat_burns_one_and_a_half_to_three_litres_a_tonne():
    """DLG tests of large combines: some 1.5 to 2.5 l/t."""
    rate = combine_fuel(COMBINE, TRAIN, tank=4000.0, speed=2.0, grain=11.0, cuts=True, out=0.0)
    assert 1.2 < rate / DIESEL / 0.011 < 3.0
