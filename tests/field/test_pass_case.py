"""The function test that an import writes: along passes that are straight from a common place on."""

import pytest

from tests.field.made_log import COLUMNS, MadeLog

pytest.importorskip("rasterio")

from swath.core.errors import InputError
from swath.field_io.folder import read
from swath.field_io.importer import Settings, import_log
from swath.field_io.pass_case import LENGTH_M, write_pass_case
from swath.field_io.pass_scenario import straight_stretches, write_pass_scenario
from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario
from swath.tools.function_test.case import read_case


def imported(folder, passes):
    log = MadeLog(passes=passes, delay_s=0.0)
    log.write(folder / "log.csv")
    (folder / "map.yaml").write_text(COLUMNS)
    settings = Settings(flow_delay_s=0.0)
    import_log(
        folder / "log.csv", folder / "f", columns=folder / "map.yaml", settings=settings, progress=False
    )
    write_pass_scenario(folder / "f")
    return folder / "f"


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    return imported(tmp_path_factory.mktemp("made"), passes=5)


def test_every_pass_of_the_case_is_straight_as_far_as_it_is_driven(field):
    case = read_case(write_pass_case(field))
    start = case.file.set["combine.start.along_edge_m"]
    passes = case.file.vary["pass"].at
    assert passes == [1, 2, 3], "the outermost have no header width of crop on both sides"
    stretches = {track.index: (begin, end) for track, begin, end in straight_stretches(read(field))}
    for number in passes:
        begin, end = stretches[number]
        assert begin <= start
        assert start + LENGTH_M < end


def test_each_of_its_runs_starts_inside_the_field(field):
    case = read_case(write_pass_case(field))
    for number in (0, case.grid_size - 1):
        sets = [*case.sets(case.grid_point(number)), "combine.lidar=off", "combine.edge=truth"]
        scenario = load_scenario(case.scenario, sets=sets)
        assert scenario.run.distance_m == LENGTH_M
        assert any(limit.name == "lateral_rms_m" for limit in scenario.expect)
        assemble(scenario).close()


def test_too_few_passes_are_said(tmp_path):
    with pytest.raises(InputError, match="at least 3 passes"):
        write_pass_case(imported(tmp_path, passes=2))
