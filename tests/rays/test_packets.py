"""Rays as packets against the plain kernel: any terrain, crop, sensor and bundle."""

from pathlib import Path

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.memory_layout import Organ, Solids
from swath.field.prototypes import make_library
from swath.field.stand import uniform
from swath.field.wind import Wind
from swath.rays.engine import RayCaster
from swath.rays.hits import Spots
from swath.sensing.beam import Beam, offsets_of, spot_pattern, turned_pattern
from tests.field.made_field import made_field
from tests.rays.bundle_rays import bundles, check_same
from tests.rays.hand_field import HandField, make_pages, set_bumps, small_library
from tests.rays.hills import make_hills, over

LIBRARY = small_library(400, tiles=3)
DEG = np.pi / 180.0
FAN = np.arange(-60, 61, 4) * DEG


@pytest.fixture(scope="module")
def hills():
    return make_hills()


def compare(field, o, d, **options):
    caster = RayCaster(field, threads=1)
    options = {"range_max": 40.0, "normals": True} | options
    found = caster.cast_bundles((o, d), **options)
    plain = caster.cast(o.reshape(-1, 3), d.reshape(-1, 3), **options)
    check_same(found, plain)
    check_normals(found, d)
    check_normals(plain, d.reshape(-1, 3))
    return found


def check_normals(found, d):
    """Of unit length against the ray, whose angle of incidence they make; 0 where nothing was hit."""
    np.testing.assert_allclose(-(found.normal * d).sum(axis=-1), found.cosine, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=-1), found.is_hit, atol=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_parallel_rays(hills, seed):
    """Many close together, a few scattered, from any side, also among solids."""
    draw, caster = np.random.default_rng(seed), RayCaster(hills, threads=1)
    azimuth, up = draw.uniform(-np.pi, np.pi), draw.uniform(4.0, 90.0) * DEG
    way = -np.array([np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up)])
    places = np.concatenate([draw.uniform([2.5, 6.0], [3.5, 7.0], (3000, 2)), draw.uniform(0, 9, (400, 2))])
    height = hills.ground_height(*places.T) + draw.uniform(0.0, 1.1, len(places))
    starts = np.column_stack([places, height]) - 8.0 * way
    starts = starts[starts[:, 2] > hills.ground_height(*starts.T[:2]) + 0.01]
    ball = Solids(
        ellipsoid_centre=np.array([[3.0, 6.4, 0.5]]) + over(hills, 0.0, 0.0, 0.0),
        ellipsoid_axes=np.eye(3)[None],
        ellipsoid_half=np.array([[0.3, 0.2, 0.9]]),
        ellipsoid_reflectance=np.array([0.5]),
    )
    options = {"range_max": 9.0, "normals": True, "solids": ball if seed % 2 else None}
    found = caster.cast_parallel(starts, way, **options)
    plain = caster.cast(starts, np.broadcast_to(way, starts.shape), **options)
    check_same(found, plain)
    check_normals(found, way)
    alike = found.organ == plain.organ
    assert np.mean(np.abs(found.normal - plain.normal)[alike] < 2e-2) > 0.999
    assert len(np.unique(found.organ)) > 3
    two = RayCaster(hills, threads=2).cast_parallel(starts, way, **options)
    for a, b in zip(found.arrays, two.arrays, strict=True):
        assert a.tobytes() == b.tobytes()
    assert caster.cast_parallel(starts[:0], way, **options).distance.shape == (0,)


@pytest.mark.parametrize("height", [1.5, 3.0, 6.0])
@pytest.mark.parametrize("depression", [5, 15, 30, 50, 70, 85])
def test_hills_at_every_depression(hills, depression, height):
    place = over(hills, 2.0, 4.0, height)
    found = compare(hills, *bundles(place, FAN + 0.3, depression * DEG, 19, exit_diameter=0.014))
    assert found.is_hit.mean() > 0.3


