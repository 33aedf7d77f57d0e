"""The results page: tables and listings, each made by the command above it.

    <!-- each row: swath run NAME --set KEY={} ; METRIC FORMAT ; METRIC FORMAT -->
    <!-- output of: python benchmarks/NAME.py ... -->

`{}` is the first cell of a row; the others are metrics of the summary of that run. Below `output of` stands in a
listing what the command prints. tests/test_docs_tables.py makes a row of each table again and compares.

make results                             all of docs/reference/results.md anew, with date, commit and processor
make results ONLY='text in a command'    what has this text in its command
"""

import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from swath.api import batch
from swath.commands.main import make_parser
from swath.judge.summary import processor
from swath.scenario.scenario import load_scenario

DOCS = Path(__file__).parents[1]
PAGE = DOCS / "reference" / "results.md"
MARKED = re.compile(r"<!-- each row: ([^>]*?) -->\n(\|.*\n\|[-|]*\n)((?:\|.*\n)+)")
LISTED = re.compile(r"<!-- output of: (.*?) -->\n```\n(.*?)```\n", re.DOTALL)
STAMP = re.compile(r"<!-- made -->\n(.*)\n")


@dataclass(frozen=True)
class Table:
    """command: with `{}` for the first cell; columns: metric of the summary and format; rows: cells."""

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


def make(page: Path, only: str = "") -> None:
    """Write the tables and listings of a page anew whose command holds a text."""

    def rows(found: re.Match[str]) -> str:
        table = _table(page, found)
        if only not in table.command:
            return found[0]
        made = ("| " + " | ".join(table.made(row[0])) + " |\n" for row in table.rows)
        return found[0].removesuffix(found[3]) + "".join(made)

    def listing(found: re.Match[str]) -> str:
        command = " ".join(found[1].split())
        if only not in command:
            return found[0]
        done = subprocess.run(
            shlex.split(command), cwd=DOCS.parent, capture_output=True, text=True, check=True
        )
        made = "\n".join(line.rstrip() for line in done.stdout.strip("\n").splitlines())
        return found[0].removesuffix(f"{found[2]}```\n") + f"{made}\n```\n"

    text = LISTED.sub(listing, MARKED.sub(rows, page.read_text(encoding="utf-8")))

    def stamp(found: re.Match[str]) -> str:
        made = _made()
        if only:
            others = re.sub(rf" `{re.escape(only)}`: .*?\.(?= `|$)", "", found[1])
            made = f"{others} `{only}`: {made[0].lower()}{made[1:]}"
        return f"<!-- made -->\n{made}\n"

    page.write_text(STAMP.sub(stamp, text), encoding="utf-8")


def _made() -> str:
    """When, of what and where."""
    asked = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(asked, cwd=DOCS.parent, capture_output=True, text=True, check=True).stdout.strip()
    return f"Made on {datetime.now(UTC):%Y-%m-%d} of commit {commit}, on {processor()}."


if __name__ == "__main__":
    make(PAGE, " ".join(sys.argv[1:]))
