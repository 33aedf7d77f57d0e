"""README and how-to: every listing in its order, in an empty folder with the page's own installation.

docs/make/typed.py does it: runs are cut to a moment, what they find is judged elsewhere. The lines whole:
benchmarks/typed_lines.py. Reference and explanation: their lines of `swath`, beside the examples. The
tutorials are typed as they stand by test_tutorials.py.
"""

import os
import subprocess
import sys
from importlib.util import find_spec

import pytest
from docs.make.typed import ELSEWHERE, LONG, PAGES, ROOT, extras_of, shortened, steps, write_hiding

from swath.commands.main import main
from tests.test_docs import LINES

MODULES = {
    "can": "can", "fmi": "fmpy", "foxglove": "foxglove", "geo": "rasterio", "gym": "gymnasium",
    "las": "laspy", "mesh": "trimesh", "mf4": "asammdf", "odd": "openodd", "osi": "osi3", "ros2": "rclpy",
    "test": "scipy", "tune": "optuna", "view": "websockets",
}  # fmt: skip
OWN = {p.name for part in ("how-to", "tutorials") for p in (ROOT / "docs" / part).glob("*.md")} | {
    "README.md"
}
OTHERS = sorted({name for name, _ in LINES} - OWN)
NOT_TYPED = {  # lines of reference and explanation: why, and which test does what they do
    "calibrate lidar": "minutes: tests/tools/test_calibrate.py",
    "compare scans": "recordings that are not here: tests/tools/test_compare_scans.py",
    "lab stand": "a minute: tests/tools/test_lab.py",
    "paper": "a minute: tests/tools/test_paper.py",
    "reda ": "minutes: tests/tools/test_reda.py",
}


def test_what_is_cut_or_typed_elsewhere_is_on_a_page_and_has_its_test():
    lines = [line for page in PAGES for name, line in steps(page.read_text(encoding="utf-8")) if not name]
    for begin in (*ELSEWHERE, *(f"swath {begin}" for begin in LONG)):
        assert any(line.startswith(begin) for line in lines), begin
    files = [*ELSEWHERE.values(), *(why.rpartition(": ")[2] for why in NOT_TYPED.values())]
    assert [file for file in files if not (ROOT / file).is_file()] == []
    typed = [line for line in lines if not line.startswith(tuple(ELSEWHERE))]
    assert len(typed) > 0.8 * len(lines)


@pytest.mark.draws
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_works_from_top_to_bottom(page, tmp_path):
    text = page.read_text(encoding="utf-8")
    for extra in extras_of(text):
        if find_spec(MODULES[extra]) is None:
            pytest.skip(f"needs the extra {extra}")
    (tmp_path / "hidden").mkdir()
    write_hiding(tmp_path / "hidden", text)
    (tmp_path / "empty").mkdir()
    paths = [str(tmp_path / "hidden"), str(ROOT), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "MPLBACKEND": "agg"}
    environment["PATH"] = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])
    command = [sys.executable, "-m", "docs.make.typed", str(page)]
    done = subprocess.run(command, cwd=tmp_path / "empty", env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


RUNS = [
    words for name, words in LINES if name == "README.md" and words[0] == "run" and "my-field" not in words
]


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(w, marks=() if "my_scenario.yaml" in w else pytest.mark.draws, id=" ".join(w))
        for w in RUNS
    ],
)
def test_a_run_of_the_readme_keeps_its_limits_and_all_are_judged(words, tmp_path, monkeypatch):
    """Whole, with exit code 0; `my-field` needs an extra: `python -m benchmarks.typed_lines README`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    assert main(["new", "scenario"]) == 0
    assert main([*words, "--no-report", "--no-replay", "--set", "run.record=none"]) == 0


def test_a_page_that_uses_an_extra_without_saying_so_fails(tmp_path):
    text = "```sh\npython -c 'import scipy'\n```\n"
    write_hiding(tmp_path, text)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", "import scipy"]
    assert subprocess.run(command, env=environment, capture_output=True).returncode == 1
    write_hiding(tmp_path, f"`pip install 'swath[test]'`\n{text}")
    assert subprocess.run(command, env=environment, capture_output=True).returncode == 0


@pytest.mark.draws
@pytest.mark.parametrize("page", OTHERS)
def test_the_lines_of_another_page_do_what_they_say(page, tmp_path, monkeypatch, capsys):
    """Exit code 0, or 1 or 3 where so short a run misses a limit or measures nothing."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    os.symlink(ROOT / "examples", tmp_path / "examples")
    for words in [words for name, words in LINES if name == page]:
        if " ".join(words).startswith(tuple(NOT_TYPED)):
            continue
        code = main(shortened(words))
        said = capsys.readouterr()
        assert code in ((0, 1, 3) if words[0] in ("run", "rerun") else (0,)), f"swath {words}\n{said.err}"
