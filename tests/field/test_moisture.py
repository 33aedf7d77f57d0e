"""Water in grain and straw of the stand, and the parts of a machine that read it."""

from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.field.moisture import Moisture
from swath.machine.process.threshing import Params, ThreshingProcess
from swath.runtime.field_setup import build_field
from swath.scenario.scenario import parse_scenario
from swath.sensing.crop_flow import delayed
from tests.machine.machine_fakes import STREAM, Ground
from tests.machine.process_rig import Rig, Row, flow, site, state
from tests.sensing import test_crop_flow

HOUR = 3600 * NS
DAY = ((6.0, 25.0), (11.0, 11.0), (20.0, 15.0))


@pytest.mark.parametrize("start", [0.0, 7.3, 13.0, 22.5])
def test_by_the_hour_it_is_linear_and_goes_on_over_midnight(start):
    wet = Moisture(straw_moisture_percent=DAY, start_hour=start)
    for hour in np.linspace(start, start + 30.0, 61).tolist():
        found = wet.at(round((hour - start) * HOUR))
        of_day = hour % 24.0
        shifted = [(h + d, p) for d in (-24.0, 0.0, 24.0) for h, p in DAY]
        wanted = np.interp(of_day, *np.array(shifted).T)
        assert found["straw_moisture"] == pytest.approx(wanted / 100.0, rel=1e-9)
        assert found["grain_moisture"] == 0.14


def test_hours_that_do_not_rise_are_refused():
    with pytest.raises(InputError, match="grain_moisture_percent"):
        Moisture(grain_moisture_percent=((8.0, 20.0), (8.0, 14.0)))


def test_a_scenario_says_it_at_the_stand():
    text = """
format: swath scenario 2
name: wet
field:
  edge: {shape: straight}
  stand: {straw_moisture_percent: [[6, 25], [11, 11]], grain_moisture_percent: 18, start_hour: 8.5}
machines: {combine: {machine: lexion-700-class}}
"""
    field = build_field(parse_scenario(text).field, stream=STREAM, base=None).field
    assert field.moisture.at(0) == pytest.approx({"straw_moisture": 0.18, "grain_moisture": 0.18})
    with pytest.raises(InputError, match=r"field.stand.straw_moisture_percent"):
        parse_scenario(text.replace("[11, 11]", "[11, 110]"))


def wet_ground(**keys):
    ground = Ground()
    ground.moisture = Moisture(**keys)
    return ground


def in_row(ground, **own):
    """The stream out of a feeder with keys of its own."""
    row = Row(site(ground, period=0.5), {"feeder": "ideal"}, {"feeder": own})
    row.reset(STREAM)
    given = {"flow": (flow(0, 5.0, 3.0, 0.5),), "state": state(0, 0.0, 2.0)}
    row.step(0, NS // 2, given)
    return row._given["threshing"]["fed"][0]


def test_the_feeder_takes_the_stands_or_its_own():
    ground = wet_ground(grain_moisture_percent=19.0, straw_moisture_percent=23.0)
    assert (in_row(ground).grain_moisture, in_row(ground).straw_moisture) == (0.19, 0.23)
    own = in_row(ground, straw_moisture_percent=9.0)
    assert (own.grain_moisture, own.straw_moisture) == (0.19, 0.09)


def lost(moisture=12.0, **keys):
    """Grain lost by `process: threshing` in 40 s [kg]."""
    rig = Rig(engine=False)
    ground = wet_ground(straw_moisture_percent=moisture)
    rig.process = ThreshingProcess(Params(**keys), site(ground, period=0.1))
    rig.load = rig.process.reset(STREAM)["load"]
    for _ in range(400):
        rig.step(2.0)
    return rig.load.lost_grain


def test_wet_straw_loses_more_unless_threshability_is_set():
    dry, noon, dew = lost(12.0), lost(16.0), lost(22.0)
    assert dry < noon < dew
    assert 2.0 < dew / dry < 4.0 * 1.5
    assert lost(22.0, threshability=0.8) == lost(12.0, threshability=0.8) != dry


def test_the_moisture_sensor_takes_the_stands_or_its_own():
    setup = SimpleNamespace(period=0.1, field=wet_ground(grain_moisture_percent=17.0))
    for own, wanted in ((None, 0.17), (12.5, 0.125)):
        level = delayed.PRESETS["ideal"]
        sensor = level.component(level.params(moisture_percent=own), setup)
        sensor.reset(STREAM)
        assert test_crop_flow.run(sensor, 1)[0]["grain"].moisture == pytest.approx(wanted)


LATE = """
format: swath scenario 2
name: late
field:
  edge: {shape: straight}
  origin: {latitude_deg: 52.3, longitude_deg: 10}
  stand: {straw_moisture_percent: [[6, 25], [11, 11]], start_hour: START}
  weather: {time: "2026-07-25T08:30+02:00"}
machines: {combine: {machine: lexion-700-class}}
"""


@pytest.mark.parametrize("start", ["8.5", "null"])
def test_the_weathers_time_is_the_hour_of_the_stand(start):
    section = parse_scenario(LATE.replace("START", start)).field
    assert build_field(section, stream=STREAM, base=None).field.moisture.at(0)["straw_moisture"] == (
        pytest.approx(0.18)
    )


def test_two_hours_of_one_day_are_refused():
    with pytest.raises(InputError, match=r"stand.start_hour = 8.0: expected 8.5, .*field.weather.time"):
        build_field(parse_scenario(LATE.replace("START", "8")).field, stream=STREAM, base=None)
