"""Otsu's detector as a kernel against the same in numpy, and saved in the middle."""

import numpy as np
import pytest

from swath.control.edge.otsu import Otsu
from tests.control.closed_loop import Course
from tests.control.edge_drive import EdgeSensor, drive
from tests.control.otsu_in_numpy import OtsuInNumpy


@pytest.mark.parametrize(
    "case",
    [
        {"side": "left", "roll_sd": 0.01, "stand": {"density": 200.0}},
        {"side": "right", "course": Course(40.0, 4.0, y=-6.0)},
        {"hz": 10, "params": {"learn_m": 0.0, "echo_parts": 5, "spot_mm": 60.0}},
        {"stand": {"tip": 0.30}},
        {"dust": 0.1, "crab": 0.03, "params": {"track_m": 3.0, "lost_s": 0.1}},
        {"inertial": 40},
    ],
    ids=["thin, rolling", "bend to the right", "10 Hz", "too low", "dust", "inertial at 1 kHz"],
)
def test_it_finds_what_it_finds_in_numpy(case):
    kernel, numpy = (drive(level=level, scans=110, **case) for level in (Otsu, OtsuInNumpy))
    assert np.array_equal(np.isnan(kernel), np.isnan(numpy))
    assert np.nanmax(np.abs(kernel - numpy)) < 1e-9


def test_saved_in_the_middle_it_goes_on_to_the_bit():
    through, first, second = (EdgeSensor(Course(y=6.0), level=Otsu) for _ in range(3))
    for k in range(1, 121):
        t, pose = k * through.period, (0.08 * k, 0.1, 0.0)
        edge = through(t, pose, 2.0, 0.0)
        now = second if k > 60 else first
        if k == 61:
            second.level.load(first.level.save())
            second.rng = first.rng
        again = now(t, pose, 2.0, 0.0)
        assert (again.offset == edge.offset) or (np.isnan(again.offset) and np.isnan(edge.offset))
        assert again.confidence == edge.confidence
    assert edge.is_found
