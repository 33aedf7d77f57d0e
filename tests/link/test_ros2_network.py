"""ROS 2 stays on this machine unless it is told otherwise, and brings no code into a run."""

from pathlib import Path
from threading import Thread

import pytest

from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from swath.scenario.scenario import parse_scenario
from tests.link.ros2_rig import CHEAP, domain, needs_ros2, start  # noqa: F401

pytestmark = [*needs_ros2, pytest.mark.skipif(not Path("/proc/net/udp").exists(), reason="needs Linux")]

SOCKETS = """
import os, sys
from contextlib import nullcontext
from pathlib import Path
from swath.link.ros2.middleware import close_node, networked, open_node
with networked() if sys.argv[1] == "network" else nullcontext():
    node = open_node("here", "a test")
own = {os.readlink(f) for f in Path("/proc/self/fd").iterdir() if f.is_symlink() and os.path.lexists(f)}
for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
    words = line.split()
    address, port = words[1].split(":")
    if f"socket:[{words[9]}]" in own:
        print(address, int(port, 16))
close_node(node)
assert "ROS_STATIC_PEERS" not in os.environ
"""


def listening(where, number):
    """Addresses at which ports of the domain are open, as in /proc/net/udp."""
    process = start("-c", SOCKETS, where, stdout=-1)
    found = [line.split() for line in process.communicate(timeout=600)[0].splitlines()]
    first = 7400 + 250 * number
    return {address for address, port in found if first <= int(port) < first + 250}


def test_only_the_loopback_interface_is_open(domain, monkeypatch):  # noqa: F811
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    assert listening("machine", domain) == {"0100007F"}
    assert "00000000" in listening("network", domain)


CALL = """
import rclpy, sys, time
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
rclpy.init(args=[])
node = rclpy.create_node("stranger")
client = node.create_client(SetParameters, "/swath/set_parameters")
assert client.wait_for_service(300.0)
value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=sys.argv[1])
request = SetParameters.Request(parameters=[Parameter(name="combine.edge.level", value=value)])
future = client.call_async(request)
rclpy.spin_until_future_complete(node, future, timeout_sec=300.0)
print(future.result().results[0].successful, future.result().results[0].reason)
"""


class Over(Exception):
    """The stranger has had an answer."""


class Wait(RunHook):
    """Goes on until a process has ended."""

    def __init__(self, process):
        self.process = process

    def begin(self, run):
        run.world.graph.before_tick.append(self.look)

    def look(self, t):
        if self.process.poll() is not None:
            raise Over


def test_a_stranger_cannot_make_a_run_execute_a_file(domain, tmp_path):  # noqa: F811
    from swath.link.ros2.bridge import Bridge

    (tmp_path / "evil.py").write_text(f"import pathlib\npathlib.Path({str(tmp_path / 'mark')!r}).touch()\n")
    stranger = start("-c", CALL, f"{tmp_path}/evil.py:Edge", stdout=-1)
    bridge = Bridge()
    scenario = parse_scenario(
        CHEAP.format(seconds=60, steer="level: constant"), sets=["realtime.pace=real_time"]
    )
    try:
        with pytest.raises(Over):
            run_job(scenario, tmp_path / "run", hooks=[bridge, Wait(stranger)])
    finally:
        bridge.close()
        said = stranger.communicate(timeout=600)[0]
    assert said.startswith("False combine.edge.level")
    assert "names code" in said
    assert not (tmp_path / "mark").exists()


def test_what_a_stranger_sets_while_parameters_are_declared_is_checked(domain):  # noqa: F811
    from rclpy.parameter import Parameter

    from swath.link.ros2.bridge import RunParameters
    from swath.link.ros2.middleware import close_node, open_node

    answers = []

    class Control:
        def set(self, name, value):
            return False, f"{name}: names code"

    class Changes:
        """Is asked for the values while the parameters are declared, and lets a stranger in just then."""

        def values(self):
            wanted = Parameter("combine.edge.level", value="evil.py:Edge")
            stranger = Thread(target=lambda: answers.extend(node.set_parameters([wanted])))
            stranger.start()
            stranger.join()
            return {"combine.edge.level": "truth"}

    node = open_node("here", "a test", allow_undeclared_parameters=True)
    try:
        RunParameters(node, Control()).join(Changes())
        refused = (False, "combine.edge.level: names code")
        assert [(a.successful, a.reason) for a in answers] == [refused]
        assert node.get_parameter("combine.edge.level").value == "truth"
    finally:
        close_node(node)


@pytest.mark.parametrize("cut", [0, 9, 2000, -40])
def test_a_cut_recording_is_not_played(tmp_path, cut):
    from swath.core.errors import InputError
    from swath.link.ros2.player import play

    run_job(parse_scenario(CHEAP.format(seconds=1, steer="level: constant")), tmp_path / "out")
    file = tmp_path / "cut.mcap"
    file.write_bytes((tmp_path / "out" / "run.mcap").read_bytes()[:cut])
    with pytest.raises(InputError, match=r"recording: expected a whole MCAP file.*cut\.mcap"):
        play(file)
