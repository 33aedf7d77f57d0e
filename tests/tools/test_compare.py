import numpy as np
import pytest

from swath.core.errors import InputError
from swath.tools.distributions import compare, histogram_intersection, ks_distance, wasserstein1
from tests.agreement import is_good

EVEN = (np.arange(20_000) + 0.5) / 20_000


def test_shifted_and_stretched_uniform_have_their_closed_forms():
    assert wasserstein1(EVEN + 0.03, EVEN) == pytest.approx(0.03, abs=1e-9)
    assert ks_distance(EVEN + 0.03, EVEN) == pytest.approx(0.03, abs=1e-4)
    # U(0, 2) against U(0, 1): the quantiles differ by q, on average 1/2; the gap is largest at 1, F = 1/2
    assert wasserstein1(2 * EVEN, EVEN) == pytest.approx(0.5, abs=1e-4)
    assert ks_distance(2 * EVEN, EVEN) == pytest.approx(0.5, abs=1e-4)
    found = compare(2 * EVEN, EVEN)
    assert found.std_ratio == pytest.approx(2.0)
    assert histogram_intersection(2 * EVEN, EVEN) == pytest.approx(0.5, abs=1e-3)
    assert found.p95_bias_m == pytest.approx(0.95, abs=1e-3)


def test_point_masses():
    assert wasserstein1([0.0], [1.0]) == 1.0
    assert ks_distance([0.0, 1.0], [1.0]) == 0.5
    assert histogram_intersection([0.0, 1.0], [1.0]) == 0.5
    assert compare([0.0, 0.04, 0.3, np.nan], [1.0]).ground_bias == pytest.approx(2 / 3)


def test_against_scipy_with_samples_of_unlike_size_and_ties():
    stats = pytest.importorskip("scipy.stats")
    rng = np.random.default_rng(3)
    a = np.round(rng.normal(0.8, 0.2, 501), 2)
    b = np.round(rng.gamma(3.0, 0.2, 333), 2)
    assert wasserstein1(a, b) == pytest.approx(stats.wasserstein_distance(a, b), abs=1e-12)
    assert ks_distance(a, b) == pytest.approx(stats.ks_2samp(a, b).statistic, abs=1e-12)


def test_all_at_once_and_no_return_is_left_out():
    real = np.append(EVEN, np.nan)
    found = compare(real + 0.01, real)
    assert is_good(found)
    assert found.mean_bias_m == pytest.approx(0.01)
    assert found.p95_bias_m == pytest.approx(0.01)
    assert found.std_ratio == pytest.approx(1.0)
    assert not is_good(compare(EVEN + 0.03, EVEN))
    with pytest.raises(InputError):
        compare([np.nan], EVEN)
