"""How full a combine reckons its tank to be at the end of passes that no cart can reach."""

import math
from dataclasses import replace

import pytest

from swath.control.job.passes import Pass
from swath.control.job.tank import TankForecast
from swath.signals import MachineLoad

LANE = Pass(((0.0, 0.0), (100.0, 0.0)), width_m=10.0)
BLIND = Pass(((0.0, 10.0), (100.0, 10.0)), cart_beside=False, width_m=10.0)
TANK = 9000.0  # kg


def load(grain):
    """At a level of the tank."""
    nothing = dict.fromkeys(("lost_grain", "dropped_straw", "held_grain", "held_straw"), 0.0)
    flows = {"grain_flow": 0.0, "straw_flow": 0.0}
    return MachineLoad(0, grain, **nothing, **flows, tank_level=grain / TANK)


@pytest.mark.parametrize(("kept", "is_full"), [(5900.0, False), (6100.0, True)])
def test_a_tank_is_full_before_the_end_of_the_next_pass(kept, is_full):
    forecast = TankForecast([LANE, LANE, LANE], full=1.0)
    forecast.update(load(kept - 3000.0), 0, 0.0)
    forecast.update(load(kept), 0, 100.0)
    assert forecast.is_full_in_next(load(kept), 0, 0.0) is is_full
    assert forecast.is_full_in_next(load(kept), 0, 10.0) is (is_full or kept > 5700.0)


@pytest.mark.parametrize(("kept", "is_too_full"), [
    (5000.0, False),  # 8300 kg
    (6000.0, True),  # 9300 kg
    (5800.0, True),  # 8800 kg as it yields, 9100 kg with a tenth more
])  # fmt: skip
def test_before_passes_without_a_cart_a_tank_has_room_for_a_tenth_more_than_they_yield(kept, is_too_full):
    forecast = TankForecast([LANE, BLIND, LANE], full=1.0)
    forecast.update(load(kept - 3000.0), 0, 0.0)
    forecast.update(load(kept), 0, 100.0)
    forecast.begin(load(kept))
    assert forecast.is_too_full(load(kept), 0) is is_too_full


@pytest.mark.parametrize(("kept", "left", "expected"), [
    (6000.0, 0.0, 100.0),  # at the end of the next pass, of 3000 kg in 100 s
    (6000.0, 50.0, 100.0),  # half of it in this pass
    (9000.0, -5.0, 0.0),  # it is full, in its turn
    (7500.0, -5.0, 50.0),
])  # fmt: skip
def test_when_a_combine_stands_for_a_cart(kept, left, expected):
    slowly = replace(LANE, speed_kmh=3.6)
    forecast = TankForecast([slowly, slowly, slowly], full=1.0)
    forecast.update(load(kept - 3000.0), 0, 0.0)
    forecast.update(load(kept), 0, 100.0)
    assert forecast.stands_in(load(kept), 0, left, 2.0) == pytest.approx(expected)


def test_nobody_knows_when_a_combine_stands_before_its_pass_has_brought_anything():
    forecast = TankForecast([LANE, LANE], full=1.0)
    forecast.update(load(0.0), 0, 10.0)
    assert math.isnan(forecast.stands_in(load(0.0), 0, 90.0, 2.0))
