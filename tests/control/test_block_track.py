"""Where a track of blocks begins, and how wide it looks: far scanners, rolling ground, bends, dust."""

import numpy as np
import pytest

from swath.control.edge.block_rows import POINTS, RETURNS, WALLS
from swath.control.edge.canopy_classes import (
    AIR,
    CELL,
    CLASSES,
    DUST,
    HALF,
    LAYER,
    LAYERS,
    LOWEST,
    NOTHING,
    PLACES,
)
from swath.signals import Scan
from tests.control.block_rig import Rig
from tests.control.canopy_scans import Canopy, answers, lay
from tests.control.synthetic_edge import mounting
from tests.control.test_likelihood_ratio import SPEED, drive

TRAVEL, SCANS = 0.08, 5  # m from scan to scan, scans of a block
FIRST, LONGEST = 4.0, 1.2  # m of travel of a block while there is no edge, and from which on it says little


def rays(edge, top, lost, rng, count=120, swallowed=(0.0, 0.0)):
    """Rays to either side of a frame, past an edge beside it [m] of a crop of some height [m].

    lost: share of them that do not come back; swallowed: from where to where beside the edge dust answers [m]
    """
    beside = rng.uniform(-2.4, 2.4, count)
    height = np.where(beside > edge, top - 0.1, 0.05) + 0.03 * rng.standard_normal(count)
    layer = ((height - LOWEST) / LAYER).astype(np.int64)
    kind = np.where(rng.uniform(size=count) < lost, NOTHING, layer)
    kind[(beside > edge + swallowed[0]) & (beside < edge + swallowed[1])] = DUST
    cells = np.floor((beside + HALF) / CELL).astype(np.int64) * CLASSES + kind
    return answers(cells)


def follow(edges, seed, *, tops=(0.85,), lost=0.0, swallowed=()):
    """(track, blocks followed after each block) past edges beside the way [m], block by block.

    tops: heights of the crop [m]; the last one stays
    swallowed: of each of the last blocks, as `rays` has it
    """
    track, rng, followed = Rig(), np.random.default_rng(seed), []
    for k, edge in enumerate(edges):
        top = tops[min(k, len(tops) - 1)]
        strip = ((0.0, 0.0),) * (len(edges) - len(swallowed)) + tuple(swallowed)
        for n in range(SCANS):
            at = TRAVEL * (SCANS * k + n), 0.0, 0.0
            scan = rays(edge - track.frame(*at).u, top, lost, rng, swallowed=strip[k])
            track.add(scan, TRAVEL, at, along=0.4 * 120, near=120)
        followed.append(track.row["followed"])
    return track, followed


