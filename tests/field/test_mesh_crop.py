"""Crops whose plants are the user's own meshes: reading, size, organs, masses, and what cannot be a plant."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from swath.core.errors import InputError, MissingExtra
from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.edges.edge import StraightEdge, make_edge
from swath.field.field import make_field
from swath.field.field_setup import FieldSetup
from swath.field.memory_layout import Organ, Shape
from swath.field.mesh_crop import MeshFacts
from swath.field.mesh_file import read_mesh
from swath.field.plants import make_plants
from swath.field.prototypes import make_library, resolution
from swath.field.stand import uniform
from swath.field.terrain import plane
from tests.field.made_field import STREAM, rectangle
from tests.field.silhouettes import silhouette_area

trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")

MESHES = Path(__file__).parents[2] / "examples" / "meshes"
SHEET = (MESHES / "sunflower.yaml").read_text(encoding="utf-8")
SUNFLOWER = load_crop(str(MESHES / "sunflower.yaml"))
MESH = SUNFLOWER.organs[MeshFacts]
COUNT = 400
PLANTS = make_plants(SUNFLOWER, COUNT, np.random.default_rng(1))


def sheet(folder, *pairs, **files):
    """A changed copy of the example's sheet in a folder, with the meshes and further files beside it."""
    text = SHEET
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    for name in ("a", "b"):
        (folder / f"sunflower-{name}.obj").write_bytes((MESHES / f"sunflower-{name}.obj").read_bytes())
    for name, content in files.items():
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name.replace("_", ".")).write_bytes(data)
    path = folder / "plant.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def one_mesh(name):
    return ("[sunflower-a.obj, sunflower-b.obj]", name)


def test_the_meshes_in_the_folder_are_those_of_the_script(tmp_path):
    runpy.run_path(str(MESHES / "make_meshes.py"))["main"](tmp_path)
    for file in tmp_path.iterdir():
        assert file.read_bytes() == (MESHES / file.name).read_bytes()
    assert len(list(tmp_path.iterdir())) == 3


def test_plants_are_the_meshes_scaled_and_turned():
    heights = [v.height for v in MESH.variants]
    assert PLANTS.height.mean() == pytest.approx(np.mean(heights), rel=0.01)
    assert PLANTS.height.std() / PLANTS.height.mean() == pytest.approx(0.07, rel=0.1)
    assert (PLANTS.shape == Shape.TRIANGLE).all()
    number = np.bincount(PLANTS.owner)
    assert set(number) == {len(v.organ) for v in MESH.variants}
    top = np.full(COUNT, -np.inf)
    corners = np.stack([PLANTS.a - PLANTS.width, PLANTS.a + PLANTS.width, PLANTS.b], axis=1)
    np.maximum.at(top, PLANTS.owner, corners[..., 2].max(axis=1))
    np.testing.assert_allclose(top, PLANTS.height, rtol=1e-12)
    assert corners[..., 2].min() == pytest.approx(0.0, abs=1e-12)
    head = corners[PLANTS.organ == Organ.EAR].mean(axis=1)
    azimuth = np.arctan2(head[:, 1], head[:, 0])
    assert np.abs(np.exp(1j * azimuth).mean()) < 0.1
    area = silhouette_area(PLANTS)
    whole = 0.5 * sum(
        np.linalg.norm(
            np.cross(v.corners[:, 1] - v.corners[:, 0], v.corners[:, 2] - v.corners[:, 0]), axis=1
        ).sum()
        for v in MESH.variants
    )
    assert sum(area.values()) / COUNT == pytest.approx(0.25 * whole, rel=0.03)


def test_masses_are_the_sheet_s_and_go_with_size():
    assert PLANTS.grain_kg.mean() == pytest.approx(0.060, rel=1e-12)
    assert PLANTS.straw_kg.mean() == pytest.approx(0.110, rel=1e-12)
    assert np.corrcoef(PLANTS.height, PLANTS.grain_kg)[0, 1] > 0.7


