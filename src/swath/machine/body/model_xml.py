"""What URDF and SDF share: the XML, numbers in it, and the shapes of a visual."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse
from xml.etree.ElementTree import Element

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Array
from swath.documents.text_file import read_bytes
from swath.documents.xml_file import XmlError, read_xml
from swath.field.mesh_file import read_mesh
from swath.machine.body import triangles

BYTES_MAX, PARTS_MAX = 8 << 20, 10_000
CHAIN_MAX = 100  # links or frames that hang on each other
TOO_DEEP = f"expected a tree of links, at most {CHAIN_MAX} on each other: it hangs on itself, or on more"
LENGTH_MAX = 100.0  # of a machine's part [m]


@dataclass(frozen=True)
class Part:
    """A visual of a link. link: its name; group: names of the links that it hangs on, its own first.

    corners: triangles (n, 3, 3) in the model's frame [m]
    """

    link: str
    group: tuple[str, ...]
    corners: Array


@dataclass(frozen=True)
class ModelFile:
    """A model file and the key that names it. Its errors name the place in the file."""

    path: Path
    key: str

    def error(self, where: str, expected: str) -> InputError:
        """An InputError of the key: where in the file, and what was expected there."""
        return InputError(self.key, self.path.name, f"{where}: {expected}")

    def root(self, tag: str) -> Element:
        """The root element `tag`. No entities are resolved, a DOCTYPE is refused."""
        try:
            root = read_xml(read_bytes(self.path, self.key, "a model", BYTES_MAX))
        except XmlError as error:
            raise self.error(
                f"line {error.line}", f"expected XML that can be read: {error.reason}"
            ) from error
        if root.tag != tag:
            raise self.error(f"<{root.tag}>", f"expected <{tag}>")
        return root

    def numbers(self, text: str | None, count: int, where: str) -> Array:
        """`count` finite numbers of a text. Raises InputError."""
        try:
            found = np.array([float(word) for word in (text or "").split()])
        except ValueError:
            found = np.zeros(0)
        if len(found) != count or not np.isfinite(found).all():
            raise self.error(where, f"expected {count} finite numbers, got {(text or '')[:60]!r}")
        return found

    def lengths(self, text: str | None, count: int, where: str) -> Array:
        """`count` lengths [m] above 0."""
        found = self.numbers(text, count, where)
        if not ((found > 0.0) & (found <= LENGTH_MAX)).all():
            raise self.error(where, f"expected above 0 and at most {LENGTH_MAX:g} m, got {text!r}")
        return found

    def mesh(self, uri: str | None, scale: Array, where: str) -> Array:
        """Triangles of a mesh named by a path or an URI (package://, model://, file://)."""
        if not uri:
            raise self.error(where, "expected the name of a mesh")
        found = self._find(uri)
        if found is None:
            raise self.error(where, f"expected a mesh that is there, {uri!r} is not at or above this file")
        corners = np.concatenate([part.corners for part in read_mesh(found, key=self.key)])
        return np.asarray(corners * scale)

    def _find(self, uri: str) -> Path | None:
        """The file that an URI means: `package://NAME/rest` in a folder NAME at or above the model file, or
        as `rest` in a folder above it.
        """
        parsed = urlparse(uri)
        if parsed.scheme in ("package", "model"):
            rest = unquote(parsed.path.lstrip("/"))
            around = self.path.resolve().parents
            tries = [folder / parsed.netloc / rest for folder in around] + [
                folder / rest for folder in around
            ]
        else:
            tries = [self.path.parent / unquote(parsed.path if parsed.scheme == "file" else uri)]
        return next((file for file in tries if os.path.isfile(file)), None)


def shape(file: ModelFile, geometry: Element | None, where: str) -> Array:
    """Triangles (n, 3, 3) [m] of the `geometry` of a visual, in URDF (attributes) or SDF (elements)."""
    for node in () if geometry is None else geometry:
        get = _reader(node)
        if node.tag == "box":
            return triangles.box(file.lengths(get("size"), 3, f"{where}: size"))
        if node.tag == "cylinder":
            radius, length = (file.lengths(get(n), 1, f"{where}: {n}")[0] for n in ("radius", "length"))
            return triangles.cylinder(float(radius), float(length))
        if node.tag == "sphere":
            return triangles.sphere(float(file.lengths(get("radius"), 1, f"{where}: radius")[0]))
        if node.tag == "mesh":
            scale = file.numbers(get("scale") or "1 1 1", 3, f"{where}: scale")
            return file.mesh(get("filename") or get("uri"), scale, where)
    names = ", ".join(node.tag for node in geometry) if geometry is not None else "no geometry"
    raise file.error(where, f"expected a box, cylinder, sphere or mesh, got {names or 'nothing'}")


def checked(file: ModelFile, parts: Sequence[Part]) -> tuple[Part, ...]:
    """The parts of a file, which has some and not too many."""
    if not 0 < len(parts) <= PARTS_MAX:
        raise file.error("the model", f"expected 1 to {PARTS_MAX} visuals, it has {len(parts)}")
    return tuple(parts)


def _reader(node: Element) -> Any:
    """Attribute or text of a child, by name."""

    def get(name: str) -> str | None:
        return node.get(name) or node.findtext(name)

    return get
