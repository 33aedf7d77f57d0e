"""The LiDAR level `replay`: rays through measured heights, against hand calculation and against `plants`."""

import contextlib
import io
import pickle
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.solid.solids import post
from swath.rays.height_grid import EVEN, load_height_grid
from swath.rays.heights import MEASURED, NOTHING, SOLID, UNMEASURED, HeightCaster
from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive as run
from swath.scenario.scenario import parse_scenario
from swath.sensing.lidar.replay import Params, ReplayLidar
from swath.tools.height_map.build import build_height_map
from tests.rays.height_rays import cast_heights
from tests.sensing.replay_rig import (
    SHARES,
    TEXT,
    drive,
    hand_grid,
    heights_of,
    set_where,
    small_world,
    source_of,
    wasserstein,
)


def ray(x, y, z, towards, down_deg):
    """Origin and direction of one ray."""
    b = np.radians(down_deg)
    d = np.array([np.cos(b) * np.cos(towards), np.cos(b) * np.sin(towards), -np.sin(b)])
    return np.array([[x, y, z]]), d[None]


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("down", [12.0, 45.0, 88.0])
def test_even_heights_are_hit_where_geometry_says(yaw, down):
    grid = hand_grid(heights=0.8, origin=(100.0, -50.0, 7.0), yaw=yaw)
    x, y = grid.to_world(6.0, 4.0)
    o, d = ray(float(x), float(y), 7.0 + 2.4, yaw + 0.3, down)
    hits = cast_heights(HeightCaster(grid), o, d, range_max=40.0, seed=1)
    assert hits.what[0] == MEASURED
    assert hits.distance[0] == pytest.approx(1.6 / np.sin(np.radians(down)), abs=2e-3)


def test_sloping_ground_carries_the_heights():
    grid = hand_grid(heights=0.5, slope=0.05)
    o, d = ray(1.0, 6.0, 2.0, 0.0, 20.0)
    hits = cast_heights(HeightCaster(grid), o, d, range_max=40.0)
    # 2 - t sin = 0.5 + 0.05 (1 + t cos)
    b = np.radians(20.0)
    assert hits.distance[0] == pytest.approx((1.5 - 0.05) / (np.sin(b) + 0.05 * np.cos(b)), abs=3e-3)


def test_rays_under_the_measured_ground_or_of_no_range_are_refused():
    caster = HeightCaster(hand_grid(heights=0.5, slope=0.05))
    o, d = ray(10.0, 6.0, 0.3, 0.0, 20.0)
    with pytest.raises(InputError, match=r"origin = \[10, 6, 0.3\]: .* it is 0.2 m below"):
        cast_heights(caster, o, d, range_max=40.0)
    assert cast_heights(caster, o + np.array([0.0, 0.0, 1.0]), d, range_max=40.0).what[0] == MEASURED
    with pytest.raises(InputError, match="range_max = nan: expected a finite range > 0 m"):
        cast_heights(caster, o + np.array([0.0, 0.0, 1.0]), d, range_max=float("nan"))


def test_wall_shadow_and_what_was_never_measured():
    grid = hand_grid(heights=0.0)
    set_where(grid, lambda u, v: (u > 5.0) & (u < 6.0), 1.0)  # a wall across
    set_where(grid, lambda u, v: (u > 6.0) & (u < 9.0), None)  # its shadow when it was measured
    caster = HeightCaster(grid)
    o, d = ray(2.0, 6.0, 1.2, 0.0, 11.0)
    hit = cast_heights(caster, o, d, range_max=40.0)
    assert hit.what[0] == MEASURED
    assert o[0, 0] + hit.distance[0] * d[0, 0] == pytest.approx(5.0, abs=2e-3)  # the face of the wall
    o, d = ray(2.0, 6.0, 3.0, 0.0, 25.0)  # over the wall, into the shadow
    over = cast_heights(caster, o, d, range_max=40.0)
    assert over.what[0] == UNMEASURED
    o, d = ray(2.0, 6.0, 3.0, 0.0, 17.0)  # over both, onto the ground behind
    assert cast_heights(caster, o, d, range_max=40.0).what[0] == MEASURED
    o, d = ray(2.0, 6.0, 3.0, 0.0, 3.0)  # beyond the box
    assert cast_heights(caster, o, d, range_max=80.0).what[0] == UNMEASURED
    assert cast_heights(caster, o, d, range_max=20.0).what[0] == NOTHING
    o, d = ray(2.0, 6.0, 3.0, 0.0, -10.0)
    assert cast_heights(caster, o, d, range_max=80.0).what[0] == NOTHING


