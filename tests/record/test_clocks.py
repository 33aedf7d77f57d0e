"""Clocks of a recording: stamps are on that of the log, whatever made them, and whenever it is set."""

import numpy as np
import pytest

from swath.core.schedule import NS
from swath.record.read.clocks import Clocks

BEGIN = 1_700_000_000 * NS


def drawn(seed):
    """Messages of 10 to 100 Hz, 1 to 80 ms late: when each was measured, and received [ns]."""
    rng = np.random.default_rng(seed)
    period, late = NS // int(rng.integers(10, 101)), int(rng.integers(1, 80)) * NS // 1000
    true = BEGIN + period * np.arange(400)
    return rng, true, true + late + rng.integers(0, NS // 1000, 400)


def read(stamps, received):
    notes = []
    clocks = Clocks()
    pairs = zip(stamps.tolist(), received.tolist(), strict=True)
    return np.array([clocks.time("x", s, t, notes.append) for s, t in pairs]), notes


@pytest.mark.parametrize("seed", range(12))
def test_times_stay_true_where_the_clock_is_set(seed):
    rng, true, received = drawn(seed)
    step = int(rng.choice([-1, 1]) * rng.uniform(0.2, 40.0) * NS)
    found, notes = read(true + np.where(np.arange(400) > rng.integers(2, 399), step, 0), received)
    assert np.abs(found - true).max() < 3 * NS // 1000
    assert len(notes) == 1
    way, size = notes[0].partition("was set ")[2].split()[:3:2]
    assert way == ("ahead" if step > 0 else "back")
    assert float(size) == pytest.approx(abs(step) / NS, abs=0.02)


@pytest.mark.parametrize("seed", range(12))
def test_stalls_gaps_and_drift_are_no_steps(seed):
    rng, true, received = drawn(seed)
    first = int(rng.integers(50, 300))
    stalled = np.where(received > received[first], np.maximum(received, received[first] + 3 * NS), received)
    for stamps, t in (
        (true, stalled),
        (np.delete(true, np.s_[first : first + 90]), np.delete(received, np.s_[first : first + 90])),
        (true + (true - BEGIN) // 10_000, received),
        (true, np.sort(BEGIN + rng.integers(0, NS, 400))),  # written anew, all within a second
    ):
        found, notes = read(stamps, t)
        assert (found == stamps).all()
        assert notes == []


def test_other_clocks_count_from_where_they_are():
    _, true, received = drawn(5)
    for ahead, said in ((37, "37 s ahead: TAI"), (18, "18 s ahead: GPS time")):
        found, notes = read(true + ahead * NS, received)
        assert (found == true).all()
        assert said in notes[0]
    found, notes = read(true - BEGIN + 812 * NS, received)
    assert np.abs(found - received).max() < NS // 500
    assert "not on the clock of the log" in notes[0]
    assert read(0 * true, received)[0].tolist() == received.tolist()
    assert Clocks().time("x", 0, NS // 20, notes.append) == 0  # of a recording that begins at 0


def test_clocks_that_differ_by_a_delay_are_one():
    """Of a recording that was played and recorded again years later."""
    notes, clocks = [], Clocks()
    pose = clocks.time("pose", 5 * NS, BEGIN, notes.append)
    assert clocks.time("scan", 5 * NS, BEGIN + NS // 10, notes.append) == pose
    assert clocks.again().time("scan", 6 * NS, BEGIN + 2 * NS, notes.append) == pose + NS
    assert len(notes) == 1
