"""swath from Python: what `import swath` offers, and a loop of one's own."""

import subprocess
import sys
from itertools import pairwise

import pytest

import swath
from swath.commands.main import main
from swath.core.errors import InputError
from swath.documents.yaml_document import read_document
from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive, ticks
from swath.scenario.scenario import Scenario

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
    text = f"3 of 6 limits pass, 3 not measured, in {result.folder}>"
    assert repr(result).endswith(text)


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
    assert (
        "it offers batch, branch, detect, load_scenario, read_field, run, scan, tune, worlds, Env"
        in run.stderr
    )


SCAN = {"run.distance_m": 1, "combine.lidar.level": "empirical"}


def test_a_scan_notes_a_rate_that_the_sensor_does_not_have(tmp_path, capsys):
    told = swath.scan("straight", tmp_path / "odd", sets={**SCAN, "combine.lidar.rate_hz": 40}).notes
    assert ["is not a rate of the" in note for note in told].count(True) == 1
    words = [word for key, value in SCAN.items() for word in ("--set", f"{key}={value}")]
    odd = ["scan", "straight", *words, "--set", "combine.lidar.rate_hz=40", "--format", "npz"]
    assert main([*odd, "--out", str(tmp_path / "again")]) == 0
    assert "40 Hz is not a rate of the" in capsys.readouterr().err


def test_a_scan_at_a_rate_of_the_sensor_notes_nothing_of_it(tmp_path):
    assert not any("rate" in note for note in swath.scan("straight", tmp_path / "s", sets=SCAN).notes)


def test_tick_by_tick_is_the_same_run():
    """As in docs/how-to/python.md: every tick is one step of the loop, and all of them are the run."""
    scenario = swath.load_scenario("straight", sets=SCAN)
    whole, single = Digest(), Digest()
    drive(assemble(scenario), [whole])
    world, times = assemble(scenario), []
    for t in ticks(world, [single]):
        times.append(t)
        assert world.graph.t == t
    assert single.hex == whole.hex
    assert times == sorted(set(times))
    assert max(b - a for a, b in pairwise(times)) == 5_000_000  # steering runs at 200 Hz
