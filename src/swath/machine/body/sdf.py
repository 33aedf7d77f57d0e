"""The visuals of a model in SDFormat, as it stands in its own frame."""

from pathlib import Path
from xml.etree.ElementTree import Element

from swath.core.frames import Pose
from swath.core.units import DEG
from swath.machine.body.model_xml import CHAIN_MAX, TOO_DEEP, ModelFile, Part, checked, shape

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
    """A link's or frame's own frame in that of the model. known: of frames so far"""
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
