"""What is not a log is refused in one line; what is broken in a log is counted by name."""

import gzip
import io
import os
import random
import shutil
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.field.made_log import COLUMNS, MadeLog

pytest.importorskip("rasterio")

from swath.core.errors import InputError, SwathError
from swath.field_io import folder
from swath.field_io.importer import Settings, import_log, show
from swath.field_io.logs.columns import find_columns, guess
from swath.field_io.logs.log import read_log
from swath.field_io.outline import read_outlines


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    path = tmp_path_factory.mktemp("small")
    MadeLog(passes=3).write(path / "log.csv")
    (path / "map.yaml").write_text(COLUMNS)
    return path


HEAD = "lat,lon,flow,speed,swath\n"
GOOD = [f"47.{8900000 + 18 * i},-110.55,8.5,2.0,12.0\n" for i in range(100)]
NO_LOGS = {
    "the file is empty": b"",
    "a PNG image": b"\x89PNG\r\n\x1a\n" + bytes(50),
    "a JPEG image": b"\xff\xd8\xff\xe0" + bytes(50),
    "a PDF": b"%PDF-1.7 ...",
    "a web page": b"<!DOCTYPE html><html><body>404</body></html>",
    "this is binary": bytes(range(256)) * 4,
    "readable file": b"\x1f\x8b\x08\x00 not really gzip",
    "three named columns": b"hello world\n" * 50,
    "lat and lon (or easting and northing), grain_flow or yield, header_width": b"a,b,c\n" + b"1,2,3\n" * 50,
    "grain_flow or yield, header_width (or --header-width-m); ": b"lat,lon,moisture\n"
    + b"47.1,-110.2,12\n" * 50,
    "each column name once": b"lat,lon,flow,lat\n" + b"47.1,-110.2,12,1\n" * 50,
    "at least 30 whole rows": (HEAD + "".join(GOOD[:10])).encode(),
    "at least 30 usable rows": (HEAD + "x,y,z,q,w\n" * 50).encode(),
    "known unit": b"lat,lon,Flow (furlong/s)\n" + b"47.1,-110.2,12\n" * 50,
    "--header-width-m": b"lat,lon,flow,speed\n"
    + b"".join(b"47.%d,-110.2,8,2\n" % (1000 + i) for i in range(60)),
}


@pytest.mark.parametrize("reason", NO_LOGS)
def test_what_is_no_log_gets_one_clear_error(tmp_path, reason):
    path = tmp_path / "thing.dat"
    path.write_bytes(NO_LOGS[reason])
    with pytest.raises(InputError) as caught:
        import_log(path, tmp_path / "out", progress=False)
    text = str(caught.value)
    assert reason in text or (reason == "known unit" and "kg/s, g/s, kg/h, t/h, lb/s" in text)
    assert "\n" not in text
    assert "thing.dat" in text
    made = ["thing.columns.yaml"] if "columns.yaml" in text else []
    assert sorted(p.name for p in tmp_path.iterdir()) == [*made, "thing.dat"]


def test_names_of_a_common_yield_monitor():
    header = ["Longitude", "Latitude", "Crop Flw(M)(lb/s)", "Duration(s)", "Swth Wdth(in)", "Moisture(%)"]
    found = guess(header, "log.csv").columns
    flow, width = found["grain_flow"], found["header_width"]
    assert (flow.column, flow.unit) == ("Crop Flw(M)(lb/s)", "lb/s")
    assert (width.column, width.unit) == ("Swth Wdth(in)", "in")
    assert guess(["Yld Mass(Wet)(lb/ac)"], "log.csv").columns["yield"].unit == "lb/ac"
    assert "yield" not in guess(["Yld Mass(Dry)(lb/ac)"], "log.csv").columns  # grain is mapped as harvested


def test_missing_files_and_folders_are_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        import_log(tmp_path / "no.csv", tmp_path / "out", progress=False)
    with pytest.raises(InputError, match="a folder with a shapefile or TASKDATA"):
        import_log(tmp_path, tmp_path / "out", progress=False)
    with pytest.raises(InputError, match="there is none"):
        show(tmp_path / "none")
    with pytest.raises(InputError, match=r"no field\.yaml"):
        show(tmp_path)


def test_a_folder_that_is_something_else_is_left_alone(tmp_path, small):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="expected a new or empty folder"):
        import_log(small / "log.csv", tmp_path / "out", columns=small / "map.yaml", progress=False)
    assert (tmp_path / "out" / "letter.txt").read_text() == "dear"
    with pytest.raises(InputError, match="this is a file"):
        import_log(
            small / "log.csv", tmp_path / "out" / "letter.txt", columns=small / "map.yaml", progress=False
        )


