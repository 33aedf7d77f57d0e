"""ISOXML time logs: what a writer after the standard wrote comes back; broken ones keep what is left."""

import csv
import gzip
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.errors import InputError, SwathError
from swath.field_io.logs.table import read_table
from swath.field_io.task_data.isoxml import is_taskdata, read_taskdata
from tests import shared_data
from tests.field.made_taskdata import HEADER, TASKDATA, record, simple_records, write

DATA = shared_data.DATA / "forage_harvester_isoxml"
real = pytest.mark.skipif(not DATA.is_dir(), reason="needs the forage harvester's time logs: SWATH_DATA")


def test_made_records_come_back(tmp_path):
    write(tmp_path / "a", {"TLG00001": b"".join(simple_records(50))})
    data = read_taskdata(tmp_path / "a")
    columns, (log,) = data.columns(), data.logs
    k = np.arange(50)
    assert data.problems == ()
    assert data.described.devices["DVC-1"].name == "Harvester"
    assert str(log.time[0]) == "2018-05-01T10:00:00.000"
    assert log.task == "TSK1"
    assert log.device == "DVC-1"
    np.testing.assert_allclose(columns["time_s"], k)
    np.testing.assert_allclose(columns["lat_deg"], 52.0 + 1.8e-5 * k, atol=1e-7)
    np.testing.assert_allclose(columns["lon_deg"], 9.0)
    np.testing.assert_allclose(columns["elevation_m"], 80.0)
    np.testing.assert_allclose(columns["crop_flow_kg_s"], 9.0 + 1e-3 * k)
    np.testing.assert_allclose(columns["moisture_pct"], 14.0)
    np.testing.assert_allclose(columns["speed_m_s"], 2.0)
    np.testing.assert_allclose(columns["engine_speed_rpm"], 1000.0 + k)  # scale 0.5 of the device
    np.testing.assert_allclose(columns["working_width_m"], 6.0)  # logged once, then held
    np.testing.assert_allclose(log.position["pdop"], 1.2)
    np.testing.assert_allclose(log.position["satellites"], 9)


def test_the_shape_of_the_records_follows_from_the_xml(tmp_path):
    import struct

    header = '<TIM A="" D="4"><PTN A="" B=""/><DLV A="0057" B="" C="DET-1"/></TIM>'
    data = b"".join(
        struct.pack("<IHiiBBi", 1000 * k, 14_000, 520_000_000, 90_000_000, 1, 0, k) for k in range(5)
    )
    write(tmp_path, {"TLG00007": data}, header=header)
    (log,) = read_taskdata(tmp_path).logs
    np.testing.assert_allclose(log.values[:, 0], 1e-6 * np.arange(5))
    assert np.isnan(log.up).all()
    assert log.position == {}


def test_logs_are_put_in_the_order_of_time(tmp_path):
    late, early = (b"".join(simple_records(4, days=d)) for d in (14_001, 14_000))
    write(tmp_path, {"TLG00001": late, "TLG00002": early})
    data = read_taskdata(tmp_path)
    assert [log.name for log in data.logs] == ["TLG00002", "TLG00001"]
    assert data.time[4] == 86_400.0
    assert data.columns()["log"][4] == "TLG00001"


def test_a_zip_with_a_folder_and_a_single_log(tmp_path):
    folder = write(tmp_path / "TASKDATA", {n: b"".join(simple_records(4)) for n in ("TLG00001", "TLG00002")})
    packed = tmp_path / "task.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for part in folder.iterdir():
            archive.write(part, f"TASKDATA/{part.name}")
    assert is_taskdata(packed)
    assert is_taskdata(folder)
    assert is_taskdata(folder / "TLG00002.bin")
    assert len(read_taskdata(packed)) == len(read_taskdata(folder)) == 8
    assert [log.name for log in read_taskdata(folder / "TLG00002.bin").logs] == ["TLG00002"]


def test_what_was_cut_off_is_said_with_file_and_byte(tmp_path):
    parts = simple_records(10)
    data = b"".join(parts)[:-3]
    write(tmp_path, {"TLG00001": data})
    read = read_taskdata(tmp_path)
    at = len(b"".join(parts[:9]))
    assert len(read) == 9
    assert read.logs[0].unread == len(parts[9]) - 3
    assert read.problems == (
        f"damaged: TLG00001.bin: byte {at}: expected a whole record, "
        f"the last {len(data) - at} bytes are none",
    )


