"""OSI traces of a run, read back with ASAM's own package."""

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.frames import rotation_matrix
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.files import open_log
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario

pytest.importorskip("osi3", reason="needs the extra osi")
from swath.link.osi.trace import write_trace

SETS = [
    *("run.max_duration_s=1", "run.record=full", "combine.lidar.sub_rays=7", "combine.lidar.noise=none"),
    "combine.motion.start_speed_kmh=7",
]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("osi") / "run"

    run_job(load_scenario("straight", sets=SETS), folder)
    return folder


def read(file, kind):
    from osi3trace.osi_trace import OSITrace

    trace = OSITrace(str(file), kind)
    messages = list(trace)
    trace.close()
    return messages


def exact(run, slot, output):
    log = open_log(run)
    return [sample for _, sample in exact_samples(log.messages((exact_topic(slot, output),)))]


def turn(angles):
    return rotation_matrix(angles.roll, angles.pitch, angles.yaw)


def xyz(vector):
    return np.array([vector.x, vector.y, vector.z])


def world_points(data, sensor=None):
    """By OSI's own definitions: sensor -> vehicle (origin at the rear axle) -> bounding box -> world."""
    machine = data.sensor_view[0].global_ground_truth.moving_object[0]
    axle = xyz(machine.base.position) + turn(machine.base.orientation) @ xyz(
        machine.vehicle_attributes.bbcenter_to_rear
    )
    found = []
    for detection in (sensor or data.feature_data.lidar_sensor[0]).detection:
        d, a, e = (getattr(detection.position, n) for n in ("distance", "azimuth", "elevation"))
        seen = d * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        mount = data.mounting_position
        there = xyz(mount.position) + turn(mount.orientation) @ seen
        found.append(axle + turn(machine.base.orientation) @ there)
    return np.array(found)


def test_detections_lie_where_the_beams_hit(run, tmp_path):
    assert write_trace(run, tmp_path / "x.osi") == 26
    messages, scans = read(tmp_path / "x.osi", "SensorData"), exact(run, "combine.lidar", "scan")
    truths = exact(run, "combine.lidar", "truth")
    assert len(messages) == len(scans) == 26
    for data, scan, truth in zip(messages, scans, truths, strict=True):
        lidar = data.feature_data.lidar_sensor[0]
        is_seen = np.isfinite(scan.ranges)
        assert data.timestamp.seconds * 10**9 + data.timestamp.nanos == scan.t
        assert lidar.header.number_of_valid_detections == len(lidar.detection) == is_seen.sum()
        told = [d.position.distance for d in lidar.detection]
        np.testing.assert_array_equal(np.array(told, dtype=np.float32), scan.ranges[is_seen])
        told = [d.intensity for d in lidar.detection]
        np.testing.assert_allclose(told, 100.0 * scan.intensity[is_seen], rtol=1e-6)
        if scan.t == 0:
            continue
        gap = np.linalg.norm(world_points(data) - truth.points[is_seen], axis=1)
        # The machine drives 2 m/s during the 20 ms of a sweep, which a scanner does not correct.
        assert np.median(gap) < 0.05
    assert [d.beam_id.value for d in lidar.detection] == np.nonzero(is_seen)[0].tolist()


def test_the_view_holds_the_machine_and_the_rays(run, tmp_path):
    assert main(["osi", str(run), "--out", str(tmp_path / "v.osi"), "--type", "sv"]) == 0
    views, states = read(tmp_path / "v.osi", "SensorView"), exact(run, "combine.motion", "state")
    at = {s.t: s for s in states}
    scan = exact(run, "combine.lidar", "scan")[-1]
    view = views[-1]
    machine = view.global_ground_truth.moving_object[0]
    assert view.version.version_major == 3
    assert machine.id.value == view.host_vehicle_id.value
    state = at[scan.t]
    axle = xyz(machine.base.position) + turn(machine.base.orientation) @ xyz(
        machine.vehicle_attributes.bbcenter_to_front
    )
    down = axle - state.pose.position  # swath's origin is on the ground below the front axle
    assert np.allclose(down, state.pose.rotation[:, 2] * np.linalg.norm(down), atol=1e-9)
    assert np.linalg.norm(xyz(machine.base.velocity)) == pytest.approx(state.speed, abs=0.01)
    rays = view.lidar_sensor_view[0].view_configuration
    assert len(rays.directions) == len(scan.azimuth)
    assert np.arctan2(rays.directions[7].y, rays.directions[7].x) == pytest.approx(scan.azimuth[7])


def test_detections_of_a_radar(tmp_path):
    """What OSI says of a standing post, by its definitions: its place in the world, its speed towards us."""
    folder, post = tmp_path / "run", (-4.0, 25.0)
    sets = ["run.max_duration_s=0.6", "run.record=full", "combine.lidar=off", "combine.edge=truth"]
    sets += [f"field.obstacles=[{{kind: post, x_m: {post[0]}, y_m: {post[1]}}}]"]
    sets += ["combine.radar={level: error, noise: none}", "combine.motion.start_speed_kmh=7"]
    run_job(load_scenario("straight", sets=sets), folder)
    assert main(["osi", str(folder), "--out", str(tmp_path / "r.osi")]) == 0
    messages = read(tmp_path / "r.osi", "SensorData")
    samples = exact(folder, "combine.radar", "targets")
    assert len(messages) == len(samples)
    data, sample = messages[-1], samples[-1]
    radar = data.feature_data.radar_sensor[0]
    assert radar.header.number_of_valid_detections == len(radar.detection) == len(sample.range) == 1
    assert data.timestamp.seconds * 10**9 + data.timestamp.nanos == sample.t
    found = radar.detection[0]
    assert (found.snr, found.rcs) == (sample.snr[0], sample.rcs[0])
    assert found.position_rmse.azimuth == sample.azimuth_sd[0]
    at = world_points(data, radar)[0]
    assert at[:2] == pytest.approx(post, abs=0.1)
    assert found.radial_velocity == pytest.approx(7 / 3.6 * np.cos(found.position.azimuth), abs=0.02)


def test_the_same_run_gives_the_same_bytes(run, tmp_path):
    for name in ("a.osi", "b.osi"):
        write_trace(run, tmp_path / name)
    assert (tmp_path / "a.osi").read_bytes() == (tmp_path / "b.osi").read_bytes()


def test_what_cannot_be_written_is_named(run, tmp_path):
    for folder, out, more, text in (
        (tmp_path, "x.osi", {}, "it has no scenario.yaml"),
        (run, "x.mcap", {}, "expected a file such as x.osi"),
        (run, "x.osi", {"kind": "gt"}, "expected one of sd, sv"),
        (run, "x.osi", {"slot": "cart.lidar"}, "expected a scanner or radar of the .*: combine.lidar"),
        (run, "x.osi", {"slot": "combine.radar"}, "expected a scanner or radar of the .*: combine.lidar"),
    ):
        with pytest.raises(InputError, match=text):
            write_trace(folder, tmp_path / out, **more)
    assert not list(tmp_path.iterdir())
