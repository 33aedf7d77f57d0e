"""What is put into a page does nothing there."""

import pytest

from swath.report.html import Section, Table, render_page, rich

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
