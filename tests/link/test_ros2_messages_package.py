"""swath_msgs as a package, and topics that the bridge does not publish."""

import re
from functools import partial
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from rosbags.typesys import get_types_from_msg

from swath.core.errors import InputError
from swath.link.ros2.message_package import write_package
from swath.record.message_factory import MessageFactory
from tests.link.ros2_rig import needs_ros2


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
