"""The scenario that an import writes runs as it is."""

import pytest

from tests.field.made_log import COLUMNS, MadeLog

pytest.importorskip("rasterio")

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


def test_without_a_straight_pass_it_goes_through_the_middle(field):
    tracks = field / "tracks.geojson"
    text = tracks.read_text()
    tracks.write_text(text.replace('"straights":[{', '"straights":[],"former":[{'))
    scenario = load_scenario(write_pass_scenario(field))
    assert scenario.name == "f-middle"
    assemble(scenario).close()
