"""Drawn weather tables and downloads: right, told or refused by the key that was stated before."""

import pytest

from tests.readers.drawn_weather import draw, read
from tests.readers.verdict import verdict


@pytest.mark.parametrize("seed", range(900, 915))
def test_a_drawn_weather_is_right_told_or_refused_with_its_cause(seed):
    found = verdict(draw(seed), read)
    assert found.is_good, "\n".join(found.lines())
