"""Samples as numbers and clouds, without ROS: what goes out comes back to the last bit."""

from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.component import Port
from swath.core.errors import SwathError
from swath.link.ros2.slotnode import (
    LAYOUT,
    check_names,
    fill_cloud,
    numbers_of,
    numbers_of_inputs,
    sample_of,
    scan_of,
)
from swath.signals import CropEdge, HeaderState, MachineLoad, Odometry, Scan, SteerCommand


def scan(beams=5, echoes=2, t=40_000_000):
    rng = np.random.default_rng(1)
    ranges = rng.uniform(1, 80, (beams, echoes)).astype(np.float32)
    ranges[-1, -1] = ranges[0, :] = np.nan
    angles = rng.uniform(-1, 1, (2, beams))
    return Scan(t, -rng.uniform(0, 0.02, beams), *angles, ranges, 0.3 * ranges)


def cloud_of(sent):
    return fill_cloud(SimpleNamespace(), sent, SimpleNamespace)


@pytest.mark.parametrize("shape", [(5, 2), (1, 1), (7, 3)])
def test_a_scan_comes_back_to_the_last_bit(shape):
    sent = scan(*shape)
    got = scan_of(cloud_of(sent), sent.t)
    for name in ("beam_t", "azimuth", "elevation", "ranges", "intensity"):
        before, after = getattr(sent, name), getattr(got, name)
        assert after.dtype == before.dtype
        assert np.array_equal(before, after, equal_nan=True), name


def test_a_cloud_shows_its_points_to_viewers():
    sent = scan()
    cloud = cloud_of(sent)
    table = np.frombuffer(cloud.data, LAYOUT).reshape(cloud.height, cloud.width)
    points = sent.points()
    assert np.allclose(table["z"], points[:, :, 2], atol=1e-5, equal_nan=True)
    assert [f.name for f in cloud.fields[:4]] == ["x", "y", "z", "intensity"]
    assert cloud.point_step == LAYOUT.itemsize == 48


def test_a_cloud_of_another_make_is_read_by_its_fields():
    layout = np.dtype([("time", ">f4"), ("elevation", ">f8"), ("azimuth", ">f8"), ("range", ">f8")])
    table = np.array([(-0.5, 0.1, 0.2, 7.0), (-0.25, 0.0, 0.3, np.nan)], dtype=layout)
    fields = [SimpleNamespace(name=n, offset=layout.fields[n][1], datatype=8) for n in layout.names]
    fields[0].datatype = 7
    cloud = SimpleNamespace(
        height=2, width=1, fields=fields, is_bigendian=True, point_step=layout.itemsize, data=table.tobytes()
    )
    got = scan_of(cloud, 9)
    assert got.azimuth.tolist() == [0.2, 0.3]
    assert got.beam_t.tolist() == [-0.5, -0.25]
    assert np.isnan(got.intensity).all()
    assert got.ranges[0, 0] == 7.0
    cloud.fields = fields[:3]
    with pytest.raises(SwathError, match="no field range"):
        scan_of(cloud, 9)


def test_numbers_name_every_field_and_make_the_sample_again():
    edge = CropEdge(80, 1.25, -0.1, 1e-17, 8.0, 0.5, np.nan, 0.2)
    numbers = numbers_of("edge", edge)
    assert numbers["edge.t_ns"] == 80
    assert numbers["edge.curvature"] == 1e-17
    again = sample_of(Port("edge", CropEdge), 99, numbers)
    assert again.t == 80
    assert np.isnan(again.crop_height)
    np.testing.assert_equal(asdict(again), asdict(edge))
    command = sample_of(Port("c", SteerCommand), 99, {"c.curvature": 0.1, "c.is_engaged": 1.0})
    assert command == SteerCommand(99, 0.1, True)


def test_arrays_keep_their_order_beyond_ten():
    state = HeaderState(5, np.arange(12.0), np.arange(3.0), 0.1, 0.02, 0.0, 0.0, 0.0)
    again = sample_of(Port("state", HeaderState), 5, dict(reversed(numbers_of("state", state).items())))
    assert again.heights.tolist() == state.heights.tolist()


def test_inputs_with_history_have_every_sample_and_the_newest_by_its_plain_name():
    told = numbers_of_inputs(
        {
            "odometry": (Odometry(1, 2.0, 0.0, 0.0), Odometry(2, 3.0, 0.0, 0.0)),
            "scan": scan(t=7),
            "edge": None,
            "load": (),
        }
    )
    assert (told["odometry.speed"], told["odometry.0.speed"], told["odometry.1.t_ns"]) == (3.0, 2.0, 2.0)
    assert told["scan.t_ns"] == 7
    assert not [name for name in told if name.startswith(("edge", "load", "scan.r"))]


def test_what_is_wrong_with_an_answer_is_named():
    port = Port("load", MachineLoad)
    with pytest.raises(SwathError, match=r"load: MachineLoad: expected a value for lost_grain"):
        sample_of(port, 1, {"load.tank_grain": 1.0})
    with pytest.raises(SwathError, match=r"load: variable = grain"):
        sample_of(port, 1, {"load.grain": 1.0})
    with pytest.raises(SwathError, match=r"speed: expected a name that starts with load\."):
        check_names([port], {"speed": 1.0})
    assert sample_of(port, 1, {"other.x": 1.0}) is None
