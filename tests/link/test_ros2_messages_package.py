"""swath_msgs as a package, and topics that the bridge does not publish."""

import json
import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from rosbags.typesys import get_types_from_msg

from swath.core.errors import InputError
from swath.link.ros2.message_package import write_package
from swath.record.message_factory import MessageFactory
from tests.link.ros2_rig import HERE, domain, hashes_of, needs_ros2, node  # noqa: F401
from tests.waiting import PATIENCE_S

RUN = """
import sys
from pathlib import Path

from swath.link.ros2.bridge import Bridge
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario
from tests.link.ros2_rig import Heard, all_taken

bridge = Bridge(is_paused=True)
sets = ["run.max_duration_s=1"]
scenario = load_scenario("person-at-edge", sets=sets)
run_job(scenario, Path(sys.argv[1]), hooks=[bridge, Heard(bridge, sys.argv[2:])])
all_taken(bridge._node)
bridge.close()
"""
LISTENED = {
    "/combine/objects/objects": "Objects",
    "/combine/steer/command": "SteerCommand",
}


def test_every_message_of_the_package_is_a_definition(tmp_path):
    files = write_package(tmp_path)
    root = ElementTree.parse(tmp_path / "swath_msgs" / "package.xml").getroot()
    assert root.findtext("name") == "swath_msgs"
    named = re.findall(r"msg/\w+\.msg", (tmp_path / "swath_msgs" / "CMakeLists.txt").read_text())
    messages = [f for f in files if f.suffix == ".msg"]
    assert sorted(named) == sorted(f"msg/{f.name}" for f in messages)
    for file in messages:
        assert re.fullmatch(r"[A-Z][A-Za-z0-9]*", file.stem)
        found = get_types_from_msg(file.read_text(), f"swath_msgs/msg/{file.stem}")
        for name, _ in found[f"swath_msgs/msg/{file.stem}"][1]:
            assert re.fullmatch(r"[a-z](_?[a-z0-9])*", name), name  # as rosidl asks
    with pytest.raises(InputError, match="it is there already"):
        write_package(tmp_path)


@pytest.mark.draws
@pytest.mark.skipif(needs_ros2[0].args[0], reason="rclpy is not installed")
@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
@pytest.mark.skipif(
    not Path(sys.prefix, "include", "fastcdr").exists(),
    reason="rclpy is not from the wheels, which bring headers",
)
def test_where_the_package_is_built_its_types_travel_as_recorded(domain, monkeypatch, tmp_path):  # noqa: F811
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    from tests.link.built_messages import build

    write_package(tmp_path)
    offered = build(tmp_path / "swath_msgs", tmp_path / "built", set(LISTENED.values()))
    out, report = tmp_path / "run", tmp_path / "report.json"
    pairs = [f"{topic}=swath_msgs/{name}" for topic, name in LISTENED.items()]
    listener = (HERE / "ros2_listener.py", report, *pairs)
    with (
        node(*listener, also=offered, stdin=subprocess.PIPE) as heard,
        node("-c", RUN, out, *LISTENED, also=offered) as run,
    ):
        assert run.wait(PATIENCE_S) == 0
        sent = {topic: hashes_of(out, topic) for topic in LISTENED}
        heard.communicate(json.dumps({topic: hashes[-1] for topic, (_, hashes) in sent.items()}), timeout=600)
    for topic, got in json.loads(report.read_text())["got"].items():
        first, hashes = sent[topic]
        assert got[-len(hashes) :] == hashes, topic
        assert set(got[: -len(hashes)]) <= set(first), topic
        assert len(hashes) >= 5, topic


class FakeNode:
    """Keeps what is published."""

    def __init__(self):
        self.topics = {}

    def create_publisher(self, kind, name, qos):
        self.topics[name] = []
        return SimpleNamespace(publish=self.topics[name].append)


@pytest.mark.skipif(needs_ros2[0].args[0], reason="rclpy is not installed")
def test_types_with_constants_are_published_and_others_are_named(caplog, monkeypatch):
    from swath.link.ros2 import publisher as module

    make, node = MessageFactory(), FakeNode()
    sender = module.Publisher(node, make.store)
    for topic, kind in (("/fix", "sensor_msgs/msg/NavSatFix"), ("/edge", "visualization_msgs/msg/Marker")):
        sender(topic, 0, b"", partial(make, kind), False)
        assert len(node.topics[topic]) == 1
    assert sender.left_out == {}
    other = SimpleNamespace(get_fields_and_field_types=lambda: {"header": "std_msgs/Header"})
    monkeypatch.setattr(module, "type_of", lambda msgtype: other)
    sender("/old", 0, b"", partial(make, "sensor_msgs/msg/Imu"), False)
    sender("/older", 0, b"", partial(make, "sensor_msgs/msg/Imu"), False)
    assert sender.left_out == dict.fromkeys(
        ["/old", "/older"], "the installed sensor_msgs/msg/Imu has other fields"
    )
    assert "/old is not published" in caplog.text
    assert len(caplog.records) == 1  # one line a reason
