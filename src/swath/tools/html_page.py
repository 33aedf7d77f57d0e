"""HTML pages of the tools: templates in `templates/`, filled by Jinja2, in the style of the run report."""

from pathlib import Path
from typing import Any

from swath.report.page import CSS


def write_page(path: Path, template: str, **content: Any) -> Path:
    """Fill a template and write the page; a page half written is never seen under its name."""
    part = path.with_name(path.name + ".part")
    part.write_text(render_page(template, **content), encoding="utf-8")
    part.replace(path)
    return path


def render_page(template: str, **content: Any) -> str:
    """The HTML. Values are escaped; a name that the template uses and `content` lacks is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("swath.tools"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.globals["css"] = environment.filters["safe"](CSS)
    return environment.get_template(f"{template}.html.j2").render(**content)


def signed(value: float, digits: int) -> str:
    """A number with a real minus sign, and without one where it rounds to 0."""
    text = f"{value:.{digits}f}"
    return text.replace("-", "" if float(text) == 0.0 else "−")