def rays_along(way, frame, at, rng, count=240):
    """(rays of a machine at x [m], sum of their places along): their middle lies 9 m ahead of it, the wall
    that they show 1.2 m farther.

    way: (x) -> u of the edge [m]
    """
    c, s, x, u = np.cos(frame.angle), np.sin(frame.angle), frame.x + at, frame.u
    middle, wall = (c * (at + d - x) + s * (way(at + d) - u) for d in (9.0, 10.2))
    edge = c * (way(at + 10.2) - u) - s * (at + 10.2 - x) - 0.5 * frame.bend * wall**2
    seen = rays(edge, 0.85, 0.0, rng, count)
    beside = CELL * (seen["cell"] // CLASSES) - HALF
    seen["ahead"] = np.where(beside > edge, wall + 0.3 * rng.standard_normal(count), np.nan)
    return seen, middle * count


@pytest.mark.parametrize("radius", [15.0, 20.0])
def test_the_begin_of_a_bend_away_from_the_crop_lies_at_its_wall(radius):
    begin, rng, track = 16.0, np.random.default_rng(2), Rig()
    way = lambda x: -0.5 * max(x - begin, 0.0) ** 2 / radius  # noqa: E731
    for at in TRAVEL * np.arange(150):
        scan, along = rays_along(way, track.frame(at, 0.0, 0.0), at, rng)
        track.add(scan, TRAVEL, (at, 0.0, 0.0), along=along, near=240)
    x, u = track.points[:, :2].T
    beside = (u - [way(v) for v in x])[(x > begin) & (x < begin + 2.0)]
    assert len(beside) >= 4
    assert abs(beside.mean()) < 0.02


@pytest.mark.parametrize("seed", [0, 1])
def test_in_dust_the_gate_is_as_wide_as_a_block_is_blurred(seed):
    """Of 12 rays one comes back: an edge 0.35 m beside the track is not cut off at 0.28 m."""
    track, _ = follow([0.0] * 20 + [0.35] * 16, seed, lost=0.92)
    assert track.arc["u"] == pytest.approx(0.35, abs=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_where_dust_hides_the_strip_about_the_edge_the_track_goes_on_and_says_so(seed):
    """Rays of the stubble further out come back, and those in the crop: the edge is anywhere between."""
    draw = np.random.default_rng(seed)
    strips = [(-draw.uniform(0.6, 1.2), draw.uniform(0.0, 0.3)) for _ in range(8)]
    seen, _ = follow([0.0] * 30, seed)
    track, _ = follow([0.0] * 38, seed, swallowed=strips)
    assert np.abs(track.points[:, 1]).max() < 0.1
    assert track.row["agreed"] < 0.5 * seen.row["agreed"]


def test_crop_that_rises_from_block_to_block_is_a_front():
    rising, level = (
        follow([0.0] * 6, 3, tops=tops)[1] for tops in ((0.35, 0.5, 0.65, 0.8, 0.95), 5 * (0.65,))
    )
    assert rising[:4] == [0] * 4
    assert level[1:] == [1, 2, 3, 4, 5]


def test_an_edge_first_seen_far_ahead_is_told_where_the_machine_is():
    """A high scanner that looks 16 m ahead never sees the first metres: what lies ahead will be reached."""
    edges, error = drive(metres=8.0, mounted=mounting(height=3.0, ahead=16.0))
    first = next(k for k, e in enumerate(edges) if e.is_found)
    assert first * SPEED * 0.04 < 2.5
    assert all(e.is_found and e.confidence <= 0.45 for e in edges[first:])
    assert all(abs(v) < 2.0 * e.offset_sd for v, e in zip(error[first:], edges[first:], strict=True))


@pytest.mark.parametrize("seed", range(4))
def test_dust_to_one_side_of_the_edge_only_says_where_it_is_not(seed):
    """Hidden up to where the crop begins: not the middle of what is hidden, but what is known of the line."""
    rng, (track, _) = np.random.default_rng(seed), follow([0.0] * 20, seed)
    width = rng.uniform(0.15, 0.26)
    track.block.clear()
    for _ in range(SCANS):
        lay(track.block, rays(0.0, 0.85, 0.0, rng, swallowed=(-width, 0.0)), TRAVEL)
    alone, known = (track("find_edge", 0.28, variance)[0] for variance in (np.inf, 0.02**2))
    assert alone == pytest.approx(-0.5 * width, abs=0.03)
    assert abs(known) < 0.5 * abs(alone)


def added(place, chance, known):
    """Mean [m] and variance [m2] that chances of places add to a variance known."""
    return Rig()("added", known, len(place), place, chance)[:2]


@pytest.mark.parametrize("seed", range(4))
def test_what_a_block_adds_to_what_is_known_gives_it_again(seed):
    """The product of two normals is one: of a normal likelihood the part added is that likelihood."""
    draw, place = np.random.default_rng(seed), CELL * np.arange(-60, 61)
    mean, sd, known = draw.uniform(-0.1, 0.1), draw.uniform(0.06, 0.2), draw.uniform(0.05, 0.3) ** 2
    chance = np.exp(-0.5 * ((place - mean) / sd) ** 2)
    assert added(place, chance / chance.sum(), known) == pytest.approx((mean, sd**2), rel=0.02, abs=1e-3)
    assert added(place, np.ones(121), known)[1] > 1.0  # flat: it adds nothing


@pytest.mark.parametrize("seed", range(6))
def test_what_a_block_adds_lies_where_it_looked(seed):
    """Chances that rise to one side, as where dust hides the edge, once seemed an edge metres off."""
    draw, place = np.random.default_rng(seed), CELL * np.arange(-12, 13)
    steep, known = draw.choice([-1, 1]) * draw.uniform(1.0, 20.0), draw.uniform(0.05, 0.2) ** 2
    chance = np.exp(steep * place)
    mean, variance = added(place, chance / chance.sum(), known)
    assert abs(mean) <= place[-1]
    assert mean * steep >= 0.0
    assert variance > 0.0


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_haze_is_the_optical_depth_that_answers_so_many_rays(share):
    rig = Rig()
    rig.block.counts[:, DUST], rig.block.counts[:, 10] = 1000.0 * share, 1000.0 * (1.0 - share)
    np.testing.assert_allclose(rig("haze", told=PLACES), -np.log(1.0 - share), rtol=1e-3)


def test_an_echo_that_dust_may_have_sent_says_less():
    """(crop + dust) / (stubble + dust): nothing where dust is all there is; elsewhere what it was."""
    track, _ = follow([0.0] * 20, 1)
    dusty = np.array([track("ratios", haze, told=CLASSES) for haze in (0.0, 0.01, 0.1, 1e6)])
    assert np.abs(dusty[0]).max() > 1.0
    assert (np.diff(np.abs(dusty[:, :LAYERS]), axis=0) <= 1e-12).all()
    np.testing.assert_allclose(dusty[-1, :LAYERS], 0.0, atol=1e-4)


def search(populations, seed, *, blocks=20, turning=0.0, rays=60):
    """(track, travel [m] until an edge began or nan) of a machine that sees no edge yet.

    populations: of places beside the way (n,), shares of classes (n, CLASSES); turning: of it [rad/m]
    """
    track, rng = Rig(), np.random.default_rng(seed)
    for n in range(blocks * SCANS):
        place = rng.uniform(-3.0, 3.0, rays)
        drawn = rng.uniform(size=(rays, 1))
        kind = np.minimum((np.cumsum(populations(place), axis=1) < drawn).sum(axis=1), CLASSES - 1)
        cells = np.floor((place + HALF) / CELL).astype(np.int64) * CLASSES + kind
        stands = rng.uniform(size=rays) < 0.5
        travel = TRAVEL * (n + 1)
        at = travel, 0.0, turning * travel
        track.add(
            answers(cells, stands=stands, upper=place, lower=place), TRAVEL, at, near=rays, solid=stands
        )
        if track.has_arc:
            return track, travel
    return track, np.nan


def shares(**of):
    """Shares of classes by name."""
    kinds = {"stubble": 5, "crop": 12, "air": AIR, "dust": DUST, "nothing": NOTHING}
    made = np.zeros(CLASSES)
    made[[kinds[name] for name in of]] = list(of.values())
    return made / made.sum()


def faint(rng):
    """Crop in which few rays end, beside stubble of which few come back: in the air, or not at all."""
    crop, quiet = rng.uniform(0.10, 0.13), rng.choice(["air", "nothing"])
    return shares(crop=crop, stubble=0.04, **{quiet: 0.96 - crop}), shares(stubble=0.04, **{quiet: 0.96})


@pytest.mark.parametrize("seed", range(6))
def test_what_says_little_in_a_metre_begins_an_edge_in_four(seed):
    rng = np.random.default_rng(seed)
    place, (crop, stubble) = rng.uniform(-1.2, 1.2), faint(rng)
    field = lambda beside: np.where((beside > place)[:, None], crop, stubble)  # noqa: E731
    track, travel = search(field, seed)
    assert LONGEST < travel < 2.0 * FIRST
    assert abs(track.arc["u"] - place) < 0.25
    assert np.isnan(search(field, seed, turning=0.15)[1])  # it was somewhere else a metre before


@pytest.mark.parametrize("seed", range(6))
def test_one_population_never_begins_an_edge_however_far_it_is_driven(seed):
    rng = np.random.default_rng(20 + seed)
    for population in faint(rng):
        track, travel = search(lambda beside, of=population: np.tile(of, (len(beside), 1)), seed, blocks=40)
        assert np.isnan(travel)
        held = set(track.block.save()["rays"]["scan"])
        assert len(held) <= (LONGEST + 2.0 * TRAVEL) / TRAVEL  # and nothing piles up


def test_of_an_edge_along_which_blocks_pile_up_the_newest_stay():
    """A machine that hardly moves on adds points and returns without end: there is room for so many."""
    rig = Rig()
    for k in range(300):
        rig("point", float(k), 0.0, 1e-4, 1e-3 * k)
        rig("found_again", 1e-3 * k)
        rig("add_wall", 1e-3 * k, 0.0, 1.0)
    points, walls = rig.row["points"], rig.row["walls"]
    np.testing.assert_array_equal(rig.points[:, 0], np.arange(300 - POINTS, 300))
    np.testing.assert_allclose(points["returns"], 1e-3 * np.arange(300 - RETURNS, 300))
    np.testing.assert_allclose(walls["rows"][::4], 1e-3 * np.arange(300 - WALLS, 300))
    assert (points["count"], points["return_count"], walls["count"]) == (POINTS, RETURNS, WALLS)


def test_an_echo_of_the_air_at_the_scanner_says_that_nothing_answered():
    """At 0.7 to 1.5 m no crop stands: in fog and behind a dirty window beams that meet none answer there."""
    azimuth, ranges = np.linspace(-1.0, 1.0, 41), np.random.default_rng(1).uniform(0.7, 1.49, (41, 1))
    level, ones = np.zeros(41), np.ones((41, 1), np.float32)
    rays = Canopy(mounting(), centre=9.0)
    rays.take(Scan(1, level, azimuth, level, ranges.astype(np.float32), ones), speed=2.0)
    found = rays.block.save()["rays"]
    assert len(found) > 5
    assert set((found["cell"] % CLASSES).tolist()) == {AIR}
    assert np.isnan(found["height"]).all()
