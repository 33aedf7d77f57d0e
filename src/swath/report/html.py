"""The one page that swath writes: a heading, facts and sections of tables, figures and text.

Everything that is put in is escaped. In running text `code` in backticks, **bold** text and [links](target)
are set as such; a link leads to a place or a file beside the page alone, for the text may be a stranger's.
"""

import html
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from swath.core.files.whole_file import write_whole

SHORT, LONG = 16, 60  # characters of a cell that stays whole, and that would get too narrow beside those
MANY = 40  # rows of a table that would push away what follows it
TEMPLATES = Path(__file__).parent / "templates"
INLINE = ((r"`([^`\n]+)`", r"<code>\1</code>"), (r"\*\*(.+?)\*\*", r"<strong>\1</strong>"),
          (r"\[([^\]\n]+)\]\((#?\w[\w./-]*)\)", r'<a href="\2">\1</a>'))  # fmt: skip


VERDICTS = {
    "pass": ("✓", "pass"), "shown": ("✓", "pass"), "fail": ("✗", "fail"), "broken": ("✗", "fail"),
    "not shown": ("?", "none"), "not judged": ("–", "none"),
}  # fmt: skip


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()

    def __html__(self) -> str:
        return self


def element(name: str, text: object = "", **attributes: object) -> Html:
    """An element around text, which is escaped unless it is HTML. `class_` stands for `class`."""
    given = "".join(f' {key.rstrip("_")}="{html.escape(str(v))}"' for key, v in attributes.items() if v)
    return Html(f"<{name}{given}>{escaped(text)}</{name}>")


def escaped(text: object) -> Html:
    """The text, escaped unless it is HTML."""
    as_html = getattr(text, "__html__", None)
    return Html(as_html() if as_html else html.escape(str(text)))


def rich(text: object) -> Html:
    """Running text: code, bold text and links set as such."""
    made = str(escaped(text))
    if not isinstance(text, Html):
        for pattern, put in INLINE:
            made = re.sub(pattern, put, made)
    return Html(made)


def joined(parts: Sequence[object], between: str = " ") -> Html:
    """Several pieces of text or HTML as one."""
    return Html(between.join(escaped(p) for p in parts))


def verdict(word: str) -> Html:
    """A verdict with its sign and colour; another word as it is."""
    sign, look = VERDICTS.get(word, ("", ""))
    return element("span", f"{sign} {word}".strip(), class_=look)


def bar(share: float, width: str = "px", most: float = 120.0) -> Html:
    """A bar as long as a share of `most`."""
    return Html(f'<span class="bar" style="width:{most * share:.1f}{width}"></span>')


def counted(n: int, what: str) -> str:
    """`1 run`, `2 runs`."""
    return f"{n} {what}{'' if n == 1 else 's'}"


@dataclass(frozen=True)
class Facts:
    """Names and values beside each other; None is left out."""

    values: Mapping[str, object]
    kind = "facts"


@dataclass(frozen=True)
class Table:
    """A table.

    Parameters
    ----------
    title : heading, may be empty.
    head : names of the columns.
    rows : cells, text or HTML.
    numeric : positions of the columns that are numbers.
    text : running text below.
    kinds : a class of the style sheet for each row.
    """

    title: str
    head: Sequence[object]
    rows: Sequence[Sequence[object]]
    numeric: Collection[int] = ()
    text: str = ""
    kinds: Sequence[str] = ()
    kind = "table"

    def __bool__(self) -> bool:
        return bool(self.rows)


@dataclass(frozen=True)
class Figure:
    """A picture with its heading and caption. image: a data address."""

    title: str
    image: str
    caption: str
    kind = "figure"

    @property
    def is_drawn(self) -> bool:
        """It has a light and a dark look; others stand on white."""
        return self.image.startswith("data:image/svg")


@dataclass(frozen=True)
class Items:
    """A list of running text. is_wide: in two columns."""

    items: Sequence[object]
    is_wide: bool = False
    kind = "items"

    def __bool__(self) -> bool:
        return bool(self.items)


@dataclass(frozen=True)
class Beside:
    """Parts beside each other. look: `charts` in rows, `columns` in two columns, `pair` of the same width."""

    parts: Sequence[Any]
    look: str = "charts"
    kind = "beside"


@dataclass(frozen=True)
class Fold:
    """Parts that are shown when their heading is clicked."""

    summary: str
    parts: Sequence[Any]
    kind = "fold"


@dataclass(frozen=True)
class Banner:
    """Text that nobody should miss."""

    text: str
    kind = "banner"


@dataclass(frozen=True)
class Section:
    """A heading with its parts: text, or one of the classes here. Empty parts are left out."""

    title: str
    parts: Sequence[Any] = field(default_factory=tuple)
    anchor: str = ""

    def __bool__(self) -> bool:
        return any(self.parts)


def render_page(
    sections: Sequence[Any],
    *,
    heading: str,
    lead: str = "",
    title: str = "",
    verdict: tuple[str, str, str] | None = None,
    top: Sequence[Any] = (),
    footer: str = "",
) -> str:
    """A page.

    Parameters
    ----------
    sections : sections; a table or a figure is one under its own title. Those that hold nothing are left out.
    heading, lead : the first lines of the page.
    title : of the window, the heading by default.
    verdict : kind (`pass`, `fail` or `none`), text, small text of the box in the upper right corner.
    top : parts before the first section.
    footer : the last line.
    """
    shown = [s for s in map(_section, sections) if s]
    page = _environment().get_template("page.html.j2")
    css = (TEMPLATES / "page.css").read_text(encoding="utf-8")
    return str(
        page.render(
            css=css, sections=shown, heading=heading, lead=lead, title=title or heading, verdict=verdict,
            top=top, footer=footer,
        )
    )  # fmt: skip


def _section(made: Any) -> Section | None:
    if isinstance(made, Table):
        table, count = replace(made, title=""), len(made.rows)
        return Section(made.title, (Fold(f"Show all {count} rows", (table,)) if count > MANY else table,))
    return Section(made.title, (made,)) if isinstance(made, Figure) else made


def write_page(path: Path, sections: Sequence[Any], **values: Any) -> Path:
    """Render and write a page; one that is half written is never seen under its name."""
    return write_whole(path, render_page(sections, **values))


def cell(text: object, *, is_number: bool) -> Html:
    """A cell of a table: a word or a short text stays whole, a number has a real minus, none is a dash."""
    made, plain = escaped(text), "" if isinstance(text, Html) else str(text)
    if is_number and plain:
        made = Html("-" if plain == "nan" else re.sub(r"(?<![\w.])-(?=[\d.])", "−", made))
    seen = html.unescape(re.sub("<[^>]*>", "", made))
    is_whole = len(seen) <= SHORT or " " not in seen
    look = "n" if is_number else "word" if is_whole else "long" if len(plain) > LONG else ""
    return Html(f'<td class="{look}">{made}</td>' if look else f"<td>{made}</td>")


@cache
def _environment() -> Any:
    import jinja2

    loader = jinja2.FileSystemLoader(TEMPLATES)
    made = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    made.filters["rich"] = rich
    made.globals["cell"] = cell
    return made
