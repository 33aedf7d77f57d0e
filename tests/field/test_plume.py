"""Puffs of dust against Gaussian plumes, Stokes' law, and their own sums."""

from math import exp, pi, sqrt

import numpy as np
import pytest

from swath.field.plume import Grains, Puffs, fall_speed
from swath.sensing.haze import Haze, extinction_at, haze_along

FINE = Grains(1.0, 1e-9, 1000.0, 300.0)  # does not fall; 0.3 m2/g


class Site:
    """A field of flat ground with one source of puffs."""

    def __init__(self, puffs):
        self.plumes = {"combine": puffs}

    def ground_height(self, x, y):
        return 0.0 * np.asarray(x)


def summed(puffs, points):
    """Extinction [1/m] by packed puffs (n, 6) at points x, y and height above the ground (m, 3)."""
    away = points[:, None, :2] - puffs[None, :, :2]
    flat = (away * away).sum(axis=2) * puffs[:, 3]
    up, down = points[:, None, 2] - puffs[:, 2], points[:, None, 2] + puffs[:, 2]
    parts = np.exp(-flat - up * up * puffs[:, 4]) + np.exp(-flat - down * down * puffs[:, 4])
    return (parts * puffs[:, 5]).sum(axis=1)


def blown(rate, wind, every, stability="C", length=400.0):
    """A source at 0, 0, 0 of so much [kg/s] that has blown along x until the plume is longer than needed."""
    puffs = Puffs(stability)
    for k in range(1, int(length / wind / every)):
        puffs.emit((0.0, 0.0, 0.0), rate * every, [FINE])
        puffs.drift(every if k > 1 else 0.5 * every, (wind, 0.0))
    return puffs


def spread(x):
    return 0.11 * x / sqrt(1 + 1e-4 * x), 0.08 * x / sqrt(1 + 2e-4 * x)


def test_a_puff_at_the_ground_is_as_thick_as_its_formula():
    puffs = Puffs("C")
    puffs.emit((0.0, 0.0, 0.0), 0.1, [FINE])
    for _ in range(10):
        puffs.drift(5.0, (0.0, 2.0))
    found = extinction_at(puffs.packed(), np.array([[0.0, 100.0, 0.0]]))[0] / FINE.extinction
    assert found == pytest.approx(13.38e-6, rel=2e-3)


def test_puffs_make_the_plume_of_a_steady_source():
    """10 g/s, 3 m/s, class C: 12.24 mg/m3 at the ground 100 m away."""
    puffs = blown(0.01, 3.0, 0.05)
    found = extinction_at(puffs.packed(), np.array([[100.0, 0.0, 0.0]]))[0] / FINE.extinction
    assert found == pytest.approx(12.24e-6, rel=0.01)


def test_light_across_a_plume_is_dimmed_as_far_away_by_the_gaussian_one():
    puffs = blown(0.01, 3.0, 0.5)
    draw = np.random.default_rng(7)
    for x, z in zip((100.0, *draw.uniform(60, 200, 5)), (0.0, *draw.uniform(0, 10, 5)), strict=True):
        high = spread(x)[1]
        depth = 300.0 * 0.01 * 2.0 * exp(-0.5 * (z / high) ** 2) / (sqrt(2 * pi) * high * 3.0)
        haze = haze_along(
            Site(puffs), np.array([[x, -100.0, z]]), np.array([[0.0, 1.0, 0.0]]), 0.0, 200.0, 0.75
        )
        assert haze.depths[0, -1] == pytest.approx(depth, rel=0.01)
        points = np.column_stack(np.broadcast_arrays(x, np.arange(-100, 100, 0.1), z))
        assert haze.depths[0, -1] == pytest.approx(0.1 * summed(puffs.packed(), points).sum(), rel=0.02)


@pytest.mark.parametrize("seed", range(6))
def test_beams_meet_the_sum_of_all_puffs_everywhere_on_and_over_the_ground(seed):
    draw = np.random.default_rng(seed)
    puffs = Puffs(draw.choice(list("ABCDEF")), start=draw.uniform(0.2, 3.0))
    for _ in range(30):
        puffs.emit((*draw.uniform(-15.0, 15.0, 2), draw.uniform(0.0, 3.0)), draw.uniform(0.0, 0.05))
        puffs.drift(draw.uniform(0.0, 2.0), draw.normal(0.0, 3.0, 2))
    origins = np.column_stack([draw.uniform(-20.0, 20.0, (40, 2)), draw.uniform(0.0, 5.0, 40)])
    ways = draw.normal(size=(40, 3))
    ways[:2] = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    step, packed = 0.75, puffs.merged()
    reach = np.append(40.0, draw.uniform(6.0, 40.0, 39))
    haze = haze_along(Site(puffs), origins, ways, 0.01, reach, step)
    points = origins[:, None] + step * (np.arange(haze.local.shape[1]) + 0.5)[None, :, None] * ways[:, None]
    points[..., 2] = np.maximum(points[..., 2], 0.0)
    peer = summed(packed, points.reshape(-1, 3)).reshape(haze.local.shape)
    is_before = step * np.arange(haze.local.shape[1]) < reach[:, None]
    assert (haze.local[~is_before] == 0.0).all()
    np.testing.assert_allclose(
        haze.local, np.where(is_before, peer + 0.01, 0.0), rtol=1e-5, atol=3e-9 * len(packed)
    )
    np.testing.assert_allclose(haze.depths, np.cumsum(haze.local, axis=1) * step, rtol=1e-12)
    np.testing.assert_allclose(extinction_at(packed, points[0]), peer[0], rtol=1e-5, atol=3e-9 * len(packed))
    place, albedo = haze.echo(5.0, 20.0)
    middles = step * (np.arange(haze.local.shape[1]) + 0.5)
    back = pi * step / 20.0 * haze.local * np.exp(-2.0 * (haze.depths - 0.5 * step * haze.local))
    best = np.where(middles >= 5.0, back / middles**2, 0.0).argmax(axis=1)
    np.testing.assert_array_equal(place, middles[best])
    np.testing.assert_allclose(albedo, back[np.arange(40), best], rtol=1e-12)


