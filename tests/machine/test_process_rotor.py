import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import load_machine
from swath.machine.separation.model import Rotor
from swath.machine.threshing.model import coupled

RATE = st.floats(0.01, 12.0)


@given(RATE, RATE, st.floats(0, 5), st.floats(0, 5))
@settings(max_examples=100)
def test_coupled_exponentials_solve_their_equations(threshing, separation, ear, free):
    """Against a fine Runge-Kutta integration of du/dx = -l u, df/dx = l u - b f."""

    def rate(u, f):
        return -threshing * u, threshing * u - separation * f

    u, f, n = ear, free, 200
    h = 1.0 / n
    for _ in range(n):
        a = rate(u, f)
        b = rate(u + 0.5 * h * a[0], f + 0.5 * h * a[1])
        c = rate(u + 0.5 * h * b[0], f + 0.5 * h * b[1])
        d = rate(u + h * c[0], f + h * c[1])
        u += h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        f += h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
    assert coupled(ear, free, threshing, separation) == pytest.approx((u, f), rel=1e-6, abs=1e-9)


def test_separated_share_is_mius_formula():
    lam, beta = 4.0, 1.72
    u, f = coupled(1.0, 0.0, lam, beta)
    miu = 1.0 - (beta * math.exp(-lam) - lam * math.exp(-beta)) / (beta - lam)
    assert 1.0 - u - f == pytest.approx(miu, rel=1e-12)
    assert miu == pytest.approx(0.70, abs=0.005)  # 70 % before the rotors, APS SYNFLOW


def test_equal_rates_have_their_own_limit():
    assert coupled(1.0, 0.0, 2.0, 2.0)[1] == pytest.approx(2.0 * math.exp(-2.0))
    assert coupled(1.0, 0.0, 2.0, 2.0 + 1e-7)[1] == pytest.approx(2.0 * math.exp(-2.0), rel=1e-6)


@pytest.mark.parametrize("dt", [0.01, 0.1, 0.37, 5.0])
def test_a_steady_rotor_loses_what_the_closed_form_says(dt):
    rotor = Rotor(4.5, 4.3, 1.1, 3.0)
    for _ in range(round(10.0 / dt) + 8):
        separated, out = rotor.advance(
            (0.2 * dt, 3.0 * dt, 10.0 * dt, 9.0 * dt), layer=1.2, dt=dt, ratio=1.0, threshability=1.0
        )
    scale = 1.2**-1.1
    expected = coupled(0.2, 3.0, 4.5 * scale, 4.3 * scale)
    assert np.array(out[:2]) / dt == pytest.approx(expected, rel=1e-9)
    assert np.array(out[2:]) / dt == pytest.approx([10.0, 9.0], rel=1e-9)
    assert separated / dt == pytest.approx(3.2 - sum(expected), rel=1e-9)


def test_straw_leaves_a_slower_rotor_without_lumps():
    """At speeds at which the passage is no whole number of steps."""
    for ratio in (0.83, 0.9137, 1.01):
        rotor, out = Rotor(4.5, 4.3, 1.1, 3.0), []
        for _ in range(120):
            crop = (0.02, 0.3, 1.0, 0.9)
            out.append(rotor.advance(crop, layer=1.0, dt=0.1, ratio=ratio, threshability=1.0)[1][2])
        assert np.ptp(out[60:]) < 1e-9
        first = next(i for i, straw in enumerate(out) if straw > 0.0)
        assert abs((first + 1) * 0.1 - 3.0 / ratio) <= 0.1 + 1e-9


@given(
    st.lists(
        st.tuples(st.floats(0, 3), st.floats(0, 3), st.floats(0, 1.2), st.floats(0.1, 3)),
        min_size=1,
        max_size=60,
    )
)
@settings(max_examples=60)
def test_grain_and_straw_are_kept_through_stops(steps):
    rotor, fed, gone = Rotor(4.5, 4.3, 1.1, 3.0), np.zeros(2), np.zeros(2)
    for grain, straw, ratio, layer in steps:
        fed += (grain, straw)
        through, out = rotor.advance(
            (0.1 * grain, 0.9 * grain, straw, grain), layer=layer, dt=0.2, ratio=ratio, threshability=1.0
        )
        gone += (through + out[0] + out[1], out[2])
    assert gone + rotor.held() == pytest.approx(fed, rel=1e-12, abs=1e-12)


def drum_and_rotor(share):
    """Loss of drum and rotors at a share of the nominal straw flow, from the sheet's numbers alone."""
    d = drivetrain_of(load_machine("lexion-700")).threshing
    drum, rotor = share**-d.drum_exponent, share**-d.rotor_exponent
    u, f = coupled(1.0, 0.0, d.drum_threshing * drum, d.drum_separation * drum)
    return sum(coupled(u, f, d.rotor_threshing * rotor, d.rotor_separation * rotor))


def test_loss_doubles_with_every_15_percent_of_throughput():
    assert drum_and_rotor(1.0) == pytest.approx(0.005, rel=0.1)
    assert 1.8 < drum_and_rotor(1.15) / drum_and_rotor(1.0) < 2.2
    assert 1.6 < drum_and_rotor(1.30) / drum_and_rotor(1.15) < 2.2


@pytest.mark.parametrize(
    ("threshing", "separation"), [(1.0, 900.0), (900.0, 1.0), (900.0, 900.0), (0.0, 2e3)]
)
def test_rates_beyond_what_an_exponential_holds(threshing, separation):
    """Of rates t and s, with the smaller one a, t / |s - t| exp(-a) is on its way."""
    slow, fast = sorted((threshing, separation))
    on_its_way = threshing / max(fast - slow, 1.0) * math.exp(-slow)
    assert coupled(1.0, 0.0, threshing, separation) == pytest.approx((math.exp(-threshing), on_its_way))
