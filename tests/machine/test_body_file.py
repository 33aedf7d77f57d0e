"""A machine's shape from URDF, SDF or a mesh: the shapes themselves, where they sit, what is refused."""

from math import pi, sin

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swath.core.errors import InputError
from swath.machine.body import triangles
from swath.machine.body.body import read_body, read_sdf, read_urdf
from swath.machine.body.model_xml import PARTS_MAX
from swath.scenario.sections import BodySection

CUBE = "<geometry><box size='1 1 1'/></geometry>"
SDF_CUBE = "<geometry><box><size>1 1 1</size></box></geometry>"


def area(shape):
    across = np.cross(shape[:, 1] - shape[:, 0], shape[:, 2] - shape[:, 0])
    return 0.5 * np.linalg.norm(across, axis=1).sum()


def middle(part):
    flat = part.corners.reshape(-1, 3)
    return 0.5 * (flat.min(axis=0) + flat.max(axis=0))


def written(tmp_path, name, text):
    file = tmp_path / name
    file.write_text(text)
    return file


def urdf(tmp_path, body):
    return read_urdf(written(tmp_path, "m.urdf", f"<robot name='m'>{body}</robot>"), "combine.body.file")


def sdf(tmp_path, body):
    text = f"<sdf version='1.9'><model name='m'>{body}</model></sdf>"
    return read_sdf(written(tmp_path, "m.sdf", text), "combine.body.file")


def test_surfaces_are_those_of_the_solids():
    assert area(triangles.box(np.array([2.0, 3.0, 0.5]))) == pytest.approx(2 * (6.0 + 1.0 + 1.5))
    n, radius, length = triangles.SIDES, 0.7, 1.3
    ring = n * 2 * radius * sin(pi / n)
    ends = n * radius**2 * sin(2 * pi / n)
    assert area(triangles.cylinder(radius, length)) == pytest.approx(ring * length + ends)
    assert area(triangles.sphere(radius)) == pytest.approx(4 * pi * radius**2, rel=0.02)


def test_a_urdf_is_a_tree_of_turned_frames(tmp_path):
    first, second = (0.3, -0.2, 1.1), (-0.5, 0.7, 0.2)
    body = f"""<link name='a'/><link name='b'/><link name='header'>
      <visual><origin xyz='0.5 0 0' rpy='0.1 0.2 0.3'/>{CUBE}</visual></link>
      <joint name='j' type='fixed'><parent link='a'/><child link='b'/>
        <origin xyz='1 2 3' rpy='{" ".join(map(str, first))}'/></joint>
      <joint name='k' type='revolute'><parent link='b'/><child link='header'/>
        <origin xyz='0 0 1' rpy='{" ".join(map(str, second))}'/></joint>"""
    (part,) = urdf(tmp_path, body)
    turn_a, turn_b = (Rotation.from_euler("xyz", angles) for angles in (first, second))
    inner = np.array([0, 0, 1]) + turn_b.apply([0.5, 0, 0])
    expected = np.array([1, 2, 3]) + turn_a.apply(inner)
    np.testing.assert_allclose(middle(part), expected, atol=1e-12)
    assert part.group == ("header", "b", "a")
    turned = turn_a * turn_b * Rotation.from_euler("xyz", [0.1, 0.2, 0.3])
    reach = np.abs(turned.as_matrix()).sum(axis=1)
    np.testing.assert_allclose(np.ptp(part.corners.reshape(-1, 3), axis=0), reach, atol=1e-12)


def test_an_sdf_has_poses_relative_to_frames(tmp_path):
    body = f"""<frame name='f'><pose degrees='true'>1 0 0 0 0 90</pose></frame>
      <link name='a'><pose relative_to='f'>2 0 0 0 0 0</pose>
        <visual name='v'><pose>0 1 0 0 0 0</pose>{SDF_CUBE}</visual></link>
      <link name='b'><visual name='v'><pose relative_to='a'>0 0 3 0 0 0</pose>{SDF_CUBE}</visual></link>
      <joint name='j' type='fixed'><parent>a</parent><child>b</child></joint>"""
    a, b = sdf(tmp_path, body)
    np.testing.assert_allclose(middle(a), [0, 2, 0], atol=1e-12)
    np.testing.assert_allclose(middle(b), [1, 2, 3], atol=1e-12)
    assert (a.group, b.group) == (("a",), ("b", "a"))