@pytest.mark.parametrize("down", [10.0, 30.0, 70.0])
def test_an_even_stand_gives_back_the_distribution_that_was_measured(down):
    rng = np.random.default_rng(4)
    stand = np.sort(np.where(rng.random(4000) < 0.2, 0.0, rng.normal(0.8, 0.08, 4000)))
    measured = np.quantile(stand, SHARES)
    grid = hand_grid(tiles=(6, 8), heights=measured)
    n = 3000
    o = np.column_stack([rng.uniform(2, 4, n), rng.uniform(4, 12, n), np.full(n, 2.4)])
    d = np.repeat(ray(0, 0, 0, 0.2, down)[1], n, axis=0)
    hits = cast_heights(HeightCaster(grid), o, d, range_max=40.0, seed=9)
    z = o[:, 2] + hits.distance * d[:, 2]
    assert wasserstein(z, measured) < 0.015
    assert np.mean(z < 0.3) == pytest.approx(0.2, abs=0.03)


def test_a_fixed_share_is_that_quantile_and_higher_shares_are_met_earlier():
    grid = hand_grid(heights=np.linspace(0.4, 0.9, EVEN))
    o, d = ray(2.0, 6.0, 2.4, 0.0, 30.0)
    caster = HeightCaster(grid)
    z = [2.4 - 0.5 * cast_heights(caster, o, d, range_max=40, share=s).distance[0] for s in (0.1, 0.5, 0.9)]
    assert np.allclose(z, np.interp([0.1, 0.5, 0.9], SHARES, np.linspace(0.4, 0.9, EVEN)), atol=0.01)


def test_each_ray_is_drawn_alone_and_anew_in_every_scan():
    grid = hand_grid(heights=np.linspace(0.2, 0.9, EVEN))
    rng = np.random.default_rng(2)
    o = np.column_stack([rng.uniform(2, 4, 50), rng.uniform(4, 8, 50), np.full(50, 2.4)])
    d = np.repeat(ray(0, 0, 0, 0.0, 20.0)[1], 50, axis=0)
    caster = HeightCaster(grid)
    all_ = cast_heights(caster, o, d, range_max=40, seed=5).distance
    assert np.array_equal(all_[::-1], cast_heights(caster, o[::-1], d, range_max=40, seed=5).distance)
    assert np.array_equal(
        all_[:7], cast_heights(HeightCaster(grid), o[:7], d[:7], range_max=40, seed=5).distance
    )
    assert np.mean(all_ == cast_heights(caster, o, d, range_max=40, seed=6).distance) < 0.2


def test_solids_stand_before_and_shade_what_is_behind():
    grid = hand_grid(heights=0.8)
    o, d = ray(2.0, 6.0, 2.4, 0.0, 16.0)
    caster = HeightCaster(grid)
    free = cast_heights(caster, o, d, range_max=40)
    pole = post([5.0, 6.0, 0.0], 3.0, 0.2)
    hit = cast_heights(caster, o, d, range_max=40, solids=pole)
    assert free.what[0] == MEASURED
    assert hit.what[0] == SOLID
    assert hit.distance[0] == pytest.approx(2.9 / np.cos(np.radians(16.0)), abs=2e-3)
    behind = cast_heights(caster, o, d, range_max=40, solids=post([9.0, 6.0, 0.0], 3.0, 0.2))
    assert behind.distance[0] == free.distance[0]  # the crop hides it


@pytest.fixture(scope="module")
def world():
    return small_world()


