"""Files of makers and advisers, plans, bodies and tables of a user's own, for the fuzz."""

import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from tests.fuzz.kind import Kind, bundled, written

# ---- logs as other programs write them, and a field made of each


def _import(**settings: Any) -> Callable[[Path], Any]:
    def read(folder: Path) -> Any:
        from swath.field_io.importer import Settings, import_log

        shutil.rmtree(folder / "out", ignore_errors=True)
        log = next(p for p in sorted(folder.iterdir()) if p.name.startswith("log"))
        with patch("swath.field_io.importer.draw"):  # seconds of matplotlib
            return import_log(log, folder / "out", settings=Settings(**settings), progress=False)

    return read


def _export(name: str, form: str, **options: Any) -> Callable[[Path], Any]:
    def make(folder: Path) -> None:
        from tests.field import made_exports

        getattr(made_exports, form)(folder / name, **options)

    return make


def _deere(folder: Path) -> None:
    from tests.field.made_exports import john_deere

    data = {
        "DataType": "Harvest",
        "ClientName": "a",
        "DataAttributes": [{"Name": "WetMass", "Unit": "lb1ac-1"}],
    }
    john_deere(folder / "log", sections=2, metadata=json.dumps(data))


# ---- boundaries, plans, jobs

RING = "9.000,52.000,0 9.003,52.000,0 9.003,52.004,0 9.000,52.004,0 9.000,52.000,0"
KML = f"""<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>Hill</name>
<Polygon><outerBoundaryIs><LinearRing><coordinates>{RING}</coordinates></LinearRing></outerBoundaryIs></Polygon>
</Placemark></Document></kml>
"""


