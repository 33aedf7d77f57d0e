"""HTML pages from the Jinja2 templates in `templates/`; everything that is put in is escaped."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from swath.core.whole_file import write_whole

TEMPLATES = Path(__file__).parent / "templates"
CSS = (TEMPLATES / "base.css").read_text(encoding="utf-8")


@dataclass(frozen=True)
class Figure:
    """A picture with its heading and caption. image: a data address."""

    title: str
    image: str
    caption: str


@dataclass(frozen=True)
class Table:
    """A table with its heading. numeric: positions of columns that are numbers; text: below it."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[object]]
    numeric: Collection[int] = ()
    text: str = ""


def render_page(template: str, **values: Any) -> str:
    """The page that a template makes of some values; a name that it uses and `values` lacks is an error."""
    return str(_environment().get_template(template).render(css=CSS, **values))


def write_page(path: Path, template: str, **values: Any) -> Path:
    """Render and write a page; one that is half written is never seen under its name."""
    return write_whole(path, render_page(template, **values))


def write_tables(
    path: Path,
    heading: str,
    lead: str,
    tables: Sequence[Table],
    *,
    title: str = "",
    verdict: tuple[str, str, str] | None = None,
    figures: Sequence[Figure] = (),
    notes: Sequence[str] = (),
) -> Path:
    """Write a page of tables and pictures; those without rows are left out.

    title: of the window, the heading by default; verdict: kind (`pass`, `fail` or `none`), text, small text
    """
    values = {"heading": heading, "lead": lead, "tables": tables, "verdict": verdict}
    more = {"title": title or heading, "figures": figures, "notes": notes}
    return write_page(path, "tables.html.j2", **values, **more)


def signed(value: float, digits: int) -> str:
    """A number with a real minus sign, and without one where it rounds to 0; a dash for nan.

    Thousands are set off by narrow spaces.
    """
    if value != value:
        return "–"
    text = f"{value:,.{digits}f}"
    return text.replace("-", "−" if text.strip("-0.") else "").replace(",", "\u202f")


@cache
def _environment() -> Any:
    import jinja2

    loader = jinja2.FileSystemLoader(TEMPLATES)
    return jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