@pytest.mark.parametrize("subs", [1, 2, 5, 7, 8, 9, 16, 17, 37, 61])
def test_any_number_of_sub_rays(hills, subs):
    azimuth = np.arange(-50, 51, max(1, subs // 8)) * DEG
    compare(hills, *bundles(over(hills, 3.0, 3.0, 2.5), azimuth, 22 * DEG, subs))


def test_inside_the_canopy_and_upwards(hills):
    """The sensor stands among the plants; its beams go level, down and up."""
    depression = np.tile([-30, -5, 0, 4, 20, 60], 21) * DEG
    azimuth = np.repeat(np.linspace(-3.0, 3.0, 21), 6)
    for height in (0.05, 0.5):
        found = compare(hills, *bundles(over(hills, 7.2, 4.1, height), azimuth, depression, 9), range_max=8.0)
        assert np.median(found.distance[found.is_hit]) < 1.0


def test_every_beam_from_its_own_place(hills):
    """A sweep from a machine that drives, pitches and rolls; every spot is turned."""
    rng = np.random.default_rng(1)
    n = 120
    o, d = bundles([0, 0, 0], np.linspace(-1, 1, n), 20 * DEG + 0.02 * rng.normal(size=n), 37, turn=1.0)
    o = o + over(hills, 1.0, 4.0, 3.0) + np.linspace(0, 0.4, n)[:, None, None] * [0.8, 0.6, 0.05]
    compare(hills, o, d)


def test_wind_moves_the_crop():
    wind = Wind(azimuth_deg=50.0, sway_deg=7.0, steady_deg=4.0, wavelength_m=3.0, period_s=1.6)
    field = made_field(stand=uniform.Params(stems_per_m2=400.0, row_azimuth_deg=20.0, wind=wind))
    field.ensure(0.0, 5.0, 30.0)
    rays = bundles(over(field, -1.0, 5.0, 2.5), FAN, 25 * DEG, 9)
    first = compare(field, *rays, t=0)
    later = compare(field, *rays, t=700_000_000)
    assert np.mean(np.abs(first.distance - later.distance) > 0.01) > 0.3


def test_solids_among_the_plants(hills):
    place = over(hills, 7.0, 6.0, 0.0)
    solids = Solids(
        box_centre=place + np.array([[1.5, 0, 0.5], [3, 2, 1]]),
        box_axes=np.stack([np.eye(3)] * 2),
        box_half=np.array([[0.3, 0.4, 0.5], [0.5, 0.1, 1.5]]),
        box_reflectance=np.array([0.5, 0.7]),
        capsule_a=place[None] + [2.0, 1.0, 0.0],
        capsule_b=place[None] + [2.0, 1.0, 2.0],
        capsule_radius=np.array([0.06]),
        capsule_reflectance=np.array([0.3]),
    )
    found = compare(hills, *bundles(place - [2, 0, -2.0], FAN * 0.5, 20 * DEG, 19), solids=solids)
    assert {Organ.SOLID, Organ.EAR, Organ.STEM, Organ.LEAF} <= set(found.organ.ravel())


def test_rays_along_the_axes_and_tile_sides():
    """Directions with zeros, origins on sides and corners of tiles."""
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
    field = HandField(pages, LIBRARY)
    behind = Solids(
        box_centre=np.array([[20.0, 4.0, 2.0]]),
        box_axes=np.eye(3)[None],
        box_half=np.array([[1.0, 6.0, 4.0]]),
        box_reflectance=np.array([0.5]),
    )
    o, d = bundles([3.0, 4.0, 2.2], np.linspace(-np.pi, np.pi, 90), np.tile([0.02, 0.2, 0.9], 30), 9)
    found = compare(field, o, d, solids=behind)
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
    found = compare(
        HandField(pages, LIBRARY),
        *bundles([4.0, 4.0, 2.6], np.arange(-180, 180, 4) * DEG, np.tile([0.5, 1.1], 45), 19),
    )
    assert {Organ.STUBBLE, Organ.STRAW, Organ.GROUND, Organ.EAR} <= set(found.organ.ravel())


def test_scattered_rays_are_slow_but_right(hills):
    """Bundles whose rays go anywhere, and neighbours far from each other."""
    rng = np.random.default_rng(5)
    o = rng.uniform([0, 2, 0], [8, 9, 0], (40, 12, 3))
    o[..., 2] = np.asarray(hills.ground_height(o[..., 0], o[..., 1])) + rng.uniform(1.2, 3.0, (40, 12))
    d = rng.normal(size=(40, 12, 3)) - [0, 0, 1.0]
    d /= np.linalg.norm(d, axis=2, keepdims=True)
    compare(hills, o, d)


def test_images(hills):
    """Blocks of pixels of any shape, as scan lines or as a camera."""
    caster = RayCaster(hills, threads=1)
    place = over(hills, 1.0, 2.0, 3.0)
    for rows, columns, pitch in ((48, 64, 0.006), (3, 200, 0.003), (70, 5, 0.004), (1, 1, 0.0)):
        v, u = np.meshgrid(
            pitch * (np.arange(rows) - rows / 2), pitch * (np.arange(columns) - columns / 2), indexing="ij"
        )
        d = np.stack([np.cos(0.4) + 0 * u, 0.35 - u, -np.sin(0.4) - v], axis=-1)
        d /= np.linalg.norm(d, axis=2, keepdims=True)
        found = caster.cast_image(place, d, range_max=30.0)
        assert found.distance.shape == (rows, columns)
        check_same(found, caster.cast(np.tile(place, (rows * columns, 1)), d.reshape(-1, 3), range_max=30.0))


def test_wide_bundles_with_solids_and_lost_rays():
    """Bundles too wide for one group, solids within and behind the crop, pages that end."""
    field = HandField(make_pages(LIBRARY, pages=1, mixed=1), LIBRARY)
    solids = Solids(
        box_centre=np.array([[20.0, 4.0, 2.0], [5.0, 4.0, 0.4]]),
        box_axes=np.stack([np.eye(3)] * 2),
        box_half=np.array([[1.0, 9.0, 9.0], [0.3, 0.3, 0.4]]),
        box_reflectance=np.array([0.5, 0.7]),
    )
    for width in (0.05, 1.6):
        o, d = bundles([3.0, 4.0, 2.2], np.linspace(-0.5, 0.5, 40), np.tile([0.02, 0.3], 20), 37, width=width)
        found = compare(field, o, d, solids=solids)
        assert Organ.SOLID in found.organ


@pytest.mark.parametrize("spot", ["fixed", "turned"])
def test_spots_hit_what_their_rays_hit(hills, spot):
    """Beams from their own places with an aperture; wide ones go part by part."""
    n, rng = 50, np.random.default_rng(4)
    for subs, angle in ((37, 0.012), (9, 0.012), (2, 0.012), (1, 0.012), (37, 1.2)):
        pattern = spot_pattern(subs).position[None]
        if spot == "turned":
            pattern = turned_pattern(rng, n, spot_pattern(subs)).position
        a, b = np.linspace(-0.6, 0.6, n), 0.4 + 0.05 * rng.normal(size=n)
        ahead = np.stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), -np.sin(b)], axis=-1)
        left = np.stack([-np.sin(a), np.cos(a), 0 * a], axis=-1)
        axes = np.stack([ahead, left, np.cross(ahead, left)], axis=-1)
        origins = over(hills, 2.0, 4.0, 2.5) + np.linspace(0, 0.3, n)[:, None] * [0.8, 0.6, 0.0]
        beam = Beam((0.014, 0.01), (angle, 0.5 * angle), "uniform")
        beams = Spots(origins, axes, offsets_of(beam, pattern))
        rays, caster = beams.rays(), RayCaster(hills, threads=1)
        expected = caster.cast_bundles(rays, range_max=20.0)
        assert expected.is_hit.mean() > 0.3
        for name, found in vars(caster.cast_bundles(beams, range_max=20.0)).items():
            np.testing.assert_array_equal(found, getattr(expected, name))
    with pytest.raises(InputError, match="below"):
        caster.cast_bundles(Spots(origins - [0, 0, 5.0], axes, beams.offsets), range_max=20.0)


