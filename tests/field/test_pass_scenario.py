"""The scenario that an import writes runs as it is."""

import re
import shutil

import numpy as np
import pytest

from tests.field.made_log import COLUMNS, MadeLog
from tests.field.unit_logs import Harvest, table

pytest.importorskip("rasterio")

from swath.commands.main import main
from swath.field_io.folder import read
from swath.field_io.importer import Settings, import_log
from swath.field_io.pass_scenario import write_pass_scenario
from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """Of a log that ends where the crop ends, so that passes reach the outline, and without moisture."""
    folder, log = tmp_path_factory.mktemp("made"), MadeLog(passes=4, delay_s=0.0)
    log.rows = [row for row in log.rows if row["flow"] > 0.3]
    log.write(folder / "log.csv", drop=("moisture",))
    (folder / "map.yaml").write_text("".join(c for c in COLUMNS.splitlines(True) if "moisture" not in c))
    settings = Settings(flow_delay_s=0.0)
    import_log(
        folder / "log.csv", folder / "f", columns=folder / "map.yaml", settings=settings, progress=False
    )
    return folder / "f"


def test_machine_and_run_keep_inside_the_field(field):
    scenario = load_scenario(write_pass_scenario(field))
    assert scenario.run.distance_m == 150.0
    assemble(scenario).close()


@pytest.mark.parametrize("name", ["Schläge Süd 1", "-ост-", "f" * 90, "Feld.1"])
def test_any_folder_gives_its_scenario_a_name(field, tmp_path, name):
    found = load_scenario(write_pass_scenario(shutil.copytree(field, tmp_path / name))).name
    assert re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", found)


@pytest.mark.parametrize(("records", "width"), [(60, 9.0), (90, 2.0)])
def test_a_single_pass_has_heights_and_says_why_nothing_drives_there(tmp_path, capsys, records, width):
    h = Harvest(passes=1, width=width)
    table(tmp_path / "log.csv", {
        **h.places(), "time_s": h.t, "width_m": width * h.one, "yield_t_ha": 10 * h.wet, "elevation_m": h.z,
    })  # fmt: skip
    lines = (tmp_path / "log.csv").read_text().splitlines()
    (tmp_path / "log.csv").write_text("\n".join(lines[: records + 1]))
    out = tmp_path / "f"
    assert main(["field", "import", str(tmp_path / "log.csv"), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "the field is no wider than the header there" in said
    made = read(out)
    assert 0.02 * 2.0 * (records - 25) < np.ptp(made.terrain.values) < 0.02 * 2.0 * records + 3.0
    mapped = made.info["crop"]["grain_on_map_kg"] / made.info["crop"]["grain_logged_kg"]
    assert mapped == pytest.approx(made.info["field"]["area_ha"] * 1e4 / (2.0 * width * records), rel=0.05)


def test_heights_of_few_records_are_told(tmp_path):
    h = Harvest(passes=3)
    heights = np.where(np.arange(len(h)) < 100, h.z, np.nan)
    table(tmp_path / "log.csv", {
        **h.places(), "time_s": h.t, "width_m": 9 * h.one, "yield_t_ha": 10 * h.wet, "elevation_m": heights,
    })  # fmt: skip
    report = import_log(tmp_path / "log.csv", tmp_path / "f", progress=False)
    assert re.fullmatch(r"flat: 100 of 270 records have a height", report.terrain["source"])


def test_without_a_straight_pass_it_goes_through_the_middle(field):
    tracks = field / "tracks.geojson"
    text = tracks.read_text()
    tracks.write_text(text.replace('"straights":[{', '"straights":[],"former":[{'))
    scenario = load_scenario(write_pass_scenario(field))
    assert scenario.name == "f-middle"
    assemble(scenario).close()
