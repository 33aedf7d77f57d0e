"""Small files that would fill the memory or never end, each read in a process of little memory.

Run as a program (`--all`: the slow ones, too) it prints name, seconds of processor time, most memory of the
process so far [MiB] and what came out.
"""

import gzip
import io
import json
import os
import resource
import struct
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

MEMORY_GB = 3
MIB = 1 << 20
SECONDS = 60.0  # of processor time for each: what never ends takes more on any machine
SLOW = ("csv.gz of small rows", "ISOXML of channels", "MCAP of zeros")  # not in the quick test


def _log(text: bytes, count: int, head: bytes = b"lat,lon,flow,speed,swath\n") -> Callable[[Path], Any]:
    def read(folder: Path) -> Any:
        from swath.field_io.logs.log import read_log

        path = folder / "log.csv.gz"
        with gzip.open(path, "wb", compresslevel=9) as stream:
            stream.write(head)
            for _ in range(count):
                stream.write(text)
        assert path.stat().st_size < 400_000
        return read_log(path)

    return read


def _zip(folder: Path, name: str, **members: bytes) -> Path:
    with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, data in members.items():
            archive.writestr(member.replace("__", "."), data)
    return folder / name


def _task(folder: Path, taskdata: str, header: str = "", records: bytes = b"") -> Any:
    from swath.field_io.logs.table import read_table

    files = {"TASKDATA__XML": taskdata.encode(), "TLG00001__xml": header.encode(), "TLG00001__bin": records}
    return read_table(_zip(folder, "task.zip", **files))


def _laughs(folder: Path) -> Any:
    lines = [f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 12)]
    return _task(folder, f'<!DOCTYPE a [<!ENTITY a0 "ha">{"".join(lines)}]><a B="&a11;"/>')


def _deep_xml(folder: Path) -> Any:
    return _task(folder, "<a>" * 100_000)


def _counts(folder: Path) -> Any:
    header = '<TIM A=""><PTN/>' + '<DLV A="0057" C="D"/>' * 255 + "</TIM>"
    record = struct.pack("<IHB", 36_000_000, 14_000, 0)
    return _task(folder, '<a><TSK A="1"><TLG A="TLG00001"/></TSK></a>', header, record * (15 * MIB // 7))


def _devices(folder: Path) -> Any:
    inside = "".join(f'<DET A="E{k}"/><DPD A="{k}" B="{k:X}"/>' for k in range(40_000))
    return _task(folder, f'<a><DVC A="D">{inside}</DVC></a>')


def _object(line: bytes) -> Callable[[Path], Any]:
    def read(folder: Path) -> Any:
        from swath.field.mesh_file import read_mesh

        (folder / "m.obj").write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" + line)
        return read_mesh(folder / "m.obj", key="file")

    return read


def _gltf(folder: Path) -> Any:
    from swath.field.mesh_file import read_mesh

    accessor = {"componentType": 5126, "count": 2_000_000_000, "type": "VEC3"}
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    scene = {"scenes": [{"nodes": [0]}], "scene": 0, "nodes": [{"mesh": 0}], "asset": {"version": "2.0"}}
    (folder / "m.gltf").write_text(json.dumps({**scene, "meshes": [mesh], "accessors": [accessor]}))
    return read_mesh(folder / "m.gltf", key="file")


def _arrays(folder: Path, read: Callable[[Path], Any]) -> Any:
    import numpy as np

    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (600, 131_072)}
    )
    path = folder / "a.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("ranges_m.npy", "w", force_zip64=True) as member,
    ):
        member.write(head.getvalue())
        for _ in range(60):
            member.write(bytes(MIB))
    return read(path)


def _scans(path: Path) -> Any:
    from swath.tools.height_map.source import Wanted, open_npz

    return open_npz(path, Wanted(), None)


def _table(path: Path) -> Any:
    from swath.sensing.tables import load_table

    return load_table(str(path))


def _grid(path: Path) -> Any:
    from swath.rays.height_grid import load_height_grid

    return load_height_grid(path)


