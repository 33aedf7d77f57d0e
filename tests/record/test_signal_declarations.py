"""What the signals declare is what is done, and what docs/reference/signals.md says."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from docs.make.signals import bundled_signals, messages_of, signals_page, with_table
from mcap.reader import make_reader

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.signal import signal_types
from swath.field.maps.projection import Origin
from swath.record.formats import RECORDING, TRACKS, check_format
from swath.record.mcap_file import McapFile
from swath.record.read.files import open_log
from swath.record.recorder import Recorder
from swath.record.tracks import read_tracks
from swath.signals import CropEdge, Fix, Odometry, Scan
from swath.signals.flat import build, flat_fields
from tests.fake_run import ArcEdge, GridField, drive, machine

DOCS = Path(__file__).parents[2] / "docs" / "reference"
ORIGIN = Origin(32632, 500_000.0, 5_400_000.0, 300.0)


def sample_of(signal):
    """A sample whose dimensions are all 2 long and whose numbers are 2."""
    given = {}
    for name, f in flat_fields(signal).items():
        length = int(np.prod([d if isinstance(d, int) else 2 for d in f.quantity.shape]))
        given[name] = {"real": 2.0, "int": 2, "bool": True, "array": np.full(length, 2.0)}[f.kind]
    return build(signal, 0, given)


def test_pages_are_as_made():
    """`python -m docs.make.signals` makes them."""
    assert (DOCS / "signals.md").read_text() == signals_page(bundled_signals())
    assert (DOCS / "run-folder.md").read_text() == with_table((DOCS / "run-folder.md").read_text())


def test_every_field_of_every_signal_says_what_it_is():
    for signal in bundled_signals():
        for name, field in flat_fields(signal).items():
            assert field.quantity.meaning != name.replace("_", " "), (signal, name)
            assert (field.kind == "array") == bool(field.quantity.shape), (signal, name)
            if isinstance(field.default, float) and np.isnan(field.default):
                assert field.quantity.nan, (signal, name)


@pytest.mark.parametrize("signal", bundled_signals(), ids=lambda s: s.__name__)
def test_messages_are_those_that_are_declared(signal, tmp_path):
    pytest.importorskip("pyproj")
    lines = {"edge": np.zeros((2, 3))}
    shown = replace(machine(), origin=ORIGIN, lines=lines, triangles=np.zeros((1, 3, 3)))
    with Recorder(tmp_path, [shown], detail="full") as recorder:
        recorder("combine.slot", 0, {"output": sample_of(signal)})
        if signal is Scan:  # a plane at even angles, with an echo per beam
            even = Scan(1, *np.array([[-1.0, 0.0], [0.0, 0.1], [0.0, 0.0]]), *np.ones((2, 2, 1), np.float32))
            recorder("combine.slot", 1, {"output": even})
    with (tmp_path / "run.mcap").open("rb") as file:
        found = {(c.topic, s.name) for s, c, _ in make_reader(file).iter_messages()}
    exact = ("/combine/slot/output_exact", "swath_msgs/msg/Samples")
    assert (exact in found) == (signal.about.samples != "messages")
    declared = {
        (re.sub("^/machine", "/combine", m.topic), m.type.replace("/", "/msg/")) for m in messages_of(signal)
    }
    assert found - {exact, ("/clock", "rosgraph_msgs/msg/Clock")} == declared


def test_two_receivers_have_columns_each(tmp_path):
    outputs = {"gnss_left.fix": Fix, "odometry.odometry": Odometry, "gnss_right.fix": Fix}
    with Recorder(tmp_path, [replace(machine(), outputs=outputs)]) as recorder:
        recorder("combine.gnss_left", 0, {"fix": replace(sample_of(Fix), x=1.0)})
        recorder("combine.gnss_right", 0, {"fix": replace(sample_of(Fix), x=5.0)})
        drive([recorder], GridField(ArcEdge()), seconds=0.2)
    tracks = read_tracks(tmp_path / "tracks.parquet")
    assert (tracks["fix_x_m"][-1], tracks["gnss_right_fix_x_m"][-1]) == (1.0, 5.0)
    assert not {"gnss_left_fix_x_m", "odometry_odometry_speed_m_s"} & set(tracks)


def test_two_scanners_have_topics_and_frames_each(tmp_path):
    both = replace(machine(), mounting={"lidar_left": Pose.identity(), "lidar_right": Pose.identity()})
    with Recorder(tmp_path, [both]) as recorder:
        for slot in both.mounting:
            recorder(f"combine.{slot}", 0, {"scan": sample_of(Scan)})
    topics = open_log(tmp_path).topics().keys() - {"/clock"}
    assert {f"/combine/{slot}/scan{end}" for slot in both.mounting for end in ("_points", "_exact")} == set(
        topics
    )


def test_an_edge_of_an_older_recording_has_unknown_accuracy():
    edge = CropEdge(0, 0.1, 0.0, 0.0, 8.0, 0.9, 0.8, 0.1)
    assert np.isnan([edge.offset_sd, edge.heading_sd, edge.seen_to]).all()
    assert edge.is_held is False


def test_tracks_have_an_order_that_no_two_signals_share():
    orders = [s.about.track_order for s in signal_types() if s.about.track_order is not None]
    assert len(orders) == len(set(orders))


def test_a_newer_recording_is_refused(tmp_path):
    file = McapFile(tmp_path / "run.mcap")
    file.attach("recording.json", "application/json", b'{"format": "swath recording 4"}')
    file.close()
    with pytest.raises(InputError, match="format = swath recording 4: expected swath recording 3 or older"):
        open_log(tmp_path)


def test_newer_tracks_are_refused(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "tracks.parquet"
    pq.write_table(pa.table({"t_s": [0.0]}).replace_schema_metadata({"format": "swath tracks 2"}), path)
    with pytest.raises(InputError, match="expected swath tracks 1 or older"):
        read_tracks(path)


@pytest.mark.parametrize("found", ["", RECORDING, "swath recording 1", "swath recording 2"])
def test_formats_that_are_read(found):
    check_format(found, RECORDING, Path("x"))
    with pytest.raises(InputError):
        check_format(RECORDING, TRACKS, Path("x"))
