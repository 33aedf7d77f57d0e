"""The page of figures: which stand in the docs, section by section, and what gives them.

    python -m docs.make.figures      counts them anew; a section that the page did not have gets a `?` to fill in

A figure is a number with a unit of a result: %, cm, mm, ms, MB, times and so on. Those that a command or the
code writes into a page (`<!-- made by`, `<!-- output of`, `<!-- each row`), listings and code are left out.
"""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "figures.md"
UNITS = "%|cm|mm|ms|us|µs|MB|GB|CPU-s|CPU-hours|times|s of"
FIGURE = re.compile(rf"(?<![\w.])\d[\d,]*(?:\.\d+)?(?:\s*(?:to|/|,|and)\s*\d[\d.,]*)*\s?(?:{UNITS})(?![\w/])")
MADE = re.compile(
    r"<!-- (?:made by|output of|each row).*?-->.*?(?=<!-- end -->|\n\n|\Z)|```.*?```|^    .*?$|`[^`\n]*`",
    re.DOTALL | re.MULTILINE,
)
ROW = re.compile(r"^\| (\S+) \| (.*?) \| (\d+) \| (.*?) \| (\S+) \|$", re.MULTILINE)
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


def stated() -> dict[Place, tuple[int, str, str]]:
    """What the page says: number of figures, what gives them, and the commit in which they stand since."""
    rows = ROW.findall(PAGE.read_text(encoding="utf-8")) if PAGE.is_file() else ()
    return {(page, heading): (int(count), by, commit) for page, heading, count, by, commit in rows}


def _since(page: str, lines: list[int]) -> str:
    """The newest commit of some lines."""
    asked = ["git", "blame", "--line-porcelain", *(f"-L{n},{n}" for n in lines), "--", page]
    told = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    commits = re.findall(r"^([0-9a-f]{40}) .*?^committer-time (\d+)", told, re.MULTILINE | re.DOTALL)
    return max(commits, key=lambda pair: int(pair[1]))[0][:8]


def markdown() -> str:
    """The rows of the page, counted anew."""
    known, rows = stated(), []
    for (page, heading), figures in found().items():
        count, by, commit = known.get((page, heading), (0, "?", "?"))
        if count != len(figures):
            commit = _since(page, [number for number, _ in figures])
        rows.append(f"| {page} | {heading} | {len(figures)} | {by} | {commit} |")
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    head, _, _ = PAGE.read_text(encoding="utf-8").partition("|---|---|---|---|---|\n")
    PAGE.write_text(f"{head}|---|---|---|---|---|\n{markdown()}", encoding="utf-8")
