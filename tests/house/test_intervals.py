"""Each number with an interval stands in the list of them, with what must agree before it counts."""

import re
from pathlib import Path

import swath

SOURCE = Path(swath.__file__).parent
MAKES = re.compile(
    r"\bdef \w*(bootstrap|jackknife|left_out_error|standard_error|interval)|clopper|wilson", re.IGNORECASE
)
PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "validation.md"


def test_the_page_lists_every_fit_with_an_interval():
    listed = PAGE.read_text(encoding="utf-8").partition("## Numbers with an interval")[2]
    makers = {
        f.relative_to(SOURCE) for f in SOURCE.rglob("*.py") if MAKES.search(f.read_text(encoding="utf-8"))
    }
    assert len(makers) > 4
    assert not [str(f) for f in makers if str(f) not in listed and f.parent.as_posix() not in listed]
    for name in re.findall(r"`((?:core|field_io|tools)/[\w/]+\.py)`", listed):
        assert (SOURCE / name).is_file()
