"""Dust on a window against the law of its transmission, the flux that settles, and what takes it off."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

import swath
from swath.core.errors import InputError
from swath.core.estimate import estimates
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.plume import PLANT, Grains, Puffs, fall_speed
from swath.field.weather import SiteWeather, Weather
from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario
from swath.sensing.window import Params, Window, transmission

AROUND = np.column_stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4), np.zeros(8)])
HERE = np.array([0.0, 0.0, 3.0])


class Site:
    """A field with weather and maybe puffs."""

    def __init__(self, puffs=None, **weather):
        self.weather = SiteWeather(Weather(**weather))
        self.plumes = {} if puffs is None else {"combine": puffs}

    def ground_height(self, x, y):
        return 0.0


def stand(window, site, seconds, steps=10, start=0.0):
    for k in range(steps + 1):
        t = int((start + seconds * k / steps) * NS)
        through = window.step(t, site, HERE, AROUND, Stream(1, "drops"))
    return through


def test_dust_of_a_harvest_takes_a_tenth_of_the_light_of_solar_cells_in_some_hours():
    """0.66 g/m2 an hour for 2.6 h; of what a scanner sees a fifth, and as much of its range."""
    assert transmission(np.array([0.0, 1.72]), 1.0) == pytest.approx([1.0, 0.898], abs=2e-3)
    assert transmission(np.array([0.0, 1.72])) == pytest.approx([1.0, 0.806], abs=2e-3)


def test_direct_light_lies_between_that_of_solar_glass_and_what_was_measured_outdoors():
    """Where solar cells lose 7 % direct light loses 50 % at most, 'A unified global investigation on the
    spectral effects of soiling losses of PV glass substrates'; by Mie's theory it loses exp(-k m) at least.
    """
    mass = np.linspace(0.01, 4.0, 400)
    cells, band = transmission(mass, 1.0), estimates(Params)["loss_factor"]
    at = float(np.interp(0.07, 1.0 - cells, mass))
    assert transmission(np.array(at), band.high) == pytest.approx(0.5, abs=0.02)
    assert 0.5 < transmission(np.array(at)) < np.exp(-1e-3 * PLANT[2].extinction * at)
    for grain, factor in ((PLANT[1], Params().loss_factor), (PLANT[2], band.low)):
        assert transmission(np.array(1.0), factor) == pytest.approx(
            np.exp(-1e-3 * grain.extinction), abs=0.01
        )
    assert (np.diff(transmission(np.linspace(0.0, 100.0, 500), 20.0)) <= 0.0).all()


def test_a_wider_beam_loses_fewer_echoes_to_drops():
    """Fersch et al. 2016 (doi:10.1109/GEMIC.2016.7461562): the ratio of drop and beam favours wide beams."""
    lost, mean = [], []
    for wide in (0.003, 0.006, 0.012, 0.024):
        window = Window(Params(drop_catch_percent=20.0, drop_mm=2.0), 4000, wide)
        around, stream = np.tile(AROUND, (500, 1)), Stream(1, "drops")
        for k in range(0, 240, 4):
            through = window.step(k * NS, Site(rain_mm_h=30.0), HERE, around, stream)
        lost.append(float((through**2 < 0.1).mean()))
        mean.append(float(through.mean()))
    assert lost == sorted(lost, reverse=True)
    assert lost[0] > 10.0 * lost[-1]
    assert mean == pytest.approx([mean[0]] * 4, rel=0.1)  # of the light as much comes through


def test_a_window_in_still_dust_catches_its_share_of_what_falls():
    site, middle = Site(dust_per_m=0.01), PLANT[1]
    window = Window(Params(fall_percent=10.0), 8)
    stand(window, site, 3600.0)
    falls = 0.01 / middle.extinction * fall_speed(middle.diameter, middle.density) * 3600.0
    assert window.mass == pytest.approx(np.full(8, 1e3 * 0.1 * falls), rel=1e-9)


def test_the_side_to_the_wind_gets_dirty_first():
    window = Window(Params(fall_percent=0.0), 8)
    through = stand(window, Site(dust_per_m=0.05, wind_m_s=5.0, wind_azimuth_deg=90.0), 1800.0)
    assert through.argmin() == 4  # looks west
    carried = 0.02 * 0.05 / PLANT[1].extinction * 5.0 * 1800.0 * 1e3
    np.testing.assert_allclose(window.mass, carried * np.maximum(-AROUND[:, 0], 0.0), atol=1e-9)


def test_dust_of_a_puff_settles_by_its_own_fall():
    puffs = Puffs("C", start=3.0)
    puffs.emit((0.0, 0.0, 3.0), 0.5, [Grains(1.0, 50e-6, 1300.0, 80.0)])
    window = Window(Params(impaction_percent=0.0), 8)
    stand(window, Site(puffs), 10.0)
    thick = 0.5 / ((2 * np.pi) ** 1.5 * 27.0) * (1.0 + np.exp(-0.5 * 36.0 / 9.0))
    assert window.mass == pytest.approx(np.full(8, 1e3 * 0.1 * thick * fall_speed(50e-6, 1300.0) * 10.0))


def test_a_cloth_and_rain_take_it_off_and_the_scanner_warns():
    window = Window(Params(dust_g_m2=4.0, wiped_s=(5.0,)), 8)
    assert stand(window, Site(), 4.0).max() < 0.85
    assert "warning" in window.notes[0]
    assert stand(window, Site(), 2.0, start=4.0) == pytest.approx(np.ones(8))
    rained = Window(Params(dust_g_m2=4.0, rinse_mm=2.0, drop_catch_percent=0.0), 8)
    stand(rained, Site(rain_mm_h=6.0), 2400.0)
    assert rained.mass == pytest.approx(np.full(8, 1.0))
    saved = rained.save()
    rained.reset()
    assert rained.mass[0] == 4.0
    rained.load(saved)
    assert rained.mass == pytest.approx(np.full(8, 1.0))


def test_drops_cover_what_comes_less_what_runs_off():
    """Their mean against the balance of a drop's circle: catch R 2.38 / d on what is free, over stay_s."""
    draw = np.random.default_rng(1)
    rain, drop_mm, stay = (
        float(draw.uniform(5, 40)),
        float(draw.uniform(0.5, 3.0)),
        float(draw.uniform(20, 60)),
    )
    window = Window(Params(drop_catch_percent=20.0, drop_mm=drop_mm, drop_stay_s=stay), 4000, 0.014)
    around, stream = np.tile(AROUND, (500, 1)), Stream(1, "drops")
    for k in range(int(6 * stay)):
        through = window.step(k * NS, Site(rain_mm_h=rain), HERE, around, stream)
    rate = 0.2 * rain / 3.6e6 * (0.25 * np.pi * 2.0 ** (2.0 / 3.0)) / (np.pi / 6.0) / (1e-3 * drop_mm)
    assert window.drops.mean() == pytest.approx(rate * stay / (1.0 + rate * stay), rel=0.1)
    assert window.drops.std() > 0.0
    np.testing.assert_allclose(through, 1.0 - window.drops)