def test_an_old_field_folder_survives_a_failed_import(tmp_path, small, monkeypatch):
    import_log(small / "log.csv", tmp_path / "f", columns=small / "map.yaml", progress=False)
    before = {p.name: p.read_bytes() for p in (tmp_path / "f").iterdir()}

    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(folder, "_write_json", fail)
    with pytest.raises(KeyboardInterrupt):
        import_log(small / "log.csv", tmp_path / "f", columns=small / "map.yaml", progress=False)
    assert {p.name: p.read_bytes() for p in (tmp_path / "f").iterdir()} == before
    assert [p.name for p in tmp_path.iterdir()] == ["f"]


@pytest.mark.draws
def test_a_kill_while_files_take_their_places_leaves_no_half_field(tmp_path, small, monkeypatch):
    out, killed, place = tmp_path / "f", tmp_path / "killed", os.replace
    import_log(small / "log.csv", out, columns=small / "map.yaml", progress=False)
    (out / "letter.txt").write_text("dear")
    field = folder.read(out)
    turned, moments = replace(field, row_azimuth=1.0), []

    def seen(*names, **folders):  # what a kill would leave here
        moments.append(shutil.copytree(out, killed / str(len(moments))))
        return place(*names, **folders)

    monkeypatch.setattr(os, "replace", seen)
    folder.write(turned)
    monkeypatch.undo()
    assert len(moments) > len(folder.FILES)
    azimuths = set()
    for left in (*moments, out):
        if (left / "field.yaml").is_file():
            azimuths.add(round(folder.read(left).row_azimuth, 4))
            assert (left / "density.tif").is_file()
        folder.write(replace(turned, path=left))
        assert folder.read(left).row_azimuth == pytest.approx(1.0, abs=1e-5)
        assert (left / "letter.txt").read_text() == "dear"
        assert {f.name for f in left.iterdir()} <= {*folder.FILES, "letter.txt"}
    assert azimuths == {round(field.row_azimuth, 4), 1.0}


def test_broken_rows_are_counted_by_name_and_left_out(tmp_path):
    bad = {
        "wrong_field_count": ["47.89,-110.55,8.5\n"] * 2,
        "position_not_a_number": ["here,-110.55,8.5,2,12\n", "nan,-110.55,8.5,2,12\n", ",,8.5,2,12\n"],
        "position_out_of_range": ["147.89,-110.55,8.5,2,12\n", "0,0,8.5,2,12\n"],
        "position_far_away": ["48.5,-110.55,8.5,2,12\n"],
        "grain_flow_not_a_number": ["47.8900001,-110.55,inf,2,12\n", "47.8900002,-110.55,,2,12\n"],
        "grain_flow_out_of_range": ["47.8900003,-110.55,-3,2,12\n", "47.8900004,-110.55,9000,2,12\n"],
        "speed_out_of_range": ["47.8900005,-110.55,8.5,70,12\n"],
        "header_width_out_of_range": ["47.8900006,-110.55,8.5,2,1200\n"],
        "jump": [GOOD[50].replace("-110.55", "-110.54")],
        "duplicated_position": [GOOD[50]] * 3,
    }
    rows = GOOD[:51] + [row for rows in bad.values() for row in rows] + GOOD[51:]
    rows.insert(51, rows.pop(51 + [r for v in bad.values() for r in v].index(bad["jump"][0])))
    path = tmp_path / "log.csv"
    path.write_text(HEAD + "".join(rows))
    log = read_log(path)
    assert {k: v for k, v in log.broken.items() if v} == {k: len(v) for k, v in bad.items()}
    assert log.row_count == 100 + sum(len(v) for v in bad.values())
    assert len(log) == 100


def test_spellings_of_csv(tmp_path, small):
    plain = read_log(small / "log.csv", small / "map.yaml")
    text = (small / "log.csv").read_text()
    variants = {
        "log.csv.gz": gzip.compress(text.encode()),
        "bom.csv": b"\xef\xbb\xbf" + text.encode(),
        "semicolon.csv": text.replace(",", ";").replace(".", ",").encode(),
        "tab.txt": text.replace(",", "\t").encode(),
        "blank_lines.csv": text.replace("\n", "\n\n").encode(),
    }
    for name, data in variants.items():
        (tmp_path / name).write_bytes(data)
        log = read_log(tmp_path / name, small / "map.yaml")
        np.testing.assert_array_equal(log.flow, plain.flow, err_msg=name)
        np.testing.assert_array_equal(log.east, plain.east, err_msg=name)


