"""What is put into a page does nothing there."""

import re

import pytest

from swath.report.chart import Chart
from swath.report.html import MANY, Html, Section, Table, cell, element, render_page, rich
from tests.pages import CSS, faults

BESIDE = ["replay.html", "runs/a-1/report.html", "#judged"]
AWAY = ["javascript:alert(1)", "JaVaScRiPt:alert(1)", "data:text/html,x", "//example.org", "https://example.org",
        "../../etc/passwd", "/etc/passwd", '"onclick="alert(1)', "&#106;avascript:alert(1)"]  # fmt: skip


@pytest.mark.parametrize("target", BESIDE)
def test_a_link_leads_beside_the_page(target):
    assert rich(f"see [here]({target})") == f'see <a href="{target}">here</a>'


@pytest.mark.parametrize("target", AWAY)
def test_text_of_a_stranger_leads_nowhere_else(target):
    assert "<a" not in rich(f"see [here]({target})")


def test_text_is_escaped_wherever_it_stands():
    bad = "<script>alert(1)</script>"
    table = Table(bad, [bad], [[bad]], text=bad)
    page = render_page(
        [table, Section(bad, [bad])], heading=bad, lead=bad, verdict=("pass", bad, bad), footer=bad
    )
    assert "<script" not in page
    assert page.count("&lt;script&gt;") >= 9


BAD = {
    "<table>": "does not lie in anything that scrolls",
    '<p class="misspelt">': "class misspelt has no look",
    '<p style="color:red">': "a colour in one look alone",
    '<p style="background:#fff">': "a colour in one look alone",
    '<div class="wide"><svg fill="var(--pink)"><path>': "pink is no colour of the palette",
    '<div class="wide"><svg><g></g></svg>': "a chart shows nothing",
    '<div class="wide"><table><td>nan</td>': "a cell says nan",
}
WHOLE = (
    element("p", "1 < 2", class_="banner", style="width:3px"),
    Table("", ["a"], [["-2"], [element("span", "", class_="bar", style="background:var(--blue)")]], (0,)),
)


@pytest.mark.parametrize("bad", BAD)
def test_what_is_wrong_with_a_page_is_found(bad):
    chart = Chart(10.0, 10.0, "a line")
    chart.curve([0.0, 1.0], [0.0, float("nan")])
    assert faults(render_page([Section("", [*WHOLE, chart])], heading="good")) == []
    with pytest.raises(AssertionError, match=BAD[bad]):
        render_page([Section("", [*WHOLE, Html(bad)])], heading="bad")


LOOKS = [dict(re.findall(r"--(\w+):(#\w+)", block)) for block in re.findall(r":root{([^}]*)}", CSS)]
ON = {
    4.5: [(text, back) for text in ("ink", "soft", "pass", "fail", "link") for back in ("paper", "code")]
    + [("ink", back) for back in ("warn", "row", "alike", "good", "fair", "off")],
    3.0: [(mark, back) for mark in ("blue", "orange", "on", "cross") for back in ("paper", "code")],
}


@pytest.mark.parametrize("look", LOOKS, ids=["light", "dark"])
def test_both_looks_can_be_read(look):
    assert look.keys() == LOOKS[0].keys()
    for least, pairs in ON.items():  # contrast of text and of marks by WCAG 2.2, 1.4.3 and 1.4.11
        for front, back in pairs:
            light, dark = sorted((luminance(look[front]), luminance(look[back])), reverse=True)
            assert (light + 0.05) / (dark + 0.05) >= least, (front, back)


def luminance(colour):
    """Relative luminance by WCAG 2.2."""
    given = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
    parts = [int(given[i : i + 2], 16) / 255.0 for i in (0, 2, 4)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_a_number_that_is_none_is_a_dash():
    assert [cell(text, is_number=True) for text in ("nan", "-2")] == [
        f'<td class="n">{text}</td>' for text in ("-", "−2")
    ]


def test_short_cells_stay_whole_whatever_they_are_of():
    for text in ("not shown", "-12 to -6", element("span", "not shown", title="a long text of a tip")):
        assert 'class="word"' in cell(text, is_number=False)
    assert 'class="word"' not in cell("of more words than fit", is_number=False)


@pytest.mark.parametrize("count", [1, MANY, MANY + 1])
def test_a_table_of_many_rows_is_folded(count):
    page = render_page([Table("Rows", ["a"], [["1"]] * count)], heading="long")
    assert page.count("<tr") == count + 1
    assert ("<details>" in page) == (count > MANY)
