from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.sub_rays import COUNTS, Convergence, compare, converge, table

from swath.core.frames import Pose


def converging(seed, means, sd=0.05, beams=2000):
    rng = np.random.default_rng(seed)
    shape = rng.standard_normal(beams)
    shape = (shape - shape.mean()) / shape.std()
    return Convergence(seed, COUNTS, np.array([m + sd * shape for m in means]))


def test_enough_is_where_more_sub_rays_change_less_than_other_plants():
    run = converging(1, [0.70, 0.78, 0.795, 0.80, 0.80])
    assert compare(run, converging(2, [0.70, 0.78, 0.795, 0.80, 0.80])).enough == 19  # 5 mm is less than 1 cm
    result = compare(run, converging(2, [0.73, 0.81, 0.825, 0.83, 0.83]))
    assert result.band["mean_m"] == pytest.approx(0.03)
    assert result.enough == 7  # 2 cm is less than the plants' 3 cm
    assert compare(run, converging(2, [0.5, 0.6, 0.7, 0.75, 0.80])).enough is None


def test_change_is_that_of_single_beams():
    run = Convergence(1, COUNTS, np.array([[0.0, 0.0, np.nan], *[[0.3, 0.4, np.nan]] * 4]))
    assert run.change()[0] == pytest.approx(np.sqrt(0.125))
    assert run.change()[1:] == pytest.approx(np.zeros(4))
    rows = table([run])
    assert [row["beams"] for row in rows] == [2] * 5
    assert rows[0]["ground_share"] == 1.0


def test_two_seeds_are_as_far_apart_as_their_heights():
    one, other = converging(1, [0.7, 0.8, 0.8, 0.8, 0.8]), converging(2, [0.7, 0.8, 0.8, 0.8, 0.81])
    assert other.away(one)[-1] == pytest.approx(compare(one, other).seeds_m)
    assert compare(one, other).seeds_m == pytest.approx(0.01, abs=0.002)


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
    run = converge(look, field, Pose.from_euler((2.0, 0.0, 3.0)), seed=4, beams=3, sweeps=8)
    assert len(seen) == 8 * len(COUNTS)
    assert run.heights.shape == (len(COUNTS), 24)
    # x = 2, 2.25, .. 3.75: two of eight sweeps are more than 0.3 m inside; one beam of three sees nothing
    assert np.isfinite(run.heights).sum(axis=1).tolist() == [4] * 5
    assert run.statistics()["mean_m"] == pytest.approx(0.001 * np.array(COUNTS))
