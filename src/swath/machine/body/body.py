"""A machine's body from a file, with a header that moves: the visuals of an SDFormat or a URDF model.

A model in SDFormat stands in its own frame, of a URDF every joint is at 0. Fixed-axis roll, pitch and yaw
are the turns of `Pose.from_euler`; frames are those of REP 103.
"""

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Array, Pose
from swath.core.portable import product
from swath.core.units import DEG
from swath.field.memory_layout import Solids
from swath.field.mesh_file import UNITS, UP, file_up, read_mesh
from swath.field.solid.solids import merge, mesh, moved
from swath.machine.body.model_xml import CHAIN_MAX, LENGTH_MAX, TOO_DEEP, ModelFile, Part, checked, shape
from swath.scenario.sections import BodySection

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
    """The link's frame in the root's, and the links that it hangs on, its own first; known: of others."""
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


MODEL = "__model__"


def read_sdf(path: Path, key: str) -> tuple[Part, ...]:
    """Parts in the frame of the model. A joint says what hangs on what: its child on its parent.

    InputError for what cannot be read or understood, for `include` and for models within the model.
    """
    file = ModelFile(path, key)
    model = file.root("sdf").find("model")
    if model is None:
        raise file.error("<sdf>", "expected a model")
    for tag in ("include", "model"):
        if model.find(tag) is not None:
            raise file.error(f"<{tag}>", "expected one model with links of its own")
    frames = {n.get("name", ""): n for tag in ("link", "frame") for n in model.iterfind(tag)}
    above = {
        j.findtext("child", "").strip(): j.findtext("parent", "").strip() for j in model.iterfind("joint")
    }
    known = {MODEL: Pose.identity()}
    parts = []
    for link in model.iterfind("link"):
        name = link.get("name", "")
        pose = _in_model(file, name, frames, known)
        for index, visual in enumerate(link.iterfind("visual")):
            where = f"link {name}, visual {index}"
            corners = shape(file, visual.find("geometry"), where)
            other = _relative_to(visual)
            base = pose if not other else _in_model(file, other, frames, known)
            at = base @ _pose(file, visual, where)
            parts.append(Part(name, _group(file, name, above), at.apply(corners)))
    return checked(file, parts)


def _group(file: ModelFile, name: str, above: dict[str, str]) -> tuple[str, ...]:
    group = [name]
    while group[-1] in above:
        if len(group) >= CHAIN_MAX:
            raise file.error(f"link {name}", TOO_DEEP)
        group.append(above[group[-1]])
    return tuple(group)


def _in_model(file: ModelFile, name: str, frames: dict[str, Element], known: dict[str, Pose]) -> Pose:
    """A link's or frame's own frame in that of the model. known: of frames so far."""
    chain = [name]
    while chain[-1] not in known:
        node = frames.get(chain[-1])
        if node is None:
            expected = f"expected one of {', '.join(sorted(frames))}"
            raise file.error(f"relative_to {chain[-1]!r}", expected)
        chain.append(_relative_to(node) or node.get("attached_to") or MODEL)
        if len(chain) > CHAIN_MAX:
            raise file.error(f"relative_to {name!r}", f"expected no circle, and at most {CHAIN_MAX} frames")
    for link in chain[-2::-1]:
        node = frames[link]
        on = _relative_to(node) or node.get("attached_to") or MODEL
        known[link] = known[on] @ _pose(file, node, f"{node.tag} {link}")
    return known[name]


def _relative_to(node: Element) -> str:
    pose = node.find("pose")
    return "" if pose is None else pose.get("relative_to", "")


def _pose(file: ModelFile, node: Element, where: str) -> Pose:
    pose = node.find("pose")
    if pose is None or not (pose.text or "").strip():
        return Pose.identity()
    x, y, z, *angles = file.numbers(pose.text, 6, f"{where}: pose").tolist()
    roll, pitch, yaw = (a * DEG for a in angles) if pose.get("degrees") == "true" else angles
    return Pose.from_euler([x, y, z], roll, pitch, yaw)


HEADER = "header"
READERS = {".urdf": read_urdf, ".sdf": read_sdf}


@dataclass(frozen=True)
class MachineBody:
    """A body in the machine frame. fixed: what does not move in it; header: as with a level header."""

    fixed: Solids
    header: Solids

    @property
    def level(self) -> Solids:
        """All of it, with the header as the file has it."""
        return merge(self.fixed, self.header)

    @property
    def triangles(self) -> Array:
        """All of it with a level header, (n, 3, 3) [m]."""
        return corners_of(self.level)

    def with_header_at(self, pose: Pose) -> Solids:
        """All of it. pose: of the header in the machine frame, identity where it is level."""
        return merge(self.fixed, moved(self.header, pose))


def corners_of(solids: Solids) -> Array:
    """Triangles of what was read from a file, (n, 3, 3) [m]."""
    places = zip(solids.mesh_shape, solids.mesh_centre, strict=True)
    found = [shape.corners.astype(float) + centre for shape, centre in places]
    return np.concatenate([*found, np.zeros((0, 3, 3))])


def read_body(section: BodySection, key: str) -> MachineBody:
    """The body that a section of a scenario names. key: of the section, for errors.

    InputError for a file that cannot be read, a header that it does not have, or a size that no machine has.
    """
    path = Path(section.file)
    reader = READERS.get(path.suffix.lower())
    parts = reader(path, f"{key}.file") if reader else _of_mesh(section, path, f"{key}.file")
    at = Pose.from_euler([section.x_m, section.y_m, section.z_m], yaw=section.heading_deg * DEG)
    corners = [at.apply(part.corners * section.scale) for part in parts]
    size = np.ptp(np.concatenate(corners).reshape(-1, 3), axis=0).max()
    if not 0.1 <= size <= LENGTH_MAX:
        expected = f"expected a machine of 0.1 to {LENGTH_MAX:g} m, it is {size:.3g} m: unit, scale?"
        raise InputError(f"{key}.file", path.name, expected)
    wanted = section.header or HEADER
    lifted = [wanted in part.group for part in parts]
    if section.header is not None and not any(lifted):
        names = ", ".join(sorted({name for part in parts for name in part.group}))
        raise InputError(f"{key}.header", section.header, f"expected one of {names}")
    solid = [mesh(c, Pose.identity(), section.reflectance) for c in corners]
    pairs = list(zip(solid, lifted, strict=True))
    return MachineBody(merge(*(s for s, up in pairs if not up)), merge(*(s for s, up in pairs if up)))


def _of_mesh(section: BodySection, path: Path, key: str) -> tuple[Part, ...]:
    """The parts of a mesh file, each a link by its name."""
    turn: Array = UP[section.up or file_up(path)]
    found = read_mesh(path, key=key)
    return tuple(
        Part(p.names[0] if p.names else "", p.names, product(p.corners, turn.T) * UNITS[section.unit])
        for p in found
    )
