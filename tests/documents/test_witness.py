"""Pairs that must agree: what is told, what is refused, what a user may state."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.documents.reasons import doubts
from swath.documents.witness import Pair, Witness, ask, judge, ratio


def pair(residual, **more):
    return Pair("width", "one says 9 m, the other 8 m", residual, 0.1, 0.5, "width: {unit: ft}", **more)


def test_a_pair_is_silent_told_or_refused_by_its_residual():
    assert judge([pair(0.1), pair(np.nan)]) == []
    assert judge([pair(0.2)]) == ["width: one says 9 m, the other 8 m; width: {unit: ft}"]
    with pytest.raises(
        InputError, match=r"width = one says .*: expected both to agree; width: \{unit: ft\} \(a"
    ):
        judge([pair(0.0), pair(0.6)], "a.csv")
    assert len(judge([pair(0.6, is_stated=True)])) == 1


@pytest.mark.parametrize(("one", "other", "apart"), [(9, 9, 0), (9, 6, 0.5), (6, 9, 0.5), (0, 9, None)])
def test_a_ratio_is_the_same_either_way(one, other, apart):
    assert ratio(one, other) == pytest.approx(np.nan if apart is None else apart, nan_ok=True)


def test_rows_of_a_table_are_asked_where_their_measures_are_there():
    table = (
        Witness(("fog", "air"), lambda fog, air: (air - fog, fog), "fog of {:g} m", "km?", 1.0, 5.0),
        Witness(("other",), lambda other: (other,), "never", "asked"),
    )
    assert ask(table, {"fog": 2.0}) == ask(table, {"fog": 2.0, "air": 3.0}) == []
    notes = ask(table, {"fog": 2.0, "air": 5.0})
    assert notes == ["plausible: fog of 2 m; km?"]
    assert doubts([f"field.weather: {note}" for note in notes]) == ["plausible"]
    with pytest.raises(InputError, match=r"plausible = fog of 2 m: expected numbers that agree; km\?"):
        ask(table, {"fog": 2.0, "air": 9.0})