@pytest.fixture(scope="module")
def recorded(world, tmp_path_factory):
    """A drive with `plants`, and the grid that was made from it."""
    plants = world.leader.parts["lidar"]
    outs, states = drive(plants, world)
    path = tmp_path_factory.mktemp("replay") / "drive.npz"
    build_height_map(source_of(plants, outs, states)).save(path)
    return path


def replay_of(world, path, **keys):
    setup = world.leader.parts["lidar"].setup
    return ReplayLidar(Params(file=str(path), sector_deg=(-25, 25), **keys), setup)


def test_another_path_and_speed_shows_the_heights_that_plants_shows_there(world, recorded):
    plants = world.leader.parts["lidar"]
    there, _ = drive(plants, world, offset=0.3, speed=3.0, length=7.0)
    lidar = replay_of(world, recorded)
    again, _ = drive(lidar, world, offset=0.3, speed=3.0, length=7.0)
    (p, h), (q, k) = heights_of(world, there), heights_of(world, again)
    assert wasserstein(h, k) < 0.02
    edge = world.field.first_edge
    crop, too = edge.signed_distance(p[:, 0], p[:, 1]) > 0.3, edge.signed_distance(q[:, 0], q[:, 1]) > 0.3
    assert wasserstein(h[crop], k[too]) < 0.02
    assert abs(np.mean(h > 0.4) - np.mean(k > 0.4)) < 0.02  # the edge is where it was
    assert lidar.beam_count == len(again) * len(lidar.azimuth)
    assert 0 < lidar.unmeasured_count < 0.1 * lidar.beam_count
    assert "nothing was measured" in lidar.notes[0]
    lost = sum(int(np.isnan(out["scan"].ranges).sum()) for out in again)
    assert lost == lidar.unmeasured_count


def test_a_run_goes_on_from_a_saved_state_with_the_same_bits(world, recorded):
    lidar = replay_of(world, recorded)
    outs, states = drive(lidar, world, length=1.0)
    other = replay_of(world, recorded)
    other.reset(Stream(5, "combine.lidar"))
    half = len(outs) // 2
    for k in range(half):
        other.step(k * 40_000_000, 40_000_000, {"state": tuple(states[5 * k : 5 * k + 5])})
    kept = other.save()
    for k in range(half, len(outs)):
        other.step(k * 40_000_000, 40_000_000, {"state": tuple(states[5 * k : 5 * k + 5])})
    other.load(kept)
    for k in range(half, len(outs)):
        out = other.step(k * 40_000_000, 40_000_000, {"state": tuple(states[5 * k : 5 * k + 5])})
        assert np.array_equal(out["scan"].ranges, outs[k]["scan"].ranges, equal_nan=True)
    assert other.unmeasured_count == lidar.unmeasured_count


def test_a_run_that_cuts_has_the_same_digest_when_it_is_saved_and_resumed(recorded):
    def fresh():
        keys = f"lidar: {{level: replay, file: '{recorded}',"
        return assemble(parse_scenario(TEXT.replace("lidar: {sub_rays: 7,", keys)))

    whole, half, rest = Digest(), Digest(), Digest()
    run(fresh(), [whole], until_s=1.6)
    world = fresh()
    run(world, [half], until_s=0.735)
    assert world.field.store.recut  # the header was in the crop by then
    kept = pickle.loads(pickle.dumps({"world": world.save(), "digest": half.save()}))
    other = fresh()
    other.load(kept["world"])
    rest.load(kept["digest"])
    run(other, [rest], resume=True, until_s=1.6)
    assert rest.hex == whole.hex


