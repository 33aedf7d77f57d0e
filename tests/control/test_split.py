"""The split rules on series of heights whose step is known."""

import numpy as np
import pytest
from examples.edge.consensus import fit_consensus
from examples.edge.mixture import Mixture, fit_mixture

from swath.control.edge.detector import EdgeParams
from swath.control.edge.line_fit import Prior
from swath.control.edge.max_likelihood import split_by_likelihood
from swath.control.edge.otsu import otsu_threshold, split_at, split_by_otsu
from tests.control.closed_loop import setup_of


def split_by_mixture(z, min_points):
    return Mixture(EdgeParams(), setup_of()).split(z, min_points)


def split_at_threshold(z, min_points):
    return split_at(0.45, z, min_points)


RULES = [split_by_likelihood, split_by_otsu, split_by_mixture, split_at_threshold]


def series(first, n, *, low=0.1, high=0.8, low_sd=0.04, high_sd=0.12, seed=0):
    rng = np.random.default_rng(seed)
    return np.where(
        np.arange(n) < first, low + low_sd * rng.standard_normal(n), high + high_sd * rng.standard_normal(n)
    )


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("first", [6, 30, 55])
def test_the_step_is_where_it_was_put(rule, first):
    found = [int(np.argmax(rule(series(first, 60, seed=s), 5)[0])) + 1 for s in range(20)]
    apart = np.abs(np.array(found) - first)
    assert apart.max() <= (2 if rule is split_by_mixture else 0)  # which learns from scan to scan


@pytest.mark.parametrize("rule", RULES)
def test_one_population_gains_little(rule):
    gains = [rule(series(0, 80, seed=s), 5)[1] for s in range(200)]
    steps = [rule(series(40, 80, seed=s), 5)[1] for s in range(200)]
    assert np.quantile(gains, 0.99) < 15.0 < min(steps)


@pytest.mark.parametrize("rule", RULES)
def test_a_step_down_is_no_edge(rule):
    score, gain = rule(series(30, 60)[::-1].copy(), 5)
    assert gain < 15.0 or not np.isfinite(score.max())


def test_low_echoes_deep_in_thin_crop_do_not_move_the_step():
    z = series(30, 60)
    z[[37, 44, 51]] = 0.05
    assert int(np.argmax(split_by_likelihood(z, 5)[0])) + 1 == 30


def test_scores_are_differences_of_log_likelihood_of_single_echoes():
    z = series(20, 50)
    score, _ = split_by_likelihood(z, 5)
    moved = score[20] - score[19]  # echo 20 from the crop to the stubble: it is a crop echo, so less likely
    assert moved < -1.0
    assert score[18] - score[19] < -1.0


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("n", [0, 1, 5, 9])
def test_too_few_echoes_have_no_step(rule, n):
    score, gain = rule(np.zeros(n), 5)
    assert len(score) == max(n - 1, 0)
    assert gain == 0.0


@pytest.mark.parametrize("rule", RULES)
def test_equal_heights_have_no_step(rule):
    score, gain = rule(np.full(40, 0.3), 5)
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


def test_a_mixture_is_that_which_was_drawn():
    share, mean, variance = fit_mixture(series(60, 200, seed=4), np.zeros((0, 2)))
    assert share == pytest.approx([0.7, 0.3], abs=0.02)
    assert mean == pytest.approx([0.8, 0.1], abs=0.03)
    assert np.sqrt(variance) == pytest.approx([0.12, 0.05], abs=0.03)  # 0.04 and the floor of 0.03


def test_the_line_of_most_agreement_passes_by_a_third_of_strays():
    rng = np.random.default_rng(2)
    x = np.sort(rng.uniform(2.0, 10.0, 90))
    u = 6.0 + 0.03 * (x - 6.0) + 0.02 * rng.standard_normal(90)
    u[::3] += 0.5
    line, weight = fit_consensus(x, u, np.full(90, 1e-4), 6.0, Prior(), None)
    assert line.offset == pytest.approx(6.0, abs=0.01)
    assert line.slope == pytest.approx(0.03, abs=0.005)
    assert weight[::3].sum() == 0.0
