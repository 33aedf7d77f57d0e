import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from swath.rays.hits import Spots
from swath.sensing.beam import spot_pattern
from swath.sensing.echo import Bundle, Receiver, least_energy, merging_gap, receive

RULES = ["nearest", "percentile", "mean", "leading_edge", "first", "last", "strongest", "all"]
NAN = np.nan


def ranges(distance, weight=None, albedo=None, **receiver):
    d = np.atleast_2d(np.asarray(distance, dtype=float))
    w = np.full(d.shape[1], 1 / d.shape[1]) if weight is None else np.asarray(weight, dtype=float)
    a = np.ones_like(d) if albedo is None else np.atleast_2d(np.asarray(albedo, dtype=float))
    return receive(Bundle(d, w, a), Receiver(**receiver))


def test_rules_for_one_echo_on_known_distances():
    d = [[5.0, 3.0, NAN, 4.0, 6.0], [NAN] * 5]

    def reported(**receiver):
        return ranges(d, **receiver).distance[:, 0].tolist()

    assert reported(rule="nearest") == [3.0, pytest.approx(NAN, nan_ok=True)]
    for percentile, expected in ((0, 3.0), (25, 3.0), (50, 4.0), (75, 5.0), (76, 6.0), (100, 6.0)):
        assert reported(rule="percentile", percentile=percentile)[0] == expected
    energy = 1 / np.array([3.0, 4.0, 5.0, 6.0]) ** 2
    assert reported(rule="mean")[0] == pytest.approx(energy @ [3.0, 4.0, 5.0, 6.0] / energy.sum())


def test_percentile_counts_the_weights():
    heavy = [0.1, 0.1, 0.7, 0.1]
    assert ranges([[2.0, 3.0, 5.0, 9.0]], heavy, percentile=50).distance[0, 0] == 5.0
    assert ranges([[2.0, 3.0, 5.0, 9.0]], heavy, percentile=20).distance[0, 0] == 3.0
    # of the energy that hits something: the heavy one misses
    assert ranges([[2.0, 3.0, NAN, 9.0]], heavy, percentile=50).distance[0, 0] == 3.0


def test_percentile_is_monotone_and_between_nearest_and_farthest():
    rng = np.random.default_rng(1)
    d = rng.uniform(2, 9, (40, 37))
    d[d > 8] = NAN
    weight = spot_pattern(37).weight
    table = np.array([ranges(d, weight, percentile=p).distance[:, 0] for p in range(0, 101, 5)])
    assert np.all(np.diff(table, axis=0) >= 0)
    assert np.array_equal(table[0], np.nanmin(d, axis=1))
    assert np.array_equal(table[-1], np.nanmax(d, axis=1))


def test_echoes_closer_than_half_the_pulse_merge():
    gap = merging_gap(5e-9)
    assert gap == pytest.approx(0.7495, abs=1e-4)
    for apart, count in ((0.70, 1), (0.80, 2)):
        found = ranges([[4.0, 4.0, 4.0 + apart, 4.0 + apart]], rule="all", count=3, gap=gap, within="mean")
        assert np.isfinite(found.distance).sum() == count
    # a chain of hits is one echo however long it is: the receiver never sees the signal fall
    chain = np.arange(4.0, 7.0, 0.5)[None]
    assert np.isfinite(ranges(chain, rule="all", count=5, gap=gap).distance).sum() == 1


def test_first_last_strongest_and_all():
    d, w = [[3.0, 3.1, 6.0, 9.0, 9.1]], [0.05, 0.05, 0.5, 0.2, 0.2]
    far = {"gap": 0.75, "within": "nearest", "count": 3}
    assert ranges(d, w, rule="first", **far).distance.tolist() == [[3.0]]
    assert ranges(d, w, rule="last", **far).distance.tolist() == [[9.0]]
    assert ranges(d, w, rule="strongest", **far).distance.tolist() == [[6.0]]  # 0.5/36 > 0.1/9.3
    assert ranges(d, w, rule="all", **far).distance.tolist() == [[3.0, 6.0, 9.0]]
    found = ranges(d, w, rule="all", **(far | {"count": 5}))
    assert np.allclose(found.intensity[0, :3], [0.1, 0.5, 0.4])
    assert np.isnan(found.distance[0, 3:]).all()
    assert np.allclose(found.share.sum(axis=2), [[1, 1, 1, 0, 0]])
    assert ranges(d, w, rule="all", **(far | {"count": 2})).distance.tolist() == [[3.0, 6.0]]


