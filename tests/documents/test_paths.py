"""A path with a null character is a path of no file, wherever it stands."""

from pathlib import Path

import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.documents.data_sheets import read_sheet
from swath.documents.yaml_document import read_document
from swath.field.mesh_file import read_mesh
from swath.field_io.folder import read
from swath.field_io.logs.log import read_log
from swath.field_io.outline import read_outlines
from swath.record.read.files import open_log
from swath.record.tracks import read_tracks
from swath.runtime.changes import read_events
from swath.scenario.scenario import load_scenario, parse_scenario
from swath.sensing.tables import load_table
from swath.tools.lab.measured_heights import read_measured

NUL = "a\0b.yaml"
READERS = {
    "document": lambda: read_document(Path(NUL)),
    "sheet": lambda: read_sheet("sensors", NUL),
    "scenario": lambda: load_scenario(NUL),
    "field folder": lambda: read(NUL),
    "log": lambda: read_log(Path(NUL)),
    "outline": lambda: read_outlines(Path(NUL), 32612).areas[0],
    "mesh": lambda: read_mesh(Path(NUL), key="file"),
    "recording": lambda: open_log(Path(NUL)),
    "tracks": lambda: read_tracks(Path(NUL)),
    "events": lambda: read_events(Path(NUL)),
    "table": lambda: load_table("a\0b.npz"),
    "heights": lambda: read_measured(Path(NUL)),
}


@pytest.mark.parametrize("name", READERS)
def test_every_reader_refuses_it(name):
    with pytest.raises(InputError) as caught:
        READERS[name]()
    assert str(caught.value).isprintable()


HEAD = "format: swath scenario 2\nfield: {edge: {shape: straight}}\n"
PLACES = {
    "evaluator": HEAD + 'evaluators: ["a\\0b.py:X"]\nmachines: {combine: {}}\n',
    "level": HEAD + 'machines: {combine: {steering: {level: "a\\0b.py:X"}}}\n',
    "machine": HEAD + 'machines: {combine: {machine: "a\\0b.yaml"}}\n',
    "file": HEAD + 'machines: {combine: {lidar: {level: replay, file: "a\\0b"}}}\n',
    "folder": 'format: swath scenario 2\nfield: {folder: "a\\0b"}\nmachines: {combine: {}}\n',
}


@pytest.mark.parametrize("place", PLACES)
def test_every_place_in_a_scenario_refuses_it(place):
    with pytest.raises(InputError, match=r"a\\x00b"):
        parse_scenario(PLACES[place], base=Path("/nowhere"))


def test_the_command_line_ends_with_bad_input(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text(PLACES["evaluator"])
    assert main(["run", "s.yaml"]) == 2
    assert len(capsys.readouterr().err) <= 320


@pytest.mark.parametrize("time", ["1e999", '"soon"', "true", "null", "-1", "1" + "0" * 400])
def test_an_event_without_a_time_is_refused(tmp_path, time):
    file = tmp_path / "events.json"
    file.write_text(f'[{{"t_s": {time}, "set": "a.b", "value": 1}}]')
    with pytest.raises(InputError, match=r"expected events with t_s|a whole number of 401 digits"):
        read_events(file)
