"""`swath dataset --scans`: rows of what a detector is given and the truth beside it, the same bytes again."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.sensing.labels import Label
from swath.tools.dataset.scans import file_of, is_there, make_scans, settings_of, write_drive

LIDAR = "combine.lidar={level: empirical, sector_deg: [-60, 60], step_deg: 2, rate_hz: 25}"
FEW = ("run.max_duration_s=1.5", "combine.motion.start_speed_kmh=5", LIDAR)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out, settings = tmp_path_factory.mktemp("scans"), settings_of("straight", count=2, sets=FEW)
    assert write_drive(settings, out, 0) == 0
    return file_of(out, 0)


def test_a_row_is_what_a_detector_is_given_and_the_truth_beside_it(made):
    table = pq.read_table(made)
    about = json.loads(table.schema.metadata[b"swath"])
    rows = {name: np.array(table[name].to_pylist()) for name in table.column_names}
    beams = len(about["azimuth_rad"])
    assert rows["ranges_m"].shape == rows["label"].shape == (table.num_rows, beams)
    assert (np.isnan(rows["ranges_m"]) == (rows["label"] == Label.NONE)).all()
    points = rows["points_m"].reshape(-1, beams, 3)
    far = np.linalg.norm(points - [about["mount"][k] for k in "xyz"], axis=2)
    assert np.nanmax(np.abs(far - rows["ranges_m"])) < 1e-4
    assert about["labels"][Label.OWN_MACHINE] == "own_machine"
    assert rows["edge_m"].shape == (table.num_rows, len(about["edge_x_m"]))
    # the initial edge of `straight` is the line x = 0 of the world, along y
    x, yaw = (rows[f"pose.{k}"][:, None] for k in ("x", "yaw"))
    east = x + np.cos(yaw) * about["edge_x_m"] - np.sin(yaw) * rows["edge_m"]
    assert np.nanmax(np.abs(east)) < 0.03
    assert np.isfinite(rows["edge_m"]).mean() > 0.9
    assert np.ptp(rows["odometry.speed"]) > 0.1
    assert sum(change.startswith("field.seed=") for change in about["sets"]) == 1
    assert not any(
        change.startswith("combine.lidar=") for change in about["sets"]
    )  # what was set is not drawn


def test_the_class_in_the_docs_gives_rows(made):
    """With PyTorch where it is installed, else as a plain class, as the page says."""
    page = (Path(__file__).parents[2] / "docs/how-to/python.md").read_text()
    known = {}
    exec(next(code for code in page.split("```") if "class Scans(" in code).removeprefix("python"), known)
    scans = known["Scans"]([made])
    ranges, label, edge = scans[len(scans) - 1]
    assert len(scans) == pq.read_table(made).num_rows
    assert ranges.shape == label.shape == (len(scans.about["azimuth_rad"]),)
    assert len(edge) == len(scans.about["edge_x_m"])


@pytest.mark.draws
def test_drives_differ_and_are_the_same_bytes_in_any_order(made, tmp_path):
    settings = settings_of("straight", count=2, sets=FEW)
    whole = make_scans(settings, tmp_path / "whole", workers=1)
    first, second = (file.read_bytes() for file in whole)
    assert first != second
    assert first == made.read_bytes()
    (tmp_path / whole[0].name).write_bytes(second)  # a file of another drive
    (tmp_path / whole[1].name).write_bytes(second[: len(second) // 2])
    assert not is_there(tmp_path, 0)
    assert not is_there(tmp_path, 1)
    again = make_scans(settings, tmp_path, workers=2)
    assert [file.read_bytes() for file in again] == [first, second]


@pytest.mark.draws
@pytest.mark.parametrize("fault", ["latency_ms: 200", "hold_s: [[0.5, 9]]"])
def test_a_scan_that_is_not_the_newest_has_labels_that_nobody_knows(fault, tmp_path):
    sets = (*FEW, f"combine.lidar.fault={{{fault}}}")
    assert write_drive(settings_of("straight", count=1, sets=sets), tmp_path, 0) == 0
    table = pq.read_table(file_of(tmp_path, 0))
    late = table["t_s"].to_numpy() > 0.52
    labels = np.array(table["label"].to_pylist())[late]
    assert set(np.unique(labels)) <= {Label.NONE, Label.UNKNOWN}
    if "latency" in fault:
        assert np.allclose(table["t_s"].to_numpy() - table["scan_t_s"].to_numpy(), 0.2)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"count": 0}, "--count = 0: expected >= 1"),
        ({"count": 1, "places": (-1.0,)}, "--places-m"),
        ({"count": 1, "sets": ("combine.lidar=ros2",)}, "expected a scanner that is simulated"),
        (
            {"count": 1, "sets": ("combine.lidar=off", "combine.edge=truth")},
            "expected a scenario with a machine",
        ),
    ],
)
def test_what_cannot_be_recorded_is_refused(given, said):
    with pytest.raises(InputError, match=said):
        settings_of("straight", **given)


@pytest.mark.draws
def test_the_command_writes_drives(tmp_path, capsys):
    sets = [text for change in FEW for text in ("--set", change)]
    command = [
        "dataset",
        "straight",
        "--scans",
        "--count",
        "1",
        "--out",
        str(tmp_path / "s"),
        "--workers",
        "1",
    ]
    assert main([*command, "--places-m", "2,5", *sets]) == 0
    assert capsys.readouterr().out.strip() == str(file_of(tmp_path / "s", 0))
    about = json.loads(pq.read_schema(file_of(tmp_path / "s", 0)).metadata[b"swath"])
    assert len(about["edge_x_m"]) == 2
    assert main([*command, "--width-px", "100"]) == 2
    assert "--width-px" in capsys.readouterr().err


def test_a_row_crop_stays_one():
    assert "stand" in settings_of("straight", count=1).varies
    assert "stand" not in settings_of("forage-maize", count=1).varies
