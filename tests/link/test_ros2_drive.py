"""Levels `twist` and `ackermann`: a node that knows no slots drives the machine by one stream of commands."""

import math
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import pytest

from swath.commands.main import make_parser
from swath.core.errors import InputError
from swath.link.ros2.drive_node import of_ackermann, of_twist
from swath.link.ros2.slotnode import NodeSilent
from swath.runtime.assembly import assemble
from swath.scenario.scenario import find_scenario, load_scenario, parse_scenario
from tests.link.ros2_rig import EXAMPLES, HERE, domain, needs_ros2, node  # noqa: F401
from tests.waiting import until

TEXT = """
format: swath scenario 2
name: driven
run: {{distance_m: 100, max_duration_s: 20}}
field: {{edge: {{shape: straight}}}}
machines:
  combine:
    motion: {{level: kinematic, start_speed_kmh: 3.6}}
    lidar: off
    edge: off
    {slots}
"""
BOTH = """speed: {{level: twist, stamped: {0}, hold_s: 1.0, start_timeout_s: 300}}
    steer: {{level: twist, stamped: {0}, hold_s: 1.0, start_timeout_s: 300}}"""


def twist(speed, yaw_rate):
    return SimpleNamespace(linear=SimpleNamespace(x=speed), angular=SimpleNamespace(z=yaw_rate))


def test_a_twist_is_a_speed_and_a_curvature():
    assert of_twist(twist(2.0, 0.1), 3.75).curvature == pytest.approx(1 / 20)
    assert of_twist(twist(-2.0, 0.1), 3.75).curvature == pytest.approx(-1 / 20)
    assert of_twist(twist(0.0, 0.1), 3.75).curvature is None


def test_a_bicycle_angle_is_a_curvature():
    angle = math.atan(3.75 / 15.0)
    drive = of_ackermann(SimpleNamespace(speed=1.5, steering_angle=angle), 3.75)
    assert (drive.speed, drive.curvature) == (1.5, pytest.approx(1 / 15))


@pytest.mark.usefixtures("domain")
@pytest.mark.parametrize("form", ["plain", "stamped"])
class TestDriven:
    pytestmark = needs_ros2

    def test_the_machine_drives_the_circle_and_stops_when_silence_falls(self, form):
        slots = BOTH.format(str(form == "stamped").lower())
        with node(HERE / "ros2_drive_node.py", "/cmd_vel", "1.5", "0.1", form):
            world = assemble(parse_scenario(TEXT.format(slots=slots)))
            world.graph.reset()
        try:
            world.graph.run(900_000_000)
            command = world.graph.latest("combine.steer", "command")
            assert (command.curvature, command.is_engaged) == (pytest.approx(0.1 / 1.5), True)
            assert world.graph.latest("combine.speed", "command").speed == 1.5

            def stands():  # what the node had sent before its end may arrive late
                world.graph.run(world.graph.t + 1_000_000_000)
                return world.graph.latest("combine.speed", "command").speed == 0.0

            until(stands, "the machine stops")
            assert not world.graph.latest("combine.steer", "command").is_engaged
        finally:
            world.close()


@pytest.mark.usefixtures("domain")
class TestRefused:
    pytestmark = needs_ros2

    def test_silence_at_the_start_names_the_topic(self):
        slots = "steer: {level: twist, topic: /teleop, start_timeout_s: 0.3}"
        world = assemble(parse_scenario(TEXT.format(slots=slots)))
        try:
            with pytest.raises(NodeSilent, match=r"combine\.steer: no geometry_msgs/msg/Twist on /teleop"):
                world.graph.reset()
        finally:
            world.close()

    def test_other_slots_have_no_such_level(self):
        slots = "steer: preview\n    steering: twist"
        with pytest.raises(InputError, match="expected one of the slots steer, speed"):
            assemble(parse_scenario(TEXT.format(slots=slots)))


class Recorded:
    """Stands in for a class of ROS 2's `launch`, which no wheel brings; keeps what it is made with."""

    made: ClassVar[list] = []

    def __init__(self, *args, **kwargs):
        self.args, self.kwargs = args, kwargs
        Recorded.made.append(self)


def test_the_launch_file_starts_a_command_that_there_is(monkeypatch):
    names = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument", "EmitEvent", "ExecuteProcess", "RegisterEventHandler"],
        "launch.event_handlers": ["OnProcessExit"],
        "launch.events": ["Shutdown"],
        "launch.substitutions": ["LaunchConfiguration"],
    }
    for module, classes in names.items():
        stand_in = ModuleType(module)
        for name in classes:
            setattr(stand_in, name, type(name, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, module, stand_in)
    found = runpy.run_path(str(EXAMPLES / "edge_detector_launch.py"))
    actions = found["generate_launch_description"]().args[0]
    values = {a.args[0]: a.kwargs["default_value"] for a in actions if "default_value" in a.kwargs}
    commands = {a.kwargs["name"]: a.kwargs["cmd"] for a in actions if "cmd" in a.kwargs}

    def text(part):
        parts = part if isinstance(part, list) else [part]
        return "".join(p if isinstance(p, str) else values[p.args[0]] for p in parts)

    program, *words = [text(part) for part in commands["swath"]]
    assert program == "swath"
    args = make_parser()[0].parse_args(words)
    scenario = load_scenario(find_scenario(args.scenario), sets=args.sets)
    assert scenario.machines["combine"].slots["edge"].level == "ros2"
    assert Path(commands["edge_detector"][1]).is_file()
