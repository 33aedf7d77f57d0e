"""The walk as a card compiles it: 32 lanes that run for themselves from barrier to barrier.

What lanes do together has a body of its own for the card (shuffles, ballots). Here it meets 32 fibers, each
time in another order: every lane keeps its own copy of what all know; lanes that wait at different things are
found, and lanes that read what another one writes in the same step, where it changes a result.
"""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from bundle_rays import bundles
from hand_field import HandField, make_pages, set_bumps, small_library

from swath.field.layout import Organ, Solids
from swath.field.wind import Sway
from swath.rays.device import start_warp
from swath.rays.engine import RayCaster
from swath.rays.warps import cast as warps
from swath.rays.warps import kernel

LIBRARY = small_library(400, tiles=3)
DEG = np.pi / 180.0
NAMES = ("run_lanes", "lane_now", "wait_for_all", "from_lane", "ballot")


@pytest.fixture(scope="module")
def fibers(tmp_path_factory):
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None or not Path("/usr/include/ucontext.h").is_file():
        pytest.skip("no C++ compiler with fibers (ucontext.h) here")
    target = tmp_path_factory.mktemp("fibers") / "fibers.so"
    source = Path(__file__).parent / "warp_of_fibers.cpp"
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", str(target), str(source)], check=True)
    return ctypes.CDLL(str(target))


@pytest.fixture
def lanes(fibers, monkeypatch):
    """Asks the card's lanes and the lanes one after the other, and compares."""
    import fiber_kernel

    wp = start_warp()
    places = [ctypes.cast(getattr(fibers, name), ctypes.c_void_p).value for name in NAMES]
    hooks = wp.array(np.array(places, np.uint64), dtype=wp.uint64, device="cpu")
    launch = wp.launch

    def instead(called, dim, inputs=(), **options):
        if called is kernel.walk_warps:
            called, inputs = fiber_kernel.walk_warps, [*inputs, hooks]
            options.pop("block_dim")
        return launch(called, dim=dim, inputs=inputs, **options)

    def both(field, ask):
        """The same hits, to the bit."""
        found = []
        for way in (instead, launch):
            monkeypatch.setattr(wp, "launch", way)
            caster = RayCaster(field, threads=1)
            caster._group_walk = warps.WarpWalk(wp, field.library, "cpu")
            before = ctypes.c_longlong.in_dll(fibers, "barriers").value
            found.append(ask(caster))
            count = ctypes.c_longlong.in_dll(fibers, "barriers").value - before
            assert (count > 100) == (way is instead)
        assert ctypes.c_int.in_dll(fibers, "faults").value == 0
        for a, b in zip(*(vars(hits).values() for hits in found), strict=True):
            np.testing.assert_array_equal(a, b)
        return found[0]

    return both


@pytest.fixture(scope="module")
def field():
    """Bumpy ground, straw, cut and standing cells, leaning and thinned crop."""
    pages = make_pages(
        LIBRARY,
        mixed=1,
        lean=(0.2, -0.3),
        density=300,
        ground=lambda x, y: 0.06 * np.sin(5 * x) * np.cos(4 * y) + 0.1 * x,
    )
    pages.tile_plane[..., 1] = 0.1
    pages.straw[:, 10:30, 20:40] = 0.07
    set_bumps(pages, LIBRARY.tile_size)
    pages.cut_slot[:] = 0
    pages.cut[0] = np.random.default_rng(1).choice([0, 15, 255], (32, 32)).repeat(16, 0).repeat(16, 1)
    return HandField(pages, LIBRARY)


@pytest.mark.parametrize("depression", [8, 25, 50, 85])
@pytest.mark.parametrize("subs", [9, 37])
def test_beams(lanes, field, subs, depression):
    rays = bundles([5.0, 5.0, 3.2], np.arange(0.2, 0.4, 0.01), depression * DEG, subs, exit_diameter=0.014)
    found = lanes(field, lambda caster: caster.cast_bundles(*rays, range_max=12.0))
    assert found.is_hit.mean() > 0.3
    assert depression == 85 or {Organ.GROUND, Organ.EAR, Organ.LEAF} <= set(found.organ.ravel())


@pytest.mark.parametrize("rank", [1, 19])
def test_early_stop(lanes, field, rank):
    rays = bundles([5.0, 5.0, 3.2], np.arange(0.2, 0.4, 0.01), 25 * DEG, 37)
    found = lanes(field, lambda caster: caster.cast_order(*rays, rank, range_max=12.0))
    assert found.is_hit.all()


def test_rays_that_have_nothing_to_do_with_each_other(lanes, field):
    rng = np.random.default_rng(5)
    d = rng.normal(size=(6, 12, 3)) - [0, 0, 1.0]
    d /= np.linalg.norm(d, axis=2, keepdims=True)
    o = rng.uniform([3, 3, 2.5], [12, 12, 3.5], (6, 12, 3))
    lanes(field, lambda caster: caster.cast_bundles(o, d, range_max=12.0))


def test_image_wind_and_solids(lanes, field):
    blown = HandField(
        field.pages, LIBRARY, wind=Sway((0.8, 0.6), 0.05, 0.06, (0.2, 0.1), (0.07, -0.1), 1_600_000_000)
    )
    v, u = np.meshgrid(0.004 * np.arange(-12, 12), 0.004 * np.arange(-20, 20), indexing="ij")
    d = np.stack([np.cos(0.4) + 0 * u, 0.35 - u, -np.sin(0.4) - v], axis=-1)
    d /= np.linalg.norm(d, axis=2, keepdims=True)
    box = Solids(
        box_centre=np.array([[7.0, 5.7, 1.0]]),
        box_axes=np.eye(3)[None],
        box_half=np.array([[0.2, 0.2, 2.0]]),
        box_reflectance=np.array([0.5]),
    )
    found = lanes(
        blown, lambda caster: caster.cast_image([5.0, 5.0, 3.2], d, range_max=12.0, solids=box, t=3 * 10**8)
    )
    assert Organ.SOLID in found.organ