def _made_geotiff(folder: Path) -> Path:
    import rasterio

    place = rasterio.Affine(1.0, 0.0, 500_000.0, 0.0, -1.0, 5_000_000.0)
    about = {"driver": "GTiff", "dtype": "float32", "count": 1, "crs": "EPSG:32612", "transform": place}
    sparse = {"SPARSE_OK": "TRUE", "tiled": True, "blockxsize": 4096, "blockysize": 4096}
    with rasterio.open(folder / "a.tif", "w", width=40_000, height=40_000, **about, **sparse):
        pass
    return folder / "a.tif"


def _geotiff(folder: Path) -> Any:
    from swath.field.maps.raster import Raster

    return Raster.from_geotiff(_made_geotiff(folder), may_be_empty=True)


def _dem(folder: Path) -> Any:
    import numpy as np

    from swath.field.maps.raster import Raster
    from swath.field_io.dem import read_dem

    field = Raster(np.zeros((60, 80), np.float32), 510_000.0, 4_990_000.0, 4.0, 32612)
    return read_dem(_made_geotiff(folder), field)


def _far_gap(folder: Path) -> Any:
    import numpy as np

    from swath.field.terrain.dem import fill_gaps

    values = np.full((1500, 1500), np.nan)
    values[0, 0] = 7.0
    return fill_gaps(values).sum()


ALIASES = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(9)
)