def test_usual_names_and_units_in_them_are_understood(tmp_path):
    header = [
        "Latitude",
        "Longitude",
        "Speed (mph)",
        "Swath_Width_ft",
        "Grain Flow (lb/s)",
        "Moisture(%)",
        "Elevation",
    ]
    found = guess(header, tmp_path).columns
    assert {k: (c.column, c.unit) for k, c in found.items()} == {
        "lat": ("Latitude", "deg"),
        "lon": ("Longitude", "deg"),
        "speed": ("Speed (mph)", "mph"),
        "header_width": ("Swath_Width_ft", "ft"),
        "grain_flow": ("Grain Flow (lb/s)", "lb/s"),
        "moisture": ("Moisture(%)", "%"),
        "elevation": ("Elevation", "m"),
    }
    assert [k for k, c in found.items() if c.is_assumed] == ["lat", "lon", "elevation"]


def test_yield_stands_in_for_flow(tmp_path):
    rows = [row.replace(",8.5,", ",4.0,") for row in GOOD]
    (tmp_path / "log.csv").write_text("lat,lon,yield_t_ha,speed,swath\n" + "".join(rows))
    log = read_log(tmp_path / "log.csv")
    np.testing.assert_allclose(log.flow, 0.4 * 2.0 * 12.0)


MAPS = {
    "did you mean grain_flow": "grain_flw: {column: flow, unit: kg/s}",
    "expected one of kg/s, g/s, kg/h, t/h, lb/s": "grain_flow: {column: flow, unit: furlong}",
    "nearest is 'flow'": "grain_flow: {column: Flow, unit: kg/s}",
    "expected {column: name, unit: unit}": "grain_flow: [flow]",
    "expected text like EPSG:32612": "crs: 32612",
    "a known coordinate system": COLUMNS.replace("EPSG:32612", "EPSG:999999"),
    "expected crs: EPSG:": COLUMNS.replace("crs: EPSG:32612", ""),
    "YAML: while parsing": "a: [",
    "expected canonical names": "[]",
}


@pytest.mark.parametrize("reason", MAPS)
def test_a_wrong_column_map_says_what_is_wrong(tmp_path, small, reason):
    (tmp_path / "map.yaml").write_text(MAPS[reason])
    with pytest.raises(InputError) as caught:
        read_log(small / "log.csv", tmp_path / "map.yaml")
    assert reason in str(caught.value)


@pytest.mark.parametrize("changes", [{"cell_m": 0.0}, {"cell_m": float("nan")}, {"grain_g_per_stem": -1.0}])
def test_settings_that_cannot_be_are_refused(tmp_path, small, changes):
    with pytest.raises(InputError, match=next(iter(changes))):
        import_log(
            small / "log.csv",
            tmp_path / "f",
            columns=small / "map.yaml",
            settings=Settings(**changes),
            progress=False,
        )


BOUNDARIES = {
    "expected GeoJSON or a polygon": b"\x00\x01",
    "expected GeoJSON": b"[]",
    "expected a polygon": b'{"type": "Point", "coordinates": [-110.5, 47.9]}',
    "of the records inside": b'{"type":"Polygon","coordinates":[[[10,50],[10.1,50],[10.1,50.1],[10,50]]]}',
}


def test_a_bare_shapefile_is_a_boundary(tmp_path):
    shapefile = pytest.importorskip("shapefile")
    with shapefile.Writer(tmp_path / "b") as writer:
        writer.field("name", "C")
        writer.poly([[(9.0, 52.0), (9.0, 52.01), (9.01, 52.01), (9.01, 52.0), (9.0, 52.0)]])
        writer.record("x")
    assert read_outlines(tmp_path / "b.shp", 32632).areas[0].area == pytest.approx(1113.2 * 687.0, rel=0.01)


@pytest.mark.parametrize("reason", BOUNDARIES)
def test_a_boundary_that_is_none_is_refused(tmp_path, small, reason):
    (tmp_path / "b.geojson").write_bytes(BOUNDARIES[reason])
    with pytest.raises(InputError, match=reason):
        import_log(
            small / "log.csv",
            tmp_path / "f",
            boundary=tmp_path / "b.geojson",
            columns=small / "map.yaml",
            progress=False,
        )


def zipped(files):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return stream.getvalue()


@pytest.mark.parametrize(
    "files",
    [
        {},
        {"a.txt": b"x"},
        {"a.shp": b"x"},
        {"a.shp": b"x", "a.dbf": b"y"},
        {"a.shp": b"", "a.dbf": b"", "b.shp": b""},
    ],
    ids=["empty", "no_shp", "no_dbf", "garbage", "two"],
)
def test_a_zip_that_holds_no_log_is_refused(tmp_path, files):
    (tmp_path / "a.zip").write_bytes(zipped(files))
    with pytest.raises(InputError):
        read_log(tmp_path / "a.zip")


