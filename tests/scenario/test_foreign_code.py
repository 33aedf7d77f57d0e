"""`--no-code`: nothing that a scenario brings along runs, and no change on the way brings more."""

import json
import zipfile

import pytest

from swath import api
from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.foreign_code import only_code
from swath.documents.data_sheets import find_sheet
from swath.runtime.assembly import assemble
from swath.runtime.changes import Interventions
from swath.scenario.code import code_of
from swath.scenario.scenario import load_scenario, parse_scenario

HEAD = """
format: swath scenario 2
name: foreign
run: {distance_m: 1, max_duration_s: 2}
field:
  edge: {shape: straight}
"""
MACHINE = """
machines:
  combine:
    lidar: off
    edge: truth
"""
LAW = "{level: can, interface: virtual, channel: a, box: inside, law: mine.py:Part}"
KINDS = {
    "slot": HEAD + MACHINE + "    speed: {level: mine.py:Part}\n",
    "slot, short": HEAD + MACHINE + "    speed: mine.py:Part\n",
    "terrain": HEAD + "  terrain: {level: mine.py:Part}\n" + MACHINE,
    "stand": HEAD + "  stand: {level: mine.py:Part}\n" + MACHINE,
    "evaluator": HEAD + MACHINE + "evaluators: [mine.py:Part]\n",
    "cheaper level": HEAD + MACHINE + "realtime: {degrade: [{slot: combine.edge, level: mine.py:Part}]}\n",
    "FMU": HEAD + MACHINE + "    process: {level: fmu, file: part.fmu}\n",
    "SSP": HEAD + MACHINE + "    process: {level: fmu, file: part.ssp}\n",
    "SSD": HEAD + MACHINE + "    process: {level: fmu, file: part.ssd}\n",
    "CAN law": HEAD + MACHINE + f"    steer: {LAW}\n",
    "machine's data sheet": HEAD + MACHINE + "    machine: mine.yaml\n",
    "crop habit": HEAD + "  stand: {level: uniform, crop: crop.yaml}\n" + MACHINE,
    "beside a mistake": HEAD + MACHINE + "    speed: {level: mine.py:Part}\n    steering: {bogus: 1}\n",
}


@pytest.fixture
def folder(tmp_path):
    """A Python file that leaves a mark when it is read, data sheets that name it, an FMU, systems."""
    (tmp_path / "mine.py").write_text(
        f"import pathlib\npathlib.Path({str(tmp_path / 'mark')!r}).touch()\nclass Part: pass\n"
    )
    for name in ("part.fmu", "part.ssp"):
        with zipfile.ZipFile(tmp_path / name, "w") as made:
            made.writestr("modelDescription.xml", "<a/>")
    (tmp_path / "part.ssd").write_text("<a/>")
    sheet = find_sheet("machines", "lexion-700-class").read_text()
    (tmp_path / "mine.yaml").write_text(sheet + "\nslots: {speed: mine.py:Part}\n")
    crop = find_sheet("crops", "wheat").read_text()
    (tmp_path / "crop.yaml").write_text(crop.replace("habit: cereal", "habit: mine.py"))
    return tmp_path


@pytest.mark.parametrize("kind", KINDS)
def test_no_code_refuses_every_kind_before_it_is_read(kind, folder, capsys):
    file = folder / "s.yaml"
    file.write_text(KINDS[kind])
    assert main(["run", str(file), "--no-code", "--out", str(folder / "run")]) == 2
    said = capsys.readouterr().err
    assert "expected no code" in said
    assert str(folder) in said
    assert not (folder / "mark").exists()
    assert not (folder / "run").exists()


@pytest.mark.parametrize("kind", ["slot", "evaluator", "CAN law", "crop habit"])
def test_without_it_the_file_is_read(kind, folder, capsys):
    file = folder / "s.yaml"
    file.write_text(KINDS[kind])
    assert main(["run", str(file), "--out", str(folder / "run")]) == 2
    assert (folder / "mark").exists()


@pytest.mark.parametrize("command", ["scan", "rerun", "can box", "fmu export", "osi"])
def test_other_commands_that_read_scenarios_have_it(command, folder, capsys):
    (folder / "run").mkdir()
    (folder / "run" / "scenario.yaml").write_text(KINDS["slot"].replace("mine.py", str(folder / "mine.py")))
    more = {"osi": ["--out", str(folder / "x.osi")], "rerun": []}.get(command, [])
    assert main([*command.split(), str(folder / "run"), "--no-code", *more]) == 2
    assert not (folder / "mark").exists()


