"""A small whole file of every kind that swath reads, made here, and how it is read."""

import gzip
import io
import json
import re
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from tests.fuzz.abroad_kinds import ABROAD
from tests.fuzz.command_kinds import kinds
from tests.fuzz.kept_kinds import kept_kinds
from tests.fuzz.kind import Kind, bundled, written
from tests.fuzz.measured_kinds import MEASURED

# ---- scenarios and data sheets


def _scenario(folder: Path) -> Any:
    from swath.scenario.scenario import load_scenario

    return load_scenario(folder / "mine.yaml").resolved()


def _machine(folder: Path) -> Any:
    from swath.machine.machine_sheet import load_machine

    return load_machine("mine.yaml", base=folder)


def _lidar(folder: Path) -> Any:
    from swath.sensing.lidar_sheet import load_lidar

    sheet = load_lidar("mine.yaml", folder)
    return sheet.beam, sheet.noise_sigma(np.linspace(1.0, 10.0, 5), np.full(5, 3.0))


def _crop(folder: Path) -> Any:
    from swath.field.crop_sheet import load_crop

    return load_crop("mine.yaml", folder)


OWN_CODE = """import json
from math import pi

TABLE = "mine.txt"


class Edge:
    '''Never run: what it consists of is found by its text.'''
"""


def _hash_code(folder: Path) -> Any:
    from swath.documents.contents import hashes

    return hashes({"edge": f"{folder / 'mine.py'}:Edge"})


# ---- fields


def _log(folder: Path, name: str = "log.csv") -> Path:
    from tests.field.made_log import COLUMNS, MadeLog

    (folder / "map.yaml").write_text(COLUMNS)
    return MadeLog(passes=3).write(folder / name)


def _packed_log(folder: Path) -> None:
    path = _log(folder)
    (folder / "log.csv.gz").write_bytes(gzip.compress(path.read_bytes()))
    path.unlink()


def _read_log(folder: Path, **how: Any) -> Any:
    from swath.field_io.logs.log import read_log

    log = next(p for p in folder.iterdir() if p.name.startswith("log."))
    columns = folder / "map.yaml" if (folder / "map.yaml").is_file() else None
    return read_log(log, columns, header_width=6.0, **how)


def _import(folder: Path) -> Any:
    from swath.field_io.importer import import_log

    shutil.rmtree(folder / "out", ignore_errors=True)
    with patch("swath.field_io.importer.draw"):  # seconds of matplotlib
        return import_log(folder / "log.csv", folder / "out", columns=folder / "map.yaml", progress=False)


def _machine_log(folder: Path) -> Any:
    from swath.field_io.logs.machine_log import read_machine_log

    return read_machine_log(folder / "log.csv")


def _engine_log(folder: Path) -> None:
    rows = ["lat,lon,t_s,speed_kmh,flow_kg_s,engine_load_pct,fuel_l_h,elevation_m,work_state"]
    rows += [
        f"47.{8900000 + 18 * k},-110.55,{k},7.{k % 10},8.5,{60 + k % 7},41.5,85{k % 3},In" for k in range(60)
    ]
    (folder / "log.csv").write_text("\n".join(rows) + "\n")


def _log_shapefile(folder: Path) -> None:
    import shapefile

    parts = {kind: io.BytesIO() for kind in ("shp", "shx", "dbf")}
    with shapefile.Writer(**parts, shapeType=shapefile.POINT) as writer:
        for name in ("flow", "speed", "swath"):
            writer.field(name, "N", 12, 4)
        for k in range(40):
            writer.point(-110.55, 47.89 + 1.8e-5 * k)
            writer.record(8.5, 2.0, 12.0)
    with zipfile.ZipFile(folder / "log.zip", "w") as archive:
        for kind, data in parts.items():
            archive.writestr(f"a.{kind}", data.getvalue())


def _task_data(folder: Path, count: int = 40) -> None:
    from tests.field.made_taskdata import simple_records, write

    write(folder, {"TLG00001": b"".join(simple_records(count))})


def _read_task_data(folder: Path) -> Any:
    from swath.field_io.logs.table import read_table

    return [read_table(folder).numbers("lat_deg")]