def test_weak_echoes_are_lost_at_the_reach_of_the_data_sheet():
    least = least_energy(40.0)
    for albedo, reach in ((0.1, 40.0), (0.4, 80.0), (0.025, 20.0)):  # reach goes with the root of the albedo
        for factor, is_seen in ((0.999, True), (1.001, False)):
            one = ranges([[reach * factor]], [1.0], [[albedo]], least_energy=least)
            assert np.isfinite(one.distance[0, 0]) == is_seen
    # a first echo too weak to see leaves the second as the first
    found = ranges([[5.0, 30.0]], [0.001, 0.999], [[0.01, 0.5]], rule="first", least_energy=least)
    assert found.distance[0, 0] == 30.0


def test_hits_in_pulses_too_weak_to_see_do_not_count():
    # most of the beam meets something far too dark; what a little of it meets nearby is seen
    weak = {"weight": [0.2, 0.8], "albedo": [[0.3, 0.001]], "least_energy": least_energy(40.0)}
    for rule in ("nearest", "percentile", "mean", "leading_edge"):
        assert ranges([[2.0, 30.0]], rule=rule, **weak).distance[0, 0] == 2.0
    # less than a pulse apart they arrive as one
    close = weak | {"least_energy": least_energy(200.0), "gap": 0.75}
    assert ranges([[29.5, 30.0]], rule="percentile", **close).distance[0, 0] == 30.0


def test_leading_edge_triggers_where_the_energy_reaches_the_threshold():
    d, w = [[4.0, 5.0, 6.0]], np.array([0.02, 0.48, 0.5])
    energy = w / np.array(d[0]) ** 2
    share = np.cumsum(energy) / energy.sum()
    for threshold in (0.0, 0.01, share[0] * 1.01, share[1] * 0.99, share[1] * 1.01, 1.0):
        expected = d[0][int(np.argmax(share >= threshold * (1 - 1e-6)))]
        assert ranges(d, w, rule="leading_edge", threshold=threshold).distance[0, 0] == expected
    # the threshold is never below what can be detected at all
    least = energy[0] * 1.5
    assert ranges(d, w, rule="leading_edge", threshold=0.0, least_energy=least).distance[0, 0] == 5.0


def test_places_are_those_of_the_hits():
    d = np.array([[2.0, 4.0, NAN], [NAN, NAN, NAN]])
    slope = np.array([0.0, 1.0, 0.0])  # straight on, to the side, straight on
    offsets = np.stack([0 * slope, 0 * slope, slope, 0 * slope, 1 / np.sqrt(1 + slope**2)], axis=-1)[None]
    rays = Spots(np.full((2, 3), 10.0), np.tile(np.eye(3), (2, 1, 1)), offsets)
    bundle = Bundle(d, np.full(3, 1 / 3), np.ones((2, 3)))
    nearest = receive(bundle, Receiver("nearest")).places(rays, d)
    assert nearest[0, 0].tolist() == [12.0, 10.0, 10.0]
    assert np.isnan(nearest[1]).all()
    mean = receive(bundle, Receiver("mean")).places(rays, d)
    side = 4.0 / np.sqrt(2.0)  # energies 1/4 and 1/16: shares 0.8 and 0.2
    assert mean[0, 0] == pytest.approx([11.6 + 0.2 * side, 10.0 + 0.2 * side, 10.0])


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("shape", [(0, 7), (3, 1), (4, 19)])
def test_no_hit_is_no_echo(rule, shape):
    bundle = Bundle(np.full(shape, NAN), np.full(shape[1], 1 / shape[1]), np.zeros(shape))
    found = receive(bundle, Receiver(rule, count=3))
    assert found.distance.shape == (shape[0], 3 if rule == "all" else 1)
    assert np.isnan(found.distance).all()
    assert np.isnan(found.intensity).all()
    assert not found.share.any()


