"""The native code around one ray per beam against the rules it must keep, written in numpy."""

import dataclasses

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.sensing.echo import Weather
from swath.sensing.lidar import empirical
from swath.sensing.mount import poses_at
from swath.sensing.sweep import ROOM, Sweep
from swath.signals import MachineState
from tests.sensing.test_empirical import scan, site

POSE = Pose.from_euler((25.0, 50.0, 3.0), 0.0, 0.35, 0.3)


def lidar_of(**keys):
    lidar = empirical.EmpiricalLidar(empirical.Params(**{"step_deg": 1.0} | keys), site())
    lidar.reset(Stream(7, "combine.lidar"))
    return lidar


def test_random_numbers_are_those_of_the_stream_four_words_a_beam():
    lidar, t = lidar_of(), 123_456_789_012
    scan(lidar, POSE, t)
    beams = lidar.rays.beams
    words = Stream(7, "combine.lidar").at(t).bit_generator.random_raw(4 * beams.count).reshape(-1, 4)
    u = ((words[:, :2] >> np.uint64(40)).astype(float) + 0.5) / 2**24
    far = np.sqrt(-2.0 * np.log(u[:, 0]))
    wanted = np.stack([far * np.cos(2 * np.pi * u[:, 1]), far * np.sin(2 * np.pi * u[:, 1])])
    assert np.allclose(beams.normal[:, : beams.count], wanted, atol=5e-6)


def test_normal_numbers_are_normal():
    lidar = lidar_of(step_deg=0.25)
    drawn = []
    for k in range(300):
        scan(lidar, POSE, 10**9 + k)
        drawn.append(lidar.rays.beams.normal[:, : lidar.rays.beams.count].copy())
    z = np.concatenate(drawn, axis=1)
    assert abs(z.mean()) < 0.01
    assert z.std() == pytest.approx(1.0, abs=0.01)
    assert (z**4).mean() == pytest.approx(3.0, abs=0.08)
    assert abs((z[0] * z[1]).mean()) < 0.01


@pytest.mark.parametrize("sensor", ["sick-lms511-hr", "hokuyo-utm-30lx", "velodyne-vlp16"])
def test_what_is_reported_follows_the_data_sheet(sensor):
    lidar = lidar_of(sensor=sensor)
    out = scan(lidar, POSE)
    beams, sheet, n = lidar.rays.beams, lidar.sheet, lidar.rays.beams.count
    true = beams.distance[:n].astype(float)
    albedo = (beams.cosine * beams.reflectance)[:n].astype(float)
    signal = albedo / true**2 / (0.1 / sheet.range_10**2)
    seen = (beams.kind[:n] > 0) & (true >= sheet.range_min) & (signal >= 1.0)
    sigma = sheet.noise_sigma(true, signal)
    wanted = true + lidar.scanner.noise.bias + sigma * beams.normal[1, :n]
    step = sheet.resolution
    wanted = np.round(wanted / step) * step if step > 0 else wanted
    ranges = out["scan"].ranges[:, 0]
    assert 30 < seen.sum() < len(seen)
    assert np.array_equal(np.isfinite(ranges), seen)
    assert np.abs(ranges[seen] - wanted[seen]).max() <= step + 1e-5  # the step next to it, by rounding
    assert (np.abs(ranges[seen] - wanted[seen]) < 1e-5).mean() > 0.97
    assert np.allclose(out["scan"].intensity[seen, 0], albedo[seen])
    points = POSE.position + true[:, None] * beams.directions[:n]
    assert np.allclose(out["truth"].points[seen, 0], points[seen], atol=1e-9)
    assert np.isnan(out["truth"].points[~seen]).all()
    assert np.allclose(beams.directions[:n], (POSE.rotation @ lidar.scanner.axes)[:, :, 0])


@pytest.mark.parametrize("swing", [0.01, 0.5])
def test_beams_start_where_the_machine_was_at_their_time(swing):
    """Against the numpy rule, yaw through half a turn, beams before, between and after the states."""
    rng = np.random.default_rng(3)
    mounting = Pose.from_euler((5.0, -1.0, 2.4), 0.02, 0.28, 0.1)
    beam_t = np.linspace(-0.05, 0.0, 301)
    yaw = 3.12 + swing * np.cumsum(rng.uniform(0.0, 1.0, 7))
    states = tuple(
        MachineState(k * 8_000_000, Pose.from_euler(rng.normal(0, 5, 3), *tilt, y), 1, 0, 0, 0, 0)
        for k, (y, tilt) in enumerate(zip(yaw, swing * rng.normal(0, 0.3, (7, 2)), strict=True))
    )
    sweep = Sweep(mounting, beam_t)
    for some, end in ((states, 50_000_000), (states[:1], 30_000_000), (states[2:4], 20_000_000)):
        origins, rotations = sweep(some, end)
        position, rotation = poses_at(some, end + beam_t * 1e9)
        assert np.allclose(origins, position + rotation @ mounting.position, atol=1e-12)
        assert np.allclose(rotations, rotation @ mounting.rotation, atol=1e-13)
    many = tuple(dataclasses.replace(states[0], t=k * 500_000) for k in range(2 * ROOM))
    assert np.allclose(
        sweep(many, 50_000_000)[0], mounting.position @ states[0].pose.rotation.T + states[0].pose.position
    )


def test_dust_and_puffs_reach_the_scan():
    weather = Weather(extinction_per_m=0.5, near_returns=0.5, near_reach_m=0.5)
    clear, dusty = lidar_of(noise="none"), lidar_of(noise="none", weather=weather)
    a, b = (scan(lidar, POSE) for lidar in (clear, dusty))
    near = b["scan"].ranges[:, 0] < 3.0
    assert 0.1 < near.mean() < 0.5
    both = np.isfinite(a["scan"].ranges[:, 0]) & np.isfinite(b["scan"].ranges[:, 0]) & ~near
    assert np.array_equal(a["scan"].ranges[both], b["scan"].ranges[both])
    loss = b["scan"].intensity[both, 0] / a["scan"].intensity[both, 0]
    assert np.allclose(loss, np.exp(-2 * 0.5 * a["scan"].ranges[both, 0]), rtol=1e-4)
