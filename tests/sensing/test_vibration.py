"""Lines of engine, drum and sieves on an inertial unit."""

import math
from dataclasses import fields

import numpy as np
import pytest

from swath.core.random import Stream
from swath.sensing.imu.error import AXES, ErrorImu, Params, Vibration
from swath.sensing.imu.strapdown import Place
from swath.signals import EngineState
from tests.sensing.driven_states import setup_of, standing, state

STEP = 10_000_000
QUIET = dict.fromkeys(
    ("noise_factor", "walk_factor", "gyro_bias_deg_s", "accel_bias_mg", "gyro_scale_percent"), 0.0
) | {"accel_scale_percent": 0.0}
FREQUENCIES = {"engine": 15.8, "drum": 9.2, "sieves": 4.5}


def turning(share):
    """The engine at a share of its rated speed."""
    rest = (f.name for f in fields(EngineState) if f.name not in ("t", "speed_ratio"))
    return EngineState(0, speed_ratio=share, **dict.fromkeys(rest, 0.0))


def make():
    """A unit with the axes of the machine."""
    unit = ErrorImu(Params(mount=Place(), vibration=Vibration(), **QUIET), setup_of(period=0.01))
    unit.reset(Stream(1, "combine.imu"))
    return unit


def shaken(share, seconds=20.0, unit=None):
    """(n, 6) rates and forces, 100 a second, of a machine that stands."""
    unit = unit or make()
    engine = turning(share)
    rows = []
    for i in range(round(seconds * 100)):
        times = (i * STEP + STEP // 2, (i + 1) * STEP)
        states = tuple(state(standing(), t) for t in times)
        s = unit.step(i * STEP, STEP, {"state": states, "engine": engine})["inertial"]
        rows.append((s.rate_x, s.rate_y, s.rate_z, s.force_x, s.force_y, s.force_z))
    return np.array(rows)


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_lines_stand_at_their_frequencies_with_their_size_and_turn_with_the_engine(share):
    """Over 20 s all lines are whole: the spectrum's amplitude is that of the line times sinc(f T)."""
    rows = shaken(share)
    size = np.abs(np.fft.rfft(rows, axis=0)) * math.sqrt(2.0) / len(rows)
    own = Vibration()
    for name, frequency in FREQUENCIES.items():
        f = frequency * share
        k = round(f * 20.0)
        rms = getattr(own, f"{name}_m_s2") * share**2
        got = size[k, 3:]
        want = np.array(AXES[name][0]) * rms * np.sinc(f * 0.01)
        assert np.allclose(got, want, atol=0.01 * rms)
        about = np.linalg.norm(size[k, :3])
        assert about == pytest.approx(np.linalg.norm(want) / (2.0 * math.pi * f * own.arm_m), rel=0.02)


def test_without_a_turning_engine_nothing_shakes():
    rows = shaken(0.0, 1.0)
    assert np.allclose(rows, [0.0, 0.0, 0.0, 0.0, 0.0, 9.81], atol=1e-9)


def test_the_sum_lies_within_what_machines_are_said_to_have():
    """0.5 to 2 m/s2 RMS at 2 to 30 Hz."""
    forces = shaken(1.0)[:, 3:] - [0.0, 0.0, 9.81]
    assert 0.5 < math.sqrt((forces**2).sum(axis=1).mean()) < 2.0


def test_phases_are_saved():
    one, other = make(), make()
    shaken(1.0, 0.13, one)
    kept = one.save()
    first = shaken(0.9, 0.1, one)
    assert np.abs(shaken(0.9, 0.1, other) - first).max() > 0.1
    other.load(kept)
    assert (shaken(0.9, 0.1, other) == first).all()


def test_without_an_engine_it_shakes_as_at_rated_speed():
    one, other = make(), make()
    states = {"state": (state(standing(), STEP),)}
    with_engine = one.step(0, STEP, {**states, "engine": turning(1.0)})["inertial"]
    assert other.step(0, STEP, states)["inertial"] == with_engine
