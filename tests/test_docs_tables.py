"""Tables of results: the command above each gives its last row again (`make results` gives all)."""

import re

import pytest
from docs.make.tables import DOCS, MARKED, tables

from swath.core.errors import MissingExtra

ROWS = [
    pytest.param(table, row, id=f"{page.name}-{table.command.split()[2]}-{row[0]}")
    for page in sorted(DOCS.glob("**/*.md"))
    for table in tables(page)
    for row in table.rows[-1:]  # the others: make results
]


def test_every_mark_has_its_table():
    marks = sum(len(re.findall("<!-- each row:", page.read_text())) for page in DOCS.glob("**/*.md"))
    assert marks == len({id(row.values[0]) for row in ROWS}) > 1


@pytest.mark.draws
@pytest.mark.parametrize(("table", "row"), ROWS)
def test_a_row_is_what_its_command_gives(table, row):
    try:
        made = table.made(row[0])
    except MissingExtra as error:
        pytest.skip(str(error))
    assert len(row) == len(made)
    for (metric, _), shown, found in zip(table.columns, row[1:], made[1:], strict=True):
        last_digit = 10.0 ** -len(shown.partition(".")[2])
        off = abs(float(shown) - float(found))
        assert off <= 1.01 * last_digit, f"{metric}: {shown} on the page, {found} made"


def test_a_stale_figure_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- each row: swath run straight --set run.distance_m={}; distance_m .1f;\nray_count .0f -->\n"
        "| m | way | rays |\n|---|---|---|\n| 1.0 | 9.9 | 7 |\n| 2.0 | 2.0 | 0 |\n\nafter\n"
    )
    assert MARKED.search(page.read_text())
    (table,) = tables(page)
    assert table.columns == (("distance_m", ".1f"), ("ray_count", ".0f"))
    assert [row[0] for row in table.rows] == ["1.0", "2.0"]
    with pytest.raises(AssertionError, match=r"distance_m: 9.9 on the page, 1.0 made"):
        test_a_row_is_what_its_command_gives(table, table.rows[0])
