"""The gate for code; no change on the way brings more. Of all commands: `tests/whole/test_strangers.py`."""

import json
import zipfile

import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.foreign_code import allow_code, only_code
from swath.runtime.assembly import assemble
from swath.runtime.changes import Interventions
from swath.scenario.scenario import code_of, load_scenario, parse_scenario

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


@pytest.fixture
def folder(tmp_path):
    """A Python file that leaves a mark when it is read, and an FMU."""
    (tmp_path / "mine.py").write_text(
        f"import pathlib\npathlib.Path({str(tmp_path / 'mark')!r}).touch()\nclass Part: pass\n"
    )
    with zipfile.ZipFile(tmp_path / "part.fmu", "w") as made:
        made.writestr("modelDescription.xml", "<a/>")
    return tmp_path


def test_an_override_is_refused_too(folder):
    with pytest.raises(InputError, match="names code"):
        load_scenario("straight", sets=[f"combine.edge.level={folder / 'mine.py'}:Part"])
    assert not (folder / "mark").exists()


@pytest.mark.parametrize("given", ["mine.py:Part", "absent.py:Part", "other_level"])
def test_a_level_in_place_of_one_that_cannot_be_had(folder, given):
    """Its parameters go with it, those of the slot stay."""
    slot = f"    edge: {{level: {given}, some_key: 3, widest_m: 9, rate_hz: 7}}\n"
    text = HEAD + "machines:\n  combine:\n    lidar: off\n" + slot
    changed = parse_scenario(text, base=folder, sets=["combine.edge.level=likelihood_ratio"])
    edge = changed.machines["combine"].slots["edge"]
    assert (edge.level, edge.common.rate_hz) == ("likelihood_ratio", 7.0)
    assert not (folder / "mark").exists()


def test_only_what_is_named_may_run(folder):
    level = f"{folder / 'mine.py'}:Part"
    with allow_code([level]):
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
        with allow_code([folder / "named.py"]):
            return Interventions(assemble(parse_scenario(text, base=folder)), allow)

    def test_a_new_file_is_refused_unread(self, folder):
        changes = self.changes(folder)
        with pytest.raises(InputError, match=r"combine\.speed\.level .*names code"):
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
        assert "names code" in capsys.readouterr().err
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
