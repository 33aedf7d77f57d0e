"""swath from Python: what `import swath` offers, and the example that makes many runs."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

import swath
from swath.core.errors import InputError
from swath.documents.yaml_document import read_document
from swath.scenario.scenario import Scenario

EXAMPLE = Path(__file__).parents[1] / "examples" / "many_runs.py"
TINY = {
    "run.distance_m": 1,
    "run.record": "standard",
    "combine.lidar.sub_rays": 1,
    "combine.lidar.step_deg": 2.0,
    "combine.motion.start_speed_kmh": 7,
}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return swath.run("straight", tmp_path_factory.mktemp("runs") / "r", sets=TINY, seed=5, report=False)


def test_a_run_from_python(result):
    assert result.summary["seed"] == 5
    assert (result.folder / "summary.json").is_file()
    assert not (result.folder / "report.html").exists()
    resolved = read_document(result.folder / "scenario.yaml").data
    assert resolved["machines"]["combine"]["lidar"]["sub_rays"] == 1
    assert repr(result).startswith("<run of straight, seed 5: ")
    assert repr(result).endswith(f"limits pass, in {result.folder}>")


def test_a_scenario_that_is_read_already(result):
    scenario = swath.load_scenario(result.folder)
    assert isinstance(scenario, Scenario)
    assert repr(scenario) == "<scenario straight, seed 5: combine; .resolved() is all of it>"
    with pytest.raises(InputError, match="give them to load_scenario"):
        swath.run(scenario, seed=4)


def test_errors_name_the_key():
    with pytest.raises(
        InputError, match=r"combine\.speed\.sped_kmh: unknown key, did you mean 'speed_kmh'\?"
    ):
        swath.run("straight", sets={"combine.speed.sped_kmh": 5})


def test_import_loads_nothing_and_says_what_there_is():
    code = "import sys, swath; print('numpy' in sys.modules, 'run' in dir(swath)); swath.nothing"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.stdout.split() == ["False", "True"]
    assert "it offers batch, load_scenario, run" in run.stderr


def test_many_runs_goes_on_where_it_stopped(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("many_runs", EXAMPLE)
    many = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(many)
    monkeypatch.setattr(many, "OUT", tmp_path)
    entries = many.entries()
    assert len(entries) == len({entry["out"] for entry in entries}) == 12
    asked = []

    def fake(todo, **more):
        """Runs of which the first is stopped."""
        for index, entry in enumerate(todo):
            asked.append(entry)
            entry["out"].mkdir()
            summary = {"incomplete": index == 0, "lateral_rms_m": 0.02}
            (entry["out"] / "summary.json").write_text(json.dumps(summary))
            yield swath.api.BatchRun(index, entry)

    monkeypatch.setattr(swath, "batch", fake, raising=False)
    many.main()
    assert asked == entries
    entries[0]["out"].joinpath("summary.json").unlink()
    entries[0]["out"].rmdir()
    many.main()
    assert asked[12:] == entries[:1]
    assert len((tmp_path / "table.csv").read_text().splitlines()) == 13
    assert (tmp_path / "table.png").stat().st_size > 5000
