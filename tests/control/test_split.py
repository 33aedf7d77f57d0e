"""The split rule on series of heights whose step is known."""

import numpy as np
import pytest

from tests.control.otsu_in_numpy import otsu_threshold, split_by_otsu


def series(first, n, *, low=0.1, high=0.8, low_sd=0.04, high_sd=0.12, seed=0):
    rng = np.random.default_rng(seed)
    return np.where(
        np.arange(n) < first, low + low_sd * rng.standard_normal(n), high + high_sd * rng.standard_normal(n)
    )


@pytest.mark.parametrize("first", [6, 30, 55])
def test_the_step_is_where_it_was_put(first):
    found = [int(np.argmax(split_by_otsu(series(first, 60, seed=s), 5)[0])) + 1 for s in range(20)]
    apart = np.abs(np.array(found) - first)
    assert apart.max() == 0


def test_one_population_gains_little():
    gains = [split_by_otsu(series(0, 80, seed=s), 5)[1] for s in range(200)]
    steps = [split_by_otsu(series(40, 80, seed=s), 5)[1] for s in range(200)]
    assert np.quantile(gains, 0.99) < 15.0 < min(steps)


def test_a_step_down_is_no_edge():
    score, gain = split_by_otsu(series(30, 60)[::-1].copy(), 5)
    assert gain < 15.0 or not np.isfinite(score.max())


@pytest.mark.parametrize("n", [0, 1, 5, 9])
def test_too_few_echoes_have_no_step(n):
    score, gain = split_by_otsu(np.zeros(n), 5)
    assert len(score) == max(n - 1, 0)
    assert gain == 0.0


def test_equal_heights_have_no_step():
    score, gain = split_by_otsu(np.full(40, 0.3), 5)
    assert gain < 1e-6
    assert not np.isnan(score).any()


def test_otsu_threshold_equals_an_exhaustive_search():
    z = series(25, 60, low_sd=0.1, high_sd=0.2, seed=4)

    def within(threshold):
        low, high = z[z <= threshold], z[z > threshold]
        return len(low) * low.var() + len(high) * high.var()

    middles = 0.5 * (np.sort(z)[1:] + np.sort(z)[:-1])
    best = middles[int(np.argmin([within(m) for m in middles]))]
    threshold, share = otsu_threshold(z)
    assert threshold == pytest.approx(best, abs=1e-12)
    assert share == pytest.approx(1.0 - within(best) / (len(z) * z.var()), abs=1e-9)