def test_from_python(folder):
    file = folder / "s.yaml"
    file.write_text(KINDS["slot"])
    for act in (api.load_scenario, api.run):
        with pytest.raises(InputError, match=r"speed.*expected no code"):
            act(file, code=False)
    assert not (folder / "mark").exists()


def test_an_override_is_refused_too(folder):
    with only_code(()), pytest.raises(InputError, match="expected no code"):
        load_scenario("straight", sets=[f"combine.edge.level={folder / 'mine.py'}:Part"])
    assert not (folder / "mark").exists()


def test_only_what_is_named_may_run(folder):
    level = f"{folder / 'mine.py'}:Part"
    with only_code([level]):
        assert code_of(load_scenario("straight", sets=[f"combine.speed.level={level}"])) == [
            folder / "mine.py"
        ]
        with only_code([folder / "other.py"]), pytest.raises(InputError):
            load_scenario("straight", sets=[f"combine.speed.level={level}"])


PART = """
from swath.control.speed.constant import LEVEL as Same
import pathlib
pathlib.Path({mark!r}).touch()
"""


class TestChangesOnTheWay:
    def changes(self, folder, allow=(), speed="constant"):
        for name in ("named.py", "other.py"):
            (folder / name).write_text(PART.format(mark=str(folder / f"{name}.mark")))
        text = HEAD + MACHINE + f"    speed: {speed}\n"
        return Interventions(assemble(parse_scenario(text, base=folder)), allow)

    def test_a_new_file_is_refused_unread(self, folder):
        changes = self.changes(folder)
        with pytest.raises(InputError, match=r"combine\.speed\.level .*expected no code"):
            changes.set(0, "combine.speed.level", f"{folder}/other.py:Same")
        with pytest.raises(InputError, match="expected no file but those that the scenario or --allow names"):
            changes.set(0, "combine.process", json.dumps({"level": "fmu", "file": str(folder / "part.fmu")}))
        assert not (folder / "other.py.mark").exists()
        assert changes.events == []

    def test_what_the_scenario_or_allow_names_may_come(self, folder):
        changes = self.changes(folder, [f"{folder}/other.py:Same"], speed=f"{folder}/named.py:Same")
        changes.set(0, "combine.speed.level", "constant")
        changes.set(0, "combine.speed.level", f"{folder}/named.py:Same")
        changes.set(0, "combine.speed.level", f"{folder}/other.py:Same")
        assert (folder / "other.py.mark").exists()
        assert len(changes.events) == 3

    def test_repeated_events_are_held_to_the_same(self, folder, capsys):
        self.changes(folder)
        event = {"t_s": 0.0, "set": "combine.speed.level", "value": f"{folder}/other.py:Same"}
        (folder / "events.json").write_text(json.dumps([event]))
        (folder / "s.yaml").write_text(HEAD + MACHINE)
        command = ["run", str(folder / "s.yaml"), "--events", str(folder / "events.json"), "--quiet"]
        assert main([*command, "--out", str(folder / "a")]) == 2
        assert "expected no code" in capsys.readouterr().err
        assert not (folder / "other.py.mark").exists()
        assert main([*command, "--out", str(folder / "b"), "--allow", f"{folder}/other.py:Same"]) == 0
        assert (folder / "other.py.mark").exists()


@pytest.mark.parametrize("part", ['law: "a\\0.py:Law"', 'law: "/x\\0y/a.py:Law"'])
def test_nul_in_a_path_is_bad_input(part, tmp_path, capsys):
    file = tmp_path / "s.yaml"
    steer = f"    steer: {{level: can, interface: virtual, channel: a, box: inside, {part}}}\n"
    file.write_text(HEAD + MACHINE + steer)
    assert main(["run", str(file), "--out", str(tmp_path / "run")]) == 2
    assert "expected a file or file.py:Class" in capsys.readouterr().err
    assert main(["run", "straight", "--out", "a\0b"]) == 2
    assert "without the character NUL" in capsys.readouterr().err
