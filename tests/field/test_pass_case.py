"""The function test that an import writes: along passes that are straight from a common place on."""

import numpy as np
import pytest

from tests.field.made_log import COLUMNS, MadeLog

pytest.importorskip("rasterio")

from swath.core.errors import InputError
from swath.field.edges.boundary import Region
from swath.field_io.folder import read
from swath.field_io.importer import Settings, import_log
from swath.field_io.pass_case import LENGTH_M, write_pass_case
from swath.field_io.pass_scenario import edge_offset, straight_stretches, write_pass_scenario
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
    assert {1, 2, 3} <= set(passes), "the outermost may have a header end outside the field"
    imported = read(field)
    stretches = {track.index: (track, begin, end) for track, begin, end in straight_stretches(imported)}
    ground = Region(imported.boundary, imported.holes)
    for number in passes:
        track, begin, end = stretches[number]
        assert begin <= start
        assert start + LENGTH_M < end
        along = (track.line[-1] - track.line[0]) / np.hypot(*(track.line[-1] - track.line[0]))
        left = np.array([-along[1], along[0]])
        for s in (start, start + LENGTH_M):
            ends = [track.line[0] + s * along + across * left for across in side_ends(track)]
            assert ground.contains(*np.transpose(ends)).all(), number


def side_ends(track):
    """Both ends of the header, a little inside of them (m to the left): outlines are of cells."""
    return edge_offset(track) - 0.2, edge_offset(track) - track.header_width + 0.2


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