def test_reading_goes_on_behind_broken_bytes(tmp_path):
    parts = simple_records(30)
    start, length = len(b"".join(parts[:10])), len(parts[10])
    data = bytearray(b"".join(parts))
    data[start : start + 8] = b"\xff" * 8
    write(tmp_path, {"TLG00001": bytes(data)})
    read = read_taskdata(tmp_path)
    want = np.delete(np.arange(30.0), 10)
    np.testing.assert_allclose(read.time, want)
    np.testing.assert_allclose(read.columns()["engine_speed_rpm"], 1000.0 + want)
    assert read.problems == (f"damaged: TLG00001.bin: byte {start}: no record, {length} bytes skipped",)


def test_a_missing_file_does_not_hide_the_others(tmp_path):
    write(tmp_path, {n: b"".join(simple_records(5)) for n in ("TLG00001", "TLG00002", "TLG00003")})
    (tmp_path / "TLG00001.bin").unlink()
    (tmp_path / "TLG00002.xml").unlink()
    read = read_taskdata(tmp_path)
    assert len(read) == 5
    assert any("TLG00001.bin" in p for p in read.problems)
    assert any("TLG00002.xml" in p for p in read.problems)


def test_task_data_cut_off_still_gives_its_logs(tmp_path):
    write(tmp_path, {"TLG00001": b"".join(simple_records(5))}, taskdata=TASKDATA.split("<TSK")[0])
    read = read_taskdata(tmp_path)
    assert len(read) == 5
    assert "TASKDATA.XML: byte" in read.problems[0]
    assert read.columns()["engine_speed_rpm"][2] == 1002.0


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda p: (p / "TASKDATA.XML").unlink(), "TASKDATA.XML"),
        (lambda p: (p / "TLG00001.bin").write_bytes(b""), "whole record"),
        (lambda p: (p / "TLG00001.xml").write_text("<TIM A='' D='4'><PTN"), "well-formed XML, byte"),
        (lambda p: (p / "TLG00001.xml").write_text(HEADER.replace('TIM A=""', 'TIM A="2020"')), "empty A"),
        (lambda p: (p / "TLG00001.xml").write_text(HEADER.replace("0043", "zz")), "hex"),
        (
            lambda p: (p / "TLG00001.xml").write_text('<!DOCTYPE a [<!ENTITY b "c">]>' + HEADER[39:]),
            "DOCTYPE",
        ),
    ],
)
def test_nothing_readable_is_an_error_that_says_why(tmp_path, change, expected):
    write(tmp_path, {"TLG00001": b"".join(simple_records(5))})
    change(tmp_path)
    with pytest.raises(InputError, match=expected):
        read_taskdata(tmp_path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write(tmp_path_factory.mktemp("iso"), {"TLG00001": b"".join(simple_records(12))})


@settings(max_examples=150)
@given(
    name=st.sampled_from(["TLG00001.bin", "TLG00001.bin", "TLG00001.xml", "TASKDATA.XML"]),
    at=st.integers(0, 1000),
    new=st.binary(max_size=40),
    length=st.integers(0, 60),
    end=st.integers(0, 1000),
)
def test_no_bytes_do_more_than_fail_cleanly(whole, name, at, new, length, end):
    file = whole / name
    data = file.read_bytes()
    try:
        at = min(at, len(data))
        file.write_bytes(
            (data[:at] + new + data[at + length :])[: max(1, len(data) - end) if end < 500 else None]
        )
        try:
            read = read_taskdata(whole)
        except SwathError:
            return
        columns = read.columns()
        assert all(len(c) == len(read) > 0 for c in columns.values())
        table = read_table(whole)
        assert len(table.row_number) == len(read)
    finally:
        file.write_bytes(data)


def test_an_import_of_a_made_log_gives_its_field(tmp_path):
    pytest.importorskip("rasterio")
    from swath.field_io.importer import import_log

    made = []
    for k in range(8):  # passes of 200 m, 6 m apart, north and back
        for j in range(101):
            north = 2.0 * (j if k % 2 == 0 else 100 - j)
            t = 1000 * (120 * k + j)
            place = (52.0 + north / 111_250.0, 9.0 + 6.0 * k / 68_680.0, 80.0)
            made.append(record(t, 14_000, *place, [(0, 6000), (1, 9_600_000), (2, 140_000), (3, 2000)]))
    folder = write(tmp_path / "task", {"TLG00001": b"".join(made)})
    report = import_log(folder, tmp_path / "field", progress=False)
    assert report.crop["yield_t_ha"] == pytest.approx(8.0, rel=0.01)  # 9.6 kg/s at 2 m/s and 6 m
    assert report.field["passes"] == 8


@pytest.fixture(scope="module")
def forage():
    return read_taskdata(DATA / "raw")


@pytest.fixture(scope="module")
def shipped():
    with gzip.open(DATA / "forage_harvester_1hz.csv.gz", "rt") as stream:
        return list(csv.DictReader(stream))


@real
def test_every_row_of_the_shipped_decode_is_read(forage, shipped):
    columns = forage.columns()
    assert len(forage) == len(shipped) == 61_314
    assert columns["log"] == [r["tlg"] for r in shipped]
    times = np.concatenate([log.time for log in forage.logs])
    assert times.astype("datetime64[s]").astype(str).tolist() == [r["t"].replace(" ", "T") for r in shipped]


@real
@pytest.mark.parametrize(
    ("ours", "theirs", "scale", "tolerance"),
    [
        ("lat_deg", "lat", 1, 1e-9), ("lon_deg", "lon", 1, 1e-9),
        ("working_width_m", "work_width_m", 1, 1e-9),
        ("crop_flow_kg_s", "crop_flow_kg_s", 1, 6e-4), ("yield_t_ha", "yield_t_ha", 1, 6e-4),
        ("moisture_pct", "moisture_pct", 1, 1e-9), ("work_state", "work_state", 1, 0),
        ("fuel_l_h", "fuel_l_h", 1, 6e-3),
        ("cut_length_mm", "cut_len_mm", 1, 1e-9), ("engine_speed_rpm", "engine_rpm", 1, 1e-9),
        ("engine_load_pct", "engine_load_pct", 1, 1e-9), ("speed_km_h", "speed_km_h", 1, 1e-5),
        ("header_speed_rpm", "header_rpm", 1, 1e-9), ("feed_speed_rpm", "feed_rpm", 1, 1e-9),
        ("drum_speed_rpm", "drum_rpm", 1, 1e-9), ("yield_total_t", "yield_total_t", 1, 1e-9),
        ("area_total_m2", "area_total_ha", 1e-4, 1e-9),
    ],
)  # fmt: skip
def test_values_equal_the_shipped_decode(forage, shipped, ours, theirs, scale, tolerance):
    want = np.array([float(r[theirs] or "nan") for r in shipped])
    got = forage.columns()[ours] * scale
    np.testing.assert_array_equal(np.isnan(got), np.isnan(want))
    assert np.nanmax(np.abs(got - want)) <= tolerance


@real
def test_units_of_the_standard_agree_with_what_the_device_declares():
    """Scaling from the table of identifiers against the device's own, through the units' definitions."""
    from swath.field_io.task_data.taskdata import read_description
    from swath.field_io.task_data.taskfiles import task_files

    with task_files(DATA / "raw") as found:
        described = read_description(found)
    per = {
        (87, "t/h"): 1 / 3.6,
        (67, "m"): 1,
        (84, "t/ha"): 1,
        (99, "Prozent"): 1,
        (149, "l/h"): 1,
        (90, "t"): 1,
    }
    from swath.field_io.task_data.ddi import DDI

    for (ddi, unit), factor in per.items():
        _, shown, scale, offset = described.values[described.owners["DET-1"], ddi]
        assert shown == unit
        assert offset == 0.0
        assert DDI[ddi].scale == pytest.approx(scale * factor, rel=1e-6)


@real
def test_a_cut_off_file_keeps_its_first_half(tmp_path, forage):
    for part in (DATA / "raw").iterdir():
        if part.stem in ("TASKDATA", "TLG00006"):
            (tmp_path / part.name).write_bytes(part.read_bytes())
    data = (tmp_path / "TLG00006.bin").read_bytes()
    (tmp_path / "TLG00006.bin").write_bytes(data[: len(data) // 2])
    read = read_taskdata(tmp_path)
    full = next(log for log in forage.logs if log.name == "TLG00006")
    assert 80 < len(read) < 110
    np.testing.assert_array_equal(read.logs[0].values, full.values[: len(read)])
    assert any("TLG00006.bin: byte" in p for p in read.problems)
