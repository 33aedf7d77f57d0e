"""Logs that are drawn are read right, or what is wrong with them is said by its own key."""

import pytest

pytest.importorskip("rasterio")
pytest.importorskip("asammdf")
pytest.importorskip("can")

from tests.readers.drawn_logs import HELD_OUT, draw, is_held_out, read
from tests.readers.verdict import Drawn, Got, Truth, judged, verdict

SEEDS = (6, 8, 10, 15, 21, 22, 24, 27, 51, 66, 68, 71)


@pytest.mark.draws
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.filterwarnings("ignore")
def test_a_drawn_log_is_read_right_or_told(seed):
    made = verdict(draw(seed), read)
    assert made.is_good, "\n".join(made.lines())


def test_a_draw_is_the_same_again_and_keeps_what_is_held_out():
    for seed in range(12):
        one, again = draw(seed), draw(seed)
        assert (one.usual, one.unusual, one.truth) == (again.usual, again.unusual, again.truth)
        assert not is_held_out(one)
        assert is_held_out(draw(seed, held_out=True))
        assert bool(one.expected) == bool(seed % 3)
    assert all(HELD_OUT.values())


@pytest.mark.parametrize(
    ("got", "expected", "word"),
    [
        (Got({"yield": 5.05}), {"sources"}, "right"),
        (Got({"yield": 5.05}, ("width: passes lie apart",)), set(), "false alarm"),
        (Got({"yield": 5.05}, ("unit: taken as t/ha",)), set(), "right"),
        (Got({"yield": 5.05}, (), {"records": 9}), set(), "miscounted"),
        (Got({"yield": 5.05}, (), {"records": 10}, {"delay": [1.0, float("nan")]}), set(), "right"),
        (Got({"yield": 5.05}, (), {"records": 10}, {"delay": [4.0]}), set(), "wrong claim"),
        (Got({"yield": 2.5}, ("a note without a key",)), {"sources"}, "SILENT"),
        (Got({"yield": 2.5}, ("width: passes lie apart",)), {"sources"}, "misnamed"),
        (Got({"yield": 2.5}, ("sources: two buses",)), {"sources"}, "told"),
    ],
)
def test_the_verdict_on_a_result(got, expected, word):
    counts = {"records": 10} if got.counts else {}
    claims = {"delay": Truth(1.0, absolute=0.5)}
    drawn = Drawn(0, lambda folder: folder, {"yield": Truth(5.0)}, frozenset(expected), counts, claims=claims)
    assert judged(drawn, got).word == word


def test_what_nobody_could_know_must_be_told():
    drawn = Drawn(0, lambda folder: folder, {}, frozenset({"lost"}))
    assert judged(drawn, Got({"yield": 5.0})).word == "SILENT"
    assert judged(drawn, Got({"yield": 5.0}, ("lost: 30 % of the records",))).word == "told"
