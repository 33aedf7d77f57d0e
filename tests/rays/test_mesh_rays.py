"""Plants that are meshes: rays against Embree on the same triangles, and in float64 against every one."""

from pathlib import Path

import numpy as np
import pytest

from swath.core.random import Stream
from swath.field.crop_sheet import Weeds, load_crop, weed_crop
from swath.field.memory_layout import Organ, Shape
from swath.field.mesh_file import read_mesh
from swath.field.prototypes import make_library
from swath.rays.engine import RayCaster
from tests.rays.hand_field import HandField, make_pages
from tests.rays.reference import cast_slowly

pytest.importorskip("trimesh", reason="trimesh is not installed")

MESHES = Path(__file__).parents[2] / "examples" / "meshes"
CROP = load_crop(str(MESHES / "sunflower.yaml"))
FLOWERS = [read_mesh(MESHES / f"sunflower-{v}.obj", key="test") for v in "ab"]
RAYS = 20_000
LOW, HIGH = 2.0, 12.0  # the planted square: 10 x 10 tiles of 1 m


def library_of(density, crop=CROP, **options):
    options = {"row_spacing": 0.0, "seed": Stream(1, "mesh"), "tile_count": 1} | options
    return make_library(crop, density_max=density, **options)


def changed(folder, *pairs):
    """The sunflower's data sheet with pieces of its text replaced, meshes where they are."""
    text = (
        (MESHES / "sunflower.yaml").read_text(encoding="utf-8").replace("sunflower-", f"{MESHES}/sunflower-")
    )
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    (folder / "changed.yaml").write_text(text, encoding="utf-8")
    return load_crop(str(folder / "changed.yaml"))


def instances(library):
    """Every triangle of one tile, once, from the files and the places of the plants: (n, 3, 3) [m].

    Corners come from the files alone. Which file, size and turn a plant has is found from its height and
    from where its head is.
    """
    found = []
    for plant, (x, y) in enumerate(library.stem_xy.astype(float)):
        mine = np.flatnonzero((library.owner == plant) & (library.organ == Organ.EAR))
        middle = (2.0 * library.a + library.b)[mine] / 3.0 - np.c_[library.base[mine], np.zeros(len(mine))]
        middle = middle[np.unique(np.round(middle, 4), axis=0, return_index=True)[1]]
        best = None
        for parts in FLOWERS:
            corners = np.concatenate([p.corners for p in parts])
            head = next(p.corners for p in parts if p.names[0] == "head")
            size = float(library.stem_height[plant]) / corners[..., 2].max()
            a, b = head.mean(axis=(0, 1)) * size, middle.mean(axis=0)
            turn = np.arctan2(b[1], b[0]) - np.arctan2(a[1], a[0])
            c, s = np.cos(turn), np.sin(turn)
            rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            off = np.linalg.norm(a @ rotation.T - b) if len(middle) == len(head) else np.inf
            if best is None or off < best[0]:
                best = off, size * corners @ rotation.T + [x, y, 0.0]
        assert best[0] < 1e-4
        found.append(best[1])
    return np.concatenate(found)


@pytest.mark.draws
def test_twenty_thousand_instances_on_100_m2_agree_with_embree(tmp_path):
    """One prototype on every tile, unmirrored: a tile's plants go on beyond its sides, so both see the same.

    The plants are small ones, 0.5 m, so that rays at 200/m2 get to the ground too.
    """
    rtcore = pytest.importorskip("embreex.rtcore_scene", reason="embreex is not installed")
    from embreex.mesh_construction import TriangleMesh

    height = ("  height_cv", '  height_cm: {value: 50, tag: E, source: "test"}\n  height_cv')
    below = ("straw_below_height_cm: {value: 60", "straw_below_height_cm: {value: 15")
    small = changed(tmp_path, ("  unit: cm\n", ""), height, below)
    library = library_of(200.0, small)
    pages = make_pages(library, pages=2)
    world = np.zeros((16, 16), np.float32)
    world[2:12, 2:12] = library.height_max
    pages.tile_top[:] = world.reshape(2, 8, 2, 8).transpose(0, 2, 1, 3).reshape(4, 8, 8)
    tile = instances(library)
    steps = np.stack(np.meshgrid(np.arange(1, 13), np.arange(1, 13), [0.0]), axis=-1).reshape(-1, 3)
    soup = (tile[None] + steps[:, None, None]).reshape(-1, 3, 3)
    flat = soup[..., :2]
    soup = soup[((flat.max(axis=1) > LOW - 0.01) & (flat.min(axis=1) < HIGH + 0.01)).all(axis=1)]
    assert len(library.stem_xy) * 100 == 20_000
    ground = np.array([[-50.0, -50, 0], [50, -50, 0], [0, 100, 0]])[None]
    scene = rtcore.EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(np.concatenate([soup, ground]), np.float32))
    rng = np.random.default_rng(2)
    aim = np.c_[rng.uniform(LOW + 1.0, HIGH - 1.0, (RAYS, 2)), rng.uniform(0.0, 0.45, RAYS)]
    azimuth, fall = rng.uniform(-np.pi, np.pi, RAYS), np.radians(rng.uniform(5.0, 85.0, RAYS))
    d = np.c_[np.cos(azimuth) * np.cos(fall), np.sin(azimuth) * np.cos(fall), -np.sin(fall)]
    o = aim - d * ((rng.uniform(2.5, 6.0, RAYS) - aim[:, 2]) / np.sin(fall))[:, None]
    sides = np.stack([(LOW - o[:, :2]) / d[:, :2], (HIGH - o[:, :2]) / d[:, :2]])
    enter, leave = np.maximum(sides.min(axis=0).max(axis=1), 0.0), sides.max(axis=0).min(axis=1)
    near = np.maximum(enter - 1.0, 0.0)  # pages are known 2 m around the square; flat rays start closer
    o, enter, leave = o + near[:, None] * d, enter - near, leave - near
    t = enter + scene.run((o + enter[:, None] * d).astype(np.float32), d.astype(np.float32), query="DISTANCE")
    hits = RayCaster(HandField(pages, library), threads=1).cast(o, d, range_max=100.0)
    inside = (t < leave) & (hits.organ >= Organ.STEM)
    assert inside.mean() > 0.5
    share = float(np.mean(np.abs(hits.distance - t)[inside] < 1e-4))
    organs = np.bincount(hits.organ, minlength=6)[1:6]
    print(f"{len(soup)} triangles, {inside.sum()} rays, organs {organs}, within 0.1 mm {share:.5f}")
    assert organs[[0, 2, 3, 4]].min() > 200
    assert share >= 0.999
    crop = (t < leave) & (t < o[:, 2] / np.sin(fall) - 1e-3)
    assert np.mean((hits.organ >= Organ.STEM)[crop]) > 0.999


