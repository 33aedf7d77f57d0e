"""Data sheets of the user: plain numbers, all mistakes at once, and the command that checks them."""

import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.documents.data_sheets import KINDS, find_sheet, read_sheet, sheet_names
from swath.field.crop_sheet import load_crop
from swath.sensing.camera.camera_sheet import load_camera
from swath.sensing.ground_speed.radar import load_ground_radar
from swath.sensing.lidar_sheet import load_lidar

SCANNER = """format: swath sensor 2
name: Workshop scanner
kind: lidar
wavelength_nm: 905
scan:
  field_of_view_deg: [-95, 95]
  step_deg: 0.5
  rates_hz: [25]
  line_elevation_deg: [0.0]
beam:
  profile: uniform
  convention: full_angle
  contour: edge
  exit_mm: [8, 8]
  divergence_mrad: [12, 12]
range:
  min_m: 0.1
  max_m: 30
  reach_10_percent_m: 15
  noise_mm: [[5, 12], [20, 20]]
  systematic_mm: 25
  resolution_mm: 1
"""


def test_a_sheet_of_plain_numbers_is_as_good(tmp_path, capsys):
    (tmp_path / "own.yaml").write_text(SCANNER)
    assert load_lidar("own.yaml", tmp_path).name == "Workshop scanner"
    assert main(["sheets", "check", str(tmp_path / "own.yaml")]) == 0
    assert "a sensor with 13 numbers, 13 of them without a source" in capsys.readouterr().out


def test_all_mistakes_of_a_sheet_are_said_at_once_in_the_units_of_their_keys(tmp_path, capsys):
    wrong = SCANNER.replace("step_deg: 0.5", "step_deg: -1").replace(
        "systematic_mm: 25\n", "systematc_mm: 25\n"
    )
    wrong = wrong.replace("divergence_mrad: [12, 12]", "divergence_mrad: [1200, 12]")
    (tmp_path / "own.yaml").write_text(
        wrong.replace("resolution_mm: 1", "resolution_mm: {value: 1, unit: mm}")
    )
    assert main(["sheets", "check", str(tmp_path / "own.yaml")]) == 2
    lines = capsys.readouterr().err.splitlines()
    for part in (
        "scan.step_deg = -1",
        "range.systematc_mm",
        "did you mean 'systematic_mm'",
        "expected <= 100",
        "range.resolution_mm.unit",
    ):
        assert any(part in line for line in lines), part
    assert all("own.yaml:" in line for line in lines)


@pytest.mark.parametrize("load", [load_lidar, load_camera, load_ground_radar])
def test_a_sheet_of_another_kind_is_one_line(load):
    """Not one for each of its keys, which the kind explains."""
    with pytest.raises(InputError, match="kind = radar: expected one of") as caught:
        load("radar-77ghz-front")
    assert caught.value.others == ()


def test_check_names_what_is_no_sheet(tmp_path, capsys):
    (tmp_path / "a.yaml").write_text("name: x\n")
    assert main(["sheets", "check", str(tmp_path / "a.yaml")]) == 2
    assert "expected one of format: swath sensor 2" in capsys.readouterr().err
    assert main(["sheets", "wheat", "rye"]) == 2


def test_numbers_of_an_own_crop_may_be_plain(tmp_path):
    text = find_sheet("crops", "wheat").read_text()
    import re

    plain = re.sub(r"\{value: ([^,}]+|\[[^]]*\]), [^}]*\}", r"\1", text)
    (tmp_path / "plain.yaml").write_text(plain)
    assert "tag:" not in plain
    made, own = load_crop("plain.yaml", tmp_path), load_crop("wheat")
    assert (made.stand, made.yields, made.reflectance) == (own.stand, own.yields, own.reflectance)


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in KINDS for name in sheet_names(kind)])
def test_every_bundled_number_says_where_it_comes_from(kind, name):
    entries = read_sheet(kind, name).numbers()
    assert not [key for key, entry in entries.items() if not (entry.get("tag") and entry.get("source"))]
