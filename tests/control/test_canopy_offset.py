"""How far the canopy hangs over the edge, learned from counts of echoes; and what dust may hide."""

import numpy as np
import pytest
import warp as wp

from swath.control.edge.feet.canopy_offset import LAYER, TALLEST, stopped
from swath.control.edge.feet.canopy_offset_kernel import code
from swath.kernels import repeatable, shared
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive as run
from swath.scenario.scenario import load_scenario
from tests.control.canopy_learned import CanopyOffset, Rays
from tests.control.edge_drive import drive, errors
from tests.evaluated import metrics_of

NORMAL = np.array([np.linspace(-6, 6, 1201)] * 2)
NORMAL[1] = np.cumsum(np.exp(-0.5 * NORMAL[0] ** 2))
NORMAL[1] /= NORMAL[1, -1]


TOP, LIMIT = 0.9, 0.45
CHAIN = ("run.distance_m=25", "combine.lidar.sub_rays=7", "combine.edge=otsu")


def look(rng, parts, pieces, spread, edge, count=80):
    """The rays of a scan over an edge whose feet end at u = `edge`: stopped by `parts` of the `pieces` they
    would meet down to half the height, where Phi((u - edge) / spread) of the stand is there."""
    u = np.sort(rng.uniform(-1.5, 1.6, count))
    share = np.maximum(np.interp((u - edge) / spread, *NORMAL), 1e-9)
    way = rng.standard_gamma(parts, count) / (pieces * share)  # until so many pieces are met, 1 = to LIMIT
    z = np.where(way < 1.0, TOP - way * (TOP - LIMIT), 0.05)
    return Rays(u, u, z, TOP, LIMIT)


def learned(parts, pieces, spread, edge, *, guess=0.057, scans=500, memory=30.0, seed=0):
    """Shift found after so many scans 8 cm apart."""
    rng, offset = np.random.default_rng(seed), CanopyOffset(memory, guess, parts=parts)
    for _ in range(scans):
        offset.move(0.08)
        offset.add(look(rng, parts, pieces, spread, edge), 0.95)
    return offset.shift(0.95)


@pytest.mark.parametrize("parts", [1, 2, 3, 6])
def test_the_chance_to_meet_so_many_pieces_is_that_of_drawn_ones(parts):
    drawn = np.random.default_rng(2).poisson([[1.0], [4.0]], (2, 40_000))
    assert stopped(np.array([1.0, 4.0]), parts) == pytest.approx((drawn >= parts).mean(axis=1), abs=0.01)


@wp.func_native(
    code() + "return height_at(counts.data, counts.shape[0], sum(counts.data, counts.shape[0]), share, 0.02);"
)
def height_of(counts: wp.array(dtype=wp.float64), share: wp.float64) -> wp.float64: ...


@wp.kernel
def read_heights(counts: wp.array2d(dtype=wp.float64), shares: wp.array2d(dtype=wp.float64)):
    w = wp.tid()
    for k in range(shares.shape[1]):
        shares[w, k] = height_of(counts[w], shares[w, k])


def test_heights_below_which_a_share_lies():
    """Where the counts reach the share, straight between layers; also with empty layers, and a single one."""
    rng, shares = np.random.default_rng(1), np.array([0.1, 0.5, 0.93])
    counts = rng.uniform(0.0, 9.0, (40, round(TALLEST / LAYER))) * (rng.random((40, 200)) < 0.3)
    counts[0] = np.histogram(rng.uniform(0.4, 0.9, 50_000), bins=200, range=(0.0, TALLEST))[0]
    counts[1], counts[1, 7] = 0.0, 3.0
    found = np.tile(shares, (40, 1))
    repeatable(read_heights, [shared(counts), shared(found)], threads=40).launch()
    for row, heights in zip(counts, found, strict=True):
        below = np.interp(heights, LAYER * np.arange(1, 201), np.cumsum(row) / row.sum())
        np.testing.assert_allclose(below, np.maximum(shares, row[0] / row.sum()), atol=1e-9)
    assert found[0, :2] == pytest.approx([0.45, 0.65], abs=0.005)


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize(
    ("pieces", "spread", "edge"), [(3.5, 0.035, 0.0), (14.0, 0.08, 0.1), (9.0, 0.15, 0.22)]
)
def test_the_offset_of_the_canopy_is_found_whatever_the_guess_and_the_crop(parts, pieces, spread, edge):
    found = learned(parts, pieces * parts**0.5, spread, edge)
    assert found == pytest.approx(edge, abs=0.02)
    assert learned(parts, pieces * parts**0.5, spread, edge, guess=0.0) == pytest.approx(found, abs=0.003)


def test_back_to_a_saved_moment():
    rng, one, two = np.random.default_rng(4), CanopyOffset(30.0, 0.05), CanopyOffset(30.0, 0.05)
    steps = [look(rng, 1, 9.0, 0.1, 0.1) for _ in range(60)]
    for k, step in enumerate(steps):
        if k == 30:
            state = one.save()
        one.move(0.08)
        one.add(step, 0.9)
    two.load(state)
    for step in steps[30:]:
        two.move(0.08)
        two.add(step, 0.9)
    assert two.shift(0.9) == one.shift(0.9) != 0.045


@pytest.mark.parametrize(("density", "lean"), [(200.0, 0.15), (700.0, 0.05)])
def test_the_feet_are_found_in_the_closed_form_canopy(density, lean):
    """A canopy that shares nothing with the rule but that it leans to both sides; 6 cm with the guess."""
    found = errors(drive(scans=350, stand={"density": density, "lean": lean}), after=7.0)
    assert abs(found[2]) < 0.04


@pytest.mark.parametrize("spot", [0.05, 0.10])
def test_that_a_spot_touches_the_crop_early_is_learned_too(spot):
    assert abs(errors(drive(scans=250, stand={"spot": spot}), after=5.0)[2]) < 0.01


@pytest.mark.parametrize(
    ("sets", "most"),
    [
        (("field.stand.stems_per_m2=200",), 0.02),
        pytest.param(
            ("field.stand.crop=barley", "field.edge.stubble_height_m=0.15"), 0.025, marks=pytest.mark.draws
        ),
    ],
)
def test_thin_wheat_and_barley_on_real_stems(sets, most):
    world = assemble(load_scenario("straight", sets=[*CHAIN, *sets]))
    evaluation = make_evaluation(world)
    run(world, [evaluation])
    metrics = metrics_of(evaluation)
    assert abs(metrics["edge_bias_m"]) < most  # 3.4 to 5 cm with a guess that holds throughout
    assert metrics["edge_rmse_m"] < 0.04


@pytest.mark.parametrize("dust", [0.1, 0.3])
def test_dust_above_the_crop_is_looked_through(dust):
    share, rmse, bias, _ = errors(drive(scans=150, dust=dust))
    assert share == 1.0
    assert rmse < 0.03
    assert abs(bias) < 0.02


def test_no_edge_is_made_of_dust():
    for offset in (-30.0, 30.0):  # stubble alone, crop alone
        assert drive(scans=150, dust=0.3, offset=offset)[:, 1].sum() == 0.0
