"""`swath test levels`: what agrees and saves time is proposed, what disagrees or cannot be had is not."""

import pytest

from swath.core.errors import InputError
from swath.tools.function_test import cheaper

MOTION, LAW = "combine.motion.level=kinematic", "combine.steer.level=pure_pursuit"
DEAR, CURVE = "combine.header.level=height_control", "combine.steer.curvature_per_m=0.1"

AS_IT_IS = {
    "verdict": "pass", "cpu_s": 10.0, "expect": [], "case": "turn-circle", "candidate": "base", "seed": 1,
    "point": {}, "digest": "",
}  # fmt: skip


def test_levels_of_a_case(monkeypatch):
    monkeypatch.setattr(cheaper, "_changes", lambda run: iter([MOTION, LAW, DEAR, CURVE]))
    monkeypatch.setattr(cheaper, "_time", lambda results: times.pop(0))
    times = [10.0, 4.0, 12.0, 1.0, 4.5]  # as it is, with each that comes to an end, all together
    found = cheaper.find_cheaper("turn-circle", runs=1, sets=["run.distance_m=6"])
    motion, law, dear, curve = found.tried
    assert (motion.why, dear.why) == ("", "")
    assert law.why.startswith("cannot be had")
    assert curve.why == "other numbers"
    assert found.together.sets == (MOTION,)
    assert found.saved(found.together) == pytest.approx(0.55)


def test_what_together_disagrees_is_left_out(monkeypatch):
    def against(before, planned, sets, within):
        why = "other verdicts" if len(sets) > 1 else ""
        return cheaper.Tried(sets, 5.0 - len(sets[0]) * 0.01, 1, why=why)

    monkeypatch.setattr(cheaper, "_changes", lambda run: iter([MOTION, "combine.imu.level=ideal"]))
    monkeypatch.setattr(cheaper, "_against", against)
    monkeypatch.setattr(cheaper, "_done", lambda planned, sets: [AS_IT_IS])
    found = cheaper.find_cheaper("turn-circle", runs=1)
    assert found.together.sets == (MOTION,)


def test_every_slot_is_tried_and_no_level_twice():
    run = next(iter(cheaper.Plan("turn-circle").runs()))
    changes = list(cheaper._changes(run))
    assert len(set(changes)) == len(changes) > 15
    assert "combine.motion.level=kinematic" in changes
    assert "combine.motion.level=single_track" not in changes  # the case has it


def test_numbers_that_make_no_sense():
    with pytest.raises(InputError, match="--runs = 0"):
        cheaper.find_cheaper("turn-circle", runs=0)
