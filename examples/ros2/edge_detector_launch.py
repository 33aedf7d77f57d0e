"""A run and the node that plays its slot `edge`, started together.

ros2 launch examples/ros2/edge_detector_launch.py scenario:=straight seconds:=30
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, ExecuteProcess, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration

NODE = Path(__file__).with_name("edge_detector_node.py")


def generate_launch_description() -> LaunchDescription:
    """The node, and `swath run` with the slot given to it; the node ends with the run."""
    run = ExecuteProcess(
        name="swath",
        output="screen",
        cmd=[
            *("swath", "run", LaunchConfiguration("scenario"), "--ros2"),
            *("--set", "combine.edge.level=ros2"),
            *("--set", ["run.max_duration_s=", LaunchConfiguration("seconds")]),
        ],
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("scenario", default_value="straight", description="bundled name or file"),
            DeclareLaunchArgument("seconds", default_value="30", description="simulated, at most"),
            ExecuteProcess(name="edge_detector", output="screen", cmd=["python3", str(NODE)]),
            run,
            RegisterEventHandler(OnProcessExit(target_action=run, on_exit=[EmitEvent(event=Shutdown())])),
        ]
    )
