"""Steering fitted to drawn logs of machines in continuous time: no number is both wrong and sure."""

import numpy as np
import pytest

pytest.importorskip("scipy")

from swath.core.units import DEG
from swath.machine.machine_sheet import read_machine
from swath.tools.compare_log.steering_fit import STEERING, compare_steering, run_steering, settled
from tests.tools.drawn_steering import drawn


@pytest.mark.parametrize("seed", [4, 8])
def test_numbers_of_drawn_steerings_lie_in_their_intervals(tmp_path, seed):
    made = drawn(seed, motion=False, longest=150.0)
    done = compare_steering("lexion-700-class", made.write(tmp_path / "log.csv"))
    (part,) = done.parts
    told = [f for f in part.fitted if f.is_seen and f.key in made.truth]
    assert len(told) >= 2
    for f in told:
        # half as wide again: 95 % of many numbers do not lie all in their intervals
        room = 0.25 * (f.high - f.low) if np.isfinite(f.high - f.low) else 0.0
        assert f.low - room <= made.truth[f.key] <= f.high + room
    for f in part.fitted[:-1]:
        ends = STEERING[f.key].low, STEERING[f.key].high
        assert f.value not in ends or any(note.startswith(f"{f.key}:") for note in done.notes)


def test_the_error_told_is_that_of_the_sheet_handed_out_and_held_numbers_are_named(tmp_path):
    made = drawn(5, motion=False, longest=150.0)
    done = compare_steering("lexion-700-class", made.write(tmp_path / "log.csv"), fit=["steering.lag_s"])
    (part,) = done.parts
    lag, offset = part.fitted
    angle = run_steering(read_machine(done.sheet), done.log) / DEG + offset.value
    left = (angle - done.log.angle / DEG)[settled(done.log)]
    assert part.rmse[1] == pytest.approx(float(np.sqrt(np.mean(left**2))), rel=1e-3)
    assert lag.low <= made.truth["steering.lag_s"] <= lag.high
    assert any("was held" in note for note in done.notes)
