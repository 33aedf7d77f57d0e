"""The walk for a card against the plain kernel: its text on the CPU, lane by lane; PTX; a card if any."""

import sys
from pathlib import Path

import numpy as np
import pytest
from bundle_rays import bundles, check_same, same_share
from hand_field import HandField, make_pages, set_bumps, small_library
from hills import make_hills, over

sys.path.insert(0, str(Path(__file__).parents[1] / "field"))
from made_field import made_field

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.crop import load_crop
from swath.field.layout import Organ, Solids
from swath.field.library import make_library
from swath.field.stand import uniform
from swath.field.wind import Wind
from swath.rays.device import start_warp
from swath.rays.engine import RayCaster
from swath.rays.groups.lanes import bundle_lanes, image_lanes
from swath.rays.warps import cast as warps

LIBRARY = small_library(400, tiles=3)
DEG = np.pi / 180.0
FAN = np.arange(-60, 61, 8) * DEG
ORDERS = [0, 1, 2, 9]  # lanes rising, falling, shuffled


@pytest.fixture(scope="module")
def hills():
    return make_hills()


def emulated(field, order=0):
    """A caster whose groups take the card's walk, on the CPU."""
    caster = RayCaster(field, threads=1)
    caster._group_walk = warps.WarpWalk(start_warp(), field.library, "cpu", order=order)
    return caster


def compare(field, o, d, *, order=0, **options):
    options = {"range_max": 40.0} | options
    found = emulated(field, order).cast_bundles(o, d, **options)
    check_same(found, RayCaster(field, threads=1).cast(o.reshape(-1, 3), d.reshape(-1, 3), **options))
    groups = RayCaster(field, threads=1).cast_bundles(o, d, **options)
    check_same(found, groups, least=0.9999)
    return found


@pytest.mark.parametrize("height", [1.5, 6.0])
@pytest.mark.parametrize("depression", [5, 15, 30, 50, 70, 85])
def test_hills_at_every_depression(hills, depression, height):
    place = over(hills, 2.0, 4.0, height)
    rays = bundles(place, FAN + 0.3, depression * DEG, 37, exit_diameter=0.014)
    found = compare(hills, *rays, order=ORDERS[depression % 4])
    assert found.is_hit.mean() > 0.3


@pytest.mark.parametrize("subs", [1, 2, 5, 8, 9, 16, 17, 37, 61])
def test_any_number_of_sub_rays(hills, subs):
    azimuth = np.arange(-50, 51, max(1, subs // 8)) * DEG
    compare(hills, *bundles(over(hills, 3.0, 3.0, 2.5), azimuth, 22 * DEG, subs), order=3)


def test_neighbouring_beams_of_a_scan_line(hills):
    """As a scanner has them: a group is full, and several groups."""
    azimuth = np.arange(0.2, 0.7, 0.0045)
    for subs in (9, 37):
        compare(hills, *bundles(over(hills, 1.0, 3.0, 3.0), azimuth, 15 * DEG, subs))


@pytest.mark.parametrize("order", ORDERS)
def test_no_bit_depends_on_the_order_of_lanes(hills, order):
    o, d = bundles(over(hills, 2.0, 4.0, 2.5), np.arange(0.0, 1.0, 0.01), np.linspace(0.1, 1.2, 100), 19)
    first = emulated(hills, 0).cast_bundles(o, d, range_max=30.0)
    again = emulated(hills, order).cast_bundles(o, d, range_max=30.0)
    mixed = np.random.default_rng(2).permutation(len(o))
    other = emulated(hills, order).cast_bundles(o[mixed], d[mixed], range_max=30.0)
    single = emulated(hills, order).cast_bundles(o[:, 4:5], d[:, 4:5], range_max=30.0)
    for a, b, c, e in zip(*(vars(h).values() for h in (first, again, other, single)), strict=True):
        assert a.tobytes() == b.tobytes()
        assert a[mixed].tobytes() == c.tobytes()
        assert a[:, 4].tobytes() == e.tobytes()


def test_inside_the_canopy_and_upwards(hills):
    depression = np.tile([-30, -5, 0, 4, 20, 60], 21) * DEG
    azimuth = np.repeat(np.linspace(-3.0, 3.0, 21), 6)
    for height in (0.05, 0.5):
        rays = bundles(over(hills, 7.2, 4.1, height), azimuth, depression, 9)
        found = compare(hills, *rays, range_max=8.0, order=2)
        assert np.median(found.distance[found.is_hit]) < 1.0


def test_every_beam_from_its_own_place(hills):
    rng = np.random.default_rng(1)
    n = 60
    o, d = bundles([0, 0, 0], np.linspace(-1, 1, n), 20 * DEG + 0.02 * rng.normal(size=n), 37, turn=1.0)
    o = o + over(hills, 1.0, 4.0, 3.0) + np.linspace(0, 0.4, n)[:, None, None] * [0.8, 0.6, 0.05]
    compare(hills, o, d)


def test_wind_moves_the_crop():
    wind = Wind(azimuth_deg=50.0, sway_deg=7.0, steady_deg=4.0, wavelength_m=3.0, period_s=1.6)
    field = made_field(stand=uniform.Params(stems_per_m2=400.0, row_azimuth_deg=20.0, wind=wind))
    field.ensure(0.0, 5.0, 30.0)
    rays = bundles(over(field, -1.0, 5.0, 2.5), FAN, 25 * DEG, 9)
    first, later = (compare(field, *rays, t=t) for t in (0, 700_000_000))
    assert np.mean(np.abs(first.distance - later.distance) > 0.01) > 0.3


def test_solids_among_the_plants(hills):
    place = over(hills, 7.0, 6.0, 0.0)
    solids = Solids(
        box_centre=place + np.array([[1.5, 0, 0.5], [3, 2, 1]]),
        box_axes=np.stack([np.eye(3)] * 2),
        box_half=np.array([[0.3, 0.4, 0.5], [0.5, 0.1, 1.5]]),
        box_reflectance=np.array([0.5, 0.7]),
    )
    found = compare(hills, *bundles(place - [2, 0, -2.0], FAN * 0.5, 20 * DEG, 19), solids=solids)
    assert {Organ.SOLID, Organ.EAR, Organ.STEM, Organ.LEAF} <= set(found.organ.ravel())


def test_rays_along_the_axes_and_tile_sides():
    field = HandField(make_pages(LIBRARY, mixed=2, pages=2), LIBRARY)
    flat = np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1], [1, 0, -1], [0, -1, -1]], float
    )
    d = np.repeat(flat / np.linalg.norm(flat, axis=1, keepdims=True), 8, axis=0)[:, None]
    for place in ([8.0, 8.0, 0.6], [8.3, 8.0, 0.3], [7.7, 8.4, 1.2]):
        o = np.array(place) + np.random.default_rng(3).uniform(0, 0.02, (len(d), 1, 3)) * [0, 0, 1]
        compare(field, o, d, range_max=6.0)


