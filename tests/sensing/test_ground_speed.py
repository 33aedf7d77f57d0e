"""Ground speed by radar against its formulas."""

from dataclasses import replace
from math import cos, radians, sqrt, tan
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.sensing.ground_speed.radar import (
    GroundRadar,
    Params,
    doppler,
    load_ground_radar,
    relative_noise,
)
from tests.sensing.driven_states import column, feed, straight

SHEET = load_ground_radar("ground-radar-24ghz")
SETUP = SimpleNamespace(base=None, machine=None, edge_side="left", period=0.1)


def radar(**params):
    part = GroundRadar(Params(**{"noise": "none"} | params), SETUP)
    part.reset(Stream(1, "combine.ground_speed"))
    return part


def pitched(speed, degrees):
    return lambda s: Pose.from_euler([speed * s, 0.0, 0.0], pitch=radians(degrees))


def speed_of(part, pose_of, steps=20):
    return feed(part, pose_of, steps)[-1].speed


def test_the_shift_at_2_m_per_s():
    assert doppler(2.0, radians(35.0), 24.125e9) == pytest.approx(263.7, abs=0.05)


def test_on_level_ground_it_is_the_speed():
    samples = feed(radar(), straight(2.0, yaw=0.7), 20)
    assert samples[-1].speed == pytest.approx(2.0, abs=1e-9)
    assert samples[-1].distance == pytest.approx(4.0, abs=0.05)


@pytest.mark.parametrize("degrees", [-1.0, 1.0])
def test_a_degree_of_pitch(degrees):
    """1.22 % per degree, whether the machine pitches or the unit was fitted so."""
    true = cos(radians(35.0 + degrees)) / cos(radians(35.0))
    assert speed_of(radar(), pitched(2.0, degrees)) / 2.0 == pytest.approx(true, abs=1e-6)
    assert speed_of(radar(pitch_error_deg=degrees), straight(2.0)) / 2.0 == pytest.approx(true, abs=1e-6)
    assert 1.0 - true == pytest.approx(0.0122 * degrees, abs=2e-4)
    assert tan(radians(35.0)) * radians(1.0) == pytest.approx(0.0122, abs=1e-4)


def test_a_sensor_out_of_the_middle_adds_what_turning_does():
    """On a circle the unit sits 2 m right of the axle's middle: r w faster along its beam."""
    from swath.sensing.mount import Mount
    from tests.sensing.driven_states import circle

    mount = Mount(at="axle", x_m=0.0, y_m=-2.0, z_m=0.9, pitch_deg=0.0)
    assert speed_of(radar(mount=mount), circle(2.0, 20.0)) == pytest.approx(2.2, rel=1e-3)


def test_noise_of_a_spectrum_against_a_simulated_one():
    """Mean frequency of a random signal with the spectrum of the beam, by pulse pairs."""
    rng, rate, speed = np.random.default_rng(1), 4000.0, 2.0
    centre = doppler(speed, SHEET.depression, SHEET.frequency)
    width = centre * tan(SHEET.depression) * SHEET.beam_width / 2.355 / sqrt(2.0)
    count = int(SHEET.averaging * rate)
    found = []
    grid = np.fft.fftfreq(8 * count, 1.0 / rate)
    amplitude = np.sqrt(0.5 * np.exp(-0.5 * ((grid - centre) / width) ** 2))
    for _ in range(400):
        random = rng.normal(size=len(grid)) + 1j * rng.normal(size=len(grid))
        z = np.fft.ifft(amplitude * random)[:count]
        found.append(np.angle((z[1:] * np.conj(z[:-1])).sum()) * rate / (2.0 * np.pi))
    assert np.std(found) / centre == pytest.approx(relative_noise(speed, SHEET), rel=0.15)


def test_noise_and_scale_error_of_the_sheet():
    part = GroundRadar(Params(noise="data_sheet"), SETUP)
    part._sheet = replace(SHEET, lag=0.0, error_sd=0.0)
    part.reset(Stream(1, "combine.ground_speed"))
    read = column(feed(part, straight(2.0), 600, state_step=20_000_000), "speed")[1:] / 2.0
    assert read.mean() == pytest.approx(1.0 - 0.0118, abs=4.0 * relative_noise(2.0, SHEET) / sqrt(len(read)))
    assert read.std() == pytest.approx(relative_noise(2.0, SHEET), rel=0.12)


def test_saved_and_loaded_in_the_middle():
    whole = column(feed(noisy(), straight(1.5), 20), "speed")
    part = noisy()
    feed(part, straight(1.5), 10)
    state, other = part.save(), noisy()
    other.load(state)
    assert (column(feed(other, straight(1.5), 10, first=10), "speed") == whole[10:]).all()


def noisy():
    part = GroundRadar(Params(), SETUP)
    part.reset(Stream(3, "combine.ground_speed"))
    return part