def _kmz(folder: Path) -> None:
    with zipfile.ZipFile(folder / "b.kmz", "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("doc.kml", KML)


def _outline(folder: Path) -> Any:
    from swath.field_io.outline import read_outlines

    return read_outlines(next(folder.glob("b.*")), 32632).areas[0]


def _task_plan(folder: Path) -> None:
    from tests.field.test_plan import taskdata

    taskdata(folder / "log")


def _plan_lines(folder: Path) -> None:
    corners = [[float(v) for v in point.split(",")[:2]] for point in RING.split()]
    lines = [[[9.0 + 1e-4 * k, 52.0], [9.0 + 1e-4 * k, 52.004]] for k in range(1, 29)]
    shapes = [
        {"type": "Polygon", "coordinates": [corners]},
        {"type": "MultiLineString", "coordinates": lines},
    ]
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    (folder / "plan.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))


def _read_plan(folder: Path) -> Any:
    from swath.fleet.files import read_field

    name = "plan.geojson" if (folder / "plan.geojson").is_file() else "log"
    return read_field(folder / name, 9.0)


def _read_fleet(folder: Path) -> Any:
    from swath.fleet.files import read_job

    return read_job(str(folder / "mine.yaml"))


# ---- bodies of machines

URDF = """<robot name="m"><link name="base"><visual><geometry><box size="6 3 3"/></geometry></visual></link>
<link name="header"><visual><origin xyz="4 0 0.5" rpy="0 0.1 0"/>
<geometry><mesh filename="cube.stl" scale="1 7 0.6"/></geometry></visual></link>
<joint name="lift" type="revolute"><parent link="base"/><child link="header"/><origin xyz="0 0 0.2"/></joint>
</robot>
"""
SDF = """<sdf version="1.9"><model name="m"><frame name="f"><pose degrees="true">1 0 0 0 0 90</pose></frame>
<link name="base"><pose relative_to="f">0 0 1 0 0 0</pose><visual name="v">
<geometry><cylinder><radius>1</radius><length>4</length></cylinder></geometry></visual></link>
<link name="header"><visual name="v"><pose>4 0 0.4 0 0 0</pose>
<geometry><box><size>1 7 0.6</size></box></geometry></visual></link>
<joint name="lift" type="revolute"><parent>base</parent><child>header</child></joint></model></sdf>
"""


def _urdf(folder: Path) -> None:
    import trimesh

    (folder / "m.urdf").write_text(URDF)
    (folder / "cube.stl").write_bytes(trimesh.creation.box((1.0, 1.0, 1.0)).export(file_type="stl"))


def _read_body(folder: Path) -> Any:
    from swath.machine.body.body import read_body
    from swath.scenario.sections import BodySection

    file = next(p for p in folder.iterdir() if p.suffix in (".urdf", ".sdf"))
    return read_body(BodySection(file=str(file)), "combine.body")


# ---- data sheets of other sensors, candidates, changes, tables


def _camera(folder: Path) -> Any:
    from swath.sensing.camera.camera_sheet import load_camera

    return load_camera("mine.yaml", folder).optics


def _radar(folder: Path) -> Any:
    from swath.sensing.radar.radar_sheet import load_radar

    return load_radar("mine.yaml", folder).snr(1.0, 20.0)


def _candidates(folder: Path) -> Any:
    from swath.tools.function_test.candidates import read_candidates

    return read_candidates(folder / "mine.yaml")


def _events(folder: Path) -> Any:
    from swath.runtime.changes import read_events

    return read_events(folder / "events.json")


EVENTS = json.dumps({"events": [{"t_s": 0.5, "set": "combine.speed.speed_kmh", "value": 5}]})
CANDIDATES = "base: {}\notsu: {combine.edge.level: otsu}\nmine: {speed.speed_kmh: 3, edge: mine.py:D}\n"


def _part_table(folder: Path) -> None:
    from swath.tools.part.table import columns_of

    part = _part()
    found = {name: f for name, (output, f) in columns_of(part, part.ports).items() if output in part.needed}
    rows = [",".join([f"{0.02 * k:g}", *("0.1" if f.kind == "float" else "1" for f in found.values())])
            for k in range(20)]  # fmt: skip
    (folder / "in.csv").write_text("\n".join([",".join(["t_s", *found]), *rows]) + "\n")


def _part() -> Any:
    from swath.scenario.scenario import load_scenario
    from swath.tools.part.isolate import IsolatedPart

    return IsolatedPart(load_scenario("straight", sets=["combine.lidar.level=empirical"]), "combine.steer")


def _read_part_table(folder: Path) -> Any:
    from swath.tools.part.table import read_table

    return read_table(folder / "in.csv", _part())


def _steer_log(folder: Path) -> None:
    lines = ["pass,t_s,speed_m_s,command_curvature_1_km,steer_angle_deg,yaw_rate_deg_s,x_m,y_m"]
    lines += [
        f"{k // 100},{0.05 * k:.2f},3.1,{k % 40},{k % 7},1.5,{0.15 * k:.3f},{0.01 * k:.3f}"
        for k in range(300)
    ]
    (folder / "log.csv").write_text("\n".join(lines) + "\n")


def _read_steer_log(folder: Path) -> Any:
    from swath.field_io.logs.steer_log import read_steer_log

    return read_steer_log(folder / "log.csv")


def _field_state(folder: Path) -> None:
    from swath.field.paging.state_file import write_state

    codes = [bytes(512 * 512), 15, None]
    import zlib

    from swath.field.paging.state_file import STRAW_BYTES

    state = {
        "keys": [(0, 0), (0, 1), (1, 1)],
        "codes": [zlib.compress(codes[0]), *codes[1:]],
        "straw": [zlib.compress(bytes(STRAW_BYTES)), None, None],
        "grain": {"mass": {(3, 4): 0.25}},
    }
    write_state(folder / "after.npz", state, {"field.stand.crop": "wheat"})


def _read_field_state(folder: Path) -> Any:
    from swath.field.paging.state_file import read_state

    return read_state(folder / "after.npz", {"field.stand.crop": "wheat"})


def _photo(folder: Path) -> None:
    import rasterio
    from rasterio.transform import from_origin

    where = {"crs": "EPSG:32632", "transform": from_origin(532800.0, 5304150.0, 10.0, 10.0)}
    values = np.arange(3 * 30 * 40, dtype=np.uint8).reshape(3, 30, 40) % 200
    with rasterio.open(
        folder / "map.tif", "w", driver="GTiff", width=40, height=30, count=3, dtype="uint8", **where
    ) as made:
        made.write(values)


def _read_photo(folder: Path) -> Any:
    from swath.field.maps.projection import Origin
    from swath.sensing.camera.orthophoto import Orthophoto

    return Orthophoto("map.tif", folder, Origin(32632, 533000.0, 5304000.0))


def _network(folder: Path) -> None:
    from tests.networks import linear

    linear(folder / "net.onnx", [4], np.eye(4)[:2], [0.5, -0.5])


def _run_network(folder: Path) -> Any:
    from swath.control.network import From, Into, Network
    from swath.core.foreign_code import allow_code
    from swath.signals import Odometry

    with allow_code(None):
        told = {"offset": From("y", index=0)}
        made = Network(str(folder / "net.onnx"), {"x": Into("odometry.speed", last=4)}, told, {})
    for n in range(4):
        made.take({"odometry": Odometry(t=n + 1, speed=float(n), yaw_rate=0.0, steer_angle=0.0)})
    return made.answer()["offset"].tolist()


ABROAD: dict[str, Kind] = {
    "scenario-two-scanners": Kind(bundled("scenarios", "two-scanners"), lambda f: _load(f).resolved()),
    "scenario-unload": Kind(bundled("scenarios", "unload-on-the-go"), lambda f: _load(f).resolved()),
    "scenario-person": Kind(bundled("scenarios", "person-at-edge"), lambda f: _load(f).resolved()),
    "export-deere": Kind(_deere, _import()),
    "export-sms": Kind(_export("log.txt", "sms"), _import()),
    "export-german": Kind(_export("log.csv", "german"), _import()),
    "export-platform": Kind(_export("log.csv", "farm_platform"), _import(as_map=True)),
    "export-ag-leader": Kind(_export("log.txt", "ag_leader"), _import(crop="maize")),
    "task-plan": Kind(_task_plan, _import()),
    "task-plan-job": Kind(_task_plan, _read_plan),
    "plan-geojson": Kind(_plan_lines, _read_plan),
    "outline-kml": Kind(written("b.kml", KML), _outline),
    "outline-kmz": Kind(_kmz, _outline),
    "job": Kind(bundled("jobs", "small-field"), _read_fleet),
    "network": Kind(_network, _run_network),
    "body-urdf": Kind(_urdf, _read_body),
    "body-sdf": Kind(written("m.sdf", SDF), _read_body),
    "sheet-camera": Kind(bundled("sensors", "camera-rolling-wide"), _camera),
    "sheet-radar": Kind(bundled("sensors", "radar-77ghz-front"), _radar),
    "candidates": Kind(written("mine.yaml", CANDIDATES), _candidates),
    "events": Kind(written("events.json", EVENTS), _events),
    "part-table": Kind(_part_table, _read_part_table),
    "log-steering": Kind(_steer_log, _read_steer_log),
    "field-state": Kind(_field_state, _read_field_state),
    "orthophoto": Kind(_photo, _read_photo),
}


def _load(folder: Path) -> Any:
    from swath.scenario.scenario import load_scenario

    return load_scenario(folder / "mine.yaml")