def _task_zip(folder: Path) -> None:
    _task_data(folder / "part", 300)
    with zipfile.ZipFile(folder / "log.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for part in sorted((folder / "part").iterdir()):
            archive.write(part, f"TASKDATA/{part.name}")
    shutil.rmtree(folder / "part")


RING = [[-110.556, 47.883], [-110.550, 47.883], [-110.550, 47.890], [-110.556, 47.890], [-110.556, 47.883]]
POLYGON = {"type": "Polygon", "coordinates": [RING]}
LINE = {"type": "LineString", "coordinates": RING}


def _features(*geometries: Any, **properties: Any) -> str:
    made = [{"type": "Feature", "geometry": g, "properties": properties} for g in geometries]
    return json.dumps({"type": "FeatureCollection", "features": made})


def _outline(folder: Path) -> Any:
    from swath.field_io.outline import read_outlines

    return read_outlines(next(folder.glob("b.*")), 32612).areas[0]


def _outline_shapefile(folder: Path) -> None:
    import shapefile

    with shapefile.Writer(folder / "a") as writer:
        writer.field("name", "C")
        writer.poly([RING])
        writer.record("field")
    with zipfile.ZipFile(folder / "b.zip", "w") as archive:
        for part in sorted(folder.glob("a.*")):
            archive.write(part, part.name)
            part.unlink()


def _lines(folder: Path) -> Any:
    from swath.field.edges.edge import read_lines

    class Setup:
        to_local = staticmethod(lambda points: np.asarray(points, dtype=float) * 1000.0)

    return read_lines(folder / "lines.geojson", Setup())  # type: ignore[arg-type]


def _raster() -> Any:
    from swath.field.maps.raster import Raster

    values = np.arange(30 * 40, dtype=np.float32).reshape(30, 40) / 40.0
    return Raster(values, -200.0, -150.0, 10.0, 32612)


def _geotiff(folder: Path) -> None:
    _raster().to_geotiff(folder / "map.tif", 32612, (533000.0, 5304000.0))


def _read_geotiff(folder: Path) -> Any:
    from swath.field.maps.raster import Raster
    from swath.field.terrain.dem import Dem
    from swath.field_io.dem import read_dem

    origin = (533000.0, 5304000.0)
    read_dem(folder / "map.tif", _raster().shifted(*origin))
    return Dem.from_raster(Raster.from_geotiff(folder / "map.tif", origin), None)


def _field_folder(folder: Path) -> None:
    from swath.field.maps.projection import Origin
    from swath.field_io.folder import FieldFolder, write
    from swath.field_io.passes import Track, straight_windows

    line = np.stack([np.zeros(90), np.linspace(-110.0, 110.0, 90)], axis=1)
    track = Track(line, "M1", 0, 6.0, 1.5, 0.0, 0.0, 220.0, straight_windows(line))
    corners = np.array([[-150.0, -120.0], [150.0, -120.0], [150.0, 120.0], [-150.0, 120.0]])
    hole = corners[::-1] * 0.1
    post = ({"type": "Point", "coordinates": [3.0, 4.0]}, {"name": "post", "radius_m": 0.5})
    ground = _raster()
    raster = replace(ground, values=ground.values / 40.0)
    write(
        FieldFolder(
            folder / "field", Origin(32612, 533000.0, 5304000.0, 850.0), corners, (hole,), 0.1, (track,),
            ground, raster, raster, raster, raster, (post,), {"note": "made"},
        )
    )  # fmt: skip


def _read_field_folder(folder: Path) -> Any:
    from swath.field_io.folder import read
    from swath.field_io.pass_scenario import write_pass_scenario

    found = read(folder / "field")
    found._repr_html_()
    write_pass_scenario(folder / "field")
    return found


# ---- meshes


CUBE = [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]
FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6)]


def _mesh(suffix: str) -> Callable[[Path], Any]:
    def make(folder: Path) -> None:
        import trimesh

        mesh = trimesh.Trimesh(vertices=CUBE, faces=FACES, process=False)
        name = suffix.split("-")[0]
        options = {"encoding": "ascii"} if suffix == "ply-ascii" else {}
        kind = "stl_ascii" if suffix == "stl-ascii" else name
        if name == "gltf":
            for part, data in trimesh.Scene(mesh).export(file_type="gltf").items():
                (folder / part.replace("model.gltf", "m.gltf")).write_bytes(data)
            return
        data = trimesh.Scene(mesh).export(file_type="glb") if name == "glb" else mesh.export(
            file_type=kind, **options
        )  # fmt: skip
        (folder / f"m.{name}").write_bytes(data if isinstance(data, bytes) else data.encode())

    return make


