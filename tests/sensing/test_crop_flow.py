import math
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.random import Stream
from swath.field.moisture import Moisture
from swath.sensing.crop_flow.delayed import PRESETS, DelayedCropFlow, Params
from swath.signals import MachineLoad, OrganLoads

STEP = 100_000_000
SETUP = SimpleNamespace(period=0.1, field=SimpleNamespace(moisture=Moisture()))
EXACT = {name: 0.0 for name in Params.__dataclass_fields__ if not name.startswith("moisture_percent")}


def load(**flows):
    given = {
        "grain_flow": 23.0,
        "feeder_flow": 39.0,
        "tank_level": 0.4,
        "separation_loss": 0.1,
        "threshing_loss": 0.02,
    }
    zeros = dict.fromkeys(
        ("tank_grain", "lost_grain", "dropped_straw", "held_grain", "held_straw", "straw_flow"), 0.0
    )
    return MachineLoad(0, **{**zeros, **given, "cleaning_loss": 0.05, **flows})


def run(sensor, count, offset=0, **flows):
    return [sensor.step(i * STEP, STEP, {"load": load(**flows)}) for i in range(offset, offset + count)]


def make(**params):
    sensor = DelayedCropFlow(Params(**params), SETUP)
    sensor.reset(Stream(5, "combine.crop_flow"))
    return sensor


def test_ideal_reads_what_is():
    sensor = PRESETS["ideal"].component(PRESETS["ideal"].params(), SETUP)
    sensor.reset(Stream(1, "x"))
    (out,) = run(sensor, 1)
    assert (out["feed"].flow, out["grain"].flow, out["grain"].tank_level) == (39.0, 23.0, 0.4)
    assert out["grain"].moisture == pytest.approx(0.14)
    assert (out["loss"].separation, out["loss"].cleaning) == (pytest.approx(0.12), 0.05)


def test_delay_and_smoothing_are_a_late_first_order():
    quiet = {name: 0.0 for name in EXACT if name.endswith("percent")}
    out = run(make(yield_delay_s=1.0, yield_lag_s=2.0, **quiet), 100)
    for sample in out:
        past = max(0.0, sample["grain"].t * 1e-9 - 1.0)
        assert sample["grain"].flow == pytest.approx(23.0 * (1.0 - math.exp(-past / 2.0)), abs=1e-9)


def test_scale_is_constant_and_noise_is_not():
    sensor = make()
    flows = np.array([o["feed"].flow for o in run(sensor, 3000)])[200:]
    assert flows.std() / flows.mean() == pytest.approx(0.02, rel=0.1)
    biases = []
    for seed in range(60):
        one = DelayedCropFlow(Params(feed_noise_percent=0.0), SETUP)
        one.reset(Stream(seed, "combine.crop_flow"))
        biases.append(run(one, 100)[-1]["feed"].flow / 39.0 - 1.0)
    assert abs(np.mean(biases)) < 0.012
    assert np.std(biases) == pytest.approx(0.03, rel=0.3)


def test_saved_sensors_go_on_exactly():
    one, two = make(), make()
    run(one, 57)
    two.load(one.save())
    assert run(one, 100, 57, grain_flow=10.0) == run(two, 100, 57, grain_flow=10.0)


def test_readings_are_never_negative():
    out = run(make(loss_noise_percent=100.0, tank_noise_percent=20.0), 500, tank_level=0.0)
    assert min(o["loss"].separation for o in out) >= 0.0
    assert min(o["grain"].tank_level for o in out) >= 0.0


def counted(seconds, seed=1, straw=0.0, **params):
    """Readings of the level `counted` at the end, of a steady flow; what is not given is exact."""
    level = PRESETS["counted"]
    zeros = {name: 0.0 for name in level.params.__dataclass_fields__ if name != "moisture_percent"}
    sensor = level.component(level.params(**{**zeros, **params}), SETUP)
    sensor.reset(Stream(seed, "combine.crop_flow"))
    organs = OrganLoads(0, broken_share=0.01, mog_share=0.001)
    flows = load(straw_flow=straw, return_flow=0.7)
    steps = range(round(seconds / 0.1))
    return [sensor.step(i * STEP, STEP, {"load": flows, "organs": organs}) for i in steps]


def test_plates_count_grain():
    """Poisson: 0.12 kg/s at 1,150 hits per kg scatter by 1 / sqrt(1150 * 0.12 * 0.1) a sample, mean exact."""
    found = np.array([o["loss"].separation for o in counted(300.0, loss_hits_per_kg=1150.0)])
    assert found.mean() == pytest.approx(0.12, rel=0.02)
    assert found.std() / found.mean() == pytest.approx((1150.0 * 0.012) ** -0.5, rel=0.08)


def test_plates_take_straw_for_grain():
    out = counted(1.0, straw=10.0, loss_straw_percent=0.1)[-1]
    assert (out["loss"].separation, out["loss"].cleaning) == pytest.approx((0.13, 0.06))


def test_returns_and_what_a_camera_sees():
    out = counted(40.0, camera_lag_s=20.0, camera_floor_percent=0.2)[-1]
    assert out["returns"].flow == pytest.approx(0.7)
    assert out["quality"].broken == pytest.approx(0.01 * (1.0 - math.exp(-2.0)), rel=1e-6)
    assert out["quality"].foreign == 0.002