def test_what_a_header_cuts_is_stubble_from_then_on(recorded):
    world = small_world()
    edge = world.field.first_edge
    lidar = replay_of(world, recorded)
    before, _ = drive(lidar, world, length=2.0)
    points, height = heights_of(world, before)
    s = edge.signed_distance(points[:, 0], points[:, 1])
    assert np.mean(height[s > 0.5] > 0.5) > 0.95
    h = float(edge.heading_at(0.0))
    ahead, left = np.array([np.cos(h), np.sin(h)]), np.array([-np.sin(h), np.cos(h)])
    start = np.asarray(edge.point_at(0.0))
    corners = [start, start + 14 * ahead, start + 14 * ahead - 2 * left, start - 2 * left]
    world.field.cut(np.array(corners), 0.15)
    after, _ = drive(lidar, world, length=2.0)
    points, height = heights_of(world, after)
    s = edge.signed_distance(points[:, 0], points[:, 1])
    in_strip = (s > 0.2) & (s < 1.8)
    assert in_strip.any()
    assert height[in_strip].max() < 0.2
    assert np.mean(height[s > 2.3] > 0.5) > 0.9
    fresh = replay_of(world, recorded)  # sees the same without having looked before
    assert np.array_equal(
        drive(fresh, world, length=2.0)[0][-1]["scan"].ranges, after[-1]["scan"].ranges, equal_nan=True
    )


def test_placed_elsewhere_and_on_the_fields_own_ground(world, tmp_path):
    path = tmp_path / "hand.npz"
    hand_grid(heights=0.6).save(path)
    lidar = replay_of(world, path, x_m=10.0, y_m=-5.0, heading_deg=90.0, ground="field")
    grid = lidar.grid
    x, y = grid.to_world(3.0, 2.0)
    assert (float(x), float(y)) == pytest.approx((10.0 - 2.0, -5.0 + 3.0))
    assert float(grid.ground_height(x, y)) == pytest.approx(float(world.field.ground_height(x, y)), abs=0.01)


def test_a_file_that_is_none_is_named(world, tmp_path):
    for content in (None, b"", b"not a zip", b"PK\x03\x04 broken"):
        path = tmp_path / "bad.npz"
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(InputError, match=r"replay file(?=.*: expected ).*bad\.npz"):
            replay_of(world, path)
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(InputError, match="swath height-map build"):
        replay_of(world, tmp_path / "other.npz")


def good_file():
    stream = io.BytesIO()
    grid = hand_grid(tiles=(1, 2))
    from pathlib import Path
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        path = Path(folder) / "g.npz"
        grid.save(path)
        stream.write(path.read_bytes())
    return stream.getvalue()


GOOD = good_file()


@settings(max_examples=60)
@given(at=st.integers(0, len(GOOD) - 1), value=st.integers(0, 255), cut=st.booleans())
def test_damaged_files_are_refused_or_read_whole(at, value, cut, tmp_path_factory):
    path = tmp_path_factory.mktemp("damaged") / "g.npz"
    path.write_bytes(GOOD[:at] if cut else GOOD[:at] + bytes([value]) + GOOD[at + 1 :])
    with contextlib.suppress(InputError):
        assert load_height_grid(path).quantiles.shape[0] == 2


@settings(max_examples=30)
@given(
    name=st.sampled_from(
        ["table", "height_quantiles_mm", "count", "ground_m", "origin_m", "cell_m", "yaw_rad"]
    ),
    how=st.sampled_from(["drop", "short", "nan", "text", "huge"]),
)
def test_wrong_arrays_are_refused(name, how, tmp_path_factory):
    path = tmp_path_factory.mktemp("wrong") / "g.npz"
    with np.load(io.BytesIO(GOOD)) as data:
        arrays = {n: data[n] for n in data.files}
    old = arrays.pop(name)
    if how == "short":
        arrays[name] = old.reshape(-1)[: old.size // 2]
    elif how == "text":
        arrays[name] = np.array(["wheat"])
    elif how == "nan":
        arrays[name] = np.full(old.shape, np.nan)
    elif how == "huge":
        arrays[name] = np.full(old.shape, 1e30)
    if name in {"yaw_rad", "origin_m", "ground_m"} and how == "huge":
        how = "nan"  # large numbers are places, if odd ones
        arrays[name] = np.full(old.shape, np.nan)
    np.savez(path, **arrays)
    with pytest.raises(InputError, match="replay file"):
        load_height_grid(path)


def test_file_is_the_same_bytes_again_and_holds_no_pickles(tmp_path):
    grid = hand_grid(tiles=(1, 2))
    grid.save(tmp_path / "a.npz")
    load_height_grid(tmp_path / "a.npz").save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz") as file:
        assert file.testzip() is None
