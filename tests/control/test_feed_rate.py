import numpy as np
import pytest

from swath.control.ahead.penetration import Params as SightParams
from swath.control.ahead.penetration import Penetration
from swath.control.speed.feed_rate import FeedRate
from swath.control.speed.feed_rate import Params as FeedParams
from swath.control.speed.look_ahead import LookAhead
from swath.control.speed.look_ahead import Params as LookParams
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.signals import CropEdge, FeedReading, Odometry, Scan
from tests.control.closed_loop import setup_of
from tests.control.feed_rig import STEP, Bench, H, engine_at

KMH = 1 / 3.6


def even(mass):
    return lambda x: mass


def jump(x):
    """Twice the crop between 100 and 180 m."""
    return 1.8 if 100.0 <= x < 180.0 else 0.9


@pytest.mark.parametrize("mass", [1.2, 1.6, 2.5])
def test_feed_rate_ends_at_the_wanted_throughput(mass):
    rows = Bench(FeedRate, FeedParams(throughput_kg_s=36.0), even(mass)).run(120.0)
    assert rows[-1][4] == pytest.approx(36.0, rel=1e-3)
    assert rows[-1][2] == pytest.approx(36.0 / (12.0 * mass), rel=1e-3)


def test_the_engine_holds_it_back():
    """Fully loaded at 40 kg/s, at most 95 % of it: 38 kg/s although 50 are wanted."""
    rows = Bench(FeedRate, FeedParams(throughput_kg_s=50.0), even(1.6), strength=40.0).run(120.0)
    assert rows[-1][4] == pytest.approx(38.0, rel=1e-3)


def test_noise_of_the_sensor_does_not_pull_the_mean_down():
    """Ramps are steeper downwards than upwards: they must not rectify the noise."""
    bench = Bench(FeedRate, FeedParams(throughput_kg_s=36.0), even(1.6), noise=np.random.default_rng(3))
    flows = np.array([row[4] for row in bench.run(300.0)])[1000:]
    assert flows.mean() == pytest.approx(36.0, rel=0.01)
    assert flows.std() / flows.mean() < 0.03


@pytest.mark.parametrize(("law", "params"), [(FeedRate, FeedParams), (LookAhead, LookParams)])
def test_ramps_and_bounds_are_kept(law, params):
    sight = 10.0 if law is LookAhead else 0.0
    rows = np.array(Bench(law, params(throughput_kg_s=30.0, max_speed_kmh=9.0), jump, sight=sight).run(150.0))
    steps = np.diff(rows[:, 3]) / H
    assert steps.max() <= 0.3 * KMH + 1e-9
    assert steps.min() >= -1.0 * KMH - 1e-9
    assert rows[:, 3].max() <= 9.0 * KMH + 1e-12
    assert rows[:, 3].min() >= 1.5 * KMH - 1e-12


def test_without_crop_it_waits_at_entry_speed():
    bench = Bench(FeedRate, FeedParams(entry_speed_kmh=5.0), lambda x: 0.0 if x < 60.0 else 1.6)
    rows = np.array(bench.run(120.0))
    assert rows[rows[:, 1] < 60.0][:, 3] == pytest.approx(5.0 * KMH)
    assert rows[-1][4] == pytest.approx(39.0, rel=0.01)


def test_without_any_signal_it_keeps_its_entry_speed():
    law = FeedRate(FeedParams(), setup_of())
    law.reset(Stream(1, "speed"))
    assert law.step(0, STEP, {"feed": None, "engine": None})["command"].speed == pytest.approx(5.0 * KMH)
    assert law.step(STEP, STEP, {"feed": None, "engine": engine_at(0.5)})["command"].speed > 5.0 * KMH


def test_look_ahead_learns_what_sight_weighs():
    """1 of sight per second is 12 m of header times 1 / seen kg/m2."""
    bench = Bench(LookAhead, LookParams(throughput_kg_s=36.0), even(1.5), sight=10.0, seen=3.0)
    rows = bench.run(100.0)
    assert bench.law.rates(bench.x)[0][1] == pytest.approx(12.0 * 1.5, rel=0.01)
    assert rows[-1][4] == pytest.approx(36.0, rel=0.01)


def peaks(law, params, sight):
    rows = np.array(Bench(law, params, jump, sight=sight).run(160.0))
    inside = (rows[:, 1] > 60.0) & (rows[:, 1] < 220.0)
    return rows[inside, 4].max(), rows[inside, 4].std()


