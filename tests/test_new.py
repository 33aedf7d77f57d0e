"""`swath new`: every template runs by the command printed with it; `swath scenarios NAME`, completion."""

import json
import shlex
from pathlib import Path

import pytest

from swath.commands.docs import folder
from swath.commands.main import main
from swath.commands.new import TEMPLATES
from swath.documents.data_sheets import find_sheet
from swath.scenario.scenario import scenario_names

SHORT = "--set run.distance_m=1 --set combine.lidar.level=empirical --set combine.motion.start_speed_kmh=7"
MORE = {"case": "--plan-only --out out", "odd": "", "job": "--out out"}
HEADER = "# yaml-language-server: $schema=scenario.schema.json"


@pytest.mark.parametrize("kind", TEMPLATES)
def test_a_template_runs_by_the_command_that_is_printed(kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", kind, f"my own/{TEMPLATES[kind].path.name}"]) == 0
    said = capsys.readouterr().out.splitlines()
    words = shlex.split(f"{said[-1]} {MORE.get(kind, f'{SHORT} --out out')}")
    assert words[0] == "swath"
    if kind == "odd":
        pytest.importorskip("openodd", reason="needs the extra `odd`")
    if kind == "job":
        pytest.importorskip("shapely", reason="needs the extra `geo`")
    code = main([*words[1:], *(["--no-report", "--no-replay"] if words[1] == "run" else [])])
    assert code in (0, 1, 3)  # too short for limits
    if kind == "odd":
        return
    made = Path(
        "out",
        {"scan": "scan.csv", "test": "plan.json", "fleet": "results.json"}.get(words[1], "summary.json"),
    )
    assert made.stat().st_size > 100
    if kind == "evaluator":
        assert "steering_reversals_per_100_m" in json.loads(made.read_text())


def test_nothing_is_overwritten(tmp_path, capsys):
    file = tmp_path / "mine.py"
    assert main(["new", "detector", str(file)]) == 0
    assert str(file) in file.read_text()  # its own name in how to name it
    file.write_text("mine")
    assert main(["new", "detector", str(file)]) == 2
    assert file.read_text() == "mine"
    assert "nothing is overwritten" in capsys.readouterr().err


def test_the_examples_are_copied(tmp_path):
    assert main(["new", "examples", str(tmp_path / "there")]) == 0
    names = {p.relative_to(tmp_path / "there") for p in (tmp_path / "there").rglob("*") if p.is_file()}
    assert Path("ros2/edge_detector_node.py") in names
    assert {p for p in names if p.suffix == ".pyc"} == set()


def test_a_scenario_is_printed_as_it_is(capsys):
    assert main(["scenarios", "bend"]) == 0
    assert capsys.readouterr().out == find_sheet("scenarios", "bend").read_text()
    assert main(["scenarios", "bent"]) == 2
    assert "did you mean 'bend'" in capsys.readouterr().err


def test_every_scenario_file_names_the_schema():
    files = [find_sheet("scenarios", name) for name in scenario_names()]
    files += [p for p in folder("examples").rglob("*.yaml") if "\nformat: swath scenario" in p.read_text()]
    assert len(files) > 10
    assert [str(f) for f in files if not f.read_text().startswith(HEADER)] == []


def test_completion_knows_commands_and_options(capsys):
    pytest.importorskip("shtab")
    assert main(["completion", "bash"]) == 0
    said = capsys.readouterr().out
    assert "height-map" in said
    assert "--no-replay" in said


def test_scenario_and_detector_work_together(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "scenario"]) == main(["new", "detector"]) == 0
    words = ["--set", "combine.edge.level=my_edge_detector.py:MyEdgeDetector", "--no-report", "--no-replay"]
    assert main(["run", "my_scenario.yaml", *words]) == 0
