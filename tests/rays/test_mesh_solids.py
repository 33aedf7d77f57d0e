"""Things with a surface of triangles among the solids: against Embree, and where a scenario puts them."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.field.memory_layout import Organ
from swath.field.mesh_file import read_mesh
from swath.field.solid.obstacles import MeshObstacle, Obstacle
from swath.field.solid.solids import box_on_ground, merge, mesh, moved, solid_count
from swath.rays.engine import RayCaster
from tests.obstacle_solids import solids_of
from tests.rays.hand_field import HandField, make_pages, small_library

pytest.importorskip("trimesh", reason="trimesh is not installed")

PERSON = Path(__file__).parents[2] / "examples" / "meshes" / "person.obj"
LIBRARY = small_library(50, tiles=1)
FIELD = HandField(make_pages(LIBRARY, pages=2, code=0), LIBRARY)


class Flat:
    """Ground at a height, with a boundary or none."""

    boundary = None

    def __init__(self, height):
        self.height = height

    def ground_height(self, x, y):
        return np.full(np.shape(x), self.height)


def test_many_meshes_agree_with_embree():
    rtcore = pytest.importorskip("embreex.rtcore_scene", reason="embreex is not installed")
    from embreex.mesh_construction import TriangleMesh

    corners = np.concatenate([p.corners for p in read_mesh(PERSON, key="test")])
    rng = np.random.default_rng(1)
    one, things, soup = mesh(corners, Pose.identity(), 0.5), [], []
    for _ in range(12):
        pose = Pose.from_euler(
            [*rng.uniform(2.0, 14.0, 2), rng.uniform(0.0, 1.0)],
            roll=rng.uniform(-0.5, 0.5),
            pitch=rng.uniform(-0.5, 0.5),
            yaw=rng.uniform(-np.pi, np.pi),
        )
        things.append(moved(one, pose))
        soup.append(pose.apply(corners.reshape(-1, 3)).reshape(-1, 3, 3))
    solids = merge(*things)
    assert solid_count(solids) == 12
    assert len({id(m) for m in solids.mesh_shape}) == 1
    scene = rtcore.EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(np.concatenate(soup), np.float32))
    count = 20_000
    aim = solids.mesh_centre[rng.integers(0, 12, count)] + rng.normal(0.0, 0.4, (count, 3))
    o = np.c_[rng.uniform(1.0, 15.0, (count, 2)), rng.uniform(2.5, 4.0, count)]
    d = (aim - o) / np.linalg.norm(aim - o, axis=1)[:, None]
    t = scene.run(o.astype(np.float32), d.astype(np.float32), query="DISTANCE")
    hits = RayCaster(FIELD, threads=2).cast(o, d, range_max=50.0, solids=solids)
    seen = hits.organ == Organ.SOLID
    above = t < (o[:, 2] - 0.01) / np.maximum(-d[:, 2], 1e-9)  # the rest meets the ground first
    assert seen.mean() > 0.2
    assert np.mean(seen == above) > 0.999
    both = seen & above
    assert np.mean(np.abs(hits.distance - t)[both] < 1e-4) >= 0.999
    assert set(np.round(hits.reflectance[seen], 6)) == {0.5}


def test_the_nearest_of_mesh_box_and_ground_counts():
    corners = np.concatenate([p.corners for p in read_mesh(PERSON, key="test")])
    solids = merge(
        box_on_ground([8.0, 5.0, 0.0], [1.0, 1.0, 1.0]), mesh(corners, Pose.from_euler([5.0, 5.0, 0.0]))
    )
    o = np.array([[2.0, 5.1, 1.2], [2.0, 5.1, 1.2], [2.0, 5.1, 1.2], [5.0, 5.1, 1.2]])
    d = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0]])
    hits = RayCaster(FIELD, threads=1).cast(o, d, range_max=50.0, solids=solids)
    assert hits.distance[[0, 2]] == pytest.approx([3.0 - 0.13, 1.5], abs=1e-5)
    assert list(hits.organ[:3]) == [Organ.SOLID, Organ.NONE, Organ.GROUND]
    assert hits.cosine[0] == pytest.approx(1.0)
    assert hits.distance[3] == pytest.approx(0.13, abs=1e-5)  # from inside: a mesh is a surface
    near = RayCaster(FIELD, threads=1).cast(o[:1], d[:1], range_max=2.8, solids=solids)
    assert not near.is_hit.any()


def test_a_scenario_s_mesh_stands_where_and_how_it_is_told():
    data = {"kind": "mesh", "x_m": 3.0, "y_m": 4.0, "file": str(PERSON)}
    made = TypeAdapter(Obstacle).validate_python(data | {"heading_deg": 90.0, "scale": 2.0, "z_m": 0.5})
    solids = solids_of([made], Flat(10.0))
    points = solids.mesh_shape[0].corners.reshape(-1, 3) @ solids.mesh_axes[0].T + solids.mesh_centre[0]
    # the soles are the middle of the base: x from -0.10 to 0.18 m ahead, now along y
    assert points.min(axis=0) == pytest.approx([3.0 - 0.66, 4.0 - 2 * (0.13 + 0.04), 10.5], abs=1e-5)
    assert points.max(axis=0) == pytest.approx([3.0 + 0.66, 4.0 + 2 * (0.18 - 0.04), 10.5 + 3.56], abs=1e-5)
    lying = MeshObstacle(x_m=0.0, y_m=0.0, file=str(PERSON), up="y", foot="origin", unit="cm")
    flat = solids_of([lying], Flat(0.0))
    assert np.ptp(flat.mesh_shape[0].corners, axis=(0, 1)) == pytest.approx(
        [0.0031, 0.0178, 0.0066], abs=1e-5
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"file": "gone.obj"},
            "field.obstacles.0.file = gone.obj: expected a mesh file, there is no such file",
        ),
        (
            {"unit": "cm", "scale": 0.1},
            "field.obstacles.0.file = person.obj: expected a thing of 0.01 to 200 m",
        ),
        ({"scale": 900.0}, "it is 1.6e+03 m: unit, scale?"),
    ],
)
def test_meshes_that_cannot_be_used_are_refused(change, message):
    obstacle = MeshObstacle(**({"x_m": 0.0, "y_m": 0.0, "file": str(PERSON)} | change))
    with pytest.raises(InputError) as caught:
        solids_of([obstacle], Flat(0.0))
    assert message in str(caught.value)