def test_thin_tall_leaning_and_lost():
    """Scaled, leaning, thinned crop; rays that leave the known pages see only solids."""
    pages = make_pages(
        LIBRARY, pages=1, mixed=1, slope=(0.1, -0.05), lean=(1.5, -0.9), scale=0.8, density=150
    )
    behind = Solids(
        box_centre=np.array([[20.0, 4.0, 2.0]]),
        box_axes=np.eye(3)[None],
        box_half=np.array([[1.0, 6.0, 4.0]]),
        box_reflectance=np.array([0.5]),
    )
    o, d = bundles([3.0, 4.0, 2.2], np.linspace(-np.pi, np.pi, 90), np.tile([0.02, 0.2, 0.9], 30), 9)
    found = compare(HandField(pages, LIBRARY), o, d, solids=behind, order=1)
    assert Organ.SOLID in found.organ
    assert not found.is_hit.all()


def test_cut_cells_and_bumpy_ground():
    pages = make_pages(LIBRARY, pages=1, ground=lambda x, y: 0.06 * np.sin(5 * x) * np.cos(4 * y) + 0.1 * x)
    pages.tile_plane[..., 1] = 0.1
    pages.straw[:, 10:30, 20:40] = 0.07
    set_bumps(pages, LIBRARY.tile_size)
    pages.cut_slot[:] = 0
    codes = np.random.default_rng(1).choice([0, 15, 30, 255], (32, 32))
    pages.cut[0] = codes.repeat(16, 0).repeat(16, 1)
    rays = bundles([4.0, 4.0, 2.6], np.arange(-180, 180, 4) * DEG, np.tile([0.5, 1.1], 45), 19)
    found = compare(HandField(pages, LIBRARY), *rays, order=5)
    assert {Organ.STUBBLE, Organ.STRAW, Organ.GROUND, Organ.EAR} <= set(found.organ.ravel())


def test_scattered_rays(hills):
    """Bundles whose rays go anywhere, neighbours far from each other: groups fall apart, ray by ray."""
    rng = np.random.default_rng(5)
    o = rng.uniform([0, 2, 0], [8, 9, 0], (40, 12, 3))
    o[..., 2] = np.asarray(hills.ground_height(o[..., 0], o[..., 1])) + rng.uniform(1.2, 3.0, (40, 12))
    d = rng.normal(size=(40, 12, 3)) - [0, 0, 1.0]
    d /= np.linalg.norm(d, axis=2, keepdims=True)
    compare(hills, o, d, order=4)


