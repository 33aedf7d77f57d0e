"""The shipped layout for Foxglove: panels are placed, all topics and numbers it names are in a run.mcap."""

import json
import re

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from swath.documents.data_sheets import viewer_layout
from swath.record.recorder import Recorder
from swath.signals import Scan
from tests.fake_run import ArcEdge, GridField, drive, machine

LAYOUT = json.loads(viewer_layout().read_text())
PATHS = [p["value"] for c in LAYOUT["configById"].values() for p in c.get("paths", ())]
SCENE = LAYOUT["configById"]["3D!scene"]


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """Topic -> first message of a run whose scanner has two echoes, so that there is a cloud too."""
    folder = tmp_path_factory.mktemp("run")
    with Recorder(folder, [machine()]) as recorder:

        def twice(slot, t, outputs):
            if (scan := outputs.get("scan")) is not None:
                ranges, light = (a.repeat(2, axis=1) for a in (scan.ranges, scan.intensity))
                two = Scan(t, scan.beam_t, scan.azimuth, scan.elevation, ranges, light)
                outputs = {**outputs, "scan": two}
            recorder(slot, t, outputs)

        drive([twice], GridField(ArcEdge()), seconds=1.0)
    found = {}
    with (folder / "run.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, message)
    return found


def panels(node):
    return [node] if isinstance(node, str) else panels(node["first"]) + panels(node["second"])


def test_every_panel_has_a_place_and_a_kind():
    placed = panels(LAYOUT["layout"])
    assert sorted(placed) == sorted(LAYOUT["configById"])
    assert {name.partition("!")[0] for name in placed} == {"3D", "Plot"}
    assert {"globalVariables", "userNodes", "playbackConfig"} < set(LAYOUT)


def test_every_topic_of_the_scene_is_recorded(messages):
    assert set(SCENE["topics"]) <= set(messages)
    frames = {f.child_frame_id for topic in ("/tf", "/tf_static") for f in messages[topic].transforms}
    assert SCENE["followTf"] in frames
    parents = {f.header.frame_id for topic in ("/tf", "/tf_static") for f in messages[topic].transforms}
    assert SCENE["layers"]["grid"]["frameId"] in parents
    fields = {f.name for f in messages["/combine/lidar/scan_points"].fields}
    for settings in SCENE["topics"].values():
        assert settings.get("colorField", "intensity") in fields


@pytest.mark.parametrize("path", PATHS)
def test_every_number_of_a_plot_is_recorded(messages, path):
    topic, _, inner = path.partition(".")
    value = messages[topic]
    for name in inner.split("."):
        value = getattr(value, name)
    assert isinstance(value, float)


def test_signals_of_every_part_of_the_circle_are_plotted():
    topics = {re.match(r"/combine/(\w+)/", path)[1] for path in PATHS}
    assert topics == {"edge", "steer", "steering", "motion", "odometry", "speed", "header", "process"}