@pytest.mark.parametrize("case", ["standing", "cut", "leaning"])
def test_every_triangle_is_hit_where_it_is(case):
    """Mixed and mirrored prototypes, weeds between, some cells cut: against all primitives in float64."""
    weeds = weed_crop(Weeds(plants_per_m2=10.0, height_m=0.3))
    library = library_of(8.0, row_spacing=0.7, tile_count=2, weeds=weeds)
    assert set(np.unique(library.shape)) == set(Shape)
    options = {"slope": (0.1, -0.05), "lean": (0.3, -0.2), "scale": 0.9} if case == "leaning" else {}
    pages = make_pages(library, pages=1, mixed=1, **options)
    if case == "cut":
        pages.cut_slot[:] = 0
        codes = np.random.default_rng(1).choice([0, 60, 110, 255], (32, 32))
        pages.cut[0] = codes.repeat(16, 0).repeat(16, 1)
    rng = np.random.default_rng(3)
    count = 80
    o = np.c_[rng.uniform(3.0, 8.0, (count, 2)), rng.uniform(0.2, 2.2, count)]
    o[:, 2] += 0.6 if case == "leaning" else 0.0
    azimuth, fall = rng.uniform(-np.pi, np.pi, count), rng.uniform(-0.2, 1.2, count)
    d = np.c_[np.cos(azimuth) * np.cos(fall), np.sin(azimuth) * np.cos(fall), -np.sin(fall)]
    distance, organ = cast_slowly(library, pages, o, d, 3.0)
    hits = RayCaster(HandField(pages, library), threads=1).cast(o, d, range_max=3.0)
    np.testing.assert_array_equal(hits.organ, organ)
    np.testing.assert_allclose(hits.distance, distance, rtol=0, atol=5e-6, equal_nan=True)
    wanted = {Organ.STUBBLE, Organ.LEAF} if case == "cut" else {Organ.STEM, Organ.LEAF}
    assert wanted <= set(organ)


def test_a_triangle_across_the_cut_is_hit_below_it_alone():
    library = library_of(8.0, row_spacing=0.7)
    rng = np.random.default_rng(5)
    o = np.c_[rng.uniform(3.0, 8.0, (4000, 2)), rng.uniform(0.3, 1.8, 4000)]
    azimuth = rng.uniform(-np.pi, np.pi, 4000)
    d = np.c_[np.cos(azimuth), np.sin(azimuth), np.zeros(4000)]
    standing, cut = (
        RayCaster(HandField(make_pages(library, pages=1, code=code), library), threads=1).cast(
            o, d, range_max=3.0
        )
        for code in (255, 60)
    )
    low = o[:, 2] < 0.6
    np.testing.assert_array_equal(cut.distance[low], standing.distance[low])
    assert (standing.organ[~low] == Organ.EAR).sum() > 100
    assert not cut.is_hit[~low].any()
    assert set(cut.organ[low & cut.is_hit]) == {Organ.STUBBLE, Organ.LEAF}


def test_each_part_has_its_own_reflectance(tmp_path):
    """Two parts of one organ that differ: the plants keep both, and stubble is stubble."""
    crop = changed(
        tmp_path,
        ("head: {organ: ear, reflectance: {value: 0.35", "head: {organ: leaf, reflectance: {value: 0.7"),
    )
    library = make_library(crop, density_max=8.0, row_spacing=0.7, seed=Stream(1, "mesh"), tile_count=1)
    rng = np.random.default_rng(6)
    o = np.c_[rng.uniform(3.0, 8.0, (4000, 2)), np.full(4000, 2.3)]
    d = np.tile([0.6, 0.0, -0.8], (4000, 1))
    hits = RayCaster(HandField(make_pages(library, pages=1), library), threads=1).cast(o, d, range_max=5.0)
    leaf = hits.organ == Organ.LEAF
    assert {round(float(r), 3) for r in hits.reflectance[leaf]} == {0.4, 0.7}
    z = o[:, 2] + hits.distance * d[:, 2]
    assert (hits.reflectance[leaf & (z > 1.55)] > 0.6).mean() > 0.9
