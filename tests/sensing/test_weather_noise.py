import numpy as np
import pytest

from swath.core.random import Stream
from swath.sensing.echo import Bundle, Receiver, disturb, least_energy, receive
from swath.sensing.echo import ScannerWeather as Weather
from swath.sensing.lidar_sheet import load_lidar
from swath.sensing.scanner import Noise

NAN = np.nan


def rng():
    return Stream(1, "air").at(7)


def test_dust_takes_energy_as_beer_and_lambert_say():
    distance = np.array([[2.0, 8.0, NAN]])
    moved, albedo = disturb(Weather(extinction_per_m=0.1), distance, np.full((1, 3), 0.5), 0.5, rng())
    assert np.array_equal(moved, distance, equal_nan=True)
    assert albedo[0, :2] == pytest.approx(0.5 * np.exp(-0.2 * np.array([2.0, 8.0])))
    assert Weather(rain_mm_h=25).extinction == pytest.approx(0.01 * 25**0.6)
    assert Weather().is_clear


def test_dust_shortens_the_reach_to_the_root_of_its_equation():
    # 0.4 exp(-2 b r) / r2 = 0.1 / 40^2 at b = 0.1: between 15 and 16 m instead of 80 m
    weather, receiver = Weather(extinction_per_m=0.1), Receiver("nearest", least_energy=least_energy(40.0))
    distance = np.linspace(1.0, 80.0, 791)[:, None]
    moved, albedo = disturb(weather, distance, np.full_like(distance, 0.4), 0.5, rng())
    seen = np.isfinite(receive(Bundle(moved, np.ones(1), albedo), receiver).distance[:, 0])
    last = distance[seen].max()
    assert (
        0.4 * np.exp(-0.2 * last) / last**2
        >= 0.1 / 1600
        > 0.4 * np.exp(-0.2 * (last + 0.1)) / (last + 0.1) ** 2
    )
    assert seen.sum() == round((last - 1.0) / 0.1) + 1


@pytest.mark.parametrize(("returns", "reach"), [(0.3, 1.0), (3.0, 0.5)])
def test_near_returns_come_as_often_and_as_near_as_asked(returns, reach):
    weather = Weather(near_returns=returns, near_reach_m=reach, near_share=1.0)
    free = np.full((40_000, 1), NAN)
    moved, albedo = disturb(weather, free, np.zeros_like(free), 0.7, rng())
    met = np.isfinite(moved[:, 0])
    assert met.mean() == pytest.approx(1 - np.exp(-returns), abs=0.01)
    assert moved[met].min() > 0.7
    assert (albedo[met] == weather.near_reflectance).all()
    # nearest of a Poisson process of mean measure returns (1 - exp(-x / reach))
    inside = 1 - np.exp(-returns * (1 - np.exp(-0.4 / reach)))
    assert (moved[:, 0] < 1.1).mean() == pytest.approx(inside, abs=0.01)


def test_near_returns_hide_only_what_lies_behind_and_only_their_share():
    weather = Weather(near_returns=10.0, near_reach_m=1.0, near_share=0.6)
    wall = np.full((4000, 19), 0.75)
    moved, _ = disturb(weather, wall, np.ones_like(wall), 0.7, rng())
    assert (moved <= 0.75).all()
    far = np.full((4000, 19), 9.0)
    moved, albedo = disturb(weather, far, np.full_like(far, 0.5), 0.7, rng())
    assert (moved < 9.0).mean() == pytest.approx(0.6, abs=0.01)
    # the sensor with several echoes looks through, the one with the nearest does not
    bundle = Bundle(moved, np.full(19, 1 / 19), albedo)
    assert np.nanmedian(receive(bundle, Receiver("nearest")).distance) < 2.0
    assert np.nanmedian(receive(bundle, Receiver("last", gap=0.75)).distance) == 9.0


@pytest.mark.parametrize("shape", [(0, 7), (5, 1)])
def test_air_and_noise_take_nothing_for_nothing(shape):
    free = np.full(shape, NAN)
    moved, albedo = disturb(Weather(0.2, 10.0, 1e-9), free, np.zeros(shape), 0.5, rng())
    assert moved.shape == albedo.shape == shape
    assert np.isnan(moved).all()
    assert np.isnan(noise_of("ouster-os1-64").measure(free, rng(), np.zeros(shape))).all()


def test_weather_depends_on_the_counter_alone():
    weather = Weather(near_returns=1.0)
    free = np.full((50, 7), NAN)
    stream = Stream(3, "combine.lidar").child("weather")
    one, two = (disturb(weather, free, np.zeros_like(free), 0.7, stream.at(40))[0] for _ in range(2))
    other = disturb(weather, free, np.zeros_like(free), 0.7, stream.at(80))[0]
    assert np.array_equal(one, two, equal_nan=True)
    assert not np.array_equal(one, other, equal_nan=True)
    assert np.isnan(free).all()  # what was handed in is left alone


def noise_of(name, **options):
    noise = Noise(load_lidar(name), **({"is_on": True, "angle": None, "dropout": 0.0} | options))
    noise.reset(Stream(1, "lidar"))
    return noise


def test_noise_grows_as_the_signal_falls_where_the_sheet_says_so():
    noise = noise_of("ouster-os1-64")
    for ratio, sigma in ((250, 0.015), (1e4, 0.015), (100, 0.030), (12, 0.100), (1, 0.100)):
        signal = np.full(20_000, ratio / noise.sheet.signal_at_reach)
        reported = noise.measure(np.full(20_000, 10.0), rng(), signal)
        assert reported.std() == pytest.approx(sigma, rel=0.03)
    plain = noise_of("sick-lms511-hr").sheet
    assert plain.noise_sigma(np.array([5.0]), np.array([1.0])) == pytest.approx(0.007)


def test_bias_is_constant_per_instance_and_within_the_band():
    sheet = load_lidar("sick-lms111")
    biases = []
    for seed in range(200):
        noise = Noise(sheet, is_on=True, angle=None, dropout=0.0)
        noise.reset(Stream(seed, "lidar"))
        biases.append(noise.bias)
    assert np.abs(biases).max() <= sheet.systematic
    assert np.std(biases) == pytest.approx(sheet.systematic / np.sqrt(3), rel=0.15)
    quiet = noise_of("sick-lms111", is_on=False)
    assert quiet.bias == 0.0
    assert quiet.measure(np.array([1.2345]), rng())[0] == 1.2345


def test_angle_noise_and_drop_outs_have_their_size():
    noise = noise_of("sick-lms111", angle=0.01, dropout=0.05)
    swing = np.concatenate([noise.swing(t, 500) for t in range(20)])
    assert swing.std() == pytest.approx(0.01, rel=0.03)
    assert np.mean([noise.dropped(t, 500).mean() for t in range(40)]) == pytest.approx(0.05, abs=0.005)
    assert noise_of("sick-lms111").swing(0, 5) is None
    assert noise_of("sick-lms111").dropped(0, 5) is None