def test_cut_twice_and_recounted_the_masses_add_up():
    setup = FieldSetup(STREAM)
    stand = uniform.Uniform(uniform.Params(crop=str(MESHES / "sunflower.yaml")), setup)
    ground = plane.Plane(plane.Params(), setup)
    edge = make_edge(StraightEdge(x_m=-60.0), setup)
    field = make_field(ground, stand, edge, crop=SUNFLOWER, stream=setup.stream)
    first = field.cut(rectangle(0.0, 0.0, 40.0, 30.0), 0.9)
    again = field.cut(rectangle(0.0, 0.0, 40.0, 30.0), 0.5)
    gone, counted = first + again, field.recount()
    assert first.stem_count / first.area == pytest.approx(5.5, rel=0.03)
    assert first.grain / first.stem_count == pytest.approx(0.060, rel=0.05)
    assert (again.stem_count, again.grain) == (0, 0.0)
    assert again.straw > 0.0
    assert counted.stem_count == gone.stem_count
    for name in ("grain", "straw", "area", "grain_left"):
        assert getattr(counted, name) == pytest.approx(getattr(gone, name), rel=1e-9)


def test_the_same_plant_from_every_format_unit_and_axis(tmp_path):
    """OBJ in cm with z up, PLY in mm with y up and x up, GLB in m with y up: the same triangles."""
    parts = read_mesh(MESHES / "sunflower-a.obj", key="test")
    wanted = load_crop(sheet(tmp_path, one_mesh("sunflower-a.obj"))).organs[MeshFacts].variants[0]
    turned = {"y": [0, 2, 1], "x": [2, 0, 1]}
    sign = {"y": [1, 1, -1], "x": [1, 1, 1]}
    for up, unit, kind in (("y", 10.0, "ply"), ("x", 10.0, "ply"), ("y", 0.01, "glb")):
        scene = trimesh.Scene()
        for part in parts:
            points = part.corners.reshape(-1, 3)[:, turned[up]] * sign[up] * unit
            mesh = trimesh.Trimesh(points, np.arange(len(points)).reshape(-1, 3), process=False)
            mesh.visual = trimesh.visual.TextureVisuals(
                material=trimesh.visual.material.PBRMaterial(name=f"{part.names[0]}.001")
            )
            scene.add_geometry(mesh, geom_name=part.names[0])
        data = scene.export(file_type="glb") if kind == "glb" else scene.to_geometry().export(file_type="ply")
        pairs = [one_mesh(f"m.{kind}")]
        pairs += (
            [("unit: cm", "unit: mm"), ("up: z", f"up: {up}")]
            if kind == "ply"
            else [("unit: cm\n  up: z", "unit: m")]
        )
        if kind == "ply":  # it has no names: everything is one organ
            start, end = SHEET.index("  stalk:"), SHEET.index("\nstand:")
            pairs.append(
                (
                    SHEET[start:end],
                    '  "*": {organ: leaf, reflectance: {value: 0.4, tag: E, source: x}}\n',
                )
            )
        else:
            pairs += [(f"  {p.names[0]}: {{organ", f"  {p.names[0]}.001: {{organ") for p in parts]
        found = load_crop(sheet(tmp_path, *pairs, **{f"m_{kind}": data})).organs[MeshFacts].variants[0]
        assert found.height == pytest.approx(wanted.height, rel=1e-6)
        np.testing.assert_allclose(
            np.sort(found.corners.reshape(-1, 3), axis=0),
            np.sort(wanted.corners.reshape(-1, 3), axis=0),
            atol=1e-6,
        )
        if kind == "glb":
            assert np.array_equal(np.bincount(found.organ), np.bincount(wanted.organ))


def laid_down(kind, order):
    """The example's first plant as a file, with its axes in another order."""
    scene = trimesh.Scene()
    for part in read_mesh(MESHES / "sunflower-a.obj", key="test"):
        points = 0.01 * part.corners.reshape(-1, 3)[:, order]
        mesh = trimesh.Trimesh(points, np.arange(len(points)).reshape(-1, 3), process=False)
        material = trimesh.visual.material.PBRMaterial(name=part.names[0])
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(mesh, geom_name=part.names[0])
    data = scene.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


