"""How far things stand out in pictures, against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.judge.evaluators.pictures import LEAST_PX, contrast


def picture(shift, side, seed=1):
    """Noise of a known mean with a square thing, brighter by `shift` standard deviations of 10."""
    light = np.random.default_rng(seed).normal(1000.0, 10.0, (64, 64))
    instance = np.zeros((64, 64), dtype=np.uint16)
    instance[30 : 30 + side, 20 : 20 + side] = 3
    light[instance == 3] += 10.0 * shift
    return np.rint(light).astype(np.int64), instance


@given(st.floats(-50.0, 50.0), st.integers(4, 16), st.integers(0, 99))
def test_it_is_what_the_thing_was_shifted_by(shift, side, seed):
    found = contrast(*picture(shift, side, seed), 3)
    assert found == pytest.approx(abs(shift), abs=1.5 + 0.2 * abs(shift))


@given(st.floats(1.0, 50.0), st.integers(2, 1000), st.integers(-500, 500))
def test_it_knows_neither_the_gain_nor_the_black_level(shift, gain, black):
    light, instance = picture(shift, 8)
    assert contrast(gain * light + black, instance, 3) == pytest.approx(contrast(light, instance, 3))


def test_a_speck_and_a_flat_picture_have_none():
    light, instance = picture(20.0, 1)
    assert np.count_nonzero(instance) < LEAST_PX
    assert np.isnan(contrast(light, instance, 3))
    assert np.isnan(contrast(np.full_like(light, 7), picture(20.0, 8)[1], 3))


def test_another_thing_is_not_around_it():
    light, instance = picture(20.0, 8)
    beside = instance.copy()
    beside[30:38, 29:32] = 4
    bright = np.where(beside == 4, 60_000, light)
    assert contrast(bright, beside, 3) == pytest.approx(contrast(light, instance, 3), rel=0.2)
