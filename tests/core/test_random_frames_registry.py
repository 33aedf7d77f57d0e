import sys

import numpy as np
import pytest

from swath.core.errors import InputError, SwathError
from swath.core.frames import Pose, wrap_angle
from swath.core.random import Normals, Stream
from swath.core.registry import Level, Registry, user_line

pytestmark = pytest.mark.usefixtures("code_allowed")


def test_normals_are_those_of_the_stream_in_any_order():
    stream = Stream(7, "combine.imu")
    normals = Normals(stream)
    for counter in (0, 5_000_000, 3, 2**63, 3):
        for shape in (3, (2, 2, 3), 1):  # an odd number leaves half a block in the generator
            expected = stream.at(counter).standard_normal(shape)
            assert normals.at(counter, shape).tobytes() == expected.tobytes()
        draw = stream.at(counter)
        draw.standard_normal(2)
        normals.at(counter, 2)
        assert normals.then_uniform() == draw.random()


def test_stream_depends_on_seed_name_and_counter_only():
    one = Stream(1, "combine.lidar").at(5).standard_normal(4)
    assert np.array_equal(one, Stream(1, "combine.lidar").at(5).standard_normal(4))
    for other in (
        Stream(2, "combine.lidar").at(5),
        Stream(1, "cart.lidar").at(5),
        Stream(1, "combine.lidar").at(6),
    ):
        assert not np.array_equal(one, other.standard_normal(4))


def test_neighbouring_counters_are_independent():
    draws = np.array([Stream(3, "x").at(k).standard_normal(50) for k in range(400)])
    correlation = np.corrcoef(draws[:-1].ravel(), draws[1:].ravel())[0, 1]
    assert abs(correlation) < 4 / np.sqrt(draws.size)
    assert abs(draws.mean()) < 4 / np.sqrt(draws.size)


def test_pose_inverse_product_and_angles():
    a = Pose.from_euler((1.0, -2.0, 3.0), 0.1, -0.2, 2.5)
    b = Pose.from_euler((0.3, 0.2, -0.1), -0.4, 0.3, -1.0)
    points = np.random.default_rng(0).normal(size=(5, 3))
    assert np.allclose((a @ b).apply(points), a.apply(b.apply(points)))
    assert np.allclose(a.inverse().apply(a.apply(points)), points)
    assert np.allclose(a.euler(), (0.1, -0.2, 2.5))


def test_pitch_down_and_roll_left_up():
    nose = Pose.from_euler(np.zeros(3), pitch=0.1).turn([1.0, 0.0, 0.0])
    left = Pose.from_euler(np.zeros(3), roll=0.1).turn([0.0, 1.0, 0.0])
    assert nose[2] < 0 < left[2]


def test_quaternion_turns_vectors_as_the_matrix_does():
    pose = Pose.from_euler(np.zeros(3), 0.3, -0.5, 1.2)
    x, y, z, w = pose.quaternion()
    v = np.array([0.2, -1.0, 0.7])
    q = np.array([x, y, z])
    turned = v + 2 * np.cross(q, np.cross(q, v) + w * v)
    assert np.allclose(turned, pose.turn(v))


def test_wrap_angle():
    assert np.allclose(wrap_angle(np.array([3 * np.pi, -np.pi, 0.5])), [np.pi, np.pi, 0.5])


REGISTRY = Registry({"odometry": ["swath.sensing.odometry"]})


def test_levels_are_sibling_files():
    assert REGISTRY.names("odometry") == ["error", "ideal"]
    assert isinstance(REGISTRY.get("odometry", "ideal"), Level)


def test_unknown_level_suggests_the_nearest():
    with pytest.raises(InputError, match="did you mean 'ideal'"):
        REGISTRY.get("odometry", "idael")
    with pytest.raises(InputError, match="expected one of odometry"):
        REGISTRY.get("gearbox", "ideal")


def test_users_own_file_is_a_level(tmp_path):
    (tmp_path / "mine.py").write_text('class Mine:\n    """My odometry."""\n', encoding="utf-8")
    level = REGISTRY.get("odometry", "mine.py:Mine", base=tmp_path)
    assert level.summary == "My odometry."
    with pytest.raises(InputError, match="has no Yours"):
        REGISTRY.get("odometry", "mine.py:Yours", base=tmp_path)
    with pytest.raises(InputError, match="there is no file"):
        REGISTRY.get("odometry", "other.py:Mine", base=tmp_path)


OWN = """
from __future__ import annotations
from dataclasses import dataclass
from beside_it import LIMIT

class Own:
    @dataclass(frozen=True)
    class Params:
        limit: float = LIMIT

    def __init__(self, params, setup):
        self.params = params

    def step(self):
        return self.nothing
"""


def test_a_user_file_may_import_what_lies_beside_it_and_its_errors_have_its_line(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "beside_it.py").write_text("LIMIT = 0.5\n")
    (tmp_path / "own.py").write_text(OWN)
    level = Registry({"steer": []}).get("steer", "own.py:Own", base=tmp_path)
    part = level.component(level.params(), None)
    assert part.params.limit == 0.5
    with pytest.raises(AttributeError) as caught:
        part.step()
    assert user_line(caught.value) == (str(tmp_path / "own.py"), len(OWN.splitlines()))
    with pytest.raises(ZeroDivisionError) as other:
        1 / 0  # noqa: B018
    assert user_line(other.value) is None


@pytest.mark.parametrize(("module", "is_old"), [("swath.core.setup", True), ("no_such_module", False)])
def test_a_file_of_an_older_version_names_the_one_that_rewrites_it(tmp_path, module, is_old):
    (tmp_path / "mine.py").write_text(f"import {module}\n")
    with pytest.raises(SwathError, match=module) as raised:
        Registry({"terrain": []}).get("terrain", f"{tmp_path}/mine.py:A")
    assert ("`swath migrate` of version 0.2" in str(raised.value)) == is_old
