"""The visuals of a URDF, with every joint at 0.

Fixed-axis roll, pitch and yaw of URDF are the turns of `Pose.from_euler`; frames are those of REP 103.
"""

from pathlib import Path
from xml.etree.ElementTree import Element

from swath.core.frames import Pose
from swath.machine.body.model_xml import ModelFile, Part, checked, shape


def read_urdf(path: Path, key: str) -> tuple[Part, ...]:
    """Parts in the frame of the root link. InputError for what cannot be read or understood."""
    file = ModelFile(path, key)
    root = file.root("robot")
    links = {link.get("name", ""): link for link in root.iterfind("link")}
    above = _joints(file, root, set(links))
    parts = []
    for name, link in links.items():
        pose, group = _to_root(file, name, above)
        for index, visual in enumerate(link.iterfind("visual")):
            where = f"link {name}, visual {index}"
            corners = shape(file, visual.find("geometry"), where)
            at = pose @ _origin(file, visual, where)
            parts.append(Part(name, group, at.apply(corners)))
    return checked(file, parts)


def _joints(file: ModelFile, root: Element, links: set[str]) -> dict[str, tuple[str, Pose]]:
    """Child link -> parent link, and the child's frame in it."""
    above: dict[str, tuple[str, Pose]] = {}
    for joint in root.iterfind("joint"):
        where = f"joint {joint.get('name')}"
        ends = [joint.find(end) for end in ("parent", "child")]
        parent, child = (end.get("link", "") if end is not None else "" for end in ends)
        if parent not in links or child not in links:
            raise file.error(where, "expected parent and child among the links")
        if child in above:
            raise file.error(where, f"expected one parent of link {child}, it has two")
        above[child] = parent, _origin(file, joint, where)
    return above


def _to_root(file: ModelFile, name: str, above: dict[str, tuple[str, Pose]]) -> tuple[Pose, tuple[str, ...]]:
    """The link's frame in the root's, and the links that it hangs on, its own first."""
    pose, group = Pose.identity(), [name]
    while group[-1] in above:
        parent, step = above[group[-1]]
        if parent in group:
            raise file.error(f"link {name}", "expected a tree of links, it hangs on itself")
        pose = step @ pose
        group.append(parent)
    return pose, tuple(group)


def _origin(file: ModelFile, node: Element, where: str) -> Pose:
    origin = node.find("origin")
    if origin is None:
        return Pose.identity()
    place = file.numbers(origin.get("xyz", "0 0 0"), 3, f"{where}: origin xyz")
    roll, pitch, yaw = file.numbers(origin.get("rpy", "0 0 0"), 3, f"{where}: origin rpy").tolist()
    return Pose.from_euler(place, roll, pitch, yaw)
