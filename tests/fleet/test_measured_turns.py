"""Turns as long as those that were measured."""

import numpy as np
import pytest

from swath.core.errors import InputError
from tests.fleet.measured_turns import (
    driven_by,
    dubins_length,
    in_closed_loop,
    measured_or_skip,
    medians,
    rolled_through,
    rolling_turns,
    with_clothoids,
)
from tests.fleet.turn_figures import measure


def test_a_track_without_a_turn_is_refused():
    with pytest.raises(InputError, match="expected a track that turns through half a circle"):
        measure(np.arange(9.0), np.stack([np.arange(9.0), np.zeros(9)], axis=1))


@measured_or_skip
def test_figures_of_the_measured_tracks_are_those_of_their_summary():
    turns = rolling_turns()
    stated = medians([t.figures for t in turns])
    found = medians([measure(t.time, t.points) for t in turns])
    for key in ("duration", "path", "depth", "excursion"):
        assert found[key] == pytest.approx(stated[key], rel=0.03)


@measured_or_skip
@pytest.mark.parametrize(
    ("made", "off"),
    [
        pytest.param(in_closed_loop, 0.10, marks=pytest.mark.draws),
        (with_clothoids, 0.15),
        (rolled_through, 0.15),
    ],
)
def test_turns_are_as_long_as_the_measured_ones(made, off):
    turns = rolling_turns()
    found = medians([driven_by(made, t)[0] for t in turns])
    measured = medians([t.figures for t in turns])
    for key in ("duration", "path", "depth"):
        assert found[key] == pytest.approx(measured[key], rel=off), key


@measured_or_skip
def test_a_dubins_turn_is_some_27_percent_short():
    measured = medians([t.figures for t in rolling_turns()])
    short = 1.0 - dubins_length(11.9, 6.1) / measured["path"]
    assert 0.24 < short < 0.30
