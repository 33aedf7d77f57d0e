import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.machine.process import constant
from swath.machine.process.constant import CombineParams as Params
from swath.machine.process.constant import DelayedProcess
from tests.machine.machine_fakes import STREAM, Ground, site
from tests.machine.process_rig import flow, state

STEP = 100_000_000


def make(**params):
    ground = Ground()
    process = DelayedProcess(Params(**params), site(ground, period=0.1))
    process.reset(STREAM)
    return process, ground


def drive(process, course, offset=0):
    return [
        process.step(i * STEP, STEP, {"flow": (flow(0, g, s, 0.1),), "state": state(0, 0.2 * i, 2.0)})["load"]
        for i, (g, s) in enumerate(course, offset)
    ]


def test_a_step_of_crop_answers_with_dead_time_and_first_order():
    process, _ = make(loss_percent=2.0, feed_delay_s=2.7)
    loads = drive(process, [(2.0, 1.3)] * 300)
    for load in loads:
        t = load.t * 1e-9
        for flow_now, final, delay, lag in (
            (load.grain_flow, 19.6, 11.0, 3.0),
            (load.straw_flow, 13.0, 6.0, 1.0),
            (load.separation_loss, 0.4, 6.0, 1.0),
        ):
            past, before = (max(0.0, v - delay) for v in (t, t - 0.1))
            mean = final * (past - before + lag * (math.exp(-past / lag) - math.exp(-before / lag))) / 0.1
            assert flow_now == pytest.approx(mean, abs=1e-9)


@given(st.lists(st.tuples(st.floats(0, 6), st.floats(0, 5)), min_size=1, max_size=150))
@settings(max_examples=40)
def test_grain_and_straw_are_conserved(course):
    process, _ = make()
    for i, load in enumerate(drive(process, course), 1):
        fed = np.array(course[:i]).sum(axis=0)
        inside = load.tank_grain + load.lost_grain + load.held_grain, load.dropped_straw + load.held_straw
        assert inside == pytest.approx(fed, rel=1e-12, abs=1e-12)


def test_all_straw_is_laid_down():
    process, ground = make()
    loads = drive(process, [(2.0, 1.3)] * 200 + [(0.0, 0.0)] * 300)
    assert math.fsum(m for _, m in ground.straw) == pytest.approx(260.0, rel=1e-6)
    assert loads[-1].lost_grain == pytest.approx(4.0, rel=1e-6)


def test_saved_process_goes_on_exactly():
    one, _ = make()
    two, _ = make()
    drive(one, [(1.0 + 0.1 * (i % 5), 1.0) for i in range(77)])
    two.load(one.save())
    assert drive(one, [(1.0, 0.7)] * 99, 77) == drive(two, [(1.0, 0.7)] * 99, 77)


def test_a_tank_before_the_drum_is_refused():
    with pytest.raises(InputError, match=r"grain_delay_s = 2\.0: expected >= feed_delay_s"):
        make(grain_delay_s=2.0)


def test_a_delayed_constant_is_a_delay_line_and_without_delay_an_op():
    given = {name: getattr(Params(), name) for name in constant.DELAYS}
    made = constant.LEVEL.component(constant.Params(**given), site(Ground(), period=0.1))
    made.reset(STREAM)
    process, _ = make()
    course = [(1.0 + 0.1 * (i % 5), 1.0) for i in range(300)]
    assert drive(made, course) == drive(process, course)
    at_once = constant.LEVEL.component(constant.Params(), site(Ground(), period=0.1))
    assert isinstance(at_once, constant.ConstantProcess)
