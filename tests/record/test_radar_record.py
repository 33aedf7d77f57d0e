"""A radar in a run: recorded, read by another package, played from the log and from a driver's cloud."""

import numpy as np
import pytest

from swath.record.read import radar as read
from swath.record.read.fields import Context
from swath.record.recorder import Recorder
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.signals.radar import RadarTargets
from tests.record.test_camera_record import read_mcap

TEXT = """
format: swath scenario 2
name: by-radar
seed: 3
run: {distance_m: 4, max_duration_s: 0.65}
field:
  terrain: {level: plane}
  stand: {level: uniform, stems_per_m2: 200}
  edge: {shape: straight}
  obstacles:
    - {kind: vehicle, x_m: -6, y_m: 30}
    - {kind: person, x_m: -3, y_m: 16}
machines:
  combine:
    motion: {level: single_track, start_speed_kmh: 7}
    radar: {level: error}
"""


def made(*sets):
    return assemble(parse_scenario(TEXT, sets=list(sets)))


def targets(world, *more):
    samples = []
    drive(world, [lambda *s: samples.append(s), *more])
    return [s for _, _, out in samples for s in out.values() if isinstance(s, RadarTargets)]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    world = made()
    with Recorder(folder, [world.leader.recorded()]) as recorder:
        found = targets(world, recorder)
    return folder, read_mcap(folder / "run.mcap"), found


def test_messages_hold_the_numbers(recorded):
    _, topics, samples = recorded
    assert sum(len(s.range) for s in samples) > 10
    own, clouds = (topics[f"/combine/radar/targets{s}"] for s in ("", "_points"))
    assert len(own) == len(clouds) == len(samples)
    for message, cloud, sample in zip(own, clouds, samples, strict=True):
        assert message.range == sample.range.tolist()
        assert message.radial_speed == sample.radial_speed.tolist()
        assert [f.name for f in cloud.fields][3:6] == ["radial_speed", "rcs", "snr"]
        assert cloud.header.frame_id == "combine/radar"
        back = read._targets_of_cloud(Context(3.7), cloud, sample.t)
        assert back.t == sample.t
        for name in ("range", "azimuth", "radial_speed", "rcs", "snr"):
            np.testing.assert_allclose(getattr(back, name), getattr(sample, name), rtol=1e-5, atol=1e-5)
        assert np.isnan(back.elevation).all()


def test_returns_hold_the_numbers(recorded):
    """radar_msgs/RadarScan by its public definition, read by the mcap project's decoder, and back again."""
    _, topics, samples = recorded
    for message, sample in zip(topics["/combine/radar/targets_returns"], samples, strict=True):
        assert message.header.frame_id == "combine/radar"
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == sample.t
        assert [r.elevation for r in message.returns] == [0.0] * len(sample.range)
        back = read._targets_of_returns(Context(3.7), message, sample.t)
        for name in ("range", "azimuth", "elevation", "radial_speed", "snr"):
            np.testing.assert_allclose(getattr(back, name), getattr(sample, name), rtol=1e-6, atol=1e-6)
        assert np.isnan(back.rcs).all()


@pytest.mark.parametrize(
    "topics", ["", *(f", topics: {{targets: /combine/radar/targets_{n}}}" for n in ("points", "returns"))]
)
def test_played_from_the_log(recorded, topics):
    """The run's exact samples to the last bit; a cloud or returns, as drivers give them, as float32."""
    folder, _, samples = recorded
    log = "folder: " + str(folder) if not topics else f"file: {folder / 'run.mcap'}" + topics
    played = targets(made(f"combine.radar={{level: log, {log}}}"))
    last = next(s for s in reversed(played) if len(s.range))
    same = next(s for s in samples if s.t == last.t)
    if topics:
        np.testing.assert_allclose(last.range, same.range, rtol=1e-6)
    else:
        assert (last.range.tobytes(), last.rcs.tobytes()) == (same.range.tobytes(), same.rcs.tobytes())