def _objects(folder: Path) -> None:
    lines = ["mtllib m.mtl", "o stalk", *(f"v {x} {y} {z}" for x, y, z in CUBE), "usemtl leaf"]
    lines += [f"f {a + 1}//1 {b + 1}//1 {c + 1}//1" for a, b, c in FACES]
    (folder / "m.obj").write_text("\n".join([*lines[:10], "vn 0 0 1", *lines[10:]]) + "\n")


def _read_mesh(folder: Path) -> Any:
    from swath.field.mesh_file import base_middle, read_mesh

    parts = read_mesh(next(folder.glob("m.*")), key="mesh.file")
    return [base_middle(part.corners) for part in parts]


# ---- recordings and measured scans


def _bag(kind: str, name: str) -> Callable[[Path], Any]:
    def make(folder: Path) -> None:
        from swath.core.frames import Pose
        from tests.bags import SPEED, Bag, place_at, ranges_at

        bag = Bag(folder / name, kind)
        bag.write("/tf_static", 0.0, bag.mounting())
        for k in range(30):
            t = 0.1 * k
            x, y = place_at(t)
            bag.write("/odom", t, bag.odometry(t, Pose.from_euler((x, y, 0.0)), SPEED, 0.0))
            bag.write("/scan", t, bag.laser(t, ranges_at(x, y)))
            bag.write("/points", t, bag.cloud(t, ranges_at(x, y)))
            bag.write("/gps/fix", t, bag.fix(t, (x - 1.2, y, 3.9)))
        bag.close()

    return make


def _packed_bag(folder: Path) -> None:
    """A rosbag 2 whose database is packed whole."""
    import zstandard

    _bag("sqlite", "b")(folder)
    (part,) = (folder / "b").glob("*.db3")
    (folder / "b" / f"{part.name}.zstd").write_bytes(zstandard.compress(part.read_bytes()))
    part.unlink()
    about = folder / "b" / "metadata.yaml"
    text = about.read_text().replace(part.name, f"{part.name}.zstd")
    for key, value in (("compression_mode", "FILE"), ("compression_format", "zstd")):
        text = re.sub(rf"""({key}["']?: ?)(''|"")""", rf'\1"{value}"', text)
    about.write_text(text)


def _height_map(name: str, table: str | None = None, **wanted: Any) -> Callable[[Path], Any]:
    def read(folder: Path) -> Any:
        from swath.tools.height_map.build import Settings, build_height_map, open_source
        from swath.tools.height_map.source import Wanted

        source = open_source(folder / name, Wanted(**wanted), None if table is None else folder / table)
        return build_height_map(source, Settings(reach_m=8.0, cell_m=0.2))

    return read


def _from_bag(name: str, topic: str) -> Callable[[Path], Any]:
    build = _height_map(name, scans=topic, poses="/odom")

    def read(folder: Path) -> Any:
        from swath.record.read.files import open_log

        log = open_log(folder / name)
        _ = log.begin(), log.end()
        for wanted in log.topics():
            for _ in log.messages((wanted,)):
                pass
        return build(folder)

    return read


def _scan_arrays(folder: Path) -> None:
    rng = np.random.default_rng(1)
    np.savez(
        folder / "s.npz",
        ranges_m=rng.uniform(2.0, 4.0, (20, 30)),
        angle_deg=np.linspace(-30.0, 30.0, 30),
        scan_time_s=np.arange(20) * 0.1,
        x_m=np.arange(20) * 0.2,
        y_m=np.zeros(20),
        no_return=np.zeros((20, 30), bool),
    )


def _scan_tables(folder: Path) -> None:
    rows = [f"{0.1 * k:.2f},{2.0 + 0.01 * b},{b - 15},{b}" for k in range(20) for b in range(30)]
    (folder / "s.csv").write_text("t_s,range_m,azimuth_deg,intensity\n" + "\n".join(rows) + "\n")
    poses = [f"{0.1 * k:.2f},{0.2 * k},0,1.5,0" for k in range(-2, 25)]
    (folder / "poses.csv").write_text("t_s,x_m,y_m,z_m,yaw_deg\n" + "\n".join(poses) + "\n")