@given(
    hnp.arrays(
        float, hnp.array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.floats(0, 50) | st.just(NAN)
    ),
    st.sampled_from(RULES),
    st.sampled_from(["nearest", "percentile", "mean", "leading_edge"]),
    st.floats(0, 100),
    st.floats(0, 3),
    st.floats(0, 1),
)
def test_any_bundle_gives_echoes_between_its_hits(distance, rule, within, percentile, gap, albedo):
    """Whatever was hit: nothing raises, echoes rise and lie between nearest and farthest hit."""
    n, s = distance.shape
    receiver = Receiver(rule, within, percentile, 0.2, gap, 4, least_energy=1e-4)
    found = receive(Bundle(distance, np.full(s, 1 / s), np.full((n, s), albedo)), receiver)
    assert found.distance.shape == found.intensity.shape == (n, receiver.echo_count)
    for beam in range(n):
        seen = found.distance[beam][np.isfinite(found.distance[beam])]
        hits = distance[beam][np.isfinite(distance[beam])]
        assert np.isfinite(found.distance[beam][: len(seen)]).all()
        if len(seen):
            assert hits.min() - 1e-9 <= seen.min()
            assert seen.max() <= hits.max() + 1e-9
            assert np.all(np.diff(seen) >= 0)


@pytest.mark.parametrize("s", [16, 17, 61, 128, 129, 217])
def test_every_rule_with_many_sub_rays_as_one_beam_after_the_other_by_hand(s):
    """Hits in shuffled order, some missing, some equal, in several pulses: echo by echo in plain Python."""
    rng = np.random.default_rng(s)
    d = rng.choice([3.0, 5.0, 5.3, 9.0], (12, s)) + np.round(rng.uniform(0.0, 0.2, (12, s)), 2)
    d[rng.random((12, s)) < 0.2] = NAN
    albedo, weight = rng.uniform(0.1, 0.6, (12, s)), spot_pattern(s).weight
    gap, least = 0.75, 1e-3
    for rule in ("first", "last", "strongest", "all"):
        receiver = Receiver(rule, "percentile", 30.0, gap=gap, count=2, least_energy=least)
        found = receive(Bundle(d, weight, albedo), receiver)
        for beam in range(len(d)):
            hits = sorted((r, i) for i, r in enumerate(d[beam].tolist()) if r == r)
            starts = [k for k in range(len(hits)) if k == 0 or hits[k][0] - hits[k - 1][0] >= gap]
            pulses = [hits[a:b] for a, b in zip(starts, [*starts[1:], len(hits)], strict=True)]
            echoes = []
            for pulse in pulses:
                signal = math.fsum(weight[i] * albedo[beam, i] / r**2 for r, i in pulse) / least
                enough = 0.3 * math.fsum(weight[i] for _, i in pulse) - 1e-9
                weights = itertools.accumulate(weight[i] for _, i in pulse)
                r, i = next(hit for hit, w in zip(pulse, weights, strict=True) if w >= enough)
                if signal >= 1.0:
                    echoes.append((r, math.fsum(weight[j] * albedo[beam, j] for _, j in pulse), signal, i))
            if rule == "last":
                echoes = echoes[::-1]
            elif rule == "strongest":
                echoes = sorted(echoes, key=lambda echo: -echo[2])
            for k, (r, intensity, signal, i) in enumerate(echoes[: receiver.echo_count]):
                assert found.distance[beam, k] == r
                assert found.share[beam, k].argmax() == i
                assert found.intensity[beam, k] == pytest.approx(intensity, rel=1e-12)
                assert found.signal[beam, k] == pytest.approx(signal, rel=1e-12)
            assert np.isnan(found.distance[beam, len(echoes) :]).all()


@pytest.mark.parametrize("s", [5, 8, 19, 61, 200])
def test_an_echo_adds_up_as_numpy_does(s):
    """So that it has the bits that arrays would give, whatever the processor."""
    rng = np.random.default_rng(s)
    d, albedo, weight = (
        np.sort(rng.uniform(4.0, 4.5, (9, s))),
        rng.uniform(0.1, 0.6, (9, s)),
        rng.uniform(size=s),
    )
    found = receive(Bundle(d, weight, albedo), Receiver("mean"))
    bright = weight * albedo
    energy = bright / d**2
    share = energy / energy.sum(axis=1)[:, None]
    assert np.array_equal(found.intensity[:, 0], bright.sum(axis=1))
    assert np.array_equal(found.distance[:, 0], (share * d).sum(axis=1))
