"""Speed level `map_ahead`: how much of the crop's variation is left, against closed forms."""

from math import sqrt

import numpy as np
import pytest

from swath.control.speed import look_ahead
from tests.control.feed_rig import Bench

LENGTH, MEAN = 3000.0, 1.6
OPEN = {
    "learn_m": 1000.0,
    "slope_m": 3000.0,
    "max_speed_kmh": 20.0,
    "entry_speed_kmh": 7.0,
    "ramp_kmh_s": 5.0,
}


def smooth(seed, apart=40.0):
    """Unit noise every metre with bends every 40 m."""
    nodes = np.random.default_rng(seed).standard_normal(int(LENGTH / apart) + 4)
    x = np.arange(LENGTH + 60.0) / apart
    part, k = x % 1.0, x.astype(int)
    made = nodes[k] + (nodes[k + 1] - nodes[k]) * part * part * (3.0 - 2.0 * part)
    return (made - made.mean()) / made.std()


def field(r, cv, seed=1):
    """Crop [kg/m2] with a coefficient of variation, and a map with correlation r to it, every metre."""
    told, rest = smooth(seed), smooth(seed + 50)
    rest = rest - told * float(np.mean(rest * told))
    rest /= rest.std()
    return MEAN * (1.0 + cv * (r * told + sqrt(1.0 - r * r) * rest)), MEAN * (1.0 + cv * told)


def spread(crop, chart, **params):
    at = np.arange(len(crop), dtype=float)
    bench = Bench(
        look_ahead.MapAhead,
        look_ahead.MapParams(throughput_kg_s=MEAN * 12.0 * 2.0, **(OPEN | params)),
        lambda x: float(np.interp(x, at, crop)),
        sight=10.0,
        chart=lambda x: float(np.interp(x, at, chart)),
    )
    while bench.x < LENGTH:
        bench.step()
    cut = np.array([row[4] for row in bench.rows if row[1] > 600.0])
    return cut.std() / cut.mean()


def test_what_the_map_does_not_tell_is_left():
    """CV of the crop times sqrt(1 - r^2) within 10 %: the throughput is crop over forecast."""
    r = 0.8
    crop, chart = field(r, 0.15)
    assert spread(crop, chart) == pytest.approx(0.15 * sqrt(1.0 - r * r), rel=0.1)


def test_a_map_that_tells_nothing_does_no_harm():
    """Correlation 0: as without a map, by the feeder alone; in full it would be sqrt(2) of the crop's."""
    crop, chart = field(0.0, 0.15, seed=3)
    flat = np.full(len(chart), MEAN)
    assert spread(crop, chart, learn_m=5.0) < 1.15 * spread(crop, flat, learn_m=5.0)


def test_an_exact_map_of_another_scale_leaves_little():
    crop, _ = field(1.0, 0.15)
    assert spread(crop, 0.3 * crop) < 0.02
