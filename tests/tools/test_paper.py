"""`swath paper`: commands that swath understands, on a page that shows what they leave."""

from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from swath.commands.main import main, make_parser
from swath.scenario.scenario import load_scenario
from swath.tools.paper.command import FIGURES, FILES, write_paper

COMMANDS = {name: words for shown in FIGURES for name, words in shown.commands.items()}


@pytest.mark.parametrize("name", COMMANDS)
def test_swath_understands_every_command(name):
    words = [*COMMANDS[name], "--out", name]
    args = make_parser(words[0])[0].parse_args(words)
    if hasattr(args, "scenario"):
        assert load_scenario(args.scenario, sets=args.sets).name


def test_every_command_has_its_folder():
    assert set(FILES) == {"index.html", *COMMANDS}


def test_the_page_shows_what_the_commands_left(tmp_path):
    (tmp_path / "edge").mkdir()
    (tmp_path / "edge" / "scan.png").write_bytes(b"")
    (tmp_path / "low-density").mkdir()
    (tmp_path / "low-density" / "report.html").write_bytes(b"")
    text = write_paper(tmp_path).read_text(encoding="utf-8")
    assert "A multilevel simulation framework" in text
    for words in COMMANDS.values():
        assert words[0] in text
    assert 'src="edge/scan.png"' in text
    assert 'href="low-density/report.html"' in text
    assert "broken-edge/report.html" not in text


@pytest.mark.parametrize(("code", "begun"), [(0, len(COMMANDS)), (4, 1)])
def test_each_command_is_run_in_its_folder_and_one_that_fails_ends_it(
    code, begun, tmp_path, monkeypatch, capsys
):
    started = []

    @contextmanager
    def start(*words, cwd, **others):
        started.append((words, cwd))
        yield SimpleNamespace(wait=lambda: code)

    monkeypatch.setattr("swath.tools.paper.command.start_module", start)
    assert main(["paper", "--out", str(tmp_path / "paper")]) == code
    made = [(("swath", *words, "--out", name), tmp_path / "paper") for name, words in COMMANDS.items()]
    assert started == made[:begun]
    assert ("index.html" in capsys.readouterr().out) == (code == 0)
