from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.tools.scan.converge import COUNTS, Settling, judge, settle, table, wasserstein


def settling(seed, means, sd=0.05, beams=2000):
    rng = np.random.default_rng(seed)
    shape = rng.standard_normal(beams)
    shape = (shape - shape.mean()) / shape.std()
    return Settling(seed, COUNTS, np.array([m + sd * shape for m in means]))


def test_enough_is_where_more_sub_rays_change_less_than_other_plants():
    settled = settling(1, [0.70, 0.78, 0.795, 0.80, 0.80])
    assert judge(settled, settling(2, [0.70, 0.78, 0.795, 0.80, 0.80])).enough == 19  # 5 mm is less than 1 cm
    verdict = judge(settled, settling(2, [0.73, 0.81, 0.825, 0.83, 0.83]))
    assert verdict.band["mean_m"] == pytest.approx(0.03)
    assert verdict.enough == 7  # 2 cm is less than the plants' 3 cm
    assert judge(settled, settling(2, [0.5, 0.6, 0.7, 0.75, 0.80])).enough is None


def test_change_is_that_of_single_beams():
    run = Settling(1, COUNTS, np.array([[0.0, 0.0, np.nan], *[[0.3, 0.4, np.nan]] * 4]))
    assert run.change()[0] == pytest.approx(np.sqrt(0.125))
    assert run.change()[1:] == pytest.approx(np.zeros(4))
    rows = table([run])
    assert [row["beams"] for row in rows] == [2] * 5
    assert rows[0]["ground_share"] == 1.0


def test_the_distance_of_histograms_is_scipy_s():
    stats = pytest.importorskip("scipy.stats", reason="scipy is not installed")
    rng = np.random.default_rng(1)
    a, b = rng.normal(0.8, 0.05, 300), rng.normal(0.82, 0.08, 211)
    assert wasserstein(a, b) == pytest.approx(stats.wasserstein_distance(a, b), rel=1e-12)
    assert wasserstein(a, a + 0.003) == pytest.approx(0.003)
    assert wasserstein(np.r_[a, np.nan], a) == 0.0
    assert np.isnan(wasserstein(a, np.full(3, np.nan)))
    one, other = settling(1, [0.7, 0.8, 0.8, 0.8, 0.8]), settling(2, [0.7, 0.8, 0.8, 0.8, 0.81])
    assert other.away(one)[-1] == pytest.approx(judge(one, other).seeds_m)
    assert judge(one, other).seeds_m == pytest.approx(0.01, abs=0.002)


def test_sweeps_go_ahead_and_only_the_crop_counts():
    """Ground 1 m up, crop for x > 3: points below the sensor, of which only those in the crop are heights."""
    seen = []

    def look(count, sweep, origins, rotations):
        seen.append((count, sweep, origins[0, 0]))
        points = np.repeat(origins[:, None], 2, axis=1)
        points[:, :, 2] = 1.0 + 0.001 * count
        points[0] = np.nan
        return points

    edge = SimpleNamespace(signed_distance=lambda x, y: x - 3.0)
    field = SimpleNamespace(first_edge=edge, ground_height=lambda x, y: np.ones_like(x))
    run = settle(look, field, Pose.from_euler((2.0, 0.0, 3.0)), seed=4, beams=3, sweeps=8)
    assert len(seen) == 8 * len(COUNTS)
    assert run.heights.shape == (len(COUNTS), 24)
    # x = 2, 2.25, .. 3.75: two of eight sweeps are more than 0.3 m inside; one beam of three sees nothing
    assert np.isfinite(run.heights).sum(axis=1).tolist() == [4] * 5
    assert run.statistics()["mean_m"] == pytest.approx(0.001 * np.array(COUNTS))
