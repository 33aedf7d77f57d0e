"""Beams that never answer among others that do."""

import numpy as np

from swath.core.packed_state import pack, unpack
from swath.signals import Scan
from tests.control.canopy_scans import Canopy
from tests.control.synthetic_edge import mounting

WINDOW = 50  # as of silent_beams.cpp


def look(rays, has_echo):
    """A scan whose beams came back or not; which of them count as dead after it."""
    count = len(has_echo)
    level, ranges = np.zeros(count), np.where(has_echo, 5.0, np.nan)[:, None].astype(np.float32)
    rays.take(Scan(int(rays.step["scan_t"]) + 1, level, level, level, ranges, np.ones_like(ranges)))
    return np.flatnonzero(rays.save()["beams"]["is_dead"]).tolist()


def after(echoes, scans=WINDOW):
    """Which beams count as dead after so many scans; echoes: (share of scans) per beam."""
    rays, rng = Canopy(mounting()), np.random.default_rng(2)
    return [look(rays, rng.uniform(size=len(echoes)) < echoes) for _ in range(scans)][-1]


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
    rays, echo = Canopy(mounting()), np.ones(9, bool)
    echo[4] = False
    told = [look(rays, echo) for _ in range(WINDOW)]
    assert told == [[]] * (WINDOW - 1) + [[4]]
    other = Canopy(mounting())
    other.load(unpack(pack(rays.save())))
    assert [look(other, np.ones(9, bool)) for _ in range(WINDOW)] == [[4]] * (WINDOW - 1) + [[]]
