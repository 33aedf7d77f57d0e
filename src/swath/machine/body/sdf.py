"""The visuals of a model in SDFormat, as it stands in its own frame."""

from pathlib import Path
from xml.etree.ElementTree import Element

from swath.core.frames import Pose
from swath.core.units import DEG
from swath.machine.body.model_xml import ModelFile, Part, checked, shape

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
    parts = []
    for link in model.iterfind("link"):
        name = link.get("name", "")
        pose = _in_model(file, name, frames, ())
        for index, visual in enumerate(link.iterfind("visual")):
            where = f"link {name}, visual {index}"
            corners = shape(file, visual.find("geometry"), where)
            other = _relative_to(visual)
            base = pose if not other else _in_model(file, other, frames, ())
            at = base @ _pose(file, visual, where)
            parts.append(Part(name, _group(file, name, above), at.apply(corners)))
    return checked(file, parts)


def _group(file: ModelFile, name: str, above: dict[str, str]) -> tuple[str, ...]:
    group = [name]
    while group[-1] in above:
        if above[group[-1]] in group:
            raise file.error(f"link {name}", "expected a tree of links, it hangs on itself")
        group.append(above[group[-1]])
    return tuple(group)


def _in_model(file: ModelFile, name: str, frames: dict[str, Element], asked: tuple[str, ...]) -> Pose:
    """A link's or frame's own frame in that of the model."""
    if name == MODEL:
        return Pose.identity()
    if name not in frames or name in asked:
        expected = (
            f"expected one of {', '.join(sorted(frames))}" if name not in frames else "expected no circle"
        )
        raise file.error(f"relative_to {name!r}", expected)
    node = frames[name]
    on = _relative_to(node) or node.get("attached_to") or MODEL
    return _in_model(file, on, frames, (*asked, name)) @ _pose(file, node, f"{node.tag} {name}")


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