def test_threads_order_and_company_change_no_bit(hills):
    o, d = bundles(over(hills, 2.0, 4.0, 2.5), np.arange(-90, 90, 0.5) * DEG, 0.4, 19)
    first = RayCaster(hills, threads=1).cast_bundles((o, d), range_max=30.0, normals=True)
    for threads in (2, 3):
        again = RayCaster(hills, threads=threads).cast_bundles((o, d), range_max=30.0, normals=True)
        for a, b in zip(vars(first).values(), vars(again).values(), strict=True):
            assert a.tobytes() == b.tobytes()
    order = np.random.default_rng(2).permutation(len(o))
    mixed = RayCaster(hills, threads=2).cast_bundles((o[order], d[order]), range_max=30.0, normals=True)
    single = RayCaster(hills, threads=1).cast_bundles((o[:, 4:5], d[:, 4:5]), range_max=30.0, normals=True)
    for a, b, c in zip(*(vars(h).values() for h in (first, mixed, single)), strict=True):
        assert a[order].tobytes() == b.tobytes()
        assert a[:, 4].tobytes() == c.tobytes()


def test_what_is_refused_and_what_the_plain_kernel_serves(hills):
    caster = RayCaster(hills, threads=1)
    o, d = bundles(over(hills, 2.0, 4.0, 2.5), [0.1, 0.2], 0.4, 600)
    with pytest.warns(UserWarning, match="600 sub-rays"):
        found = caster.cast_bundles((o, d), range_max=30.0)
    check_same(found, caster.cast(o.reshape(-1, 3), d.reshape(-1, 3), range_max=30.0), least=1.0)
    with pytest.raises(ValueError, match="expected both"):
        caster.cast_bundles((o[0], d[0]), range_max=30.0)
    with pytest.raises(InputError, match="below"):
        caster.cast_bundles((o - [0, 0, 5.0], d), range_max=30.0)
    for spoil in ((7, 3, 0), (0, 0, 2), (14, 36, 1)):
        for value in (np.nan, np.inf):
            for which in (0, 1):
                rays = [a.copy() for a in bundles(over(hills, 2.0, 4.0, 2.5), FAN[:15], 0.4, 37)]
                rays[which][spoil] = value
                with pytest.raises(ValueError, match="finite"):
                    caster.cast_bundles(rays, range_max=30.0)
    assert caster.cast_bundles((o[:0], d[:0]), range_max=30.0).distance.shape == (0, 600)
    assert caster.cast_image([2.0, 4.0, 9.0], np.zeros((0, 5, 3)), range_max=30.0).distance.shape == (0, 5)


