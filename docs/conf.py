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
EXTRA = ROOT / "out" / "site-extra"  # replays, where `make replays` made them
html_extra_path = [str(EXTRA)] if EXTRA.is_dir() else []
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
html_show_search_summary = False  # a page read from a file may not fetch others
templates_path = ["templates"]
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
python_use_unqualified_type_names = True
nitpick_ignore_regex = [("py:.*", r".*")]  # types of other libraries and our aliases have no page to go to
highlight_language = "none"
default_role = "code"  # in docstrings

PAGE = re.compile(r"(?<!\[)`docs/([\w/-]+\.md)`")
OUTSIDE = re.compile(r"\[([^]]*)\]\((?:\.\./)+([\w./-]+)\)")
PICTURE = re.compile(r"(!\[[^]]*\]\(\.\./figures/gallery/([\w-]+)\.webp\))")
REPLAY = """
\\1

```{{raw}} html
<details class="replay"><summary>Replay, {size:.1f} MB</summary>
<iframe src="../replays/{name}.html" title="replay of {name}" loading="lazy"></iframe></details>
```
"""
INCLUDED = ("SECURITY.md", "CONTRIBUTING.md", "CHANGELOG.md")


def read(app: object, name: str, source: list[str]) -> None:
    """Named pages become links; links to files beside `docs` lead to their copy, or become their names."""
    up = "../" * name.count("/")

    def outside(found: re.Match[str]) -> str:
        text, path = found.groups()
        if path in INCLUDED:
            return f"[{text}]({up}reference/packages.md)"
        if path == "README.md":
            return f"[{text}]({up}index.md)"
        is_folder = (ROOT / path).is_dir() and not (ROOT / "docs" / path).exists()
        return f"`{path}`" if is_folder else found[0]

    source[0] = OUTSIDE.sub(outside, PAGE.sub(rf"[`\1`]({up}\1)", source[0]))
    if name == "reference/gallery":
        source[0] = PICTURE.sub(with_replay, source[0])


def with_replay(found: re.Match[str]) -> str:
    """The picture of a scenario, and its replay below where there is one."""
    file = EXTRA / "replays" / f"{found[2]}.html"
    if not file.is_file():
        return found[0]
    return found.expand(REPLAY.format(name=found[2], size=file.stat().st_size / 1e6))


def included(app: object, relative: Path, parent: str, content: list[str]) -> None:
    """Links of the included files are those of the repository's root."""
    text = re.sub(r"\]\(docs/", "](../", PAGE.sub(r"[`\1`](../\1)", content[0]))
    content[0] = re.sub(rf"\]\(({'|'.join(INCLUDED)})\)", "](packages.md)", text)


def setup(app: object) -> None:
    """Connect the hooks."""
    app.connect("source-read", read)  # type: ignore[attr-defined]
    app.connect("include-read", included)  # type: ignore[attr-defined]
