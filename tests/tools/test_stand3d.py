"""The stand picture: its stems must be those that rays hit."""

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.field.memory_layout import Organ
from swath.tools.scan.stand3d import Camera, organs_near

pytestmark = pytest.mark.drawn

AT = 5.0 * np.cos(0.4), 5.0 * np.sin(0.4)  # a place on the edge


@pytest.fixture(scope="module")
def ground():
    from swath.core.random import Stream
    from swath.field.crop_sheet import load_crop
    from swath.field.edges.edge import EdgeShape, straight
    from swath.field.edges.edge_defects import BrokenEdge
    from swath.field.field import make_field
    from swath.field.field_setup import FieldSetup
    from swath.field.stand.uniform import LEVEL as STAND
    from swath.field.terrain.plane import LEVEL as TERRAIN

    stream = Stream(1, "field")
    setup = FieldSetup(stream)
    edge = BrokenEdge(EdgeShape(straight(0.0, 0.0, 0.4, 100.0), "right"), 15)
    stand = STAND.component(STAND.params(row_azimuth_deg=30.0, lean_deg=12.0), setup)
    terrain = TERRAIN.component(TERRAIN.params(), setup)
    made = make_field(terrain, stand, edge, crop=load_crop("wheat"), stream=stream)
    made.ensure(*AT, 12.0)
    return made


def test_rays_hit_the_drawn_stems(ground):
    """Every stem, ear, leaf and stubble hit lies on a drawn piece of that organ.

    But for those near the side of a tile, where pieces of the next tile's neighbour stand in.
    """
    from swath.rays.engine import RayCaster

    rng = np.random.default_rng(1)
    count = 900
    x, y = AT[0] + rng.uniform(-0.8, 0.8, count), AT[1] + rng.uniform(-1.2, 1.2, count)
    target = np.stack([x, y, np.zeros(count)], axis=1)
    origin = target + np.array([-4.0, 3.0, 3.0])
    direction = (target - origin) / np.linalg.norm(target - origin, axis=1)[:, None]
    hits = RayCaster(ground, threads=1).cast(origin, direction, range_max=20.0)
    found = organs_near(ground, *AT, 4.5)
    worst = {}
    for kind in (Organ.STEM, Organ.EAR, Organ.LEAF, Organ.STUBBLE):
        mine = hits.organ == kind
        points = origin[mine] + direction[mine] * hits.distance[mine, None].astype(float)
        points = points[_inside_a_tile(ground, points)]
        pieces = found.organ == kind
        reach = found.radius[pieces] + np.linalg.norm(found.half[pieces], axis=1)
        gaps = [_gap(p, found.a[pieces], found.b[pieces], reach) for p in points]
        worst[kind] = max(gaps, default=0.0)
        assert len(gaps) > 5, kind
    assert max(worst.values()) < 2e-3, worst


def _inside_a_tile(ground, points):
    """True where the side of a tile is further away than a leaf is long."""
    size = ground.library.tile_size
    place = np.stack(ground.to_stand(points[:, 0], points[:, 1])) % size
    return np.minimum(place, size - place).min(axis=0) > 0.25


def _gap(point, a, b, reach):
    """How far a point lies outside the nearest piece, taken as a fat line [m]."""
    axis = b - a
    share = np.clip(np.sum((point - a) * axis, axis=1) / np.maximum(np.sum(axis**2, axis=1), 1e-12), 0, 1)
    return float((np.linalg.norm(point - (a + share[:, None] * axis), axis=1) - reach).min())


def test_cut_stems_are_drawn_as_stubble(ground):
    """Nothing above the stubble where crop is cut; full height where it stands."""
    found = organs_near(ground, *AT, 2.0)
    top = np.maximum(found.a[:, 2], found.b[:, 2]) - ground.ground_height(found.a[:, 0], found.a[:, 1])
    stubble = found.organ == Organ.STUBBLE
    assert 100 < stubble.sum() < len(stubble)
    depth = ground.first_edge.signed_distance(found.a[:, 0], found.a[:, 1])
    assert top[stubble].max() < 0.16
    assert top[~stubble].max() > 0.6
    assert (top[(depth < -0.7) & ~stubble] < 0.16).all()
    assert (depth[stubble] < 0.1).all()
    assert ((depth > -0.7) | (found.organ != Organ.STEM)).all()


def test_stem_density_is_the_field_s(ground):
    """500 stems/m2 within a circle of 1 m: one lowest stem piece each."""
    found = organs_near(ground, 5.0, -3.0, 1.0)
    low = found.organ == Organ.STEM
    feet = np.unique(np.round(np.concatenate([found.a[low], found.b[low]]), 4), axis=0)
    base = ground.ground_height(feet[:, 0], feet[:, 1])
    count = np.sum(np.abs(feet[:, 2] - base) < 0.004)
    assert count == pytest.approx(500 * np.pi, rel=0.06)


def test_nothing_where_no_page_is():
    from types import SimpleNamespace

    pages = SimpleNamespace(table=np.zeros((0, 0), np.int32), table_x=0, table_y=0)
    library = SimpleNamespace(tile_size=1.0, stem_start=np.array([0, 1]), owner=np.array([0]))
    empty = organs_near(SimpleNamespace(pages=pages, library=library, stand_yaw=0.0), 0.0, 0.0, 1.0)
    assert empty.a.shape == (0, 3)


def test_the_camera_sees_upright_and_left_is_left():
    camera = Camera.looking(np.array([0.0, 0.0, 2.0]), np.array([10.0, 0.0, 2.0]))
    image, depth = camera.project([[5.0, 1.0, 2.0], [5.0, 0.0, 3.0], [5.0, 0.0, 2.0]])
    np.testing.assert_allclose(image, [[-0.2, 0.0], [0.0, 0.2], [0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(depth, 5.0)
    assert Pose.identity().apply([0.0, 0.0, 0.0]).tolist() == [0.0, 0.0, 0.0]
