"""The pages: links lead somewhere, every page is linked, and what they print is understood.

Command lines are parsed, YAML is read as a scenario or as part of one, Python runs.
"""

import importlib
import math
import re
import shlex
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import swath
from swath.commands.main import GONE, UsageError, make_parser
from swath.core.errors import InputError
from swath.core.together import Samples
from swath.documents.validation import validate
from swath.documents.yaml_document import dump, parse
from swath.field_io.logs.columns import QUANTITIES, read_map
from swath.fleet.files import FORMAT as FLEET_FORMAT
from swath.fleet.files import read_job
from swath.scenario.scenario import load_scenario, parse_scenario, scenario_names
from swath.scenario.slots import CATALOGUE
from swath.scenario.versions import FORMAT, SECTIONS
from swath.signals import SteerCommand
from swath.tools.function_test.candidates import read_candidates
from swath.tools.function_test.case import FORMAT as CASE_FORMAT
from swath.tools.function_test.odd.binding import FORMAT as ODD_FORMAT
from swath.tools.function_test.odd.binding import OddFile
from swath.tools.function_test.odd.openodd import read_domain
from swath.tools.function_test.plan import Plan

pytestmark = pytest.mark.usefixtures("code_allowed")  # what the pages say is ours
ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
TREE = re.compile(r"```\{toctree\}\n(.*?)```", re.DOTALL)
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
PATH = re.compile(r"`((?:docs|src|examples|tests|benchmarks)/[\w./-]+)")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`swath (?!\w+ \d)([a-z][\w-]*(?: [a-z]\w*)?)")
LINE = re.compile(r"^(?:    )?swath (\w[^\n]*)$", re.MULTILINE)


def links(page):
    text = page.read_text(encoding="utf-8")
    beside = [page.parent / m for m in LINK.findall(text) if not m.startswith("http")]
    listed = (line for tree in TREE.findall(text) for line in tree.split() if not line.startswith(":"))
    beside += [file for line in listed for file in page.parent.glob(f"{line}.md")]
    return {p.resolve() for p in (*beside, *(ROOT / m.rstrip(".") for m in PATH.findall(text)))}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    assert [str(p) for p in links(page) if not p.exists()] == []


def test_every_page_is_linked():
    linked = set().union(*(links(page) for page in PAGES))
    pages = [p for p in PAGES[1:] if p != ROOT / "docs" / "index.md"]
    assert [p.name for p in pages if p.resolve() not in linked] == []


def command_lines(page):
    """Whole command lines of a page's listings, without comments and what the shell does with them."""
    for line in LINE.findall(re.sub(r"\\\n\s*", "", page.read_text(encoding="utf-8"))):
        words = shlex.split(line, comments=True)
        cut = [i for i, word in enumerate(words) if word in (">", "&", "|", "||")]
        words = words[: cut[0]] if cut else words
        is_form = any(w.startswith(("[", "<")) or w.isupper() or "..." in w for w in words)
        if words and words[0] in NAMES and not is_form:
            yield words


PARSER, NAMES = make_parser()
LINES = [(p.name, words) for p in PAGES for words in command_lines(p)]


def test_there_are_command_lines_to_check():
    assert len(LINES) > 40


@pytest.mark.parametrize(
    ("page", "words"), LINES, ids=lambda v: " ".join(v)[:60] if isinstance(v, list) else v
)
def test_a_printed_command_line_is_understood(page, words, monkeypatch):
    monkeypatch.chdir(ROOT)
    try:
        args = PARSER.parse_args(words)
    except UsageError as error:
        pytest.fail(f"{page}: swath {' '.join(words)}: {error}")
    if getattr(args, "scenario", None) not in scenario_names():
        return
    try:
        load_scenario(args.scenario, sets=args.sets)
    except InputError as error:
        if "there is no" not in str(error) and "expected a file" not in str(error):  # a file of the reader's
            pytest.fail(f"{page}: swath {' '.join(words)}: {error}")


def test_every_command_that_is_named_exists():
    texts = {p.name: p.read_text(encoding="utf-8") for p in PAGES}
    named = {(name, found) for name, text in texts.items() for found in INLINE.findall(text)}
    shown = {name: [f[2] for f in FENCE.finditer(t) if f[1] in ("", "sh")] for name, t in texts.items()}
    named |= {(name, line.split()[0]) for name in texts for t in shown[name] for line in LINE.findall(t)}
    assert len(named) > 40
    unknown = {(page, text) for page, text in named if text.split()[0] not in NAMES}
    assert {text for page, text in unknown if page != "commands.md"} == set()
    assert {text for page, text in unknown} <= GONE.keys()


def listings(language):
    """(page and line, text) of every listing in a language."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for found in FENCE.finditer(text):
            if found[1] == language:
                yield pytest.param(found[2], id=f"{page.name}:{text.count(chr(10), 0, found.start()) + 1}")


BASE = {
    "format": FORMAT,
    "field": {"edge": {"shape": "straight"}},
    "machines": {"combine": {"machine": "lexion-700-class"}},
}


def filled(part):
    """A listing with what is missing for a scenario; one of slots alone belongs to the combine."""
    if all(CATALOGUE.kind_of(key) for key in part):
        part = {"machines": {"combine": part}}
    assert set(part) <= {"format", "machines", *SECTIONS}
    whole = {**BASE, **part, "field": {**BASE["field"], **part.get("field", {})}}
    return {**whole, "machines": {**BASE["machines"], **part.get("machines", {})}}


@pytest.mark.parametrize("text", list(listings("yaml")))
def test_yaml_is_a_scenario_or_a_part_of_one(text, tmp_path):
    part = parse(text).data
    if part.get("format") == FLEET_FORMAT:
        (tmp_path / "job.yaml").write_text(text, encoding="utf-8")
        job, _ = read_job(str(tmp_path / "job.yaml"))
        assert job.combines
        assert job.notes == ()
        return
    if part.get("format") == CASE_FORMAT:
        (tmp_path / "case.yaml").write_text(text, encoding="utf-8")
        for example in (ROOT / "examples").glob("my_*.py"):  # that `swath new` writes beside it
            shutil.copy(example, tmp_path)
        Plan(str(tmp_path / "case.yaml")).check()
        return
    if part.get("format") == ODD_FORMAT:
        assert validate(OddFile, part, (), parse(text))[1] == []
        return
    if "TAXONOMY" in part:
        pytest.importorskip("openodd", reason="needs the extra odd")
        (tmp_path / "odd.yaml").write_text(text, encoding="utf-8")
        assert read_domain([tmp_path / "odd.yaml"], {}).roots
        return
    if all(isinstance(sets, dict) and all("." in key for key in sets) for sets in part.values()):
        (tmp_path / "candidates.yaml").write_text(text, encoding="utf-8")
        assert list(read_candidates(tmp_path / "candidates.yaml")) == list(part)
        return
    named = [c.get("column") if isinstance(c, dict) else c for c in part.values()]
    if set(part) <= set(QUANTITIES) and all(isinstance(c, str) for c in named):  # the columns of a log
        (tmp_path / "map.yaml").write_text(text, encoding="utf-8")
        assert set(read_map(tmp_path / "map.yaml", named)[0]) == set(part)
        return
    if "name" in part:
        assert part.get("format") == FORMAT
    try:
        parse_scenario(text if "name" in part else dump(filled(part)))
    except InputError as error:
        for one in (error, *getattr(error, "others", ())):  # the reader's own files are not here
            assert "there is no" in one.expected or "the key is missing" in one.expected, one


TINY = f"""
format: {FORMAT}
name: straight
run: {{distance_m: 2, record: standard}}
field: {{edge: {{shape: straight}}, stand: {{level: uniform, stems_per_m2: 100}}}}
machines:
  combine: {{lidar: off, edge: truth, motion: {{level: single_track, start_speed_kmh: 7}}}}
"""
PRELUDE = {  # what a page takes for granted
    "signals.md": "from typing import Annotated\nfrom swath.core.signal import About, Quantity, Signal\n"
    "from swath.core.frozen import frozen\n",
}


SCRIPTED = [p for p in PAGES if "```python" in p.read_text() and p.parent.name != "tutorials"]