@pytest.mark.parametrize("start", [0.2, 1.0, 2.5])
def test_merged_puffs_take_from_light_what_all_of_them_take(start):
    draw = np.random.default_rng(5)
    puffs = Puffs("B", start=start)
    for _ in range(40):
        puffs.emit((0.0, 0.0, draw.uniform(0.2, 1.5)), 0.02)
        puffs.drift(1.0, (3.0, 0.5))
    packed, merged = puffs.packed(), puffs.merged()
    assert len(merged) < 0.6 * len(packed)
    along = np.arange(0.0, 120.0, 0.5)
    for y, z in draw.uniform([-10.0, 0.0], [20.0, 4.0], (10, 2)):
        points = np.column_stack(np.broadcast_arrays(along, y, z))
        assert summed(merged, points).sum() == pytest.approx(summed(packed, points).sum(), rel=5e-3)


def test_dust_falls_as_stokes_and_schiller_naumann_say():
    assert fall_speed(20e-6, 2650.0) == pytest.approx(31.4e-3, rel=0.005)
    assert fall_speed(10e-6, 1300.0) == pytest.approx(3.9e-3, rel=0.02)
    assert fall_speed(50e-6, 1300.0) == pytest.approx(92e-3, rel=0.02)
    assert fall_speed(2e-6, 2650.0) == pytest.approx(9.80665 * 2650 * 4e-12 / (18 * 1.81e-5), rel=1e-3)


def test_dust_stays_until_it_has_fallen_and_then_lies_on_the_ground():
    puffs = Puffs("D", start=2.0)
    puffs.emit((0.0, 0.0, 2.0), 10.0, [Grains(1.0, 100e-6, 1300.0, 50.0)])
    speed = fall_speed(100e-6, 1300.0)
    masses = []
    for _ in range(40):
        puffs.drift(0.25, (0.0, 0.0))
        masses.append(puffs.rows[0, 4])
    first = next(k for k, m in enumerate(masses) if m < 10.0)
    assert 0.25 * first <= 2.0 / speed <= 0.25 * (first + 1)
    assert (np.diff(masses[first:]) < 0.0).all()


def test_calm_air_keeps_dust_where_it_is_while_it_grows():
    puffs = Puffs("C", start=2.0)
    puffs.emit((1.0, 2.0, 1.0), 1.0, [FINE])
    before = puffs.spread()[0][0]
    for _ in range(20):
        puffs.drift(1.0, (0.0, 0.0))
    assert puffs.rows[0, :2].tolist() == [1.0, 2.0]
    assert puffs.spread()[0][0] > before
    whole = extinction_at(puffs.packed(), np.array([[1.0, 2.0, 1.0]]))[0]
    puffs.drift(500.0, (0.0, 0.0))
    assert not len(puffs.rows) or extinction_at(puffs.packed(), np.array([[1.0, 2.0, 1.0]]))[0] < whole


@pytest.mark.parametrize("dust", [0.002, 0.06, 0.4])
def test_even_haze_dims_as_beer_and_lambert_say(dust):
    ways = np.array([[0.0, 0.6, -0.8], [1.0, 0.0, 0.0]])
    haze = haze_along(Site(Puffs()), np.array([[0, 0, 5.0]] * 2), ways, dust, 30.0, 0.75)
    distance = np.array([[0.3, 7.1, np.nan], [12.0, 29.99, 31.0]])
    np.testing.assert_allclose(haze.depth(distance), dust * np.nan_to_num(distance), rtol=1e-9)


def test_fog_sends_back_what_the_equation_of_soft_targets_says():
    """Fog at 5 m over a target of 0.5 at 30 m: 11.2 times as much at a range of 50 m, 18.2 sr and 5 ns."""
    a, step = np.log(20.0) / 50.0, 0.5 * 299_792_458.0 * 5e-9
    local = np.full((1, 60), a)
    haze = Haze(step, np.cumsum(local * step, axis=1), local)
    place, albedo = haze.echo(5.0 - 0.5 * step, 18.2)
    at_5 = albedo[0] / place[0] ** 2 * (place[0] / 5.0) ** 2 * np.exp(2 * a * (place[0] - 5.0))
    assert abs(place[0] - 5.0) <= step
    assert at_5 / (0.5 * np.exp(-2 * a * 30.0) / 30.0**2) == pytest.approx(11.2, rel=0.005)