def test_plants_that_are_meshes():
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    crop = load_crop(str(Path(__file__).parents[2] / "examples" / "meshes" / "sunflower.yaml"))
    library = make_library(crop, density_max=6.0, row_spacing=0.0, seed=Stream(1, "mesh"), tile_count=2)
    pages = make_pages(library, mixed=1, slope=(0.05, -0.03), lean=(0.1, 0.05))
    pages.cut_slot[:1], pages.cut[0] = 0, 255
    pages.cut[0, 100:300, 200:400] = 60
    field = HandField(pages, library)
    found = compare(field, *bundles([5.0, 5.0, 3.5], FAN * 3, np.tile([0.3, 0.5, 0.9], 11)[:31], 19))
    assert np.isin(found.organ, [Organ.STEM, Organ.EAR, Organ.LEAF]).mean() > 0.3


def test_without_a_compiler_the_plain_kernel_serves(hills, monkeypatch):
    monkeypatch.setattr("swath.rays.engine.can_compile", lambda: False)
    caster = RayCaster(hills, threads=1)
    o, d = bundles(over(hills, 2.0, 4.0, 2.5), [0.1, 0.2], 0.4, 9)
    with pytest.warns(UserWarning, match="cannot be compiled"):
        found = caster.cast_bundles((o, d), range_max=30.0)
    plain = caster.cast(o.reshape(-1, 3), d.reshape(-1, 3), range_max=30.0)
    np.testing.assert_array_equal(found.distance.ravel(), plain.distance)
