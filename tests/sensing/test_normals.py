"""Normal numbers of many streams at once are those of each stream, bit for bit."""

import numpy as np
import pytest

from swath.core.random import Stream
from swath.sensing.normals import LEVELS, AllNormals, ziggurat


@pytest.mark.parametrize("count", [1, 40])
def test_they_are_numpys(count):
    streams = [Stream(seed, "combine.imu") for seed in range(count)]
    memory = np.full((count, 20), -1.0)
    drawn, counter, needs = AllNormals(memory[:, 3:16]), np.zeros(1, np.int64), np.zeros(1, np.int32)
    drawn.reset(streams)
    launch, called = drawn.launch(counter, needs), 0
    for t in range(0, 4_000_000_000, 40_000_003):
        counter[0], needs[0] = t, 0
        launch.launch()
        called += int(needs[0])
        drawn.finish(t) if needs[0] else None
        own = np.array([stream.at(t).standard_normal(13) for stream in streams])
        assert (memory[:, 3:16] == own).all()
    assert (count > 1) <= called <= count  # of the tail: 0.03 % of all numbers
    assert (memory[:, :3] == -1.0).all()
    assert (memory[:, 16:] == -1.0).all()


def test_most_are_drawn_at_once():
    widths, heights, bounds = ziggurat()
    assert (np.diff(widths[1:]) > 0.0).all()
    assert widths[LEVELS - 1] * (1 << 52) == pytest.approx(3.6541528853610088, rel=1e-14)
    assert np.mean(bounds / (1 << 52)) == pytest.approx(0.985, abs=0.003)
    assert heights[LEVELS - 1] == pytest.approx(0.00126028593049859797, rel=1e-12)  # numpy's own table
    assert (np.diff(heights) < 0.0).all()