def _yaml(read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    def run(folder: Path) -> Any:
        (folder / "a.yaml").write_text(ALIASES)
        (folder / "field.yaml").write_text(ALIASES)
        return read(folder)

    return run


def _sheet(folder: Path) -> Any:
    from swath.sensing.lidar_sheet import load_lidar

    return load_lidar("a.yaml", folder)


def _columns(folder: Path) -> Any:
    from swath.field_io.logs.columns import read_map

    return read_map(folder / "a.yaml", ["a"])


def _field(folder: Path) -> Any:
    from swath.field_io.folder import read

    return read(folder)


def _scenario(folder: Path) -> Any:
    from swath.scenario.scenario import load_scenario

    return load_scenario(folder / "a.yaml")


def _beside_table(folder: Path) -> Any:
    from swath.sensing.tables import load_table, save_table

    save_table(load_table("rye-median"), folder / "t.npz")
    (folder / "t.yaml").write_text(ALIASES)
    return load_table("t.npz", folder)


def _recording(folder: Path) -> Any:
    """A chunk of zeros, and one that says it is smaller than it is."""
    import zstandard

    from swath.record.read.files import open_log

    packer = zstandard.ZstdCompressor(level=3).compressobj()
    packed = b"".join(packer.compress(bytes(MIB)) for _ in range(2000)) + packer.flush()
    body = struct.pack("<QQQII", 0, 1, 2000 * MIB, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    record = bytes([6]) + struct.pack("<Q", len(body)) + body
    (folder / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + record)
    return open_log(folder / "a.mcap").topics()


def _tracks(folder: Path) -> Any:
    import pyarrow as pa
    import pyarrow.parquet as pq

    from swath.record.tracks import read_tracks

    rows = pa.table({f"c{k}": pa.array([1.0] * 2_000_000) for k in range(15)})
    pq.write_table(rows, folder / "t.parquet", compression="zstd")
    return read_tracks(folder / "t.parquet")


LINE = b"1," * (150 * MIB)


def _line(name: str, read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """A file of one line of 300 MiB."""

    def run(folder: Path) -> Any:
        (folder / name).write_bytes(LINE)
        return read(folder / name)

    return run


def _measured(path: Path) -> Any:
    from swath.tools.lab.measured_heights import read_measured

    return read_measured(path)


def _beams(path: Path) -> Any:
    from swath.tools.calibrate.measured import read_samples

    return read_samples(path)


def _outlines(path: Path) -> Any:
    from swath.field_io.outline import read_outlines

    return read_outlines(path).areas[0].bounds


def _plain_log(path: Path) -> Any:
    from swath.field_io.logs.log import read_log

    return read_log(path)


def _json(path: Path) -> Any:
    from swath.runtime.changes import read_events

    return read_events(path)


def _document(path: Path) -> Any:
    from swath.documents.yaml_document import read_document

    return read_document(path)


def _mesh(path: Path) -> Any:
    from swath.field.mesh_file import read_mesh

    return read_mesh(path, key="file")


def _field_of(*ring: tuple[float, float]) -> Callable[[Path], Any]:
    """A field of an outline in lon/lat."""

    def run(folder: Path) -> Any:
        from swath.field_io.importer import Settings, import_log

        shape = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        (folder / "a.geojson").write_text(json.dumps(shape))
        settings = Settings(header_width_m=9.0)
        return import_log(folder / "a.geojson", folder / "out", settings=settings, progress=False)

    return run


def _job(width: float, height: float) -> Callable[[Path], Any]:
    def run(folder: Path) -> Any:
        from swath.fleet.files import read_job
        from swath.fleet.ground import Ground
        from swath.fleet.machines import body_of
        from swath.machine.machine_sheet import load_machine

        ring = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]
        job, _ = read_job("small-field", (f"field.boundary_m={ring}",))
        return Ground(job, body_of(load_machine(job.truck.machine))).field.area

    return run


def _body(path: Path) -> Any:
    from swath.machine.body.body import read_body
    from swath.scenario.sections import BodySection

    return read_body(BodySection(file=str(path)), "combine.body")


BOX = "<visual><geometry><box size='1 1 1'/></geometry></visual>"


def _urdf_chain(folder: Path) -> Any:
    links = "".join(f"<link name='l{k}'>{BOX}</link>" for k in range(5000))
    joints = "".join(
        f"<joint name='j{k}'><parent link='l{k}'/><child link='l{k + 1}'/></joint>" for k in range(4999)
    )
    (folder / "m.urdf").write_text(f"<robot name='m'>{links}{joints}</robot>")
    return _body(folder / "m.urdf")


def _sdf_chain(folder: Path) -> Any:
    box = "<visual name='v'><geometry><box><size>1 1 1</size></box></geometry></visual>"
    links = "".join(
        f"<link name='l{k}'><pose relative_to='l{k + 1}'>0 0 0 0 0 0</pose>{box}</link>" for k in range(5000)
    )
    (folder / "m.sdf").write_text(
        f"<sdf version='1.9'><model name='m'>{links}<link name='l5000'/></model></sdf>"
    )
    return _body(folder / "m.sdf")


def _broken_zip(name: str, member: str, read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """A zip archive whose directory lies about where it begins and what it has."""

    def run(folder: Path) -> Any:
        path = _zip(folder, name, **{member.replace(".", "__"): b"<kml/>" * 100})
        data = bytearray(path.read_bytes())
        at = data.rindex(b"PK\x01\x02")
        data[at + 20 : at + 28], data[at + 42 : at + 46] = b"\xff" * 8, b"\xff\xff\xff\x7f"
        path.write_bytes(bytes(data))
        return read(path)

    return run


def _fmu(path: Path) -> Any:
    from swath.link.fmi.composite import describe_file

    return describe_file(path)


def _large_fmu(folder: Path) -> Any:
    return _fmu(_zip(folder, "m.fmu", modelDescription__xml=bytes(400 * MIB)))


BOMBS: dict[str, Callable[[Path], Any]] = {
    "one line of measured heights": _line("a.csv", _measured),
    "one line of beams": _line("a.csv", _beams),
    "one line of a log": _line("a.csv", _plain_log),
    "one line of KML": _line("a.kml", _outlines),
    "one line of GeoJSON": _line("a.geojson", _outlines),
    "one line of events": _line("a.json", _json),
    "one line of YAML": _line("a.yaml", _document),
    "one line of OBJ": _line("a.obj", _mesh),
    "one line of URDF": _line("a.urdf", _body),
    "outline of a degree": _field_of((9.0, 52.0), (10.0, 52.0), (10.0, 53.0), (9.0, 53.0)),
    "outline with a far corner": _field_of((9.0, 52.0), (9.002, 52.0), (12.0, 49.0), (9.0, 52.002)),
    "job of 1,000 ha": _job(4000.0, 2500.0),
    "job of 100 km": _job(100_000.0, 30.0),
    "URDF chain": _urdf_chain,
    "SDF chain": _sdf_chain,
    "KMZ with a broken directory": _broken_zip("a.kmz", "doc.kml", _outlines),
    "shapefile with a broken directory": _broken_zip("a.zip", "a.shp", _outlines),
    "log with a broken directory": _broken_zip("a.zip", "a.shp", _plain_log),
    "task data with a broken directory": _broken_zip("a.zip", "TASKDATA.XML", _plain_log),
    "FMU with a broken directory": _broken_zip("a.fmu", "modelDescription.xml", _fmu),
    "SSP with a broken directory": _broken_zip("a.ssp", "SystemStructure.ssd", _fmu),
    "table with a broken directory": _broken_zip("a.npz", "ranges_m.npy", _scans),
    "FMU of zeros": _large_fmu,
    "csv.gz of blank lines": _log(b"\n" * MIB, 60),
    "csv.gz of one row": _log(b"," * MIB, 60),
    "csv.gz of one line": _log(b"1" * MIB, 60),
    "csv.gz of small rows": _log(b"1,2,3,4,5\n" * (MIB // 10), 60),
    "csv.gz of one quoted cell": _log(b"a\n" * (MIB // 2), 60, head=b'lat,lon,flow\n1,2,"'),
    "csv.gz of a long header": _log(b"a," * (MIB // 2), 60, head=b""),
    "ISOXML of entities": _laughs,
    "ISOXML of depth": _deep_xml,
    "ISOXML of channels": _counts,
    "ISOXML of devices": _devices,
    "OBJ of blanks": _object(b"usemtl a" + b" " * 2_000_000 + b"b\n"),
    "OBJ of tabs": _object(b"o " + b"\t" * 2_000_000 + b"\n"),
    "glTF of zeros": _gltf,
    "npz of scans": lambda folder: _arrays(folder, _scans),
    "npz of a spread table": lambda folder: _arrays(folder, _table),
    "npz of a height grid": lambda folder: _arrays(folder, _grid),
    "GeoTIFF of 40,000 x 40,000": _geotiff,
    "DEM of 40,000 x 40,000": _dem,
    "GeoTIFF with one known cell": _far_gap,
    "aliases in a data sheet": _yaml(_sheet),
    "aliases in a column map": _yaml(_columns),
    "aliases in a field folder": _yaml(_field),
    "aliases in a scenario": _yaml(_scenario),
    "aliases beside a spread table": _beside_table,
    "MCAP of zeros": _recording,
    "tracks of equal rows": _tracks,
}


def _peak_mib() -> int:
    """Most memory of this process so far [MiB]; ru_maxrss would count the process that started it, too."""
    status = Path("/proc/self/status")
    if not status.is_file():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    return next(int(s.split()[1]) for s in status.read_text().splitlines() if s.startswith("VmHWM")) >> 10


def main() -> None:
    """Read every one of them."""
    from swath.core.errors import SwathError

    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_GB << 30, MEMORY_GB << 30))
    for name, read in BOMBS.items():
        if name in SLOW and "--all" not in sys.argv:
            continue
        with tempfile.TemporaryDirectory() as folder:
            begin = time.process_time()
            try:
                read(Path(folder))
                said = "read"
            except SwathError as error:
                said = f"refused: {error}"
            except BaseException as error:
                said = f"{type(error).__name__}: {error}"
            spent = time.process_time() - begin
            peak = _peak_mib()
            print(json.dumps([name, round(spent, 2), peak, said]), flush=True)


if __name__ == "__main__":
    main()
