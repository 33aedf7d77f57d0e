"""Tables of results on the pages, each made by a command that stands above it:

    <!-- each row: swath run NAME --set KEY={} ; METRIC FORMAT ; METRIC FORMAT -->

`{}` is the first cell of a row; the others are metrics of the summary of that run. tests/test_docs_tables.py
makes them again and compares.

python -m docs.make.tables             makes all of them anew
python -m docs.make.tables PAGE.md     and those of a page only
"""

import re
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

from swath.api import batch
from swath.commands.main import make_parser
from swath.scenario.scenario import load_scenario

DOCS = Path(__file__).parents[1]
MARKED = re.compile(r"<!-- each row: ([^>]*?) -->\n(\|.*\n\|[-|]*\n)((?:\|.*\n)+)")


@dataclass(frozen=True)
class Table:
    """command: with `{}` for the first cell; columns: metric of the summary and format; rows: cells"""

    page: Path
    command: str
    columns: tuple[tuple[str, str], ...]
    rows: tuple[tuple[str, ...], ...]

    def made(self, label: str) -> tuple[str, ...]:
        """A row as its command gives it now."""
        words = shlex.split(self.command.replace("{}", label.strip("`")))
        args = make_parser()[0].parse_args(words[1:])
        scenario = load_scenario(args.scenario, sets=[*args.sets, "run.record=none", "expect={}"])
        (done,) = batch([scenario])
        return (label, *(format(done.summary[metric], form) for metric, form in self.columns))


def tables(page: Path) -> list[Table]:
    """The marked tables of a page."""
    return [_table(page, found) for found in MARKED.finditer(page.read_text(encoding="utf-8"))]


def _table(page: Path, found: re.Match[str]) -> Table:
    command, *columns = (part.strip() for part in " ".join(found[1].split()).split(";"))
    rows = tuple(tuple(c.strip() for c in line.strip("| ").split("|")) for line in found[3].splitlines())
    return Table(page, command, tuple((c.split()[0], c.split()[1]) for c in columns), rows)


def make(page: Path) -> None:
    """Write the tables of a page anew."""

    def again(found: re.Match[str]) -> str:
        table = _table(page, found)
        rows = ("| " + " | ".join(table.made(row[0])) + " |\n" for row in table.rows)
        return found[0].removesuffix(found[3]) + "".join(rows)

    page.write_text(MARKED.sub(again, page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    for name in sys.argv[1:] or sorted(str(p.relative_to(DOCS)) for p in DOCS.glob("**/*.md")):
        make(DOCS / name)
