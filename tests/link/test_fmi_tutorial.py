"""The tutorial of a Simulink model, with an FMU compiled here in place of the export.

`tests/test_tutorials.py` runs the page as it stands, with the FMU that it makes in Python.
"""

import json
import re
import shlex
from pathlib import Path

import pytest

from swath.commands.main import main
from tests.link.made_fmus import CAN, PROCESS, needs_cc, store_fmu

pytest.importorskip("fmpy")
pytestmark = [needs_cc, pytest.mark.usefixtures("code_allowed")]
DOCS = Path(__file__).parents[2] / "docs"
TUTORIAL = (DOCS / "tutorials" / "my-simulink-model.md").read_text(encoding="utf-8")
PAGE = (DOCS / "how-to" / "simulink.md").read_text(encoding="utf-8") + TUTORIAL


def blocks(kind):
    return re.findall(rf"```{kind}\n(.*?)```", TUTORIAL, re.DOTALL)


def test_the_tutorial(tmp_path, monkeypatch, capsys):
    # as exporters have it: start values of inputs left out, one instance per process
    faulty = [(n, c, u, None if c == "input" else s) for n, c, u, s in PROCESS]
    attributes = CAN + ' canBeInstantiatedOnlyOncePerProcess="true"'
    store_fmu(tmp_path, "harvest.fmu", variables=faulty, attributes=attributes, flags=("-DONLY_ONE",))
    monkeypatch.chdir(tmp_path)
    (scenario,) = blocks("yaml")
    Path("harvest.yaml").write_text(scenario, encoding="utf-8")
    lines = [line for block in blocks("sh")[1:] for line in block.splitlines()]
    assert len(lines) == 5
    for line in lines:
        words = shlex.split(line)
        assert words[0] == "swath"
        assert main(words[1:]) == 0, line
    out = capsys.readouterr().out
    assert "it can fill a slot" in out
    runs = {
        n: json.loads(Path("runs", n, "summary.json").read_text()) for n in ("harvest", "built-in", "apart")
    }
    assert runs["harvest"]["digest"] == runs["apart"]["digest"] != runs["built-in"]["digest"]
    results = {entry["name"]: entry["result"] for entry in runs["harvest"]["expect"]}
    assert results["mass_balance_error"] == "pass"
    assert any("breaks the standard" in note for note in runs["harvest"]["notes"])


def test_the_page_names_the_keys_that_there_are():
    from dataclasses import fields

    from swath.link.levels.fmu import Params

    for field in fields(Params):
        assert f"{field.name}:" in PAGE or f"`{field.name}`" in PAGE, field.name
