"""From ROS messages to samples: which message can stand for which sample, and what is made of it.

MachineState is made of NavSatFix too, by `fixes.py`; any sample of the `swath_msgs` message of its name.
"""

from typing import Any

import numpy as np

from swath.core.layout import layout
from swath.record.read import motion, positioning, radar, scans
from swath.record.read.fields import Context, Maker, Makers
from swath.record.read.frames import pose_of
from swath.signals import Signal

MAKERS: Makers = {**scans.MAKERS, **motion.MAKERS, **positioning.MAKERS, **radar.MAKERS}
PACKAGES = (
    *("sensor_msgs", "nav_msgs", "geometry_msgs", "ackermann_msgs", "radar_msgs", "std_msgs"),
    "example_interfaces",
)


def maker_for(signal: type[Signal], msgtype: str, context: Context) -> Maker | None:
    """What makes samples of a type from messages of a type; None where nothing does."""
    package, _, name = msgtype.partition("/msg/")
    if package == "swath_msgs" and name == signal.__name__:
        return lambda message, t: _of_own(signal, message, context.stamp(message, t))
    make = MAKERS.get((signal, name)) if package in PACKAGES else None
    return None if make is None else make(context)


def message_names(signal: type[Signal]) -> list[str]:
    """Messages that a sample can be made from."""
    return [name for kind, name in MAKERS if kind is signal] + [f"swath_msgs/{signal.__name__}"]


def _of_own(signal: type[Signal], message: Any, t: int) -> Signal:
    """A swath_msgs message by its fields; arrays are flat there."""
    values = dict[str, Any]()
    for name, field in layout(signal).items():
        if not hasattr(message, name):
            continue
        value = getattr(message, name)
        if field.kind == "pose":
            values[name] = pose_of(value)
        else:
            values[name] = np.array(value, field.number) if field.is_array else field.declared(value)
    return signal(t, **values)
