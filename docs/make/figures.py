"""The page of figures: which stand in the docs, section by section, and what gives them.

    python -m docs.make.figures             counts them anew; a section that the page did not have gets a `?`
    python -m docs.make.figures --measure   runs the tests named there, and writes the commit where one passed

A figure is a number with a unit of a result: %, cm, mm, ms, MB, times and so on. Those that a command or the
code writes into a page (`<!-- made by`, `<!-- output of`, `<!-- each row`), listings and code are left out.
"""

import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "figures.md"
UNITS = "%|cm|mm|ms|us|µs|MB|GB|CPU-s|CPU-hours|times|s of"
FIGURE = re.compile(rf"(?<![\w.])\d[\d,]*(?:\.\d+)?(?:\s*(?:to|/|,|and)\s*\d[\d.,]*)*\s?(?:{UNITS})(?![\w/])")
MADE = re.compile(
    r"<!-- (?:made by|output of|each row).*?-->.*?(?=<!-- end -->|\n\n|\Z)|```.*?```|^    .*?$|`[^`\n]*`",
    re.DOTALL | re.MULTILINE,
)
ROW = re.compile(r"^\| (\S+) \| (.*?) \| (\d+) \| (.*?) \| (\S+) \| (\S+) \|$", re.MULTILINE)
HEAD = "|---|---|---|---|---|---|\n"
DEAR, NONE = "dear", "-"
LIMIT_S = 60.0  # that a test may take to be measured
Place = tuple[str, str]  # page, heading


def found() -> dict[Place, list[tuple[int, str]]]:
    """Line and text of every figure, by page and heading."""
    places: dict[Place, list[tuple[int, str]]] = {}
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        if page == PAGE:
            continue
        text = MADE.sub(lambda m: "\n" * m[0].count("\n"), page.read_text(encoding="utf-8"))
        heading = ""
        for number, line in enumerate(text.splitlines(), 1):
            if line.startswith("#"):
                heading = line.strip("# ").replace("|", "/")
            for figure in FIGURE.finditer(line):
                place = page.relative_to(ROOT).as_posix(), heading
                places.setdefault(place, []).append((number, " ".join(figure[0].split())))
    return places


def stated() -> dict[Place, tuple[int, str, str, str]]:
    """What the page says: number of figures, what gives them, since which commit, and where last measured."""
    rows = ROW.findall(PAGE.read_text(encoding="utf-8")) if PAGE.is_file() else ()
    return {(page, heading): (int(count), *others) for page, heading, count, *others in rows}


def held_by(by: str) -> list[str]:
    """The commands of a row that are tests, whose bounds hold its figures."""
    return [part.strip("`") for part in by.split("; ") if part.startswith("`pytest ")]


def is_dear(by: str) -> bool:
    """Whether a row names a command that is no test."""
    return any(part.startswith("`") and not part.startswith("`pytest ") for part in by.split("; "))


def measure() -> dict[str, str]:
    """Every test of the page that passes now within LIMIT_S, and the commit. RuntimeError where the tree is changed."""
    git = ["git", "status", "--porcelain", "src", "tests"]
    if subprocess.run(git, cwd=ROOT, capture_output=True, text=True, check=True).stdout:
        raise RuntimeError("src or tests are changed: commit first, so that a commit can be written")
    head = ["git", "rev-parse", "--short=8", "HEAD"]
    commit = subprocess.run(head, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    commands = {command for _, by, *_ in stated().values() for command in held_by(by)}
    found = {}
    for command in sorted(commands):
        words = [sys.executable, "-m", *shlex.split(command), "-q", "-n", "0"]
        try:
            code = subprocess.run(words, cwd=ROOT, timeout=LIMIT_S, stdout=subprocess.DEVNULL).returncode
        except subprocess.TimeoutExpired:
            code = None
        said = {None: f"takes more than {LIMIT_S:g} s", 0: "passes"}.get(code, f"exit code {code}")
        print(command, said, flush=True)
        found |= {command: commit} if code == 0 else {}
    return found


def _since(page: str, lines: list[int]) -> str:
    """The newest commit of some lines."""
    asked = ["git", "blame", "--line-porcelain", *(f"-L{n},{n}" for n in lines), "--", page]
    told = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    commits = re.findall(r"^([0-9a-f]{40}) .*?^committer-time (\d+)", told, re.MULTILINE | re.DOTALL)
    return max(commits, key=lambda pair: int(pair[1]))[0][:8]


def markdown(measured: Mapping[str, str]) -> str:
    """The rows of the page, counted anew; measured: commit by command."""
    known, rows = stated(), []
    for (page, heading), figures in found().items():
        count, by, commit, last = known.get((page, heading), (0, "?", "?", NONE))
        if count != len(figures):
            commit = _since(page, [number for number, _ in figures])
            last = NONE
        if is_dear(by):
            last = DEAR if last == NONE else last
        elif (commands := held_by(by)) and all(command in measured for command in commands):
            last = measured[commands[0]]
        rows.append(f"| {page} | {heading} | {len(figures)} | {by} | {commit} | {last} |")
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    head, _, _ = PAGE.read_text(encoding="utf-8").partition(HEAD)
    found_now = markdown(measure() if "--measure" in sys.argv[1:] else {})
    PAGE.write_text(f"{head}{HEAD}{found_now}", encoding="utf-8")
