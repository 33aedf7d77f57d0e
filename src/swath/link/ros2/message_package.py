"""swath's own message types as a ROS 2 package that `colcon build` makes: one .msg per signal."""

import os
from pathlib import Path

from swath import __version__
from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.signal import Signal, signal_types
from swath.record.message_factory import definition
from swath.record.messenger import MAKERS
from swath.record.samples import DEFINITION, MSGTYPE

NAME = "swath_msgs"
_PACKAGE = f"""<?xml version="1.0"?>
<package format="3">
  <name>{NAME}</name>
  <version>{__version__.partition(".dev")[0]}</version>
  <description>Message types of the simulator swath that ROS 2 has no standard message for</description>
  <maintainer email="nobody@example.com">made by swath ros2 package</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>std_msgs</depend>
  <depend>geometry_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""
_BUILD = """cmake_minimum_required(VERSION 3.8)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
find_package(std_msgs REQUIRED)
find_package(geometry_msgs REQUIRED)
rosidl_generate_interfaces(${{PROJECT_NAME}}
{messages}
  DEPENDENCIES std_msgs geometry_msgs)
ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""


def message_types() -> dict[str, str]:
    """Name of a message -> its .msg text, of the signals that no standard message carries."""
    own = [s for s in signal_types() if s.__module__.startswith("swath.signals.") and _is_own(s)]
    made = {signal.__name__: definition(signal) for signal in own}
    return dict(sorted((made | {MSGTYPE.rpartition("/")[2]: DEFINITION}).items()))


def write_package(folder: Path) -> list[Path]:
    """Write the package into a new folder `swath_msgs` in `folder`; the files. InputError if it is there."""
    root = folder / NAME
    if os.path.exists(root):
        raise InputError("--out", str(root), "expected a folder without it: it is there already")
    texts = message_types()
    lines = "\n".join(f'  "msg/{name}.msg"' for name in texts)
    files = {"package.xml": _PACKAGE, "CMakeLists.txt": _BUILD.format(name=NAME, messages=lines)}
    files |= {f"msg/{name}.msg": text for name, text in texts.items()}
    return [write_whole(root / name, text) for name, text in files.items()]


def _is_own(signal: type[Signal]) -> bool:
    declared = [message.type for message in signal.about.messages]
    return signal not in MAKERS or f"{NAME}/{signal.__name__}" in declared