def test_looking_ahead_halves_the_peak_behind_a_jump():
    measured, _ = peaks(FeedRate, FeedParams(throughput_kg_s=30.0), 0.0)
    seen, _ = peaks(LookAhead, LookParams(throughput_kg_s=30.0), 12.0)
    assert measured > 1.6 * 30.0
    assert seen - 30.0 < 0.4 * (measured - 30.0)


def test_further_sight_is_better_up_to_the_way_of_slowing_down():
    tops = [
        peaks(LookAhead, LookParams(throughput_kg_s=30.0), sight)[0] for sight in (3.0, 6.0, 9.0, 14.0, 20.0)
    ]
    assert tops[0] > tops[1] > tops[2] > tops[3]
    assert tops[4] == pytest.approx(tops[3], rel=0.05)


def test_height_of_the_crop_serves_where_nothing_better_is_seen():
    law = LookAhead(LookParams(smooth_m=0.0), setup_of())
    law.reset(Stream(1, "speed"))
    for i in range(200):
        edge = CropEdge(i * STEP, 6.0, 0.0, 0.0, 9.0, 1.0, 0.8, 0.15)
        inputs = {"map": None, "edge": edge, "odometry": Odometry(i * STEP, 2.0, 0.0, 0.0)}
        law.step(
            i * STEP, STEP, {**inputs, "feed": FeedReading(i * STEP, 32.0), "engine": None, "ahead": None}
        )
    assert law.rates(1e3)[0][1] == pytest.approx(32.0 / 2.0, rel=1e-6)


@pytest.mark.parametrize(("law", "params"), [(FeedRate, FeedParams), (LookAhead, LookParams)])
def test_saved_laws_go_on_exactly(law, params):
    one, two = (Bench(law, params(), jump, sight=9.0) for _ in range(2))
    one.run(70.0)
    two.law.load(one.law.save())
    for name in ("speed", "x", "reading", "t"):
        setattr(two, name, getattr(one, name))
    two.line = one.line.copy()
    one.rows, two.rows = [], []
    assert one.run(60.0) == two.run(60.0)


def test_bounds_the_wrong_way_round_are_refused():
    with pytest.raises(InputError, match=r"min_speed_kmh = 9\.0: expected <= max_speed_kmh = 8"):
        FeedParams(min_speed_kmh=9.0, max_speed_kmh=8.0)


def random_stand(extinction, top, *, count, seed, ragged=0.0):
    """A scan of beams into a stand in which the way to the first hit is exponential; the truth is known."""
    rng = np.random.default_rng(seed)
    pose = Pose.from_euler((4.0, 6.0, 2.8), 0.0, np.deg2rad(10.0), 0.0)
    azimuth = np.linspace(np.deg2rad(-50.0), 0.0, count)
    directions = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)], axis=1) @ pose.rotation.T
    ways = rng.exponential(1.0 / extinction, count)
    start = (2.8 - top + ragged * rng.random(count)) / -directions[:, 2]
    ground = 2.8 / -directions[:, 2]
    ranges = np.minimum(start + ways, ground).astype(np.float32)[:, None]
    flat = np.zeros(count)
    return Scan(0, flat, azimuth, flat, ranges, np.ones_like(ranges)), pose


def seen(scan, pose, **params):
    sight = Penetration(SightParams(**params), setup_of(mounting=pose))
    sight.reset(Stream(1, "ahead"))
    return sight.step(0, STEP, {"scan": scan})["ahead"]


def test_height_and_place_of_the_canopy():
    scan, pose = random_stand(4.0, 0.85, count=400, seed=1)
    ahead = seen(scan, pose)
    assert ahead.height == pytest.approx(0.85, abs=0.05)
    assert ahead.ahead == pytest.approx(4.0 + (2.8 - 0.75) / np.tan(np.deg2rad(10.0)), abs=1.0)
    assert ahead.amount == pytest.approx(ahead.height * ahead.extinction)


def test_bare_ground_and_empty_scans_say_nothing():
    scan, pose = random_stand(4.0, 0.85, count=400, seed=1)
    bare = (2.8 / (np.sin(np.deg2rad(10.0)) * np.cos(scan.azimuth))).astype(np.float32)[:, None]
    for ranges in (np.full_like(scan.ranges, np.nan), bare):
        ahead = seen(Scan(0, scan.beam_t, scan.azimuth, scan.elevation, ranges, scan.intensity), pose)
        assert np.isnan(ahead.amount)
    sight = Penetration(SightParams(), setup_of(mounting=pose))
    assert np.isnan(sight.step(0, STEP, {"scan": None})["ahead"].amount)
