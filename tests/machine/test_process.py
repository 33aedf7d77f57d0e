import math

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.field.field import Field
from swath.field.memory_layout import REVISION
from swath.machine.compensated_sum import Total
from swath.machine.process.constant import ConstantProcess, Params
from swath.signals import CropFlow, MachineState
from tests.field.made_field import made_field
from tests.machine.machine_fakes import STREAM, Ground, signed_area, site


def state(x, yaw=0.0):
    return MachineState(0, Pose.from_euler((x, 0.0, 0.0), yaw=yaw), 2.0, 0.0, 0.0, 0.0, x)


def flow(grain, straw, t=0):
    return CropFlow(t, grain, straw, 1.0, 500, 1.0, 0.04)


def make(**params):
    ground = Ground()
    process = ConstantProcess(Params(**params), site(ground))
    process.reset(STREAM)
    return process, ground


def run(process, count, offset=0):
    for i in range(offset, offset + count):
        load = process.step(
            i, 40_000_000, {"flow": (flow(0.1 + 0.01 * (i % 7), 0.06),), "state": state(0.08 * i)}
        )["load"]
    return load


def test_grain_is_shared_between_tank_and_loss():
    process, _ = make(loss_percent=1.5)
    load = run(process, 1000)
    grain = math.fsum(0.1 + 0.01 * (i % 7) for i in range(1000))
    assert load.tank_grain + load.lost_grain == pytest.approx(grain, rel=1e-14)
    assert load.lost_grain == pytest.approx(0.015 * grain)
    assert load.dropped_straw == pytest.approx(60.0, rel=1e-14)
    assert (load.held_grain, load.held_straw) == (0.0, 0.0)
    assert load.straw_flow == pytest.approx(1.5)


def test_swath_lies_behind_the_machine_without_gaps_and_holds_all_the_straw():
    process, ground = make()
    load = run(process, 1000)
    laid = math.fsum(mass for _, mass in ground.straw)
    assert -1e-9 <= load.dropped_straw - laid < 0.06 * 4
    polygons = [p for p, _ in ground.straw]
    way = sum(signed_area(p) for p in polygons) / 1.4
    rear = site().machine.body[0]
    ends = np.concatenate(polygons)
    assert ends[:, 0].min() == pytest.approx(rear)
    assert way == pytest.approx(ends[:, 0].max() - rear)
    assert np.ptp(ends[:, 1]) == pytest.approx(1.4)
    assert len(polygons) == 249


def test_every_flow_since_the_last_step_counts():
    process, _ = make(loss_percent=0.0)
    load = process.step(0, 1, {"flow": (flow(1.0, 0.5), flow(2.0, 0.25)), "state": state(0.0)})["load"]
    assert (load.tank_grain, load.dropped_straw) == (3.0, 0.75)
    load = process.step(1, 1, {"flow": (), "state": state(0.0)})["load"]
    assert (load.tank_grain, load.grain_flow) == (3.0, 0.0)


def test_saved_process_goes_on_exactly():
    one, ground_one = make()
    two, ground_two = make()
    run(one, 57)
    two.load(one.save())
    before = len(ground_one.straw)
    assert run(one, 100, offset=57) == run(two, 100, offset=57)
    assert [m for _, m in ground_two.straw] == [m for _, m in ground_one.straw[before:]]


@pytest.mark.parametrize("seed", range(3))
def test_compiled_code_lays_what_the_field_lays_of_each_polygon(seed, monkeypatch):
    """To the bit, and both fields hold the same after it: pages in the order in which they were used, too."""
    rng = np.random.Generator(np.random.Philox(seed))
    fields = own, other = [made_field(page_limit=12) for _ in range(2)]
    parts = [ConstantProcess(Params(), site(field)) for field in fields]
    monkeypatch.setattr(other, "lend", lambda *_: None)
    asked, lay = {id(field): 0 for field in fields}, Field.deposit_straw

    def counted(field, *given, **more):
        asked[id(field)] += 1
        lay(field, *given, **more)

    monkeypatch.setattr(Field, "deposit_straw", counted)
    for part in parts:
        part.reset(STREAM)
    x, y, yaw = rng.uniform(-20.0, 20.0), rng.uniform(-20.0, 20.0), rng.uniform(-3.0, 3.0)
    for number in range(300):
        ahead, turn = rng.choice([0.08, 0.2, -0.1, 0.0, 0.4]), rng.choice([0.0, 0.0, 0.03, -0.1])
        x, y, yaw = x + ahead * math.cos(yaw), y + ahead * math.sin(yaw), yaw + turn
        where = MachineState(0, Pose.from_euler((x, y, 0.0), yaw=yaw), 2.0, 0.0, 0.0, 0.0, 0.0)
        given = {"flow": (flow(0.1, rng.choice([0.0, 0.06, 0.2])),), "state": where}
        loads = [part.step(number, 100_000_000, given)["load"] for part in parts]
        assert loads[0] == loads[1]
        if number % 40 == 39:
            far = rng.uniform(-90.0, 90.0, 2)
            for field in fields:
                field.ensure(*far, 10.0)
    assert own.straw_kg == other.straw_kg == pytest.approx(loads[0].dropped_straw, rel=0.05)
    assert 0 < asked[id(own)] < 0.2 * asked[id(other)]  # the others are laid by compiled code
    assert own.pages.counters[REVISION] == other.pages.counters[REVISION]
    assert list(own.store.keys) == list(other.store.keys)
    for pool in ("straw", "tile_bump"):
        assert getattr(own.pages, pool).tobytes() == getattr(other.pages, pool).tobytes()


def test_totals_stay_exact_over_hours():
    """Twenty hours at 25 Hz of a term that binary numbers cannot hold; plain addition is off by far more."""
    total, plain, count = Total(), 0.0, 1_800_000
    for _ in range(count):
        total.add(0.1)
        plain += 0.1
    exact = math.fsum([0.1] * count)
    assert total.value == exact
    assert abs(plain - exact) > 1e-7


@pytest.mark.parametrize("yaw_step", [0.02, -0.02])
def test_swath_polygons_stay_convex_in_turns(yaw_step):
    process, ground = make()
    x = y = yaw = 0.0
    for i in range(400):
        yaw += yaw_step * 0.5
        x, y = x + 0.08 * math.cos(yaw), y + 0.08 * math.sin(yaw)
        here = MachineState(0, Pose.from_euler((x, y, 0.0), yaw=yaw), 2.0, 0.0, 0.0, 0.0, 0.0)
        process.step(i, 40_000_000, {"flow": (flow(0.1, 0.06),), "state": here})
    assert all(len(p) == 4 and signed_area(p) > 0 for p, _ in ground.straw)
