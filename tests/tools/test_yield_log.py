"""A run's yield log: what it weighs is what the machine took in, and an import reads it back."""

import json
import os
import shutil
import subprocess
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyproj")

from swath import load_scenario
from swath.commands.main import main
from swath.core.errors import InputError
from swath.field_io.logs.log import read_log
from swath.record.tracks import read_tracks
from swath.runtime.job import run_job
from swath.tools.yield_log.records import records_of


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """35 s along the straight edge: long enough that grain has passed the whole machine."""
    out = tmp_path_factory.mktemp("run") / "r"
    sets = ["run.distance_m=62", "combine.lidar=off", "combine.edge=truth", "expect={}"]
    run_job(load_scenario("straight", sets=sets), out, progress=False)
    return out


def test_the_log_holds_the_grain_that_came_into_the_tank(run):
    log, tracks = records_of(run), read_tracks(run / "tracks.parquet")
    grown = tracks["tank_grain_kg"][-1] - tracks["tank_grain_kg"][0]
    assert log.grain_kg == pytest.approx(grown, rel=0.06)  # of the last second only the whole ones
    assert log.crop == "wheat"


def test_a_sensor_further_on_shifts_the_flow_alone(run):
    near, far = records_of(run), records_of(run, delay=4.0)
    np.testing.assert_allclose(far.flow[4:], near.flow[:-4], atol=1e-9)
    np.testing.assert_array_equal(far.lat, near.lat)


@pytest.mark.parametrize("name", ["log.csv", "TASKDATA"])
def test_an_import_reads_back_what_was_written(run, tmp_path, capsys, name):
    if name == "TASKDATA":
        pytest.importorskip("isoxml", reason="needs the extra geo: isoxml")
    assert main(["yield-log", str(run), "--out", str(tmp_path / name), "--origin", "48.1,11.2"]) == 0
    assert "records" in capsys.readouterr().out
    made, log = records_of(run, at=(48.1, 11.2)), read_log(tmp_path / name)
    assert log.crop == "wheat"
    np.testing.assert_allclose(log.width, made.width, atol=1e-3)
    np.testing.assert_allclose(log.speed, made.speed, atol=2e-3)
    np.testing.assert_allclose(log.flow, np.where(made.working, made.flow, 0.0), atol=1e-4)
    np.testing.assert_allclose(log.elevation, made.height, atol=1e-3)
    tracks = read_tracks(run / "tracks.parquet")
    driven = np.hypot(np.diff(log.east), np.diff(log.north)).sum()
    assert driven == pytest.approx(tracks["distance_m"][-1], rel=0.05)
    assert 48.09 < np.median(made.lat) < 48.11


@pytest.fixture(scope="module")
def isoxml(run, tmp_path_factory):
    pytest.importorskip("isoxml", reason="needs the extra geo: isoxml")
    folder = tmp_path_factory.mktemp("iso") / "TASKDATA"
    assert main(["yield-log", str(run), "--out", str(folder), "--origin", "48.1,11.2"]) == 0
    return folder


@pytest.mark.parametrize(
    ("file", "schema"), [("TASKDATA.XML", "TaskFile"), ("TLG00001.xml", "TimeLog")]
)  # fmt: skip
def test_isoxml_is_valid_by_the_schema_of_the_standard(isoxml, file, schema):
    """ISO 11783-10, schema 4.3, as isoxml-writer brings it."""
    etree = pytest.importorskip("lxml.etree")
    home = Path(pytest.importorskip("isoxml_writer").__file__).parent / "ISOXML_schema"
    rules = etree.XMLSchema(etree.parse(str(home / f"ISO11783_{schema}_V4-3.xsd")))
    assert rules.validate(etree.parse(str(isoxml / file))), rules.error_log


def test_another_reader_finds_field_crop_machine_and_log(isoxml, run):
    from isoxml.models.base import v4
    from isoxml.util.isoxml_io import isoxml_from_path

    made = records_of(run)
    data, binaries = isoxml_from_path(isoxml)
    (device,), (field,), (task,) = data.devices, data.partfields, data.tasks
    assert field.crop_type_id_ref == data.crop_types[0].id
    assert data.crop_types[0].designator == "wheat"
    assert task.partfield_id_ref == field.id
    assert field.area == pytest.approx((made.distance * made.width)[made.working].sum(), abs=0.5)
    assert task.status == v4.TaskStatus.Completed
    assert [int.from_bytes(d.ddi, "big") for d in device.process_data] == [67, 87, 99, 141, 397]
    assert len(binaries[task.time_logs[0].filename]) == len(made.time) * (19 + 1 + 5 * 5)


NODE = """
const { createRequire } = require('module')
const at = createRequire(process.env.NODE_PATH + '/')
const { readdirSync, readFileSync } = require('fs')
const { ISOXMLManager } = at('isoxml'), JSZip = at('jszip'), zip = new JSZip(), manager = new ISOXMLManager()
const folder = process.argv[1]
for (const f of readdirSync(folder)) zip.file('TASKDATA/' + f, readFileSync(folder + '/' + f))
zip.generateAsync({ type: 'uint8array' })
  .then(data => manager.parseISOXMLFile(data, 'application/zip'))
  .then(() => {
    const log = manager.rootElement.attributes.Task[0].attributes.TimeLog[0].parseBinaryFile()
    console.log(JSON.stringify([manager.getWarnings().map(String), log.timeLogs]))
  })
"""


def test_npm_isoxml_reads_every_record_without_a_warning(isoxml, run):
    """Where node and the package are: NODE_PATH names the folder node_modules that holds isoxml."""
    home = os.environ.get("NODE_PATH", "")
    if shutil.which("node") is None or not (Path(home) / "isoxml").is_dir():
        pytest.skip("needs node, and NODE_PATH with the npm package isoxml")
    done = subprocess.run(["node", "-e", NODE, str(isoxml)], capture_output=True, text=True, check=True)
    warnings, found = json.loads(done.stdout)
    made = records_of(run, at=(48.1, 11.2))
    assert warnings == []
    values = np.array([[r["values"][f"{ddi:04X}_DET1"] for ddi in (67, 87, 99, 397)] for r in found])
    want = np.column_stack(
        [
            np.full(len(made.time), made.width),
            made.flow,
            np.full(len(made.time), 100 * made.moisture),
            made.speed,
        ]
    )
    np.testing.assert_allclose(values * (1e-3, 1e-6, 1e-4, 1e-3), want, atol=6e-4)
    at = np.array([[r["position"][f"Position{k}"] for k in ("North", "East", "Up")] for r in found])
    np.testing.assert_allclose(at[:, :2], np.column_stack([made.lat, made.lon]), atol=1e-7)
    np.testing.assert_allclose(1e-3 * at[:, 2], made.height, atol=1e-3)
    times = [datetime.fromisoformat(r["time"]) for r in found]
    assert [(t - times[0]).total_seconds() for t in times] == pytest.approx(made.time - made.time[0])


def test_what_is_no_run_or_no_place_is_refused(run, tmp_path):
    with pytest.raises(InputError, match=r"tracks\.parquet"):
        records_of(tmp_path)
    with pytest.raises(InputError, match="expected a harvester of the run: combine"):
        records_of(run, machine="cart")
    assert main(["yield-log", str(run), "--out", str(tmp_path / "x.csv"), "--origin", "here"]) == 2
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter").write_text("dear")
    assert main(["yield-log", str(run), "--out", str(tmp_path / "full")]) == 2
