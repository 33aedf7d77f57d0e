"""index.html of `swath paper`: the figures beside what the paper says, what was reproduced and what not."""

from collections.abc import Callable
from pathlib import Path

from swath import __version__
from swath.report.html import write_page
from swath.tools.paper.figures import CASES, FIGURES


def write_paper(out: Path, step: Callable[[str], None]) -> Path:
    """Make every figure and write the page; returns its path. step: told the name of each figure."""
    import matplotlib

    from swath.report.plots import STYLE

    made = {}
    for name, make in FIGURES.items():
        step(name)
        with matplotlib.rc_context(STYLE):
            made[name] = make(out)
    titles = {name: title for name, (title, _) in CASES.items()}
    return write_page(out / "index.html", "paper.html.j2", version=__version__, made=made, cases=titles)
