"""Which echo a scanner reports in fog: that of the air or that of what stands behind it."""

import numpy as np
import pytest

from swath.core.random import Stream
from swath.sensing.echo import AirBefore, Bundle, Receiver, ScannerWeather, least_energy
from swath.sensing.haze import Haze

STEP, LEAST = 0.75, least_energy(40.0)


def air(extinction, weather, nearest=0.5):
    local = np.repeat(np.asarray(extinction)[:, None], 60, axis=1)
    haze = Haze(STEP, np.cumsum(local * STEP, axis=1), local)
    return AirBefore(weather, haze, None, 0.0, nearest, 40.0, Stream(1, "air").at(3))


@pytest.mark.parametrize("rule", ["percentile", "strongest", "first", "last", "all"])
def test_the_air_is_reported_where_the_rule_of_the_receiver_says_so(rule):
    draw = np.random.default_rng(11)
    n = 400
    a, far = draw.uniform(1e-4, 0.2, n), draw.uniform(3.0, 35.0, (n, 1)) + np.zeros((n, 3))
    far[::7] = np.nan
    white = draw.uniform(0.02, 0.8, (n, 1)) + np.zeros((n, 3))
    weather = ScannerWeather(lidar_ratio_sr=20.0, overlap_m=2.0)
    bundle = Bundle(far, np.full(3, 1.0 / 3.0), white)
    found, albedo = air(a, weather).between(bundle, Receiver(rule=rule, least_energy=LEAST))
    r = (
        STEP * 2.5 if STEP * 2.5 >= 2.0 else STEP * 3.5
    )  # middle of the first step that the receiver sees whole
    soft = np.pi * STEP / 20.0 * a * np.exp(-2.0 * a * r) / r**2
    hard = np.nan_to_num(white[:, 0] * np.exp(-2.0 * a * far[:, 0]) / far[:, 0] ** 2)
    rival = {"first": 0.0 * hard, "last": np.where(hard >= LEAST, np.inf, 0.0)}
    rival["all"] = rival["last"]
    expected = (soft > LEAST) & (soft > rival.get(rule, hard))
    near = np.abs(soft / LEAST - 1) < 1e-6
    is_air = np.abs(found[:, 0] - r) <= 0.5 * STEP + 1e-9
    assert expected.mean() > 0.05
    assert (is_air == expected)[~near].all()
    kept = ~expected & np.isfinite(far[:, 0])
    np.testing.assert_allclose(
        albedo[kept], white[kept] * np.exp(-2.0 * a[kept, None] * far[kept]), rtol=1e-9
    )


def test_rain_dims_through_haze_but_sends_nothing_back():
    weather = ScannerWeather(rain_mm_h=20.0, rain_law="drops")
    bundle = Bundle(np.array([[10.0]]), np.ones(1), np.array([[0.5]]))
    found, albedo = air([1e-9], weather).between(bundle, Receiver(least_energy=LEAST))
    assert found[0, 0] == 10.0
    assert albedo[0, 0] == pytest.approx(0.5 * np.exp(-20.0 * 3.65e-4 * 20.0**0.63), rel=1e-6)