@pytest.mark.parametrize("page", SCRIPTED, ids=lambda p: p.name)
def test_python_runs(page, tmp_path, monkeypatch):
    """From top to bottom, with a short run in place of the one that the page makes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    (tmp_path / "tiny.yaml").write_text(TINY)
    code = "\n".join(found[2] for found in FENCE.finditer(page.read_text()) if found[1] == "python")
    if "runs/straight-1" in code:
        swath.run("tiny.yaml", "runs/straight-1", report=False)
    code = code.replace('"straight"', '"tiny.yaml"')
    try:
        exec(compile(PRELUDE.get(page.name, "") + code, page.name, "exec"), {})
    except ModuleNotFoundError as error:
        if str(error.name).startswith("swath"):
            raise
        pytest.skip(f"needs {error.name}")


def test_the_level_in_contributing_follows_its_equation(tmp_path, monkeypatch):
    """The wheels come to a wanted angle with 1 - exp(-t / lag), in each of two worlds with its own lag."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    (tmp_path / "lag.py").write_text(next(found[2] for found in FENCE.finditer(text) if found[1] == "python"))
    monkeypatch.syspath_prepend(tmp_path)
    lag = importlib.import_module("lag")
    setup = SimpleNamespace(machine=SimpleNamespace(wheelbase=3.0))
    both = lag.Lag.together([lag.Lag(lag.Params(s), setup) for s in (0.2, 0.5)])
    both.reset([])
    command = Samples(SteerCommand, 0, {"curvature": np.full(2, 0.1), "is_engaged": np.ones(2, bool)})
    for t in range(0, 100_000_000, 5_000_000):
        steering = both.step(t, 5_000_000, {"command": command})["steering"]
    wanted = math.atan(0.3) * (1.0 - np.exp(-0.1 / np.array([0.2, 0.5])))
    assert steering.arrays["angle"] == pytest.approx(wanted, rel=1e-12)


def test_the_lists_of_a_run_folder_are_whole(driven):
    """README and the page about the run folder name every file that a run leaves."""
    files = {path.name for path in driven("straight", "run.distance_m=8", report=True).iterdir()}
    for page in (ROOT / "README.md", ROOT / "docs/reference/run-folder.md"):
        rows = re.findall(r"^\| ((?:`[\w.]+`(?:, )?)+) \|", page.read_text(encoding="utf-8"), re.MULTILINE)
        listed = set(re.findall(r"`([\w.]+)`", " ".join(rows)))
        assert files - listed == set(), page.name
