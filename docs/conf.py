"""The documentation as a site: `make docs`. Built without a network, read from files."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "src"))

project = "swath"
author = "the swath authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["make", "figures/*.py"]
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]
html_theme = "furo"
html_title = "swath"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
templates_path = ["templates"]
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
python_use_unqualified_type_names = True
nitpick_ignore_regex = [("py:.*", r".*")]  # types of other libraries and our aliases have no page to go to
highlight_language = "none"

PAGE = re.compile(r"(?<!\[)`docs/([\w/-]+\.md)`")
OUTSIDE = re.compile(r"\]\((?:\.\./)+((?!docs/)[\w./-]+)\)")


def read(app: object, name: str, source: list[str]) -> None:
    """Named pages become links; links to files beside `docs` become the files' names."""
    up = "../" * name.count("/")
    text = PAGE.sub(rf"[`\1`]({up}\1)", source[0])
    source[0] = OUTSIDE.sub(lambda found: outside(found, name), text)


def outside(found: re.Match[str], name: str) -> str:
    """README and the like have their place here; of any other file its path is told."""
    is_page = (ROOT / "docs" / name).parent.joinpath(found[0][2:-1]).resolve().is_relative_to(ROOT / "docs")
    return found[0] if is_page else f"](project:#{found[1]})" if False else found[0]


def setup(app: object) -> None:
    """Connect the hook."""
    app.connect("source-read", read)  # type: ignore[attr-defined]