def test_images(hills):
    caster, plain = emulated(hills, 7), RayCaster(hills, threads=1)
    place = over(hills, 1.0, 2.0, 3.0)
    for rows, columns, pitch in ((48, 64, 0.006), (3, 200, 0.003), (1, 1, 0.0)):
        v, u = np.meshgrid(
            pitch * (np.arange(rows) - rows / 2), pitch * (np.arange(columns) - columns / 2), indexing="ij"
        )
        d = np.stack([np.cos(0.4) + 0 * u, 0.35 - u, -np.sin(0.4) - v], axis=-1)
        d /= np.linalg.norm(d, axis=2, keepdims=True)
        found = caster.cast_image(place, d, range_max=30.0)
        check_same(found, plain.cast(np.tile(place, (rows * columns, 1)), d.reshape(-1, 3), range_max=30.0))


@pytest.mark.parametrize("subs", [1, 4, 9, 37])
def test_the_nearest_hits_are_those_of_the_full_answer(hills, subs):
    o, d = bundles(over(hills, 2.0, 4.0, 2.5), FAN, np.linspace(-0.02, 0.9, len(FAN)), subs)
    check_nearest(emulated(hills, 2), o, d, {1, min(3, subs), (subs + 1) // 2, subs}, range_max=12.0)


def test_nearest_hits_with_solids_wide_bundles_and_lost_rays():
    """Bundles too wide for one part of the walk, solids within and behind the crop, pages that end."""
    solids = Solids(
        box_centre=np.array([[20.0, 4.0, 2.0], [5.0, 4.0, 0.4]]),
        box_axes=np.stack([np.eye(3)] * 2),
        box_half=np.array([[1.0, 9.0, 9.0], [0.3, 0.3, 0.4]]),
        box_reflectance=np.array([0.5, 0.7]),
    )
    caster = emulated(HandField(make_pages(LIBRARY, pages=1, mixed=1), LIBRARY), 1)
    for width in (0.05, 1.6):
        o, d = bundles([3.0, 4.0, 2.2], np.linspace(-0.5, 0.5, 40), np.tile([0.02, 0.3], 20), 37, width=width)
        check_nearest(caster, o, d, (1, 19, 37), range_max=30.0, solids=solids)


def check_nearest(caster, o, d, counts, **options):
    """`cast_nearest` and `cast_order` say what `cast_bundles` says, to the bit."""
    full = caster.cast_bundles(o, d, **options)
    assert not full.is_hit.all()
    order = np.argsort(full.distance, axis=1, kind="stable")
    for count in counts:
        near = caster.cast_nearest(o, d, count, **options)
        last = caster.cast_order(o, d, count, **options)
        for name, found in vars(near).items():
            expected = np.take_along_axis(getattr(full, name), order[:, :count], axis=1)
            np.testing.assert_array_equal(found, expected)
            np.testing.assert_array_equal(getattr(last, name), expected[:, -1])


def test_rays_that_are_none_are_refused(hills):
    """Not finite, not of unit length, under ground, too many sub-rays: by name, as without a card."""
    caster = emulated(hills)
    o, d = bundles(over(hills, 2.0, 4.0, 2.5), FAN[:15], 0.4, 37)
    for spoil in ((7, 3, 0), (0, 0, 2), (14, 36, 1)):
        for value in (np.nan, np.inf, 0.2):
            for which in (0, 1):
                rays = [o.copy(), d.copy()]
                rays[which][spoil] = value if which or value != 0.2 else -np.inf
                with pytest.raises(ValueError, match=r"finite|unit"):
                    caster.cast_bundles(*rays, range_max=30.0)
    with pytest.raises(InputError, match="below"):
        caster.cast_bundles(o - [0, 0, 5.0], d, range_max=30.0)


def test_garbage_in_the_pages_ends_no_process(monkeypatch):
    """Numbers that no field writes: the walk may miss; it neither hangs nor reads outside its arrays."""
    monkeypatch.setattr("swath.rays.engine.check_origins", lambda field, origins: None)
    o, d = bundles([4.0, 4.0, 2.5], FAN * 3, np.tile([0.0, 0.3, 0.9, 1.5], 4), 9)
    for name in ("ground", "tile_plane", "tile_stand", "tile_top", "tile_bump"):
        for value in (np.nan, 1e30, -1e30, 0.0):
            pages = make_pages(LIBRARY, pages=1, mixed=2)
            getattr(pages, name)[:] = value
            hits = emulated(HandField(pages, LIBRARY)).cast_bundles(o, d, range_max=20)
            assert (hits.organ <= max(Organ)).all()


def test_lists_that_run_over_lose_nothing():
    """Crop so dense, sub-rays so close and so few columns that every list of the walk fills many times."""
    library = small_library(1500, tiles=1)
    field = HandField(make_pages(library, mixed=1, lean=(0.5, 0.3)), library)
    for width in (0.001, 0.2):
        rays = bundles([4.0, 4.0, 1.6], np.arange(40) * 0.001, np.full(40, 1.0), 61, width=width)
        compare(field, *rays, order=6)


def test_plants_that_are_meshes():
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    crop = load_crop(str(Path(__file__).parents[2] / "examples" / "meshes" / "sunflower.yaml"))
    library = make_library(crop, density_max=6.0, row_spacing=0.0, seed=Stream(1, "mesh"), tile_count=2)
    pages = make_pages(library, mixed=1, slope=(0.05, -0.03), lean=(0.1, 0.05))
    pages.cut_slot[:1], pages.cut[0] = 0, 255
    pages.cut[0, 100:300, 200:400] = 60
    rays = bundles([5.0, 5.0, 3.5], FAN[:16] * 3, np.tile([0.3, 0.5, 0.9, 1.2], 4), 19)
    found = compare(HandField(pages, library), *rays)
    assert np.isin(found.organ, [Organ.STEM, Organ.EAR, Organ.LEAF]).mean() > 0.3


def test_groups_have_room_in_a_warp():
    for lanes in (
        bundle_lanes(1000, bundles([0, 0, 0], [0.0], 0.3, 37)[1][0]),
        bundle_lanes(7, bundles([0, 0, 0], [0.0], 0.3, 384)[1][0]),
        bundle_lanes(999, bundles([0, 0, 0], [0.0], 0.3, 9)[1][0]),
        image_lanes(480, 640, (0.001, 0.001)),
    ):
        first = warps.split_groups(lanes)
        packs = np.diff(first)
        assert first[0] == 0
        assert first[-1] == len(lanes.table)
        assert packs.min() > 0
        assert packs.max() * lanes.table.shape[1] <= warps.ROOM
        assert set(lanes.first) <= set(first)


def test_calls_larger_than_the_memory_go_in_blocks(hills, monkeypatch):
    o, d = bundles(over(hills, 1.0, 3.0, 3.0), np.arange(0.2, 0.6, 0.0045), 15 * DEG, 9)
    whole = emulated(hills).cast_bundles(o, d, range_max=30.0)
    monkeypatch.setattr(warps, "SLOTS_AT_ONCE", 600)
    parts = emulated(hills).cast_bundles(o, d, range_max=30.0)
    np.testing.assert_array_equal(whole.distance, parts.distance)


def test_the_walk_compiles_for_cuda(tmp_path):
    """To PTX for the H100 and H200; what all lanes know stays in registers: no array of them in memory."""
    wp = start_warp()
    if not hasattr(wp, "compile_aot_module"):
        pytest.skip("this Warp compiles CUDA only where there is a device")
    import swath.rays.warps.kernel as module

    try:
        wp.compile_aot_module(module, arch=90, module_dir=tmp_path, use_ptx=True)
    except RuntimeError as error:
        pytest.skip(f"no CUDA compiler: {error}")
    text = next(tmp_path.glob("*.ptx")).read_text(encoding="latin-1")
    walk = text.split(".entry walk_warps")[1].split("\n}\n")[0]
    assert "bar.warp.sync" in walk
    assert "atom.shared.min.u64" in walk
    assert ".local" not in walk


def test_a_card_gives_the_same(hills):
    if not start_warp().is_cuda_available():
        pytest.skip("no CUDA device")
    here, there = RayCaster(hills, threads=1), RayCaster(hills, device="cuda:0")
    for depression in (5, 22, 50, 85):
        o, d = bundles(over(hills, 2.0, 4.0, 3.0), np.arange(-60, 60, 0.5) * DEG, depression * DEG, 37)
        found = there.cast_bundles(o, d, range_max=40.0)
        assert same_share(found, here.cast_bundles(o, d, range_max=40.0)) >= 0.999
        again = there.cast_bundles(o[::-1], d[::-1], range_max=40.0)
        np.testing.assert_array_equal(found.distance, again.distance[::-1])
        for count in (1, 19):
            near = there.cast_nearest(o, d, count, range_max=40.0)
            expected = here.cast_nearest(o, d, count, range_max=40.0)
            assert same_share(near, expected) >= 0.999
