"""Tables and titled paragraphs on stdout."""

import os
import re
from collections.abc import Sequence
from typing import Any

from swath.terminal.options import option

PIPE_WIDTH = 1000  # columns of a pipe or file: lines stay whole
EDGE, BETWEEN = 2, 3  # blanks beside a table, and between two of its columns
_GROUP = r"(?<=\d) (?=\d{3}(?!\d))"  # a blank in a number
_DOT = r"(?<=[^\W\d]\.)(?=[^\W\d])|(?<=[/,])(?=[^\d/])"  # in a key, a path or a list
KEPT = "\N{NO-BREAK SPACE}"
BLANK = re.compile(rf"(?!{_GROUP})\s+")
INSIDE, ANYWHERE = re.compile(_DOT), re.compile(rf"(?!{_GROUP})\s+|{_DOT}")


def wide_console() -> Any:
    """A console on stdout as wide as the terminal or COLUMNS; as wide as it takes where there is neither."""
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal and not os.environ.get("COLUMNS", "").isdecimal():
        console.width = PIPE_WIDTH
    return console


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table. Cells break between words, keys and paths behind a dot, `/` or `,`; rows of a table that
    is too wide for that are printed one below the other.
    """
    from rich import box
    from rich.table import Table

    console = wide_console()
    if title:
        say(title)
    cells = [[str(cell) for cell in row] for row in rows]
    widths = _widths(columns, cells, console.width)
    if sum(widths) + EDGE + BETWEEN * (len(columns) - 1) > console.width:
        for line in _blocks(columns, cells, console.width):
            print(line)
        return
    made = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    heads, *texts = [
        ["\n".join(broken(c, w)) for c, w in zip(row, widths, strict=True)] for row in (columns, *cells)
    ]
    for head, width in zip(heads, widths, strict=True):
        made.add_column(head, no_wrap=True, width=width)
    for row in texts:
        made.add_row(*(cell.replace("[", "\\[") for cell in row))
    console.print(made)


def broken(text: str, width: int) -> list[str]:
    """The lines of a text, broken between words, within one behind a dot, `/` or `,` where it is too long.

    What stays too long is not broken.
    """
    lines = [""]
    for word in BLANK.split(text.strip()):
        pieces = [word] if len(word) <= width else INSIDE.split(word)
        for n, piece in enumerate(pieces):
            joined = lines[-1] + " " * (n == 0 and lines[-1] != "") + piece
            if len(joined) <= width or not lines[-1]:
                lines[-1] = joined
            else:
                lines.append(piece)
    return lines


def _widths(columns: Sequence[str], rows: Sequence[Sequence[str]], most: int) -> list[int]:
    """Widths of columns: those of their text; if that is too wide, the widest is narrowed first, at last to
    what may not be broken.

    most: width of the table with its edges and what is between columns
    """
    cells = list(zip(columns, *rows, strict=True))
    names = [tuple(cell.replace(" ", "_") for cell in cells[0]), *cells[1:]]  # names stay whole if they can
    widths = [max(map(len, column)) for column in cells]
    most -= EDGE + BETWEEN * (len(columns) - 1)
    for of, parts in ((names, BLANK), (cells, BLANK), (cells, ANYWHERE)):
        least = [max(len(part) for cell in column for part in parts.split(cell)) for column in of]
        while sum(widths) > most:
            room = [(w, k) for k, (w, m) in enumerate(zip(widths, least, strict=True)) if w > m]
            if not room:
                break
            widths[max(room)[1]] -= 1
    return widths


def _blocks(columns: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """Each row as lines of its own, `column  text`."""
    indent, lines = max(map(len, columns)) + 2, list[str]()
    for row in rows:
        for column, cell in zip(columns, row, strict=True):
            first, *more = broken(cell, max(width - indent, 1))
            if cell:
                lines += [f"{column:<{indent}}{first}", *(" " * indent + line for line in more)]
        lines.append("")
    return lines


def say(text: str) -> None:
    """Print a line, wrapped between words where the terminal or COLUMNS is narrower."""
    import textwrap

    indent, width = " " * (len(text) - len(text.lstrip())), wide_console().width
    lines = textwrap.TextWrapper(
        width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    print(lines.fill(re.sub(_GROUP, KEPT, text)).replace(KEPT, " "))


def whole(text: str) -> str:
    """A text, such as a path, that `say` does not break."""
    return text.replace(" ", KEPT)


def as_json(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print rows as a JSON list of objects with these keys."""
    import json

    print(json.dumps([dict(zip(columns, row, strict=True)) for row in rows], indent=1))


def add_json(parser: Any) -> None:
    """`--json` of a command that lists things."""
    option(parser, "--json", "print a JSON list")


def paragraphs(items: Sequence[tuple[str, str]]) -> None:
    """Print titled paragraphs, wrapped beside their titles; the texts dim where the terminal can."""
    import textwrap

    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    width = min(wide_console().width, 120)
    indent = min(max((len(title) for title, _ in items), default=0), 24) + 2
    for title, text in items:
        head = f"{title:<{indent - 2}}  "
        lines = textwrap.wrap(
            text, width, initial_indent=head, subsequent_indent=" " * indent, break_on_hyphens=False
        )
        body = "\n".join(lines).replace(KEPT, " ")
        console.print(Text(body[: len(head)]).append(body[len(head) :], style="dim"))
