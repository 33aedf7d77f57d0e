"""Where on Earth the machine is: NavSatFix in the recording of an imported field."""

from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from swath.field.projection import Origin
from swath.record.recorder import Recorder
from swath.signals import MachineState
from tests.fake_run import ArcEdge, GridField, drive, machine

pyproj = pytest.importorskip("pyproj")


def fixes(folder):
    with (folder / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [m for *_, m in reader.iter_decoded_messages(topics=["/combine/motion/fix"])]


def test_fixes_are_the_true_places_on_the_ellipsoid(tmp_path):
    states = []
    origin = Origin(32632, 500_000.0, 5_400_000.0, 300.0)  # on the central meridian of 9 deg east
    with Recorder(tmp_path, [replace(machine(), origin=origin)]) as recorder:
        keep = lambda slot, t, out: states.extend(s for s in out.values() if isinstance(s, MachineState))  # noqa: E731
        drive([keep, recorder], GridField(ArcEdge(40.0)), seconds=2.0)
    found = fixes(tmp_path)
    assert len(found) == 21  # 10 Hz
    by_time = {s.t: s for s in states}
    geod = pyproj.Geod(ellps="WGS84")
    for first, last in ((found[0], found[-1]), (found[3], found[12])):
        ends = [
            by_time[m.header.stamp.sec * 10**9 + m.header.stamp.nanosec].pose.position for m in (first, last)
        ]
        way = ends[1] - ends[0]
        azimuth, _, distance = geod.inv(first.longitude, first.latitude, last.longitude, last.latitude)
        assert distance == pytest.approx(
            np.hypot(*way[:2]) / 0.9996, rel=1e-5
        )  # scale of UTM at its meridian
        assert np.radians(azimuth) == pytest.approx(np.arctan2(way[0], way[1]), abs=1e-4)
        assert first.altitude == pytest.approx(300.0 + ends[0][2])
    assert found[0].header.frame_id == "combine/base_link"
    assert found[0].status.status == 2


def test_a_made_field_lies_nowhere_on_earth(tmp_path):
    with Recorder(tmp_path, [machine()]) as recorder:
        drive([recorder], GridField(ArcEdge(40.0)), seconds=0.2)
    assert fixes(tmp_path) == []
