"""Where on Earth the machine is: NavSatFix in the recording of an imported field."""

from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from swath.core.errors import InputError
from swath.field.maps.projection import Origin
from swath.record.recorder import Recorder
from swath.record.tracks import read_tracks
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario
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


def test_a_made_field_lies_where_its_scenario_says(tmp_path):
    """The machine's way from the origin, by the ellipsoid's own geodesic, is its place in the world."""
    sets = [
        "run.distance_m=2", "combine.lidar=off", "combine.edge=truth", "expect={}", "run.record=standard",
        "field.origin={latitude_deg: 52.3, longitude_deg: 9.0, height_m: 80}",
    ]  # fmt: skip
    run_job(load_scenario("straight", sets=sets), tmp_path / "r")
    found, tracks = fixes(tmp_path / "r"), read_tracks(tmp_path / "r" / "tracks.parquet")
    x, y = tracks["x_m"][0], tracks["y_m"][0]
    first = found[0]
    azimuth, _, distance = pyproj.Geod(ellps="WGS84").inv(9.0, 52.3, first.longitude, first.latitude)
    assert distance == pytest.approx(np.hypot(x, y) / 0.9996, rel=1e-4)  # scale of UTM at its meridian
    assert np.radians(azimuth) % (2 * np.pi) == pytest.approx(np.arctan2(x, y) % (2 * np.pi), abs=1e-3)
    assert first.altitude == pytest.approx(80.0 + tracks["z_m"][0])


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("{latitude_deg: 91, longitude_deg: 9}", "field.origin.latitude_deg"),
        ("{latitude_deg: 52}", "field.origin.longitude_deg"),
        ("{latitude_deg: 52, longitude_deg: 9, heigth_m: 1}", "field.origin.heigth_m"),
    ],
)
def test_a_wrong_origin_is_named(text, key):
    with pytest.raises(InputError) as caught:
        load_scenario("straight", sets=[f"field.origin={text}"])
    assert caught.value.key == key


def test_a_field_without_an_origin_lies_nowhere_on_earth(tmp_path):
    with Recorder(tmp_path, [machine()]) as recorder:
        drive([recorder], GridField(ArcEdge(40.0)), seconds=0.2)
    assert fixes(tmp_path) == []


def test_an_imported_field_has_its_own_origin(tmp_path):
    with pytest.raises(InputError) as caught:
        load_scenario(
            "straight",
            sets=[f"field.folder={tmp_path}", "field.origin={latitude_deg: 52, longitude_deg: 9}"],
        )
    assert "beside a field folder" in str(caught.value)
