"""HTML pages from the Jinja2 templates in `report/templates/`; everything that is put in is escaped.

Pages of the tools extend the same `base.html.j2`; their templates lie beside them, in a folder they name.
"""

from functools import cache
from pathlib import Path
from typing import Any

TEMPLATES = Path(__file__).parent / "templates"
CSS = (TEMPLATES / "base.css").read_text(encoding="utf-8")


def render_page(template: str, folder: Path = TEMPLATES, **values: Any) -> str:
    """The page that a template makes of some values. folder: where it lies, if not among the shared ones."""
    return str(_environment(folder).get_template(template).render(css=CSS, **values))


@cache
def _environment(folder: Path) -> Any:
    import jinja2

    loader = jinja2.FileSystemLoader([folder, TEMPLATES])
    return jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
