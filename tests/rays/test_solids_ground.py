"""Closed forms: boxes, posts, stones, planes and slopes; and what engine and threads must not change."""

import numpy as np
import pytest

from swath.core.errors import SwathError
from swath.field.memory_layout import REVISION, Organ, Solids
from swath.rays.device import start_warp, thread_count
from swath.rays.engine import RayCaster
from tests.rays.hand_field import HandField, make_pages, small_library

LIBRARY = small_library(300, tiles=2)


def bare(**options):
    pages = make_pages(LIBRARY, **options)
    pages.tile_top[:] = 0.0
    return HandField(pages, LIBRARY)


def one(field, origin, direction, **options):
    d = np.asarray(direction, float)
    return RayCaster(field, threads=1).cast([origin], [d / np.linalg.norm(d)], range_max=30, **options)


def test_box_turned():
    c, s = np.cos(0.5), np.sin(0.5)
    axes = np.array([[[c, -s, 0], [s, c, 0], [0, 0, 1.0]]])
    box = Solids(
        box_centre=np.array([[8.0, 8.0, 1.0]]),
        box_axes=axes,
        box_half=np.array([[2.0, 1.0, 0.5]]),
        box_reflectance=np.array([0.6]),
    )
    side = np.array([c, s, 0])  # along the box's x axis, from 5 m away
    hit = one(bare(), np.array([8.0, 8.0, 1.0]) - 5 * side, side, solids=box)
    assert hit.organ[0] == Organ.SOLID
    assert hit.distance[0] == pytest.approx(3.0, abs=1e-6)
    assert hit.cosine[0] == pytest.approx(1.0, abs=1e-6)
    assert hit.reflectance[0] == pytest.approx(0.6)
    slanted = one(bare(), [8.0, 8.0, 3.0], [0.6, 0, -0.8], solids=box)
    assert slanted.distance[0] == pytest.approx(1.5 / 0.8, abs=1e-6)
    assert slanted.cosine[0] == pytest.approx(0.8, abs=1e-6)


def test_post():
    post = Solids(
        capsule_a=np.array([[9.0, 8.0, 0.0]]),
        capsule_b=np.array([[9.0, 8.0, 2.0]]),
        capsule_radius=np.array([0.1]),
        capsule_reflectance=np.array([0.3]),
    )
    hit = one(bare(), [4.0, 8.05, 1.0], [1, 0, 0], solids=post)
    assert hit.distance[0] == pytest.approx(5 - np.sqrt(0.1**2 - 0.05**2), abs=2e-6)
    assert hit.cosine[0] == pytest.approx(np.sqrt(0.75), abs=1e-4)
    above = one(bare(), [9.0, 8.0, 5.0], [0, 0, -1], solids=post)
    assert above.distance[0] == pytest.approx(2.9, abs=2e-6)


def test_stone():
    stone = Solids(
        ellipsoid_centre=np.array([[8.0, 8.0, 0.0]]),
        ellipsoid_axes=np.eye(3)[None],
        ellipsoid_half=np.array([[0.4, 0.2, 0.3]]),
        ellipsoid_reflectance=np.array([0.3]),
    )
    hit = one(bare(), [8.2, 8.1, 2.0], [0, 0, -1], solids=stone)
    z = 0.3 * np.sqrt(1 - 0.25 - 0.25)
    assert hit.distance[0] == pytest.approx(2.0 - z, abs=2e-6)
    normal = np.array([0.2 / 0.16, 0.1 / 0.04, z / 0.09])
    assert hit.cosine[0] == pytest.approx(normal[2] / np.linalg.norm(normal), abs=1e-5)


