"""The kernel against Embree on the same plants as fine triangles, pushed through the same affine map.

A capsule becomes a 64-sided prism with rounded ends and the capsule's mean silhouette width. What is left
(0.02-0.05 % of the rays) are rays at silhouettes, where the prism's width differs by up to 0.06 %.
"""

import numpy as np
import pytest

from swath.field.memory_layout import STANDING, Organ
from swath.rays.engine import RayCaster
from tests.rays.hand_field import HandField, make_pages, small_library
from tests.rays.reference import cell_code
from tests.rays.triangles import (
    capsule_triangles,
    own_primitives,
    ribbon_triangles,
    to_stand,
)

rtcore = pytest.importorskip("embreex.rtcore_scene", reason="embreex is not installed")

LIBRARY = small_library(150, tiles=1, seed=3)
LOW, HIGH = np.array([2.0, 3.0]), np.array([5.0, 5.0])  # the planted tiles [m]
RAYS = 30_000
HOME = 3 * 7 + 3  # slot of the page that holds them


def planted(**options):
    """Pages with live tiles only between LOW and HIGH."""
    pages = make_pages(LIBRARY, pages=7, first=-3, **options)
    top = np.zeros_like(pages.tile_top)
    top[HOME, 3:5, 2:5] = pages.tile_top.max()
    pages.tile_top[:] = top
    return pages


def scene(pages):
    """The planted tiles as Embree triangles."""
    from embreex.mesh_construction import TriangleMesh

    size = LIBRARY.tile_size
    plane, stand = pages.tile_plane[HOME], pages.tile_stand[HOME].astype(float)
    index, a, b = own_primitives(LIBRARY, 0)
    thinned = LIBRARY.stem_rank[LIBRARY.owner[index]] < stand[0, 0, 3]
    plants = index[thinned], a[thinned], b[thinned]
    soup = []
    for tx in range(1, 6):
        for ty in range(2, 6):
            corner = np.array([tx * size, ty * size, 0.0])
            tile = plane[ty, tx].astype(float), stand[ty, tx], size
            ends = np.stack([to_stand(p, *tile)[:, :2] for p in plants[1:]]) + corner[:2]
            near = ((ends.max(axis=0) > LOW - 0.02) & (ends.min(axis=0) < HIGH + 0.02)).all(axis=1)
            soup.append(
                to_stand(tile_soup(pages, [p[near] for p in plants], tx, ty, stand[ty, tx]), *tile) + corner
            )
    triangles = np.concatenate(soup)
    corners = np.array([[-5.0, -5.0], [25.0, -5.0], [25.0, 25.0], [-5.0, 25.0]])
    ground = np.c_[corners, corners @ plane[4, 4, 1:]]
    triangles = np.concatenate([triangles, ground[[0, 1, 2]][None], ground[[0, 2, 3]][None]])
    result = rtcore.EmbreeScene()
    TriangleMesh(result, np.ascontiguousarray(triangles, np.float32))
    return result, len(triangles)


def tile_soup(pages, plants, tx, ty, stand):
    """Triangles of one tile in prototype coordinates, cut at the stubble height of each stem's cell."""
    index, a, b = plants
    foot = np.floor(LIBRARY.stem_xy[LIBRARY.owner[index]].astype(float) * 64).astype(int)
    code = np.array([cell_code(pages, tx * 64 + i, ty * 64 + j) for i, j in foot])
    top = np.where(code == STANDING, np.inf, 0.01 * code / stand[0])
    keep = (code > 0) & (np.minimum(a[:, 2], b[:, 2]) <= top)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(a[:, 2] < b[:, 2], (top - a[:, 2]) / (b[:, 2] - a[:, 2]), 1.0)
        back = np.where(b[:, 2] < a[:, 2], (top - b[:, 2]) / (a[:, 2] - b[:, 2]), 1.0)
    new_b = a + np.clip(share, 0, 1)[:, None] * (b - a)
    new_a = b + np.clip(back, 0, 1)[:, None] * (a - b)
    radius, width, organ = LIBRARY.radius[index], LIBRARY.width[index].astype(float), LIBRARY.organ[index]
    parts = [ribbon_triangles(new_a[m], new_b[m], width[m]) for m in [keep & (organ == Organ.LEAF)]]
    for kind, rings in ((Organ.STEM, 2), (Organ.EAR, 5)):
        m = keep & (organ == kind)
        parts.append(capsule_triangles(new_a[m], new_b[m], radius[m].astype(float), sides=64, rings=rings))
    return np.concatenate(parts)


def rays():
    """From 2 to 4 m up, 10 to 60 deg down, aimed at points in the planted tiles; entry and exit of them."""
    rng = np.random.default_rng(4)
    aim = np.c_[rng.uniform(LOW, HIGH, (RAYS, 2)), rng.uniform(0.1, 0.9, RAYS)]
    azimuth, depression = rng.uniform(-np.pi, np.pi, RAYS), np.radians(rng.uniform(10, 60, RAYS))
    d = np.c_[np.cos(azimuth), np.sin(azimuth), -np.tan(depression)] * np.cos(depression)[:, None]
    height = rng.uniform(2, 4, RAYS)
    o = aim - d * ((height - aim[:, 2]) / np.sin(depression))[:, None]
    sides = np.stack([(LOW - o[:, :2]) / d[:, :2], (HIGH - o[:, :2]) / d[:, :2]])
    enter = np.maximum(sides.min(axis=0).max(axis=1), 0.0)
    leave = sides.max(axis=0).min(axis=1)
    return o, d, enter, leave


@pytest.mark.draws
@pytest.mark.parametrize("case", ["flat", "hill", "cut"])
def test_ranges_agree_with_embree(case):
    options = {
        "flat": {},
        "hill": {"slope": (0.12, -0.07), "lean": (0.3, -0.2), "scale": 0.9, "density": 110},
        "cut": {"slope": (0.03, 0.02), "lean": (0.1, 0.0)},
    }[case]
    pages = planted(**options)
    if case == "cut":
        codes = np.random.default_rng(1).choice([0, 12, 35, 255], (32, 32))
        pages.cut_slot[HOME] = 0
        pages.cut[0] = codes.repeat(16, 0).repeat(16, 1)
    o, d, enter, leave = rays()
    inside = o + enter[:, None] * d
    mesh, count = scene(pages)
    t = enter + mesh.run(inside.astype(np.float32), d.astype(np.float32), query="DISTANCE")
    hits = RayCaster(HandField(pages, LIBRARY), threads=1).cast(o, d, range_max=60)
    ours = (hits.distance > enter) & (hits.distance < leave)
    on_side = np.abs(hits.distance - enter) < 1e-5  # the cut face of an organ in the outer side of the tiles
    crop = (ours & (hits.organ >= Organ.STEM)) | (~ours & (t < leave))
    crop &= ~on_side
    error = np.abs(hits.distance - t)[crop]
    shares = [float((error < limit).mean()) for limit in (1e-3, 1e-4)]
    print(
        f"{case}: {count} triangles, {crop.sum()} rays, within 1 mm {shares[0]:.5f}, 0.1 mm {shares[1]:.5f}"
    )
    for k in np.flatnonzero(crop)[error > 1e-3][:6]:
        ours_is = f"{Organ(hits.organ[k]).name} {hits.distance[k]:.4f}"
        print(f"  {ours_is}, Embree {t[k]:.4f} of {enter[k]:.4f}..{leave[k]:.4f}")
    assert crop.sum() > 0.2 * RAYS
    assert shares[0] >= 0.999
