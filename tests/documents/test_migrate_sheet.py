"""Data sheets of version 0.1 in their new form: nothing of what they say is lost."""

import re
from pathlib import Path

import pytest

from swath.core.errors import InputError
from swath.documents.data_sheets import find_sheet, sheet_names
from swath.documents.migrate_sheet import migrate_sheet
from swath.field.crop_sheet import load_crop
from swath.field.plants.branched import PodFacts
from swath.machine.machine_sheet import load_machine
from swath.sensing.lidar_sheet import load_lidar

LIDAR = """\
# My own scanner.
name: mine
kind: lidar
wavelength_nm: {value: 905, unit: nm, tag: M+, source: "from memory"}
scan:
  field_of_view_deg: {value: [-90, 90], unit: deg, tag: S, source: "manual, page 3"}  # both ends
  step_deg: {value: 0.50, unit: deg, tag: M/E, source: "leaflet, from memory"}
  rates_hz: {value: [25], unit: Hz, tag: S, source: manual}
  line_elevation_deg: {value: [0.0], unit: deg, tag: D, source: a plane}
beam:
  profile: gaussian
  convention: full_angle
  contour: edge
  exit_mm: {value: [8, 8], unit: "mm, diameter across and along", tag: S, source: manual}
  divergence_mrad: {value: [15, 15], unit: mrad, tag: S, source: manual}
range:
  min_m: {value: 0.5, unit: m, tag: S, source: manual}
  max_m: {value: 20, unit: m, tag: S, source: manual}
  reach_10_percent_m: {value: 18, unit: m, tag: S, source: manual}
  noise_mm: {value: [[0.5, 6], [20, 12]], unit: "m, mm one sigma", tag: S, source: manual}
  noise_by_signal: {value: [[12, 100], [250, 15]], unit: "ratio, mm", tag: S, source: manual}
  systematic_mm: {value: 30, unit: "mm, half band", tag: S, source: manual}
  resolution_mm: {value: 1, unit: mm, tag: S, source: manual}
"""


def test_a_scanner_keeps_numbers_notes_and_comments(tmp_path):
    text = migrate_sheet(LIDAR)
    (tmp_path / "mine.yaml").write_text(text)
    sheet = load_lidar("mine.yaml", tmp_path)
    assert (sheet.name, sheet.range_10, sheet.echo_count) == ("mine", 18.0, 1)
    assert sheet.signal_noise.tolist() == [[12.0, 0.1], [250.0, 0.015]]
    assert text.startswith("# My own scanner.\nformat: swath sensor 2\nname: mine\n")
    assert re.search(r'source: "manual, page 3"} +# both ends', text)
    assert "note: diameter across and along" in text
    assert '  step_deg: {value: 0.50, tag: U, source: "leaflet, not looked up"}' in text
    assert "memory" not in text
    assert "unit" not in text


def test_a_sheet_in_the_new_form_stays_as_it_is():
    for kind in ("sensors", "machines", "crops"):  # those that 0.1 had
        for name in sheet_names(kind):
            if "radar" in name or "camera" in name:
                continue
            text = find_sheet(kind, name).read_text(encoding="utf-8")
            assert migrate_sheet(text) == text


def old_crop(name: str, **units: tuple[str, float]) -> str:
    """A bundled crop written as in version 0.1: units beside the numbers; some of them other than usual."""
    symbols = {
        "percent": "%",
        "per_m2": "1/m2",
        "kg_m3": "kg/m3",
        "cm": "cm",
        "mm": "mm",
        "deg": "deg",
        "g": "g",
    }
    lines = []
    for line in find_sheet("crops", name).read_text(encoding="utf-8").splitlines():
        match = re.match(r"(  \w+?)(?:_(percent|per_m2|kg_m3|cm|mm|deg|g))?: \{value: ([^,]+), (.*)", line)
        if match is None:
            lines.append(line)
            continue
        key, unit, value = match[1], symbols.get(match[2] or "", "1"), match[3]
        if key.strip() in units:
            unit, factor = units[key.strip()]
            value = f"{float(value) * factor:.12g}"
        lines.append(f'{key}: {{value: {value}, unit: "{unit}", {match[4]}'.replace("tag: U", "tag: M"))
    return "\n".join(line for line in lines if not line.startswith("format:")) + "\n"


@pytest.mark.parametrize("name", sheet_names("crops"))
def test_crops_are_read_the_same(tmp_path, name):
    (tmp_path / "own.yaml").write_text(migrate_sheet(old_crop(name)))
    assert load_crop("own.yaml", tmp_path) == load_crop(name)


def test_a_crop_in_other_units_is_converted(tmp_path):
    text = old_crop("wheat", height=("m", 0.01), tiller_spread=("cm", 0.1), height_cv=("1", 0.01))
    assert "height: {value: 0.85, unit" in text
    (tmp_path / "own.yaml").write_text(migrate_sheet(text))
    mine, ours = load_crop("own.yaml", tmp_path), load_crop("wheat")
    assert mine.stand == ours.stand


def test_a_spread_of_pods_is_what_version_0_1_made_of_it(tmp_path):
    """It was rounded to a whole share: 30 % was none."""
    text = old_crop("rape").replace("per_plant_cv: {value: 0,", "per_plant_cv: {value: 30,")
    (tmp_path / "own.yaml").write_text(migrate_sheet(text))
    assert load_crop("own.yaml", tmp_path).organs[PodFacts].per_plant_cv == 0.0


OLD_TRACTOR = """\
header:
  width_m: {value: 2.6, unit: m, tag: E, source: no header}
  knife_x_m: {value: 4.6, unit: "m ahead of the fixed axle", tag: E, source: no header}
  offset_m: {value: 0.0, unit: "m, leftward", tag: E, source: no header}
  body_height_m: {value: 0.0, unit: m, tag: E, source: no header}
  body_depth_m: {value: 0.0, unit: m, tag: E, source: no header}
"""


def test_a_tractor_loses_its_stand_in_for_a_header(tmp_path):
    text = find_sheet("machines", "tractor-grain-cart").read_text(encoding="utf-8")
    old = text.replace("format: swath machine 2\n", "").replace(
        "type: tractor_with_trailer\n", "kind: machine\n"
    )
    (tmp_path / "own.yaml").write_text(migrate_sheet(old.replace("trailer:", "cart:") + OLD_TRACTOR))
    assert load_machine("own.yaml", base=tmp_path) == load_machine("tractor-grain-cart")


@pytest.mark.parametrize(
    ("name", "kind"), [("lexion-700-class", "combine"), ("forage-harvester-class", None)]
)
def test_machines_say_their_type(tmp_path, name, kind):
    text = find_sheet("machines", name).read_text(encoding="utf-8")
    kept = [line for line in text.splitlines(keepends=True) if not line.startswith(("format:", "type:"))]
    (tmp_path / "own.yaml").write_text(migrate_sheet("".join(kept)))
    machine = load_machine("own.yaml", base=tmp_path)
    assert machine.type == (kind or "forage_harvester")
    assert machine == load_machine(name)


@pytest.mark.parametrize("text", ["", "a: 1\n", "- 1\n", "a: [1\n"])
def test_what_is_no_sheet_is_refused(text):
    with pytest.raises(InputError):
        migrate_sheet(text)


def test_the_bundled_sheets_speak_of_no_memory():
    for file in Path(find_sheet("crops", "wheat")).parents[1].rglob("*.yaml"):
        assert "memory" not in file.read_text(encoding="utf-8"), file
