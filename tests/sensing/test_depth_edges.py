"""Noise and depth edges: a scanner in front of two walls, and a real one that stood still."""

from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.site_setup import SiteSetup
from swath.machine.machine_sheet import load_machine
from swath.rays.hits import Hits
from swath.sensing.echo import EchoRule, Weather
from swath.sensing.lidar.plants import Params, PlantsLidar
from swath.sensing.lidar_sheet import load_lidar
from swath.sensing.mount import Mount
from swath.sensing.scanner import Noise
from tests.shared_data import DATA

NEAR, FAR = 3.0, 4.2
STATIC = DATA / "sick_lms111_static" / "lms111_static.npz"


class Walls:
    """Rays against x = NEAR where y > 0 and x = far elsewhere, both of the same grey."""

    def __init__(self, far):
        self.far = far

    def cast_bundles(self, spots, *, range_max, solids, t):
        origins, directions = spots.rays()
        near, far = ((wall - origins[..., 0]) / directions[..., 0] for wall in (NEAR, self.far))
        meets = origins[..., 1] + near * directions[..., 1] > 0.0
        distance = np.where(meets, near, far)
        grey = np.full(distance.shape, 0.5, np.float32)
        cosine = directions[..., 0].astype(np.float32)
        return Hits(distance.astype(np.float32), np.full(distance.shape, 7, np.uint8), cosine, grey)


def scanner(far=FAR, **params):
    quiet = {"sensor": "sick-lms111", "sector_deg": (-10, 10), "sub_rays": 61, "noise": "none"}
    field = SimpleNamespace(weather=None, plumes={}, film=lambda t: 0.0)
    machine = load_machine("lexion-700-class")
    setup = SiteSetup(field=field, machine=machine, start=Pose.identity(), edge_side="left", period=0.02)
    lidar = PlantsLidar(Params(mount=Mount(z_m=1.0), **(quiet | params)), setup)
    lidar.caster, lidar.sight = Walls(far), SimpleNamespace(ensure=lambda *_: None)
    lidar.reset(Stream(1, "lidar"))
    return lidar


def look(lidar, t=0):
    """x of the echoes in the sensor frame (beam_count, echo_count), and the scan."""
    n = len(lidar.azimuth)
    scan = lidar.scan_from(t, np.zeros((n, 3)), np.repeat(np.eye(3)[None], n, axis=0))["scan"]
    return scan.points()[..., 0], scan


def test_nearest_reaches_half_a_spot_over_the_edge_and_the_median_none():
    counts = {}
    for name, params in {
        "nearest": {"echo": "nearest"},
        "median": {"echo": "percentile"},
        "farthest": {"echo": "percentile", "percentile": 100},
    }.items():
        x, _ = look(scanner(**params, step_deg=0.05))
        assert np.allclose(np.minimum(abs(x - NEAR), abs(x - FAR)), 0.0, atol=0.03)
        counts[name] = int((abs(x[:, 0] - NEAR) < 0.1).sum())
    lidar = scanner()
    pattern = lidar.pattern.outermost
    half_spot = np.degrees(0.5 * lidar.sheet.beam.diameter(NEAR)[0] * pattern / NEAR)
    assert (counts["nearest"] - counts["median"]) * 0.05 == pytest.approx(half_spot, abs=0.06)
    # on the far wall the outermost sub-ray alone is too weak to be seen: a little less
    assert 0.8 * half_spot < (counts["median"] - counts["farthest"]) * 0.05 < half_spot + 0.06


def test_mean_gives_ranges_between_the_walls_where_the_spot_meets_both():
    lidar = scanner(echo="mean")
    x, _ = look(lidar)
    between = (x > NEAR + 0.05) & (x < FAR - 0.05)
    spot = np.degrees(lidar.sheet.beam.diameter(NEAR)[0] / NEAR)
    assert 1 <= between.sum() <= np.ceil(spot / 0.5)  # beams stand 0.5 deg apart, the spot is 1.0 deg wide
    assert not ((look(scanner(echo="percentile"))[0] > NEAR + 0.05) & (x < FAR - 0.05) & ~between).any()


def test_walls_further_apart_than_the_pulse_give_two_echoes():
    x, scan = look(scanner(echo="all", within="nearest"))
    both = np.isfinite(x[:, 1])
    assert 1 <= both.sum() <= 3
    assert x[both] == pytest.approx(np.tile([NEAR, FAR], (both.sum(), 1)), abs=0.03)
    # what the walls throw back of the whole beam adds up
    full = np.nanmax(scan.intensity[~both, 0])
    assert np.nansum(scan.intensity[both], axis=1) == pytest.approx(full, rel=0.01)
    merged, _ = look(scanner(NEAR + 0.6, echo="all"))
    assert merged.shape[1] == 2  # the sensor's two echoes, of which the second stays empty
    assert np.isnan(merged[:, 1]).all()