def test_dirt_sensors_say_the_state_of_the_dirtiest_sector():
    window = Window(Params(dirt_sensors=4, loss_factor=1.0), 8)
    for mass, state in ((0.0, 0), (2.5, 1), (5.5, 2), (30.0, 3)):
        window.mass[:] = 0.0
        window.mass[4:6] = mass
        window.step(NS, Site(), HERE, AROUND, Stream(1, "drops"))
        assert window.told.state == state
        assert window.told.transmission == pytest.approx(float(transmission(np.array(mass), 1.0)))
        assert window.told.sector == (2 if mass else 0)
    with pytest.raises(InputError, match="serious_percent <= error_percent <= warning_percent"):
        Params(error_percent=95.0)


@pytest.mark.parametrize("level", ["empirical", "plants"])
def test_a_run_records_what_the_scanner_says_of_its_window(tmp_path, level):
    """As columns of the tracks and as a message of ROS 2's diagnostics, at every level the same numbers."""
    sets = ["run.distance_m=0.5", f"combine.lidar.level={level}", "combine.lidar.window.dust_g_m2=1",
            "combine.edge=truth", "combine.lidar.sector_deg=[-5, 5]"]  # fmt: skip
    swath.run("straight", sets=sets, out=tmp_path / "run", report=False)
    table = pq.read_table(tmp_path / "run" / "tracks.parquet")
    assert set(table["window_state"].to_pylist()) == {1.0}
    assert table["window_transmission"][0].as_py() == pytest.approx(float(transmission(np.array(1.0))))
    with (tmp_path / "run" / "run.mcap").open("rb") as stream:
        (schema, channel, _), *_ = make_reader(stream).iter_messages(topics=["/diagnostics"])
    assert schema.name == "diagnostic_msgs/msg/DiagnosticArray"
    assert channel.topic == "/diagnostics"
    with pytest.raises(InputError, match="expected no window that gets dirty"):
        assemble(load_scenario("straight", sets=[
            "combine.lidar={level: profile, window: {}}", "combine.header.level=profile"
        ]))  # fmt: skip