@pytest.mark.parametrize(
    ("kind", "order", "up"),
    [("glb", [0, 1, 2], "z"), ("glb", [2, 0, 1], "x"), ("obj", [0, 2, 1], "y"), ("obj", [2, 1, 0], "x")],
)
def test_a_plant_that_lies_where_nobody_said_what_is_up_is_refused_with_the_axis(tmp_path, kind, order, up):
    """Of a format whose usual axis is another one; said, it is the example's plant of 1.7 m again."""
    pairs = [one_mesh(f"m.{kind}"), ("unit: cm", "unit: m")]
    if kind == "obj":  # by trimesh, in one piece
        start, end = SHEET.index("  stalk:"), SHEET.index("\nstand:")
        every = '  "*": {organ: leaf, reflectance: {value: 0.4, tag: E, source: x}}\n'
        pairs.append((SHEET[start:end], every))
    files = {f"m_{kind}": laid_down(kind, order)}
    with pytest.raises(InputError, match=rf"mesh.up: expected {up}, or .*m.{kind} lies, 1.7"):
        load_crop(sheet(tmp_path, *pairs, ("  up: z\n", ""), **files))
    crop = load_crop(sheet(tmp_path, *pairs, ("up: z", f"up: {up}"), **files))
    assert crop.organs[MeshFacts].height == pytest.approx(MESH.variants[0].height, rel=1e-5)
    with pytest.raises(InputError, match="straw_below_height_cm"):  # what is said is taken
        load_crop(sheet(tmp_path, *pairs, ("up: z", f"up: {'y' if up != 'y' else 'x'}"), **files))


def test_every_part_without_an_entry_and_every_entry_without_a_part_is_named_at_once(tmp_path):
    with pytest.raises(InputError) as caught:
        load_crop(sheet(tmp_path, ("  dry_leaf:", "  dry_leav:"), ("  head:", "  hat:")))
    first, *others = str(caught.value), *map(str, caught.value.others)
    assert "parts.dry_leaf, head: expected an entry for these parts of sunflower-a.obj" in first
    for name, text in zip(("sunflower-b", "dry_leav", "hat"), others, strict=True):
        assert name in text


def test_objects_name_parts_where_there_are_no_materials(tmp_path):
    text = (MESHES / "sunflower-a.obj").read_text(encoding="utf-8").replace("usemtl", "o")
    crop = load_crop(sheet(tmp_path, one_mesh("m.obj"), m_obj="mtllib gone.mtl\n" + text))
    assert {Organ(o) for o in crop.organs[MeshFacts].variants[0].organ} == {Organ.STEM, Organ.LEAF, Organ.EAR}


def test_parts_can_be_left_out_and_height_can_be_given(tmp_path):
    left = (
        'stalk: {organ: stem, reflectance: {value: 0.40, tag: E, source: "dry stalk, as straw"}}',
        "stalk: {organ: none}",
    )
    bare = load_crop(sheet(tmp_path, left))
    assert 0.35 < bare.reflectance["stem"] < 0.40
    assert all(Organ.STEM not in v.organ for v in bare.organs[MeshFacts].variants)
    tall = ("  height_cv", '  height_cm: {value: 200, tag: E, source: "test"}\n  height_cv')
    crop = load_crop(sheet(tmp_path, ("  unit: cm\n", ""), tall))
    assert crop.stand.height == pytest.approx(2.0)


def test_heavy_meshes_make_fewer_prototypes_and_too_heavy_ones_are_refused():
    assert resolution(SUNFLOWER, 6, None, None, None) == (16, 20, 16)
    assert resolution(SUNFLOWER, 250, None, None, None) == (9, 40, 32)
    assert resolution(SUNFLOWER, 250, 1, None, 8) == (1, 40, 8)
    with pytest.raises(
        InputError, match=r"mesh\.files = sunflower: expected at most 100 triangles per plant"
    ):
        make_library(SUNFLOWER, density_max=4000.0, row_spacing=0.0, seed=Stream(1, "t"))


