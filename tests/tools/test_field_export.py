"""A field taken away: what other libraries read in its files is what the world holds."""

import importlib.util
import json
import subprocess
import sys
from math import pi
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from swath.commands.main import main
from swath.core.errors import InputError
from swath.field.memory_layout import Organ
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.tools.field_export.export import Wanted, export
from swath.tools.field_export.scene import body_corners, plants_near, surface_of
from swath.tools.scan.stand3d import Organs

trimesh = pytest.importorskip("trimesh", reason="extra mesh")
SIDE, RADIUS = 40.0, 1.5
SCENARIO = """
format: swath scenario 2
name: away
run: {distance_m: 100, max_duration_s: 60}
field:
  terrain: {level: formula, slope_percent: 5.0, slope_azimuth_deg: 30, roughness_class: none}
  edge: {shape: straight}
  obstacles:
    - {kind: box, x_m: 12, y_m: -8, length_m: 3, width_m: 2, height_m: 2.5, heading_deg: 30}
    - {kind: post, x_m: 4, y_m: -9, height_m: 2.0, diameter_m: 0.2}
    - {kind: person, x_m: 15, y_m: -4}
    - {kind: tree, x_m: 400, y_m: 0}
machines:
  combine:
    motion: {level: kinematic, start_speed_kmh: 7}
    lidar: off
    edge: truth
    speed: {speed_kmh: 7}
"""


@pytest.fixture(scope="module")
def world():
    made = assemble(parse_scenario(SCENARIO))
    drive(made, [], until_s=4.0)
    yield made
    made.close()


def taken(world, form, out, **more):
    wanted = Wanted(form, out, ground=SIDE, plants=RADIUS, per_m2=40.0, **more)
    said = []
    return export(world, wanted, said.append), said


@pytest.fixture(scope="module")
def sdf(world, tmp_path_factory):
    folder = tmp_path_factory.mktemp("away") / "world"
    _, said = taken(world, "sdf", folder)
    return folder, said


@pytest.fixture(scope="module")
def glb(world, tmp_path_factory):
    (file,), said = taken(world, "glb", tmp_path_factory.mktemp("away") / "field.glb")
    return file, said


def numbers(said, word):
    return next(line for line in said if line.startswith(word)).split()


def z_up(points):
    x, y, z = np.asarray(points, dtype=float).T
    return np.stack([x, -z, y], axis=-1)