def test_solids_are_not_seen_from_inside_and_hide_what_is_behind():
    box = Solids(
        box_centre=np.array([[8.0, 8.0, 2.0], [8.0, 8.0, 1.0]]),
        box_axes=np.stack([np.eye(3)] * 2),
        box_half=np.array([[1.0, 1.0, 0.5], [0.2, 0.2, 0.2]]),
        box_reflectance=np.array([0.5, 0.9]),
    )
    hit = one(bare(), [8.0, 8.0, 2.0], [0, 0, -1], solids=box)
    assert hit.distance[0] == pytest.approx(0.8, abs=1e-6)
    assert hit.reflectance[0] == pytest.approx(0.9)


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.15, -0.1)])
def test_plane_ground(slope):
    field = bare(slope=slope)
    rng = np.random.default_rng(2)
    o = np.c_[rng.uniform(5, 11, (200, 2)), rng.uniform(3, 4, 200)]
    azimuth, depression = rng.uniform(-np.pi, np.pi, 200), rng.uniform(0.7, 1.5, 200)
    ce = np.cos(depression)
    d = np.c_[np.cos(azimuth) * ce, np.sin(azimuth) * ce, -np.sin(depression)]
    hits = RayCaster(field, threads=1).cast(o, d, range_max=30)
    normal = np.array([-slope[0], -slope[1], 1.0])
    expected = -(o @ normal) / (d @ normal)
    np.testing.assert_allclose(hits.distance, expected, atol=5e-6)
    np.testing.assert_allclose(hits.cosine, np.abs(d @ normal) / np.linalg.norm(normal), atol=1e-5)
    assert (hits.organ == Organ.GROUND).all()


def test_twisted_ground_patch():
    """z = x y / 20 is bilinear, so the lattice holds it exactly."""
    pages = make_pages(LIBRARY, ground=lambda x, y: x * y / 20.0)
    pages.tile_top[:] = 0.0
    pages.tile_bump[:] = 20.0
    o, d = np.array([2.0, 3.0, 9.0]), np.array([0.4, 0.5, -0.8]) / np.sqrt(1.05)
    hit = one(HandField(pages, LIBRARY), o, d)
    a, b, c = -d[0] * d[1], 20 * d[2] - o[0] * d[1] - o[1] * d[0], 20 * o[2] - o[0] * o[1]
    roots = np.roots([a, b, c])
    assert hit.distance[0] == pytest.approx(min(roots[roots > 0]), abs=5e-6)


def test_any_number_of_threads_gives_the_same_bits():
    field = HandField(make_pages(LIBRARY, mixed=3), LIBRARY)
    rng = np.random.default_rng(3)
    n = 9001
    o = np.c_[rng.uniform(2, 14, (n, 2)), np.full(n, 2.0)]
    d = rng.normal(size=(n, 3)) * [1, 1, 0.3] - [0, 0, 1]
    d /= np.linalg.norm(d, axis=1)[:, None]
    first = RayCaster(field, threads=1).cast(o, d, range_max=20)
    for threads in (2, 3):
        caster = RayCaster(field, threads=threads)
        for _ in range(2):
            again = caster.cast(o, d, range_max=20)
            for a, b in zip(vars(first).values(), vars(again).values(), strict=True):
                assert a.tobytes() == b.tobytes()
    order = rng.permutation(n)
    shuffled = RayCaster(field, threads=1).cast(o[order], d[order], range_max=20)
    assert shuffled.distance.tobytes() == first.distance[order].tobytes()


def test_changes_of_the_field_are_seen():
    pages = make_pages(LIBRARY)
    field = HandField(pages, LIBRARY)
    caster = RayCaster(field, threads=1)
    rng = np.random.default_rng(4)
    o = np.c_[rng.uniform(5, 11, (500, 2)), np.full(500, 2.0)]
    d = np.broadcast_to([0.0, 0.0, -1.0], o.shape)
    before = caster.cast(o, d, range_max=5)
    assert (before.organ != Organ.GROUND).sum() > 50
    pages.cut_slot[:] = -1  # bare, in place
    pages.counters[REVISION] += 1
    assert (caster.cast(o, d, range_max=5).organ == Organ.GROUND).all()
    pages.ground = np.repeat(pages.ground, 2, axis=0) + np.float32(0.5)  # the pool was reallocated
    pages.tile_plane[..., 0] += 0.5
    pages.counters[REVISION] += 1
    np.testing.assert_allclose(caster.cast(o, d, range_max=5).distance, 1.5, atol=1e-6)


