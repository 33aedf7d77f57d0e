"""Numbers for people: digits, signs and the same text wherever a value is shown."""

import re
from math import inf, nan
from random import Random

import numpy as np
import pytest

from swath.core.number_text import FEW, LARGEST, LEAST, num, percent_of, signed, span
from swath.judge.catalogue import load_evaluators
from swath.report.notebook import run_html
from swath.report.page import _groups, limit_row
from swath.terminal.outcome import print_outcome


def drawn(rng, count=400):
    """Computed numbers of all sizes, and what people write: few digits."""
    for _ in range(count):
        value = rng.choice((-1.0, 1.0)) * rng.uniform(1.0, 10.0) * 10.0 ** rng.randint(-12, 12)
        yield value if rng.random() < 0.6 else float(f"{value:.{rng.randint(1, FEW)}g}")


def parsed(text):
    return float(text.replace(" ", ""))


def behind(text):
    return len(text.partition(".")[2])


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0837912, "0.0838"), (8.37912, "8.38"), (0.084, "0.084"), (1234.5678, "1 235"), (1087151, "1 087 151"),
     (0.9877, "0.9877"), (0.1 + 0.2, "0.3"), (1.6612e-16, "1.6612e-16"),
     (1.66123456e-16, "1.66e-16"), (0.0, "0"), (-0.0, "0"), (12, "12"),
     (None, "-"), (nan, "-"), (inf, "inf"), (-inf, "-inf"), (True, "True"), ("as it is", "as it is")],
)  # fmt: skip
def test_numbers(value, text):
    assert num(value) == text


def test_units_percents_ranges_and_differences():
    assert (num(0.0837912, "m"), num(0.5, "1"), num(3, "")) == ("0.0838 m", "0.5", "3")
    assert (percent_of(0.98765432), percent_of(None), percent_of(nan)) == ("98.8 %", "-", "-")
    assert (span([2.0, 8.0]), span([2.0, 2.0])) == ("2 to 8", "2")
    assert signed(0.00059971, "m", of=[0.0837912, 0.0831915]) == "+0.0006 m"
    assert signed(-1e-9, of=[0.5, 0.5]) == "0"
    assert (signed(12, of=[100, 112]), signed(-12), signed(0), signed(inf)) == ("+12", "-12", "0", "+inf")


def test_what_is_read_back_is_as_near_as_the_digits():
    rng, exact, exponents = Random(1), 0, 0
    for value in drawn(rng):
        text, size = num(value), abs(value)
        few = float(f"{value:.{FEW}g}") == value and LEAST <= size < LARGEST
        is_plain = LEAST <= size < LARGEST
        off = abs(parsed(text) - value)
        assert off == 0.0 if few else off <= max(0.0051 * size, 0.0)
        assert off <= 0.5 or not is_plain, "places before the point are never rounded away"
        assert ("e" in text) == (not is_plain)
        assert text == num(np.float64(value)) == num(parsed(text)) or not few
        assert not re.search(r"\.\d*0$", text)
        exact, exponents = exact + few, exponents + (not is_plain)
    assert exact > 50
    assert exponents > 50


def test_numbers_that_differ_are_told_apart():
    rng = Random(2)
    for value in drawn(rng):
        other = value * (1.0 + rng.choice((-1, 1)) * 10.0 ** -rng.randint(1, 12))
        if min(abs(value), abs(other)) > LEAST and max(abs(value), abs(other)) < LARGEST and value != other:
            assert num(value, beside=[other]) != num(other, beside=[value])
            assert num(value, beside=[value, None]) == num(value)


def test_a_difference_has_the_places_of_what_it_is_of():
    rng = Random(3)
    for _ in range(300):
        a = rng.uniform(0.001, 900.0)
        b = a * rng.uniform(0.8, 1.2)
        text, places = signed(b - a, of=[a, b]), [behind(num(v, beside=[a, b])) for v in (a, b)]
        assert text == "0" or behind(text) == max(places)
        assert text == "0" or text.startswith("+" if b > a else "-")
        assert abs(parsed(text) - (b - a)) <= 0.5001 * 10.0 ** -max(places)


def test_a_metric_is_the_same_text_wherever_it_is_shown(tmp_path, capsys):
    known, rng = load_evaluators().metrics, Random(4)
    names = [name for name, metric in known.items() if metric.unit]
    walked = 0
    for value in drawn(rng, 40):
        metric = known[rng.choice(names)]
        values, text = {metric.name: value}, num(value)
        print_outcome({"machines": {"combine": values}, "expect": []}, tmp_path)
        assert f" {text} " in capsys.readouterr().out
        assert f">{num(value, metric.unit)}<" in str(_groups(values, [metric])[0].parts[0].rows[0][1])
        assert f">{text}</td>" in run_html("run", values, tmp_path)
        entry = {"subject": "combine", "name": metric.name, "value": value, "result": "pass", "limit": {}}
        assert limit_row(entry, known)["value"] == num(value, metric.unit)
        walked += 4
    print(f"{walked} texts of {len(names)} metrics")


def test_a_value_is_told_from_its_limit(tmp_path, capsys):
    entry = {"subject": "combine", "name": "header_use", "limit": {"min": 0.9877}, "value": 0.98765432,
             "result": "fail", "reason": ""}  # fmt: skip
    print_outcome({"machines": {"combine": {"header_use": 0.98765432}}, "expect": [entry]}, tmp_path)
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith(" header_use"))
    assert row.split() == ["header_use", "0.98765", "1", "min", "0.9877", "fail"] or "0.98765" in row
    assert limit_row(entry, load_evaluators().metrics)["value"] == "0.98765"
