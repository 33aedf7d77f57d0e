"""What a viewer shows of a machine and its field without any set-up: the machine's body, the field, the edge.

The body is a URDF of one link, the frame `<machine>/base_link`, so that it moves with /tf alone: box of the
chassis, header and wheels from the data sheet. It has no joints and no mass: no viewer has to simulate it.
"""

from collections.abc import Iterator
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

from swath.core.frames import Pose
from swath.record.messages import Sent, Source
from swath.signals import F64
from swath.signals.setup import MachineGeometry

CHASSIS, HEADER, RUBBER = (0.42, 0.56, 0.14, 1.0), (0.8, 0.8, 0.78, 1.0), (0.15, 0.15, 0.15, 1.0)
WHEEL_WIDTH, WHEEL_RADIUS = 0.6, 0.75  # [m], for the eye: data sheets of geometry alone hold no tyres
LINE_STRIP, TRIANGLE_LIST = 4, 11  # visualization_msgs/Marker
COLOURS = {"edge": (0.0, 0.45, 0.7)}


def urdf(name: str, machine: MachineGeometry) -> str:
    """The machine as URDF, one link `<name>/base_link` with boxes and wheels."""
    robot = Element("robot", name=name)
    link = SubElement(robot, "link", name=f"{name}/base_link")
    rear, front, half, bottom, top = machine.body
    chassis = (front - rear, 2.0 * half, top - bottom)
    _box(link, "chassis", chassis, (0.5 * (rear + front), 0.0, 0.5 * (bottom + top)), CHASSIS)
    if machine.has_header:
        size = (machine.header_depth, machine.header_width, machine.header_height)
        at = (machine.knife_x - 0.5 * size[0], machine.header_y, 0.15 + 0.5 * size[2])
        _box(link, "header", size, at, HEADER)
    for axle, x, track in (
        ("fixed", 0.0, machine.front_track),
        ("steered", machine.steered_x, machine.rear_track),
    ):
        for side, y in (("left", 0.5 * track), ("right", -0.5 * track)):
            visual = _visual(link, f"{axle}_{side}_wheel", (x, y, WHEEL_RADIUS), RUBBER, turn="1.570796 0 0")
            SubElement(visual, "cylinder", radius=f"{WHEEL_RADIUS}", length=f"{WHEEL_WIDTH}")
    return '<?xml version="1.0"?>\n' + tostring(robot, encoding="unicode")


def scene_messages(source: Source) -> Iterator[Sent]:
    """Before the first sample of a machine's motion: frames, body and lines on the field; all latched.

    The body of the first machine goes where viewers look for it, `/robot_description`.
    """
    make, machine = source.make, source.machine
    frames = [make.transform(0, source.base, f"{machine.name}/{s}", p) for s, p in machine.mounting.items()]
    frames.append(make.transform(0, "map", source.odom, Pose.identity()))
    yield Sent("/tf_static", make("tf2_msgs/msg/TFMessage", transforms=frames), "latched")
    body = make("std_msgs/msg/String", data=urdf(machine.name, machine.geometry))
    topic = "/robot_description" if machine.is_first else f"/{machine.name}/robot_description"
    yield Sent(topic, body, "latched")
    if len(machine.triangles):
        marked = make("visualization_msgs/msg/MarkerArray", markers=[_triangles(make, source)])
        yield Sent(f"/{machine.name}/body_markers", marked, "latched")
    if machine.lines:
        markers = [_line(make, name, points) for name, points in machine.lines.items()]
        marked = make("visualization_msgs/msg/MarkerArray", markers=markers)
        yield Sent(f"/{machine.name}/field_markers", marked, "latched")


def _line(make: Any, name: str, points: F64) -> Any:
    colour = (*COLOURS.get(name, (0.9, 0.9, 0.9)), 1.0)
    return make.marker(make.header(0, "map"), name, LINE_STRIP, colour, (0.08,), points=points.tolist())


def _triangles(make: Any, source: Source) -> Any:
    """The machine's body from its file, with a level header."""
    header, size = make.header(0, source.base), (1.0, 1.0, 1.0)
    corners = source.machine.triangles.reshape(-1, 3).tolist()
    return make.marker(header, "body", TRIANGLE_LIST, CHASSIS, size, points=corners, frame_locked=True)


def _box(link: Element, name: str, size: tuple[float, ...], at: tuple[float, ...], colour: Any) -> None:
    SubElement(_visual(link, name, at, colour), "box", size=_text(size))


def _visual(link: Element, name: str, at: tuple[float, ...], colour: Any, turn: str = "0 0 0") -> Element:
    """The geometry of a new visual."""
    visual = SubElement(link, "visual", name=name)
    SubElement(visual, "origin", xyz=_text(at), rpy=turn)
    geometry = SubElement(visual, "geometry")
    SubElement(SubElement(visual, "material", name=name), "color", rgba=_text(colour))
    return geometry


def _text(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:g}" for number in numbers)