def test_garbage_in_the_pages_ends_no_process(monkeypatch):
    """Numbers that no field writes: the kernel may miss; it neither hangs nor reads outside its arrays."""
    monkeypatch.setattr("swath.rays.engine.check_origins", lambda field, origins: None)
    rng = np.random.default_rng(5)
    o = np.c_[rng.uniform(1, 7, (300, 2)), rng.uniform(0.1, 3, 300)]
    d = rng.normal(size=(300, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    for name in ("ground", "tile_plane", "tile_stand", "tile_top", "tile_bump"):
        for value in (np.nan, 1e30, -1e30, 0.0):
            pages = make_pages(LIBRARY, pages=1, mixed=2)
            getattr(pages, name)[:] = value
            hits = RayCaster(HandField(pages, LIBRARY), threads=1).cast(o, d, range_max=20)
            assert (hits.organ <= max(Organ)).all()


def test_bad_rays_and_thread_counts_are_refused(monkeypatch):
    caster = RayCaster(bare(pages=1), threads=1)
    with pytest.raises(ValueError, match="finite"):
        caster.cast([[0, 0, np.nan]], [[0, 0, -1]], range_max=5)
    with pytest.raises(ValueError, match="same shape"):
        caster.cast([[0, 0, 1]], [[0, 0, -1]] * 2, range_max=5)
    with pytest.raises(ValueError, match="unit"):
        caster.cast([[0, 0, 1]], [[0, 0, 0]], range_max=5)
    assert len(caster.cast(np.zeros((0, 3)), np.zeros((0, 3)), range_max=5).distance) == 0
    monkeypatch.setenv("SWATH_THREADS", "none")
    with pytest.raises(SwathError, match="SWATH_THREADS = none: expected a whole number"):
        thread_count()
    monkeypatch.delenv("SWATH_THREADS")
    for name in ("cuda:77", "gpu"):
        monkeypatch.setenv("SWATH_DEVICE", name)
        with pytest.raises(SwathError, match=f"SWATH_DEVICE = {name}: expected one of this machine's cpu"):
            RayCaster(bare(pages=1))
    with pytest.raises(SwathError, match="device = cuda:77: expected one of"):
        RayCaster(bare(pages=1), device="cuda:77")
    assert RayCaster(bare(pages=1), device="cpu").device == "cpu"


def test_the_kernel_compiles_for_cuda(tmp_path):
    wp = start_warp()
    if not wp.is_cuda_available() and not hasattr(wp, "compile_aot_module"):
        pytest.skip("this Warp compiles CUDA only where there is a device")
    import swath.rays.kernel.cast as module

    try:
        wp.compile_aot_module(module, arch=80, module_dir=tmp_path, use_ptx=True)
    except RuntimeError as error:
        pytest.skip(f"no CUDA compiler: {error}")
    ptx = next(tmp_path.glob("*.ptx")).read_text(encoding="utf-8")
    entry = ptx[ptx.index(".entry cast") :]
    assert ".maxntid 64" in entry[: entry.index("{")]  # else registers are not limited
    assert ".minnctapersm 16" in entry[: entry.index("{")]


def test_cuda_gives_the_same_ranges():
    wp = start_warp()
    if not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    field = HandField(make_pages(LIBRARY, mixed=3, slope=(0.05, 0.02)), LIBRARY)
    rng = np.random.default_rng(3)
    o = np.c_[rng.uniform(3, 13, (5000, 2)), np.full(5000, 2.0)]
    d = rng.normal(size=(5000, 3)) * [1, 1, 0.3] - [0, 0, 1]
    d /= np.linalg.norm(d, axis=1)[:, None]
    caster = RayCaster(field, device="cuda")
    assert caster.device == "cuda:0"
    for code in (255, 15):
        field.pages.cut_slot[:] = -1 - code
        field.pages.counters[REVISION] += 1
        here, there = (c.cast(o, d, range_max=20) for c in (RayCaster(field, threads=1), caster))
        agree = np.abs(here.distance - there.distance) < 1e-4
        assert (agree | (np.isnan(here.distance) & np.isnan(there.distance))).mean() > 0.999
