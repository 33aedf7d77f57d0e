"""Every whole command line of README and docs, typed in an empty folder, page by page.

Runs are cut to a moment, and recorded only where they have a folder that the page goes on with; what they
find is judged elsewhere. The tutorials are typed as they stand by test_tutorials.py.
"""

import os
from importlib.util import find_spec
from pathlib import Path

import pytest

from swath.commands.main import main
from tests.test_docs import LINES, ROOT

SHORT = ["--set", "run.max_duration_s=0.4", "--set", "run.distance_m=2"]
PAGES = sorted({page for page, _ in LINES} - {p.name for p in (ROOT / "docs" / "tutorials").glob("*.md")})
BEFORE = {  # what the reader has by then
    "again.md": [["new", "detector", "my.py"]],
}
SHEETS = {
    "my-scanner.yaml": "sick-lms511-hr",
    "my-combine.yaml": "lexion-700-class",
    "my-wheat.yaml": "wheat",
}
NEEDS = {"osi": "osi3", "fmu": "pythonfmu3", "field": "pyproj"}
ELSEWHERE = {  # begin of a line: why it is not typed here, and which test does what it does
    "calibrate lidar": "minutes: tests/tools/test_calibrate.py",
    "calibrate engine": "a log of the reader's: tests/tools/test_calibrate_engine.py",
    "can ": "a box on a bus: tests/link/test_can.py",
    "run examples/can/hil.yaml": "a box on a bus, at the pace of the clock: tests/link/test_can_udp.py",
    "run examples/devices/wire.yaml": "a box in another process: tests/link/test_device_loop.py",
    "run straight --real-time --foxglove": "a viewer: tests/link/test_foxglove.py",
    "dataset straight": "hundreds of pictures: tests/tools/test_dataset.py",
    "lab stand": "a minute: tests/tools/test_lab.py",
    "migrate my-scenario.yaml": "files of version 0.1: tests/tools/test_migrate.py",
    "reda ": "a minute: tests/tools/test_reda.py",
    "test compare": "results of many runs: tests/tools/test_compare_results.py",
    "test search": "64 runs: tests/tools/test_search.py",
    "test again": "results of many runs: tests/tools/test_function_test.py",
    "test report": "results of many runs: tests/tools/test_function_test.py",
    "test run gap": "the reader's candidates: tests/test_tutorials.py",
    "run feed-rate --isobus": "a CAN bus: tests/link/test_isobus.py",
    "run laser-pilot --ros2": "a ROS 2 domain: tests/link/test_ros2_tutorial.py",
}


def shortened(words):
    """The same line, quicker: a moment of a run, the plan of a test."""
    if words[:2] == ["test", "run"]:
        return [*words, "--plan-only"]
    if words[0] == "branch":  # of a run that was shortened, too
        at = next(k for k, word in enumerate(words) if word in ("--at", "--at-s"))
        return [*words[:at], "--at-s", "0.2", *words[at + 2 :]]
    if words[0] not in ("run", "rerun"):
        return words
    unrecorded = [] if "--out" in words or words[0] == "rerun" else ["--set", "run.record=none"]
    said = {word.partition("=")[0] for word in words}
    short = [word for word in SHORT if word.partition("=")[0] not in said and word != "--set"]
    short = [part for word in short for part in ("--set", word)]
    return [*words, *short, *unrecorded, *(["--no-replay"] if words[0] == "run" else [])]


@pytest.fixture
def folder(tmp_path, monkeypatch, capsys):
    """Where the reader stands: beside the examples, with data sheets printed into files."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    os.symlink(ROOT / "examples", tmp_path / "examples")
    for file, name in SHEETS.items():
        assert main(["sheets", name]) == 0
        (tmp_path / file).write_text(capsys.readouterr().out, encoding="utf-8")
    return tmp_path


def test_what_is_typed_elsewhere_is_on_a_page_and_has_its_test():
    lines = [" ".join(words) for _, words in LINES]
    assert [begin for begin in ELSEWHERE if not any(line.startswith(begin) for line in lines)] == []
    files = [why.rpartition(": ")[2] for why in ELSEWHERE.values()]
    assert [file for file in files if not (ROOT / file).is_file()] == []
    typed = [line for line in lines if not line.startswith(tuple(ELSEWHERE))]
    assert len(typed) > 0.8 * len(lines)


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_do_what_they_say(page, folder, capsys):
    """Exit code 0, or 1 where so short a run misses a limit."""
    own = [words for name, words in LINES if name == page]
    for words in (*BEFORE.get(page, []), *own):
        line = " ".join(words)
        if line.startswith(tuple(ELSEWHERE)) or find_spec(NEEDS.get(words[0], "swath")) is None:
            continue
        code = main(shortened(words))
        said = capsys.readouterr()
        assert code in ((0, 1) if words[0] in ("run", "rerun") else (0,)), f"swath {line}\n{said.err}"
        if line == "new detector my.py":
            file = folder / "my.py"
            file.write_text(file.read_text().replace("MyEdgeDetector", "Edge"))
        out = words[words.index("--out") + 1] if "--out" in words else None
        if out is not None and words[:2] != ["test", "run"]:
            assert Path(out).exists(), line
