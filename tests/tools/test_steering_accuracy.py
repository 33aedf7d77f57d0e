"""The table of steering accuracy: classes of 1 cm, and the one up to which 95 % lie."""

from types import SimpleNamespace

import numpy as np
import pytest

from swath.tools.function_test.judging.steering_accuracy import accuracy, classes_of, pooled


def judged(error, settling=0.0):
    """A judge of a path with errors at every 10 cm."""
    distance = np.arange(len(error)) * 0.1
    series = SimpleNamespace(distance=distance, lateral=np.asarray(error, dtype=float))
    return SimpleNamespace(series=lambda: series, setup=SimpleNamespace(settling_m=settling))


def test_a_normal_error_has_its_95_percent_within_two_sigma():
    """1.96 x 2.5 cm = 4.9 cm: class 5; RMS 2.5 cm."""
    rng = np.random.default_rng(3)
    runs = [classes_of(judged(rng.normal(0.0, 0.025, 4001))) for _ in range(5)]
    rms, upto = accuracy(pooled(runs))
    assert rms == pytest.approx(0.025, rel=0.03)
    assert upto == 5


def test_classes_begin_where_they_should_and_the_last_takes_the_rest():
    told = classes_of(judged([0.0, 0.005, -0.015, 0.025, 7.0]))
    assert told["classes"][:3] == [[0, 2], [1, 1], [2, 1]][: len(told["classes"])]
    rms, upto = accuracy(classes_of(judged([5.0] * 50)))
    assert (rms, upto) == (pytest.approx(5.0), 100)


def test_the_way_before_settling_does_not_count():
    told = classes_of(judged([0.5] * 50 + [0.001] * 100, settling=5.0))
    assert accuracy(told)[1] == 1
    assert accuracy(pooled(())) is None