def _run(folder: Path) -> None:
    from swath.record.recorder import Recorder
    from swath.scenario.scenario import load_scenario
    from tests.fake_run import ArcEdge, GridField, drive, machine

    (folder / "run").mkdir()
    scenario = load_scenario("straight").resolved()
    with Recorder(folder / "run", [machine()], scenario=scenario) as recorder:
        drive([recorder], GridField(ArcEdge(40.0)), seconds=2.0)
    (folder / "run" / "summary.json").write_text(
        json.dumps({"events": [{"t_s": 0.5, "set": "combine.speed.speed_kmh", "value": 5}]})
    )


def _read_run(folder: Path) -> Any:
    from swath.record.read.feed import exact_samples, exact_topic, own_outputs
    from swath.record.read.files import open_log
    from swath.record.tracks import read_tracks
    from swath.runtime.changes import read_events
    from swath.tools.rerun.rerun import plan_rerun

    read_events(folder / "run")
    for tracks in folder.glob("run/*.parquet"):
        read_tracks(tracks)
    log = open_log(folder / "run")
    for slot in ("combine.motion", "combine.lidar", "combine.steering"):
        for output, is_exact in own_outputs(log, slot).items():
            if is_exact:
                list(exact_samples(log.messages((exact_topic(slot, output),))))
    return plan_rerun(folder / "run")


def _spread_table(folder: Path) -> None:
    from swath.sensing.tables import load_table, save_table

    table = load_table("rye-median")
    save_table(table, folder / "t.npz")


def _read_spread_table(folder: Path) -> Any:
    from swath.sensing.tables import load_table

    return load_table("t.npz", folder).standing.cell(200.0, 1.0, 0.3, 0.1)


def _height_grid(folder: Path) -> None:
    _scan_arrays(folder)
    _height_map("s.npz")(folder).save(folder / "grid.npz")
    (folder / "s.npz").unlink()


def _read_height_grid(folder: Path) -> Any:
    from swath.rays.height_grid import load_height_grid
    from swath.rays.heights import HeightCaster

    return HeightCaster(load_height_grid(folder / "grid.npz"))


def _read_heights(folder: Path) -> Any:
    from swath.tools.lab.measured_heights import read_measured

    return read_measured(folder / "real.csv")


# ---- models


def _fmu(folder: Path) -> None:
    from tests.link.made_fmus import engine_xml, process_xml

    with zipfile.ZipFile(folder / "model.fmu", "w") as made:
        made.writestr("modelDescription.xml", engine_xml() if len(folder.name) % 2 else process_xml())
        made.writestr("binaries/linux64/store.so", b"\x7fELF" + bytes(60))


def _read_fmu(folder: Path) -> Any:
    from swath.link.fmi.description import read_fmu

    return read_fmu(folder / "model.fmu")


def _system(folder: Path) -> None:
    from tests.link.made_fmus import component, connection, connector, package, process_xml, system

    with zipfile.ZipFile(folder / "store.fmu", "w") as made:
        made.writestr("modelDescription.xml", process_xml())
    inside = system(
        "whole",
        [connector("feed", "input", "kg/s"), connector("out", "output", "kg/s")],
        [component("store", "resources/store.fmu", loss=0.1)],
        [connection("feed", "store.grain_in"), connection("store.grain_flow", "out")],
    )
    package(folder, "model.ssp", inside, folder / "store.fmu")
    (folder / "store.fmu").unlink()


def _read_system(folder: Path) -> Any:
    from swath.link.fmi.composite import describe_file
    from swath.link.fmi.ssp import read_system

    describe_file(folder / "model.ssp")
    return read_system(folder / "model.ssp")


def _read_beams(folder: Path) -> Any:
    from swath.tools.calibrate.measured import read_samples

    return read_samples(folder / "beams.csv")


def _read_case(folder: Path) -> Any:
    from swath.tools.function_test.case import read_case

    case = read_case(folder / "mine.yaml")
    return case.grid(), case.drawn(5, 1), case.sets(case.grid()[0])