def test_a_point_shapefile_reads_like_the_csv(tmp_path, small):
    shapefile = pytest.importorskip("shapefile")
    plain = read_log(small / "log.csv", small / "map.yaml")
    parts = {k: io.BytesIO() for k in ("shp", "shx", "dbf")}
    with shapefile.Writer(**parts, shapeType=shapefile.POINT) as writer:
        for name in ("machine", "time", "speed", "swath", "flow"):
            writer.field(name, "C" if name == "machine" else "N", 20, 0 if name == "machine" else 6)
        for row in MadeLog(passes=3).rows:
            writer.point(row["easting"], row["northing"])
            writer.record(*(row[k] for k in ("machine", "time", "speed", "swath", "flow")))
    from pyproj import CRS

    files = {f"log.{k}": v.getvalue() for k, v in parts.items()} | {
        "log.prj": CRS(32612).to_wkt("WKT1_ESRI").encode()
    }
    (tmp_path / "log.zip").write_bytes(zipped(files))
    log = read_log(tmp_path / "log.zip")
    np.testing.assert_allclose(log.east, plain.east, atol=1e-3)
    np.testing.assert_allclose(log.flow, plain.flow, atol=1e-3)
    assert find_columns(["flow"], tmp_path, None, has_points=True, needs={}).profile == "usual names"


@pytest.mark.draws
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    seed=st.integers(0, 2**32),
    cuts=st.integers(0, 60),
    mode=st.sampled_from(["byte", "line", "cell", "end", "gzip"]),
)
def test_corrupted_bytes_never_end_in_a_traceback(small, seed, cuts, mode):
    rng = random.Random(seed)
    data = bytearray((small / "log.csv").read_bytes())
    if mode == "gzip":
        data = bytearray(gzip.compress(bytes(data), mtime=0))
    for _ in range(cuts):
        at = rng.randrange(len(data))
        if mode in ("byte", "gzip"):
            data[at] = rng.randrange(256)
        elif mode == "line":
            data[at : at + rng.randrange(400)] = bytes(
                rng.choices(b'",;\n\r\t0-9.eEinfa', k=rng.randrange(40))
            )
        elif mode == "cell":
            data[at : at + 4] = rng.choice([b"nan", b",,", b"-1e99", b'"', b"1e400", b"\xff\xfe", b"9" * 30])
        else:
            del data[max(at, 1) :]
    path = small / "broken.csv"
    path.write_bytes(bytes(data))
    out = small / "out"
    try:
        import_log(path, out, columns=small / "map.yaml", progress=False)
    except SwathError:
        pass
    else:
        folder.read(out)
    assert not [p for p in small.iterdir() if p.name.startswith(".")]


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32), cuts=st.integers(1, 8))
def test_a_corrupted_field_folder_is_read_or_refused(small, seed, cuts):
    out = small / "kept"
    if not out.is_dir():
        import_log(small / "log.csv", out, columns=small / "map.yaml", progress=False)
    rng = random.Random(seed)
    name = rng.choice(["field.yaml", "boundary.geojson", "tracks.geojson", "density.tif"])
    whole = (out / name).read_bytes()
    data = bytearray(whole)
    for _ in range(cuts):
        data[rng.randrange(len(data))] = rng.randrange(256)
    (out / name).write_bytes(bytes(data))
    try:
        folder.read(out)
    except SwathError:
        pass
    finally:
        (out / name).write_bytes(whole)


def test_names_that_look_like_markup_are_only_names(tmp_path):
    rich = pytest.importorskip("rich.console")
    made = MadeLog(passes=3)
    for row in made.rows:
        row["machine"] = "a$b_$ [/red] \t 収穫"
    log = made.write(tmp_path / "$x^$.csv")
    (tmp_path / "map.yaml").write_text(COLUMNS)
    report = import_log(log, tmp_path / "f[bold", columns=tmp_path / "map.yaml", progress=False)
    assert folder.read(tmp_path / "f[bold").tracks[0].machine == "a$b_$ [/red] ? 収穫"
    console = rich.Console(width=120, file=io.StringIO())
    console.print(report)
    assert "[/red]" in console.file.getvalue()


def test_limits_are_in_the_unit_of_the_column(tmp_path):
    rows = "".join(f"{47 + 2e-5 * i:.7f},8.1,6,{70 + i % 9}\n" for i in range(100))
    path = tmp_path / "log.csv"
    path.write_text("lat,lon,width_m,yield_t_ha\n" + rows)
    with pytest.raises(InputError, match=r"yield_t_ha: 74 t/ha at the middle, expected 0 to 50, --columns"):
        import_log(path, tmp_path / "out", progress=False)
