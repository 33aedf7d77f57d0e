"""`swath paper`: figures that say what is true of what they show, on a page that shows all of them."""

import re

import pytest

from swath.report.html import write_page
from swath.tools.paper.figures import CASES, FIGURES, Made


def numbers(text):
    return [float(n) for n in re.findall(r"[-+]?\d+\.?\d*", text)]


def test_the_levels_are_those_of_the_registry(tmp_path):
    from swath.scenario.slots import CATALOGUE

    kinds = [*CATALOGUE.field_levels, *(slot.name for slot in CATALOGUE.slots)]
    made = FIGURES["levels"](tmp_path)
    count = sum(len(CATALOGUE.registry.names(kind)) for kind in kinds)
    assert numbers(made.result) == [len(kinds), count]


def test_stands_hold_the_plants_that_the_paper_names(tmp_path):
    _, first, second, *_ = numbers(FIGURES["lab stands"](tmp_path).result)
    assert first == pytest.approx(200, rel=0.05)
    assert second == pytest.approx(600, rel=0.05)


def test_the_three_sensor_models_measure_about_the_same_heights(tmp_path):
    made = FIGURES["sensor models"](tmp_path)
    found = {name: float(m) for name, m in re.findall(r"(replay|empirical|plants) (\d\.\d+) m", made.result)}
    assert set(found) == {"replay", "empirical", "plants"}
    assert max(found.values()) - min(found.values()) < 0.1
    assert 0.3 < found["plants"] < 0.8  # of a stand of 0.85 m, seen from 30 degrees


def test_the_edge_is_found_where_it_is(tmp_path):
    found, true, error = numbers(FIGURES["edge detection"](tmp_path).result)
    assert error == pytest.approx(100 * (found - true), abs=0.11)
    assert abs(error) < 5


def test_the_flow_is_that_of_the_demo(tmp_path):
    from swath.scenario.scenario import load_scenario

    parts, wires = numbers(FIGURES["flow"](tmp_path).result)[:2]
    assert parts == len(load_scenario("laser-pilot").machines["combine"].slots)
    assert wires >= parts


@pytest.mark.drawn
def test_the_page_shows_every_figure_and_case(tmp_path):
    made = {name: Made(f"data:{k}", f"result {k}.") for k, name in enumerate(FIGURES)}
    cases = {name: title for name, (title, _) in CASES.items()}
    page = write_page(tmp_path / "index.html", "paper.html.j2", version="1", made=made, cases=cases)
    text = page.read_text(encoding="utf-8")
    assert [k for k in range(len(made)) if text.count(f"result {k}.") != 1 or f'"data:{k}"' not in text] == []
    for name in cases:
        assert f"{name}/report.html" in text
    assert "A multilevel simulation framework" in text
