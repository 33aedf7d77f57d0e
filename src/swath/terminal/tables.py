"""Tables and titled paragraphs on stdout."""

import os
from collections.abc import Sequence
from typing import Any

from swath.terminal.options import option

PIPE_WIDTH = 1000  # columns of a pipe or file: lines stay whole
EDGE, BETWEEN = 2, 3  # blanks beside a table, and between two of its columns


def wide_console() -> Any:
    """A console on stdout as wide as the terminal or COLUMNS; as wide as it takes where there is neither."""
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal and not os.environ.get("COLUMNS", "").isdecimal():
        console.width = PIPE_WIDTH
    return console


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table."""
    from rich import box
    from rich.table import Table

    console = wide_console()
    made = Table(title=title or None, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    for column, width in zip(columns, _widths(columns, rows, console.width), strict=True):
        made.add_column(column, overflow="fold", width=width)
    for row in rows:
        made.add_row(*(str(cell).replace("[", "\\[") for cell in row))
    console.print(made)


def _widths(columns: Sequence[str], rows: Sequence[Sequence[str]], most: int) -> list[int]:
    """Widths of columns: those of their text; if that is too wide, the widest is narrowed first.

    most: width of the table with its edges and what is between columns
    """
    cells = [[str(cell) for cell in column] for column in zip(columns, *rows, strict=True)]
    cells[0] = [cell.replace(" ", "_") for cell in cells[0]]  # names stay whole
    widths = [max(map(len, column)) for column in cells]
    words = [max(len(word) for cell in column for word in (cell.split() or [""])) for column in cells]
    most -= EDGE + BETWEEN * (len(columns) - 1)
    for least in (words, [1] * len(words)):
        while sum(widths) > most:
            room = [(w, k) for k, (w, m) in enumerate(zip(widths, least, strict=True)) if w > m]
            if not room:
                break
            widths[max(room)[1]] -= 1
    return widths


def say(text: str) -> None:
    """Print a line, wrapped between words where the terminal or COLUMNS is narrower."""
    import textwrap

    indent, width = " " * (len(text) - len(text.lstrip())), wide_console().width
    whole = textwrap.TextWrapper(
        width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    print(whole.fill(text))


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
        body = "\n".join(lines).replace("\N{NO-BREAK SPACE}", " ")
        console.print(Text(body[: len(head)]).append(body[len(head) :], style="dim"))


def result(value: Any) -> str:
    """A result of one seed, of which others differ by half and more: two digits, or whole numbers."""
    if isinstance(value, float) and abs(value) < 1e6:
        return f"{value:.0f}" if abs(value) >= 9.5 else f"{value:.2g}"
    return number(value)


def number(value: Any) -> str:
    """A number at a readable length, anything else as it is."""
    if value is None:
        return "-"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if isinstance(value, int):
        return f"{value:,}".replace(",", " ")
    return f"{value:.4g}"