TETRA = "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 90\nusemtl stalk\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
STALK_ONLY = (SHEET[SHEET.index("  dry_leaf:") : SHEET.index("\nstand:")], "")


@pytest.mark.parametrize(
    ("pairs", "files", "message"),
    [
        ([one_mesh("gone.obj")], {}, "mesh.files = {0}/gone.obj: expected a mesh file, there is no such"),
        ([one_mesh("m.obj")], {"m_obj": ""}, "mesh.files = {0}/m.obj: expected triangles, it has none"),
        (
            [one_mesh("m.obj")],
            {"m_obj": "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"},
            "expected triangles with an area",
        ),
        ([one_mesh("m.obj")], {"m_obj": TETRA.replace("90", "nan")}, "expected finite corners, part 'stalk'"),
        ([one_mesh("m.obj")], {"m_obj": TETRA.replace("90", "9e9")}, "expected coordinates within 1e+06"),
        (
            [one_mesh("m.obj")],
            {"m_obj": TETRA.replace("f 1 2 4", "f 1 2 9")},
            "expected a mesh that can be read",
        ),
        ([one_mesh("m.glb")], {"m_glb": b"glTF\x02\x00"}, "expected a mesh that can be read"),
        ([one_mesh("m.ply")], {"m_ply": "ply\nnonsense"}, "expected a mesh that can be read"),
        ([one_mesh("m.doc")], {"m_doc": "x"}, "expected a mesh file, one of .obj, .ply, .stl"),
        ([one_mesh("[]")], {}, "mesh.files = []: expected at least 1 items"),
        ([("unit: cm", "unit: m")], {}, "expected a plant 0.02 to 6 m high, it is 170 m: mesh.unit"),
        ([("unit: cm", "unit: foot")], {}, "mesh.unit = foot: expected one of m, cm, mm, inch"),
        ([("  unit: cm\n", "")], {}, "mesh.unit: expected either this (m, cm, mm, inch) or stand.height_cm"),
        (
            [one_mesh("m.obj"), STALK_ONLY],
            {"m_obj": TETRA.replace("v 10", "v 300")},
            "expected at most 1.2 m from the foot sideways",
        ),
        ([("up: z", "tilt: z")], {}, "mesh.tilt: unknown key, expected one of files, unit, up, foot, turn"),
        (
            [("  dry_leaf:", "  dry_leav:")],
            {},
            "parts.dry_leaf: expected an entry for this part of sunflower-a.obj",
        ),
        ([("  dry_leaf:", "  dry_leav:")], {}, "or for '*', did you mean 'dry_leav'?"),
        ([STALK_ONLY, ("  stalk:", '  "*":')], {}, None),
        (
            [("parts:\n", "parts:\n  root: {organ: none}\n")],
            {},
            "parts.root: no mesh has a part of this name, they have dry_leaf",
        ),
        ([("organ: leaf", "organ: petal")], {}, "parts.dry_leaf.organ = petal: expected one of stem, ear"),
        ([("value: 0.35", "value: 35")], {}, "parts.head.reflectance = 35: expected <= 1"),
        (
            [("grain_mass_g: {value: 60", "grain_mass_kg: {value: 60")],
            {},
            "yield.grain_mass_kg: unknown key, did you mean 'grain_mass_g'? expected in g",
        ),
        ([("  straw_mass_g:", "  hay_g:")], {}, "yield.hay_g: unknown key"),
    ],
)
def test_what_cannot_be_a_plant_is_refused_by_name(tmp_path, pairs, files, message):
    path = sheet(tmp_path, *pairs, **files)
    if message is None:
        assert load_crop(path).reflectance["stem"] == 0.4
        return
    with pytest.raises(InputError) as caught:
        load_crop(path)
    assert message.format(tmp_path) in str(caught.value)
    assert f"({path}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_without_trimesh_the_extra_is_named(tmp_path, monkeypatch):
    path = sheet(tmp_path, one_mesh("new.obj"), new_obj=TETRA)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(
        MissingExtra, match=r"reading a mesh needs an optional part: pip install 'swath\[mesh\]'"
    ):
        load_crop(path)
