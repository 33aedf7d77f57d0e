"""Beams that never answer among others that do."""

import numpy as np

from swath.control.edge.silent_beams import WINDOW, SilentBeams


def after(echoes, scans=WINDOW):
    """Which beams count as dead after so many scans; echoes: (share of scans) per beam."""
    beams, rng = SilentBeams(), np.random.default_rng(2)
    for _ in range(scans):
        beams.take(rng.uniform(size=len(echoes)) < echoes)
    return np.flatnonzero(beams.is_dead).tolist()


def test_silent_beams_among_answering_ones_are_dead():
    share = np.full(40, 0.6)
    share[[5, 17, 18, 19, 30]] = 0.0
    assert after(share) == [5, 17, 18, 19, 30]
    assert after(share, scans=WINDOW - 1) == []


def test_dust_and_sky_swallow_neighbours_too():
    share = np.concatenate([np.zeros(10), np.full(10, 0.02), np.full(10, 0.9), np.zeros(10)])
    assert after(share) == []
    assert after(np.zeros(20)) == []


def test_a_beam_that_answers_again_counts_again():
    beams, echo = SilentBeams(), np.ones(9, bool)
    echo[4] = False
    told = [beams.take(echo) for _ in range(WINDOW)]
    assert told == [False] * (WINDOW - 1) + [True]
    assert beams.is_dead.sum() == 1
    other = SilentBeams()
    other.load(beams.save())
    assert [other.take(np.ones(9, bool)) for _ in range(WINDOW)][-1]
    assert not other.is_dead.any()