def test_a_mesh_of_a_package_is_found_above_the_file(tmp_path):
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    (tmp_path / "robot" / "meshes").mkdir(parents=True)
    (tmp_path / "robot" / "urdf").mkdir()
    text = "o part\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"
    (tmp_path / "robot" / "meshes" / "a.obj").write_text(text)
    mesh = "<geometry><mesh filename='package://robot/meshes/a.obj' scale='2 2 2'/></geometry>"
    file = tmp_path / "robot" / "urdf" / "m.urdf"
    file.write_text(f"<robot name='m'><link name='a'><visual>{mesh}</visual></link></robot>")
    (part,) = read_urdf(file, "combine.body.file")
    assert np.ptp(part.corners.reshape(-1, 3), axis=0) == pytest.approx([2, 2, 2])


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("", f"expected 1 to {PARTS_MAX} visuals, it has 0"),
        (
            "<link name='a'><visual/></link>",
            "visual 0: expected a box, cylinder, sphere or mesh",
        ),
        (
            f"<link name='a'><visual><origin xyz='1 2'/>{CUBE}</visual></link>",
            "xyz: expected 3 finite",
        ),
        (
            "<link name='a'><visual><geometry><sphere radius='-1'/></geometry></visual></link>",
            "radius: expected above 0",
        ),
        (
            "<link name='a'/><joint name='j'><parent link='a'/><child link='b'/></joint>",
            "joint j: expected",
        ),
        (
            "<link name='a'><visual><geometry><mesh filename='package://x/y.stl'/></geometry></visual></link>",
            "'package://x/y.stl' is not at or above this file",
        ),
        (
            "<link name='a'/><link name='b'><visual/></link><joint name='j'><parent link='a'/>"
            "<child link='b'/></joint><joint name='k'><parent link='b'/><child link='a'/></joint>",
            "hangs on itself",
        ),
        ("<link name='a'>", "line 1: expected XML that can be read"),
    ],
)
def test_what_is_no_urdf_is_refused_with_its_place(tmp_path, body, said):
    with pytest.raises(InputError, match=r"m\.urdf") as caught:
        urdf(tmp_path, body)
    assert said in str(caught.value)


def test_entities_are_refused(tmp_path):
    file = written(tmp_path, "m.urdf", "<!DOCTYPE r [<!ENTITY a 'b'>]><robot name='&a;'/>")
    with pytest.raises(InputError, match="DOCTYPE is not allowed"):
        read_urdf(file, "combine.body.file")


def test_an_sdf_of_several_models_is_refused(tmp_path):
    with pytest.raises(InputError, match="<include>: expected one model"):
        sdf(tmp_path, "<include><uri>model://x</uri></include>")


class TestBody:
    TEXT = f"""<robot name='m'><link name='base'><visual>{CUBE}</visual></link>
      <link name='header'><visual><origin xyz='3 0 0'/>{CUBE}</visual></link>
      <link name='reel'><visual><origin xyz='4 0 0'/>{CUBE}</visual></link>
      <joint name='j'><parent link='base'/><child link='header'/></joint>
      <joint name='k'><parent link='header'/><child link='reel'/></joint></robot>"""

    def test_the_header_takes_along_what_hangs_on_it(self, tmp_path):
        file = written(tmp_path, "m.urdf", self.TEXT)
        body = read_body(BodySection(file=str(file), z_m=1.0, heading_deg=90), "combine.body")
        np.testing.assert_allclose(body.fixed.mesh_centre, [[0, 0, 1]], atol=1e-12)
        np.testing.assert_allclose(body.header.mesh_centre, [[0, 3, 1], [0, 4, 1]], atol=1e-12)
        assert len(body.triangles) == 36

    def test_a_header_that_is_not_there_is_refused_with_those_that_are(self, tmp_path):
        file = written(tmp_path, "m.urdf", self.TEXT)
        with pytest.raises(InputError, match=r"combine\.body\.header.*expected one of base, header, reel"):
            read_body(BodySection(file=str(file), header="table"), "combine.body")

    def test_a_machine_in_millimetres_is_refused(self, tmp_path):
        file = written(tmp_path, "m.urdf", self.TEXT)
        with pytest.raises(InputError, match=r"expected a machine of 0\.1 to 100 m, it is 5e"):
            read_body(BodySection(file=str(file), scale=1000), "combine.body")