def test_a_glb_read_by_pygltflib_names_every_part_and_is_as_large_as_it_said(world, glb):
    pygltflib = pytest.importorskip("pygltflib", reason="extra dev")
    file, said = glb
    read = pygltflib.GLTF2().load(str(file))
    names = [node.name for node in read.nodes if node.mesh is not None]
    plants = {"stem", "ear", "leaf", "stubble", "straw"}
    assert set(names) == plants | {"ground", "combine", "box 1", "post 1", "person 1"}
    assert {read.materials[p.material].name for m in read.meshes for p in m.primitives} == set(names)
    accessors = {m.name: read.accessors[m.primitives[0].indices].count // 3 for m in read.meshes}
    listed = next(line for line in said if line.startswith("plants")).partition("triangles: ")[2]
    told = dict(part.split(" ", 1) for part in listed.split(", "))
    assert {name: accessors[name] for name in told} == {k: int(v.replace(" ", "")) for k, v in told.items()}
    size = float(numbers(said, "size")[2]) * 1e6
    assert abs(file.stat().st_size - size) < 0.03 * size + 30e3  # and the picture of the ground
    (image,) = read.images
    assert image.mimeType == "image/png"


def test_a_glb_read_by_trimesh_lies_where_the_world_does(world, glb):
    scene = trimesh.load_scene(glb[0], process=False)
    ground = z_up(scene.geometry["ground"].vertices)
    assert np.abs(ground[:, 2] - world.field.terrain.height(*ground[:, :2].T)).max() < 1e-5
    assert np.ptp(ground[:, :2], axis=0) == pytest.approx([SIDE, SIDE], abs=1e-4)
    normals = scene.geometry["ground"].face_normals
    assert (normals[:, 1] > 0.9).all()  # it looks up
    for body in world.bodies.in_sight(""):
        if body.name not in scene.geometry:
            assert body.name == "tree 1"  # beyond the square
            continue
        theirs = z_up(scene.geometry[body.name].vertices)
        own = body_corners(body.solids).reshape(-1, 3)
        assert np.allclose([theirs.min(0), theirs.max(0)], [own.min(0), own.max(0)], atol=1e-4)
    box = scene.geometry["box 1"]
    assert abs(box.volume) == pytest.approx(3 * 2 * 2.5, rel=1e-4) or box.area == pytest.approx(
        37.0, rel=1e-4
    )


def test_plants_stand_where_crop_stands_and_are_stubble_where_it_was_cut(world):
    field = world.field
    x, y, _ = world.bodies.pose_of("combine").apply([-2.0, 0.0, 0.0])  # behind the knife
    cut = {s.name: s for s in plants_near(field, np.array([x, y]), 1.0)}
    assert {"ear", "stem"} & set(cut) == set()
    own = cut["stubble"].vertices
    left = float(field.left_height(x, y))
    above = own[:, 2] - field.ground_height(*own[:, :2].T)
    assert 0.05 < left < 0.3
    assert left - 0.02 < above.max() < left + 0.02
    x, y, _ = world.bodies.pose_of("combine").apply([9.0, 0.0, 0.0])  # before it
    standing = {s.name: s for s in plants_near(field, np.array([x, y]), 1.0)}
    assert "stubble" not in standing
    ears = len(standing["ear"].faces) / 8 / pi
    per_m2 = world.field.stand.density_max
    assert 0.5 * per_m2 < ears / round(ears / per_m2) < 1.5 * per_m2
    reach = np.hypot(*(standing["stem"].vertices[:, :2] - [x, y]).T).max()
    assert 0.9 < reach < 1.0 + field.library.reach + 0.05


def test_a_rod_is_as_wide_as_the_round_one_on_average():
    a, b = np.array([[0.0, 0.0, 0.0]]), np.array([[0.1, 0.2, 0.9]])
    rod = Organs(a, b, np.zeros((1, 3)), np.array([0.004]), np.array([Organ.STEM], np.uint8), np.ones(1))
    surface = surface_of(rod, Organ.STEM)
    axis = (b - a)[0] / np.linalg.norm(b - a)
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    up = np.cross(axis, side)
    widths = [
        np.ptp(surface.vertices @ (np.cos(t) * side + np.sin(t) * up)) for t in np.linspace(0, pi, 721)[:-1]
    ]
    assert np.mean(widths) == pytest.approx(2 * 0.004, rel=1e-4)


def test_the_height_map_is_the_ground_north_up(world, sdf):
    folder, _ = sdf
    heights = np.asarray(Image.open(folder / "ground.png"))
    assert heights.shape == (257, 257)
    assert (heights.dtype, heights.min(), heights.max()) == (np.uint16, 0, 65535)
    root = ElementTree.parse(folder / "world.sdf").getroot()
    ground = root.find("world/model[@name='ground']")
    x0, y0, z0 = (float(v) for v in ground.findtext("pose").split()[:3])
    size = [float(v) for v in ground.findtext("link/collision/geometry/heightmap/size").split()]
    steps = np.linspace(-0.5, 0.5, 257)
    x, y = np.meshgrid(x0 + size[0] * steps, y0 - size[1] * steps)
    there = z0 + size[2] * heights / 65535
    assert np.abs(there - world.field.terrain.height(x, y)).max() <= 0.5 * size[2] / 65535 + 1e-6
    assert size[2] == pytest.approx(np.ptp(world.field.terrain.height(x, y)), rel=1e-6)


def test_the_cover_shows_what_stands(world, sdf):
    folder, _ = sdf
    cover = np.asarray(Image.open(folder / "cover.png"))
    root = ElementTree.parse(folder / "world.sdf").getroot()
    x0, y0 = (float(v) for v in root.find("world/model[@name='ground']").findtext("pose").split()[:2])
    at = np.arange(7, 1024, 101)
    x, y = np.meshgrid(x0 + SIDE * ((at + 0.5) / 1024 - 0.5), y0 - SIDE * ((at + 0.5) / 1024 - 0.5))
    shown = (cover[np.ix_(at, at)] == [0xE9, 0xC4, 0x6A]).all(axis=-1)
    assert np.array_equal(shown, world.field.standing(x, y))
    assert 10 < shown.sum() < shown.size - 10


def test_the_meshes_of_the_world_are_those_of_the_glb(sdf, glb):
    scene = trimesh.load_scene(glb[0], process=False)
    for name in ("stem", "ear", "leaf", "stubble", "straw"):
        theirs = trimesh.load_mesh(sdf[0] / "meshes" / f"{name}.stl", process=False)
        other = scene.geometry[name]
        assert np.allclose(
            theirs.triangles, z_up(other.triangles.reshape(-1, 3)).reshape(-1, 3, 3), atol=1e-5
        )


def read_by_libsdformat(file):
    if importlib.util.find_spec("pydrake") is None:
        pytest.skip("needs drake, which has libsdformat: pip install drake")
    reader = Path(__file__).with_name("sdf_reader.py")
    return subprocess.run([sys.executable, str(reader), str(file)], capture_output=True, text=True)


def test_the_parser_of_gazebo_reads_the_world_as_it_is(world, sdf):
    run = read_by_libsdformat(sdf[0] / "world.sdf")
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert set(found) == {"ground", "stand", "combine", "box_1", "post_1", "person_1"}
    bodies = {body.name.replace(" ", "_"): body for body in world.bodies.in_sight("")}
    for name in ("combine", "box_1"):
        own = bodies[name]
        assert np.allclose(found[name]["at"], own.pose.position, atol=1e-6)
        assert np.allclose(found[name]["x"], own.pose.rotation[:, 0], atol=1e-6)
        boxes = [s for s in found[name]["shapes"] if s["shape"] == "Box"]
        assert np.allclose([s["at"] for s in boxes], own.solids.box_centre, atol=1e-6)
        assert np.allclose([s["size"] for s in boxes], 2 * own.solids.box_half, atol=1e-6)
        assert np.allclose([s["x"] for s in boxes], own.solids.box_axes[:, :, 0], atol=1e-6)
    assert [s["shape"] for s in found["post_1"]["shapes"]] == ["Capsule"]
    assert len(found["person_1"]["shapes"]) > 3


@pytest.mark.parametrize(
    ("was", "now"), [("<gravity>", "<weight>"), ("0.9 0.9 0.85 1", "bright"), ("<mass>", "<mass>-")]
)
def test_the_parser_of_gazebo_refuses_what_is_no_sdf(sdf, was, now, tmp_path):
    text = (sdf[0] / "world.sdf").read_text(encoding="utf-8").replace("meshes/", f"{sdf[0]}/meshes/")
    broken = tmp_path / "world.sdf"
    broken.write_text(
        text.replace(was, now).replace("</gravity>", "</weight>" if "weight" in now else "</gravity>")
    )
    assert read_by_libsdformat(broken).returncode != 0


def test_a_survey_read_by_laspy_meets_ground_crop_and_things_where_they_are(world, tmp_path):
    laspy = pytest.importorskip("laspy", reason="extra las")
    (file,), said = taken(world, "las", tmp_path / "survey.las")
    las = laspy.read(file)
    assert len(las.points) == 40 * SIDE**2 == int("".join(numbers(said, "survey")[1:3]))
    assert abs(file.stat().st_size - float(numbers(said, "size")[2]) * 1e6) < 0.06e6
    points = np.stack([las.x, las.y, las.z], axis=1)
    kind = np.asarray(las.classification)
    ground = world.field.ground_height(*points[:, :2].T)
    assert np.abs(points[kind == 2, 2] - ground[kind == 2]).max() < 0.006  # straw of 5 mm hides no soil
    assert (kind == 2).sum() > 1000
    stands = world.field.standing(*points[:, :2].T)
    crop = np.isin(kind, (3, 4, 5))
    top = float(np.percentile((points[:, 2] - ground)[stands & crop], 90))
    assert 0.7 * world.field.crop_height < top < 1.2 * world.field.crop_height
    above = points[:, 2] - ground
    assert above[kind == 3].max() < 0.501  # the file counts half millimetres
    assert above[kind == 4].min() > 0.499
    box = next(body for body in world.bodies.in_sight("") if body.name == "box 1").solids
    inner = np.abs((points - box.box_centre[0]) @ box.box_axes[0])
    on_top = (inner[:, :2] < box.box_half[0, :2] - 0.05).all(axis=1)
    assert on_top.sum() > 100
    assert (kind[on_top] == 1).all()
    assert np.abs(points[on_top, 2] - (box.box_centre[0, 2] + box.box_half[0, 2])).max() < 0.001
    assert np.abs(np.asarray(las.scan_angle)).max() > 0
    assert (np.diff(las.gps_time) >= 0).all()


def test_the_same_world_gives_the_same_bytes(world, glb, sdf, tmp_path):
    (again,), _ = taken(world, "glb", tmp_path / "again.glb")
    assert again.read_bytes() == glb[0].read_bytes()
    files, _ = taken(world, "sdf", tmp_path / "again")
    assert [f.read_bytes() for f in files] == [
        (sdf[0] / f.relative_to(tmp_path / "again")).read_bytes() for f in files
    ]


@pytest.mark.parametrize(
    ("form", "out", "more", "said"),
    [
        ("glb", "field.sdf", {}, "--out = .*: expected a name with .glb"),
        ("sdf", "world.sdf", {}, "--out = .*: expected the name of a folder"),
        ("las", "field.glb", {}, "--out = .*: expected a name with .las or .laz"),
        ("glb", "field.glb", {"most": 1e6}, r"--plants-m = 1.5: expected at most [01]\.?\d* for --most-mb 1"),
        ("las", "field.las", {"most": 1e6}, r"--points-per-m2 = 40.0: expected at most 18.4 for --most-mb 1"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_written(world, form, out, more, said, tmp_path):
    with pytest.raises(InputError, match=said):
        taken(world, form, tmp_path / out, **more)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--place", "1;2"], "--place = 1;2: expected two numbers X,Y in metres"),
        (["--ground-m", "2"], "--ground-m = 2.0: expected 5 to 1000"),
        (["--plants-m", "nan"], "argument --plants-m: expected a number, not 'nan'"),
    ],
)
def test_a_wrong_number_on_the_command_line_is_named(words, said, tmp_path, capsys):
    code = main(["field", "export", "straight", "--to", "glb", "--out", str(tmp_path / "f.glb"), *words])
    assert code == 2
    assert said in capsys.readouterr().err


def test_a_body_from_a_file_is_a_mesh_that_the_parser_can_collide_with(tmp_path):
    from swath.scenario.scenario import load_scenario

    sets = ["combine.lidar=off", "field.terrain=plane"]
    example = Path(__file__).parents[2] / "examples" / "machine" / "scenario.yaml"
    made = assemble(load_scenario(example, sets=sets))
    drive(made, [], until_s=0.0)
    taken(made, "sdf", tmp_path / "world")
    run = read_by_libsdformat(tmp_path / "world" / "world.sdf")
    assert run.returncode == 0, run.stderr
    body = next(b for b in made.bodies.in_sight("") if b.name == "combine")
    assert len(json.loads(run.stdout)["combine"]["shapes"]) == len(body.solids.mesh_shape) > 5
    for number, shape in enumerate(body.solids.mesh_shape):
        theirs = trimesh.load_mesh(tmp_path / "world" / "meshes" / f"combine_{number}.obj", process=False)
        assert np.allclose(theirs.triangles, shape.corners, atol=1e-6)
    made.close()


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """A field on Earth from the bundled log."""
    pytest.importorskip("pyproj", reason="extra geo")
    folder = tmp_path_factory.mktemp("field") / "made"
    assert main(["field", "import", "sample-log", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def on_earth(imported):
    made = assemble(load_field(imported))
    drive(made, [], until_s=0.0)
    yield made
    made.close()


def test_a_field_on_earth_has_its_place_in_every_form(imported, on_earth, tmp_path):
    import laspy
    import pyproj

    sets = ["--set", "combine.lidar=off", "--set", "combine.edge=truth"]
    words = ["field", "export", str(imported), *sets, "--ground-m", "20", "--points-per-m2", "5"]
    assert main([*words, "--to", "las", "--out", str(tmp_path / "survey.laz")]) == 0
    taken(on_earth, "sdf", tmp_path / "world")
    origin = __import__("swath").read_field(imported).origin
    earth = ElementTree.parse(tmp_path / "world" / "world.sdf").find("world/spherical_coordinates")
    here = [float(earth.findtext(tag)) for tag in ("longitude_deg", "latitude_deg", "heading_deg")]
    utm = pyproj.Proj(f"EPSG:{origin.epsg}")
    lon, lat = utm(origin.easting, origin.northing, inverse=True)
    assert here[:2] == pytest.approx([lon, lat], abs=1e-8)
    assert here[2] == pytest.approx(-utm.get_factors(lon, lat).meridian_convergence, abs=1e-3)
    las = laspy.read(tmp_path / "survey.laz")
    assert las.header.parse_crs().to_epsg() == origin.epsg
    assert abs(np.mean(las.x) - origin.easting) < 1000
    assert abs(np.mean(las.y) - origin.northing) < 1000


def test_ground_beyond_the_map_is_told_and_beyond_all_of_it_refused(on_earth, tmp_path):
    made = on_earth
    west, _, _, north = made.field.terrain.raster.bounds
    wanted = Wanted("glb", tmp_path / "f.glb", (west, north), 40.0, 0.0)
    said = []
    (file,) = export(made, wanted, said.append)
    assert any(line.startswith("note      7") for line in said)  # three quarters of it
    ground = trimesh.load_scene(file, process=False).geometry["ground"]
    used = z_up(ground.vertices[np.unique(ground.faces)])
    assert made.field.terrain.covers(*used[:, :2].T).all()
    las = Wanted("las", tmp_path / "f.las", (west, north), 40.0, 0.0, 10.0)
    (file,) = export(made, las, said.append)
    points = __import__("laspy").read(file)
    origin = made.leader.origin
    assert 0.2 < len(points.x) / (10 * 40 * 40) < 0.3
    assert made.field.terrain.covers(
        np.asarray(points.x) - origin.easting, np.asarray(points.y) - origin.northing
    ).all()
    for form in ("glb", "sdf", "las"):
        out = tmp_path / {"sdf": "far"}.get(form, f"far.{form}")
        with pytest.raises(InputError, match="expected a place on the map of the terrain"):
            export(made, Wanted(form, out, (5000.0, 0.0), 40.0), said.append)
        assert not out.exists()


def load_field(folder):
    from swath.scenario.scenario import load_scenario

    return load_scenario(folder, sets=["combine.lidar=off", "combine.edge=truth"])
