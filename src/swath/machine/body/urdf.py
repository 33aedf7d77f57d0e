"""The visuals of a URDF, with every joint at 0.

Fixed-axis roll, pitch and yaw of URDF are the turns of `Pose.from_euler`; frames are those of REP 103.
"""

from pathlib import Path
from xml.etree.ElementTree import Element

from swath.core.frames import Pose
from swath.machine.body.model_xml import CHAIN_MAX, TOO_DEEP, ModelFile, Part, checked, shape

Placed = tuple[Pose, tuple[str, ...]]


def read_urdf(path: Path, key: str) -> tuple[Part, ...]:
    """Parts in the frame of the root link. InputError for what cannot be read or understood."""
    file = ModelFile(path, key)
    root = file.root("robot")
    links = {link.get("name", ""): link for link in root.iterfind("link")}
    above = _joints(file, root, set(links))
    parts = []
    known: dict[str, Placed] = {}
    for name, link in links.items():
        pose, group = _to_root(file, name, above, known)
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


def _to_root(
    file: ModelFile, name: str, above: dict[str, tuple[str, Pose]], known: dict[str, Placed]
) -> Placed:
    """The link's frame in the root's, and the links that it hangs on, its own first; known: of others"""
    chain = [name]
    while chain[-1] not in known and chain[-1] in above:
        chain.append(above[chain[-1]][0])
        if len(chain) > CHAIN_MAX:
            raise file.error(f"link {name}", TOO_DEEP)
    if chain[-1] not in known:
        known[chain[-1]] = Pose.identity(), (chain[-1],)
    for link in chain[-2::-1]:
        parent, step = above[link]
        pose, group = known[parent]
        if len(group) >= CHAIN_MAX:
            raise file.error(f"link {name}", TOO_DEEP)
        known[link] = pose @ step, (link, *group)
    return known[name]


def _origin(file: ModelFile, node: Element, where: str) -> Pose:
    origin = node.find("origin")
    if origin is None:
        return Pose.identity()
    place = file.numbers(origin.get("xyz", "0 0 0"), 3, f"{where}: origin xyz")
    roll, pitch, yaw = file.numbers(origin.get("rpy", "0 0 0"), 3, f"{where}: origin rpy").tolist()
    return Pose.from_euler(place, roll, pitch, yaw)