def test_a_trembling_beam_switches_at_the_edge_and_only_there():
    lidar = scanner(angle_noise_deg=0.1, noise="data_sheet")
    x = np.stack([look(lidar, t)[0][:, 0] for t in range(60)])
    sd = x.std(axis=0)
    at_edge = np.abs(np.degrees(lidar.azimuth)) < 0.3
    assert sd[at_edge].max() > 0.3  # between two walls 1.2 m apart: up to 0.6 m
    assert np.median(sd[~at_edge]) == pytest.approx(0.0105, abs=0.002)
    assert sd[np.abs(np.degrees(lidar.azimuth)) > 1.0].max() < 0.02


def test_drop_outs_and_dust_reach_the_scan():
    _, scan = look(scanner(drop_out_percent=30, step_deg=0.05))
    assert np.isnan(scan.ranges).mean() == pytest.approx(0.3, abs=0.06)
    assert np.array_equal(np.isnan(scan.ranges), np.isnan(scan.intensity))
    clear, _ = look(scanner())
    dusty, scan = look(scanner(weather=Weather(extinction_per_m=0.05, near_returns=0.5, near_share=1.0)))
    near = dusty[:, 0] < NEAR - 0.1
    assert 0.1 < near.mean() < 0.6
    assert np.array_equal(dusty[~near], clear[~near])
    whole = ~near & (np.abs(scan.azimuth) > np.radians(1.0))  # on one wall with all of the spot
    expected = 0.5 * np.cos(scan.azimuth[whole]) * np.exp(-0.1 * scan.ranges[whole, 0].astype(float))
    assert scan.intensity[whole, 0] == pytest.approx(expected, rel=0.01)


class Sky:
    """Nothing to hit."""

    def cast_bundles(self, spots, *, range_max, solids, t):
        n = spots.shape
        none = np.zeros(n, np.float32)
        return Hits(np.full(n, np.nan, np.float32), np.zeros(n, np.uint8), none, none)


@pytest.mark.parametrize("echo", get_args(EchoRule))
@pytest.mark.parametrize("spot", ["fixed", "turned", "random"])
def test_a_scan_of_nothing_is_empty(echo, spot):
    everything = {"angle_noise_deg": 0.1, "drop_out_percent": 5, "noise": "data_sheet", "sub_rays": 7}
    lidar = scanner(echo=echo, spot=spot, sensor="ouster-os1-64", **everything)
    lidar.caster = Sky()
    x, scan = look(lidar)
    assert x.shape == (len(lidar.azimuth), 1)
    assert np.isnan(scan.ranges).all()
    assert np.isnan(scan.intensity).all()


@pytest.mark.parametrize("spot", ["fixed", "turned", "random"])
def test_spots_are_drawn_from_the_counter_alone(spot):
    one, two = (scanner(spot=spot, echo="mean", step_deg=0.1) for _ in range(2))
    first, again, other = look(one, 40)[0], look(two, 40)[0], look(two, 80)[0]
    assert np.array_equal(first, again)
    assert np.array_equal(first, other) == (spot == "fixed")


@pytest.fixture(scope="module")
def static():
    if not STATIC.is_file():
        pytest.skip("no recordings: set SWATH_DATA")
    ranges = np.load(STATIC)["ranges_m"].astype(float)
    ranges[ranges < 0.05] = np.nan
    return ranges


def test_range_noise_is_that_of_a_real_scanner(static):
    """The model's spread of each beam against the recorded one, 175 scans, by range."""
    middle = np.nanmedian(static, axis=0)
    noise = Noise(load_lidar("sick-lms111"), is_on=True, angle=None, dropout=0.0)
    noise.reset(Stream(1, "lidar"))
    rng = np.random.default_rng(1)
    made = np.stack([noise.measure(middle, rng) for _ in range(len(static))])
    for low, high in ((0.2, 0.5), (0.5, 1.0), (1.0, 2.0)):
        inside = (middle > low) & (middle < high)
        real, model = (float(np.nanmedian(np.nanstd(r[:, inside], axis=0))) for r in (static, made))
        assert 0.0055 < real < 0.0095
        assert model == pytest.approx(real, rel=0.15)


def test_real_beams_at_depth_edges_lie_between_the_depths_and_stand_still(static):
    """What a LMS1xx does where its spot meets two surfaces less than a pulse apart: one echo between."""
    middle, sd = np.nanmedian(static, axis=0), np.nanstd(static, axis=0)
    step = middle[2:] - middle[:-2]
    share = (middle[1:-1] - middle[:-2]) / np.where(step == 0, np.nan, step)
    at_edge = np.flatnonzero((np.abs(step) > 0.15) & (share > 0.1) & (share < 0.9)) + 1
    assert len(at_edge) >= 1
    assert sd[at_edge].max() < 0.02
    # the model's merged echo does the same where the walls are less than a pulse apart
    close = NEAR + 0.5
    x = np.stack([look(scanner(close, echo="first", within="mean"), t)[0][:, 0] for t in range(3)])
    between = (x[0] > NEAR + 0.05) & (x[0] < close - 0.05)
    assert between.sum() >= 1
    assert np.array_equal(x[0], x[1])
    apart, _ = look(scanner(FAR, echo="first", within="mean"))
    assert not ((apart > NEAR + 0.05) & (apart < FAR - 0.05)).any()