BEAMS = "stems_per_m2,crop_height_m,depression_deg,spot_mm,height_m\n" + "300,0.8,20,15,0.6\n" * 60
HEIGHTS = "height_m,stems_per_m2,sensor,depression_deg\n" + "0.5,300,sick-lms111,20\n" * 20
COLUMN_MAP = "lat: {column: lat, unit: deg}\nlon: lon\nyield: {column: flow, unit: t/ha}\ncrs: EPSG:32612\n"


def _read_map(folder: Path) -> Any:
    from swath.field_io.logs.columns import read_map

    return read_map(folder / "map.yaml", ["lat", "lon", "flow"])


SCENARIOS = ("straight", "two-combines", "look-ahead", "feed-rate")
KINDS: dict[str, Kind] = {
    **{f"scenario-{name}": Kind(bundled("scenarios", name), _scenario) for name in SCENARIOS},
    "sheet-machine": Kind(bundled("machines", "lexion-700-class"), _machine),
    "sheet-cart": Kind(bundled("machines", "tractor-grain-cart"), _machine),
    "sheet-lidar": Kind(bundled("sensors", "sick-lms111"), _lidar),
    "sheet-wheat": Kind(bundled("crops", "wheat"), _crop),
    "sheet-maize": Kind(bundled("crops", "maize"), _crop),
    "own-code": Kind(written("mine.py", OWN_CODE), _hash_code),
    "columns": Kind(written("map.yaml", COLUMN_MAP), _read_map),
    "log-csv": Kind(_log, _read_log),
    "log-import": Kind(_log, _import),
    "log-gz": Kind(_packed_log, _read_log),
    "log-engine": Kind(_engine_log, _machine_log),
    "log-shapefile": Kind(_log_shapefile, partial(_read_log, as_map=True)),
    "isoxml": Kind(_task_data, _read_task_data),
    "isoxml-zip": Kind(_task_zip, _read_log),
    "outline-geojson": Kind(written("b.geojson", _features(POLYGON)), _outline),
    "outline-shapefile": Kind(_outline_shapefile, _outline),
    "lines-geojson": Kind(written("lines.geojson", _features(LINE, POLYGON)), _lines),
    "geotiff": Kind(_geotiff, _read_geotiff),
    "field-folder": Kind(_field_folder, _read_field_folder),
    **{
        f"mesh-{kind}": Kind(_mesh(kind), _read_mesh)
        for kind in ("ply", "ply-ascii", "stl", "stl-ascii", "glb", "gltf", "off")
    },
    "mesh-obj": Kind(_objects, _read_mesh),
    "scans-npz": Kind(_scan_arrays, _height_map("s.npz")),
    "scans-csv": Kind(_scan_tables, _height_map("s.csv", "poses.csv")),
    "bag-ros1": Kind(_bag("rosbag1", "b.bag"), _from_bag("b.bag", "/scan")),
    "bag-sqlite": Kind(_bag("sqlite", "b"), _from_bag("b", "/points")),
    "bag-packed": Kind(_packed_bag, _from_bag("b", "/points")),
    "bag-mcap": Kind(_bag("mcap", "b"), _from_bag("b", "/scan")),
    "run-folder": Kind(_run, _read_run),
    "spread-table": Kind(_spread_table, _read_spread_table),
    "height-grid": Kind(_height_grid, _read_height_grid),
    "heights-csv": Kind(written("real.csv", HEIGHTS), _read_heights),
    "beams-csv": Kind(written("beams.csv", BEAMS), _read_beams),
    "test-case": Kind(bundled("tests", "gap"), _read_case),
    "fmu": Kind(_fmu, _read_fmu),
    "ssp": Kind(_system, _read_system),
    **ABROAD,
    **MEASURED,
}
KINDS |= kinds(KINDS)
KINDS |= kept_kinds(KINDS)
REFUSED = {"mf4-older"}  # kinds whose whole files are refused: MDF 3


def repacked(data: bytes, change: Callable[[bytes], bytes], pick: Callable[[list[str]], str]) -> bytes:
    """A zip archive with one of its members changed, packed as before."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        chosen = pick(old.namelist())
        for info in old.infolist():
            inside = old.read(info)
            new.writestr(info, change(inside) if info.filename == chosen else inside)
    return out.getvalue()
