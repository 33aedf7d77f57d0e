"""Receiver and inertial unit in the recording: messages, and samples made of them again."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from swath.core.frames import Pose
from swath.documents.reasons import key_of
from swath.field.maps.projection import Origin
from swath.record.read.fields import Context
from swath.record.read.leaps import Leaps
from swath.record.read.messages import maker_for
from swath.record.recorder import Recorder
from swath.record.tracks import read_tracks
from swath.signals import FIX_QUALITIES, Fix, Inertial
from tests.fake_run import ArcEdge, GridField, drive, machine

NS = 1_000_000_000
NAN = float("nan")
ANTENNA = Pose.from_euler((1.0, 0.0, 3.9))
NOTHING = [NAN] * 8


def decoded(folder, *topics):
    with (folder / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = {t: [] for t in topics}
        for _, channel, _, message in reader.iter_decoded_messages(topics=list(topics)):
            found[channel.topic].append(message)
        return found


def record(folder, slot, samples, output, **about):
    """A drive with the samples of one more slot; each comes out 50 ms after it was valid."""
    sensor = replace(
        machine(), mounting={slot: ANTENNA}, outputs={f"{slot}.{output}": type(samples[0])}, **about
    )
    with Recorder(folder, [sensor]) as recorder:
        drive([recorder], GridField(ArcEdge(40.0)), seconds=0.5)
        for sample in samples:
            recorder(f"combine.{slot}", sample.t + 50_000_000, {output: sample})


def fix(k, quality="fix", course=0.5, **more):
    at = (3.0 + 0.2 * k, -4.0, 4.1)
    return Fix(k * NS // 10, *at, 2.0, course, 0.012, 0.021, 0.03, FIX_QUALITIES.index(quality), **more)


def on_earth(origin, sample):
    longitude, latitude = np.radians(origin.to_lon_lat([[sample.x, sample.y]])[0])
    place = {"longitude": float(longitude), "latitude": float(latitude)}
    return replace(sample, **place, height=origin.height + sample.z)


def test_a_measured_fix_takes_the_place_of_the_true_one(tmp_path):
    pyproj = pytest.importorskip("pyproj")
    origin = Origin(32632, 500_000.0, 5_400_000.0, 300.0)  # on the central meridian of 9 deg east
    samples = [on_earth(origin, fix(k, q)) for k, q in enumerate(("fix", "float", "dgps", "single"))]
    samples.append(Fix(4 * NS // 10, *NOTHING, 0))
    record(tmp_path, "gnss", samples, "fix", origin=origin)
    names = ("/combine/motion/fix", "/combine/gnss/fix", "/combine/gnss/fix_odometry", "/tf_static")
    truth, fixes, odometry, tree = decoded(tmp_path, *names).values()
    assert truth == []
    assert [m.status.status for m in fixes] == [2, 2, 1, 0, -1]
    assert all(m.header.frame_id == "combine/gnss" for m in fixes)
    assert [m.header.stamp.nanosec for m in fixes] == [k * NS // 10 for k in range(5)]
    geod = pyproj.Geod(ellps="WGS84")
    _, _, apart = geod.inv(fixes[0].longitude, fixes[0].latitude, fixes[3].longitude, fixes[3].latitude)
    assert apart == pytest.approx(0.6 / 0.9996, rel=1e-5)  # scale of UTM at its meridian
    assert fixes[0].altitude == pytest.approx(304.1)
    assert fixes[0].position_covariance_type == 2
    covariance = np.reshape(fixes[0].position_covariance, (3, 3))
    np.testing.assert_allclose(covariance, np.diag([0.012**2, 0.012**2, 0.021**2]))
    assert np.isnan(fixes[4].latitude)
    assert fixes[4].position_covariance_type == 0
    assert len(odometry) == 4
    frames = {t.child_frame_id: t for t in tree[0].transforms}
    assert frames["combine/gnss"].transform.translation.z == 3.9


def test_in_a_field_that_lies_nowhere_a_fix_is_an_odometry_of_the_map(tmp_path):
    record(tmp_path, "gnss", [fix(0), fix(1, course=NAN), Fix(NS // 5, *NOTHING, 0)], "fix")
    fixes, odometry = decoded(tmp_path, "/combine/gnss/fix", "/combine/gnss/fix_odometry").values()
    assert fixes == []
    first, second = odometry
    assert (first.header.frame_id, first.child_frame_id) == ("map", "combine/gnss_course")
    place = first.pose.pose.position
    assert (place.x, place.y, place.z) == (3.0, -4.0, 4.1)
    assert first.pose.pose.orientation.z == pytest.approx(np.sin(0.25))
    assert first.twist.twist.linear.x == 2.0
    turn = np.diag(np.reshape(first.pose.covariance, (6, 6)))
    assert turn == pytest.approx([0.012**2, 0.012**2, 0.021**2, 1e6, 1e6, (0.03 / 2.0) ** 2])
    assert second.pose.covariance[35] == 1e6


def test_samples_come_back_from_the_messages(tmp_path):
    pytest.importorskip("pyproj")
    origin = Origin(32632, 500_000.0, 5_400_000.0, 300.0)
    samples = [on_earth(origin, fix(k)) for k in range(2)]
    samples[1] = replace(samples[1], quality=1, horizontal_sd=2.1, vertical_sd=3.5)
    samples.append(Fix(NS // 5, *NOTHING, 0))
    record(tmp_path, "gnss", samples, "fix", origin=origin)
    fixes, odometry = decoded(tmp_path, "/combine/gnss/fix", "/combine/gnss/fix_odometry").values()

    def to_local(places):
        return np.column_stack([origin.to_local(places[:, :2]), places[:, 2] - origin.height])

    make = maker_for(Fix, "sensor_msgs/msg/NavSatFix", Context(3.7, to_local))
    for message, sample in zip(fixes[:2], samples, strict=False):
        made = make(message, sample.t + 50_000_000)
        assert (made.t, made.quality) == (sample.t, sample.quality)
        assert (made.x, made.y, made.z) == pytest.approx((sample.x, sample.y, sample.z), abs=1e-6)
        assert (made.horizontal_sd, made.vertical_sd) == pytest.approx(
            (sample.horizontal_sd, sample.vertical_sd)
        )
        assert made.latitude == pytest.approx(sample.latitude, abs=1e-15)
        assert np.isnan(made.speed)
    lost = make(fixes[2], NS // 5)
    assert (lost.quality, lost.t) == (0, NS // 5)
    assert np.isnan(lost.x)
    plane = maker_for(Fix, "sensor_msgs/msg/NavSatFix", Context(3.7))  # at the first position
    assert plane(fixes[0], 0).x == pytest.approx(0.0, abs=1e-6)
    assert plane(fixes[1], NS).x == pytest.approx(0.2, rel=1e-3)
    made = maker_for(Fix, "nav_msgs/msg/Odometry", Context(3.7))(odometry[0], NS // 20)
    for name in (
        "t",
        "x",
        "y",
        "z",
        "speed",
        "course",
        "horizontal_sd",
        "vertical_sd",
        "speed_sd",
        "quality",
    ):
        assert getattr(made, name) == pytest.approx(getattr(samples[0], name)), name


@given(st.integers(0, 10**6), st.sampled_from([0.1, 0.2, 1.0]), st.sampled_from([1, 2, 3, 4]), st.booleans())
@settings(max_examples=40)
def test_positions_out_of_reach_are_counted_and_no_others(seed, period, quality, has_speed):
    rng = np.random.default_rng(seed)
    count, t0 = 120, int(rng.integers(0, 10**6))
    t = np.arange(count) * period
    speed = np.clip(2.0 + np.cumsum(rng.normal(0.0, 0.3 * period**0.5, count)), 0.0, 6.0)
    course = np.cumsum(rng.normal(0.0, 0.3, count) * period)
    x, y = (np.cumsum(speed * part(course) * period) for part in (np.cos, np.sin))
    spread = {1: 1.5, 2: 0.6, 3: 0.25, 4: 0.02}[quality]
    x += rng.normal(0.0, spread, count)
    bad = np.zeros(count, bool)
    bad[rng.choice(np.arange(0, count - 2), 8, replace=False)] = True
    bad[1:] &= ~bad[:-1]
    far = float(rng.uniform(100.0, 5000.0))
    leaps, good = Leaps(), Leaps()
    for k in range(count):
        own = speed[k] if has_speed else NAN
        sample = Fix(round((t0 + t[k]) * NS), x[k], y[k], 0.0, own, NAN, NAN, NAN, NAN, quality)
        assert good.take(k, sample) == (k, sample)
        leaps.take(k, replace(sample, y=y[k] + far * bad[k]))
    assert good.notes == {}
    assert leaps.count == bad.sum()
    ((note, times),) = leaps.notes.items()
    assert times == bad.sum()
    assert far - 60.0 < leaps.farthest <= far + 10.0
    assert key_of(note) == "place"


def test_a_receiver_that_stays_where_it_leapt_to_is_told_once():
    leaps = Leaps()
    for k in range(40):
        leaps.take(k, Fix(k * NS // 10, 0.2 * k, 0.8 * (k > 20), 0.0, 2.0, NAN, NAN, NAN, NAN, 4))
    for k in range(40, 80):  # after a pause it may be anywhere that a machine reaches
        leaps.take(k, Fix((k + 600) * NS // 10, 500.0 + 0.2 * k, 0.0, 0.0, 2.0, NAN, NAN, NAN, NAN, 4))
    assert leaps.count == 1
    assert leaps.farthest < 0.8


def test_columns_are_there_where_the_slot_is(tmp_path):
    (tmp_path / "with").mkdir()
    (tmp_path / "without").mkdir()
    record(tmp_path / "with", "gnss", [fix(0, "float")], "fix")
    tracks = read_tracks(tmp_path / "with" / "tracks.parquet")
    assert (tracks["fix_x_m"][-1], tracks["fix_quality"][-1]) == (3.0, 3.0)
    with Recorder(tmp_path / "without", [machine()]) as recorder:
        drive([recorder], GridField(ArcEdge(40.0)), seconds=0.2)
    assert "fix_x_m" not in read_tracks(tmp_path / "without" / "tracks.parquet")


def test_an_inertial_unit_is_an_imu_without_orientation(tmp_path):
    sample = Inertial(NS // 10, 0.1, -0.2, 0.3, 0.5, -0.6, 9.7, 0.004, 0.02)
    record(tmp_path, "imu", [sample], "inertial")
    messages, tree = decoded(tmp_path, "/combine/imu/inertial", "/tf_static").values()
    (message,) = messages
    assert message.header.frame_id == "combine/imu"
    assert message.header.stamp.nanosec == NS // 10
    rate, force = message.angular_velocity, message.linear_acceleration
    assert (rate.x, rate.y, rate.z, force.x, force.y, force.z) == (0.1, -0.2, 0.3, 0.5, -0.6, 9.7)
    assert message.orientation_covariance[0] == -1.0
    np.testing.assert_allclose(np.reshape(message.angular_velocity_covariance, (3, 3)), np.eye(3) * 0.004**2)
    np.testing.assert_allclose(
        np.reshape(message.linear_acceleration_covariance, (3, 3)), np.eye(3) * 0.02**2
    )
    assert "combine/imu" in {t.child_frame_id for t in tree[0].transforms}
    made = maker_for(Inertial, "sensor_msgs/msg/Imu", Context(3.7))(message, NS // 10)
    assert made == sample
    assert read_tracks(tmp_path / "tracks.parquet")["imu_force_z_m_s2"][-1] == 9.7
