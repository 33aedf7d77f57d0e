"""Times of the points of a cloud, as the usual drivers write them: a wall lies where it is."""

import numpy as np
import pytest

from swath.core.schedule import NS
from swath.record.read.fields import Context
from swath.record.read.files import open_log
from swath.record.read.messages import maker_for
from swath.signals import Scan
from swath.tools.height_map.bag import open_bag
from swath.tools.height_map.source import Wanted
from tests.bags import BEGIN
from tests.foreign_bags import WALL, heading_for_a_wall

TOLERANCE_M = 0.01
DRIVERS = {
    "velodyne": ("time", "f4", lambda stamp, late: late),
    "ouster": ("t", "u4", lambda stamp, late: late * 1e9),
    "hesai, robosense": ("timestamp", "f8", lambda stamp, late: stamp / NS + late),
    "livox_ros_driver": ("offset_time", "u4", lambda stamp, late: late * 1e9),
    "livox_ros_driver2": ("timestamp", "f8", lambda stamp, late: stamp + late * 1e9),
    "autoware": ("time_stamp", "u4", lambda stamp, late: late * 1e9),
    "blickfeld": ("point_time_offset", "u4", lambda stamp, late: late * 1e9),
    "in ms": ("time", "f4", lambda stamp, late: late * 1e3),
    "in us": ("t", "u4", lambda stamp, late: late * 1e6),
    "us of the clock": ("timestamp", "f8", lambda stamp, late: stamp / 1e3 + late * 1e6),
    "by another name": ("gps_time", "f8", lambda stamp, late: stamp / NS + late),
    "since the hour in us": ("timestamp", "u4", lambda stamp, late: 1_234_567_890 + late * 1e6),
    "since power-on in s": ("timestamp", "f8", lambda stamp, late: 812.5 + late),
}
USUAL = list(DRIVERS)[:7]


def column(driver):
    """With a column of zeros before it, which another driver would have filled."""
    name, kind, values = DRIVERS[driver]
    idle = [] if driver in USUAL else [("time_offset", "f4", 0.0)]
    return lambda stamp, late: [*idle, (name, kind, values(stamp, late))]


@pytest.fixture(scope="module", params=DRIVERS)
def bag(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("clouds") / "bag"
    return request.param, heading_for_a_wall(folder, column(request.param))


def test_a_height_map_has_the_wall_in_its_place(bag):
    driver, path = bag
    source = open_bag(path, Wanted())
    found = []
    for echoes in source.sweeps():
        place, rotation, known = source.track.at(echoes.time)
        points = place + np.einsum("nij,nj->ni", rotation, source.mounting.apply(echoes.points))
        found.append(points[known & (points[:, 2] > 0.05) & (points[:, 2] < 0.95), 0])
    wall = np.concatenate(found)
    assert len(wall) > 1000
    assert np.abs(wall - WALL).max() < TOLERANCE_M
    said = [note for note in source.notes if "times of points" in note]
    assert len(said) == (0 if driver in USUAL and driver != "livox_ros_driver2" else 1)


def test_so_has_a_scan(bag):
    driver, path = bag
    log, context = open_log(path), Context(3.7)
    make = maker_for(Scan, "sensor_msgs/msg/PointCloud2", context)
    found = []
    for _, t, message in log.messages(("/points",)):
        scan = make(message, t)
        assert scan.t <= t
        when = (scan.t - BEGIN) / NS + scan.beam_t
        flat = scan.ranges[:, 0] * np.cos(scan.elevation)
        height = 2.5 + scan.ranges[:, 0] * np.sin(scan.elevation)
        x = 3.0 * when + flat * np.cos(scan.azimuth)
        found.append(x[(height > 0.05) & (height < 0.95)])
    assert np.abs(np.concatenate(found) - WALL).max() < TOLERANCE_M
    assert bool(context.notes) == (driver not in USUAL or driver == "livox_ros_driver2")


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (lambda stamp, late: [], "no times of points"),
        (lambda stamp, late: [("time", "f4", 0 * late)], "those of no sweep"),
        (lambda stamp, late: [("time", "f4", np.nan * late)], "those of no sweep"),
        (lambda stamp, late: [("timestamp", "f4", stamp / NS + late)], "those of no sweep"),
    ],
)
def test_times_that_are_given_up_are_said(tmp_path, columns, said):
    path = heading_for_a_wall(tmp_path / "bag", columns)
    source = open_bag(path, Wanted())
    assert sum(len(echoes.time) for echoes in source.sweeps()) > 1000
    assert [note for note in source.notes if said in note]
    context = Context(3.7)
    make = maker_for(Scan, "sensor_msgs/msg/PointCloud2", context)
    scans = [make(message, t) for _, t, message in open_log(path).messages(("/points",))]
    assert all((scan.beam_t == 0.0).all() for scan in scans)
    assert [note for note in context.notes if said in note]
