"""Triangle meshes from files (OBJ, PLY, GLB and what else trimesh reads), in parts with names.

A part's name is that of its material, else of its object. An OBJ file's materials are taken from its own
`usemtl` lines (`o` and `g` lines where it has none), so its .mtl file and textures need not be there.
"""

import io
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, MissingExtra
from swath.core.portable import product
from swath.core.units import CM, MM

Array = NDArray[np.float64]
TRIANGLES_MAX = 2_000_000
SIZE_MAX = 1e6  # coordinates beyond this are taken for a broken file [file units]
UNITS = {"m": 1.0, "cm": CM, "mm": MM, "inch": 0.0254}
FOOT_SHARE = 0.02  # the lowest part of a mesh, of its height, that its foot is the middle of
UP = {  # rows: x, y, z of the world from those of the file, right-handed
    "z": np.eye(3),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}


@dataclass(frozen=True)
class MeshPart:
    """Triangles with one material. names: what a sheet may call it by, first choice first; corners: (n, 3, 3)
    in the units and axes of the file.
    """

    names: tuple[str, ...]
    corners: Array


def read_mesh(path: Path, *, key: str, file: Path | None = None) -> tuple[MeshPart, ...]:
    """Parts of a mesh file, in the order of their names.

    Triangles without an area are left out. Raises InputError with this key (of the sheet or scenario `file`)
    for a file that is missing, cannot be read, or holds no triangle, a corner that is no number, or
    coordinates beyond SIZE_MAX; MissingExtra without trimesh.
    """
    if not path.is_file():
        raise InputError(key, str(path), "expected a mesh file, there is no such file", file=file)
    stat = path.stat()
    try:
        return _read(path, stat.st_mtime_ns, stat.st_size)
    except _BadMesh as error:
        raise InputError(key, str(path), str(error), file=file) from error


def file_up(path: Path) -> str:
    """The axis that points up unless one is told: y in GLB and glTF, which say so, else z."""
    return "y" if path.suffix.lower() in (".glb", ".gltf") else "z"


def base_middle(corners: Array) -> Array:
    """Middle of the lowest part of triangles (n, 3, 3), at the height of the lowest corner, (3,)."""
    flat = corners.reshape(-1, 3)
    low, high = flat[:, 2].min(), flat[:, 2].max()
    base = flat[flat[:, 2] <= low + FOOT_SHARE * (high - low)]
    return np.append(0.5 * (base.min(axis=0) + base.max(axis=0))[:2], low)


class _BadMesh(Exception):
    """What is wrong with a file, as an expectation."""


@lru_cache(maxsize=16)
def _read(path: Path, mtime_ns: int, size: int) -> tuple[MeshPart, ...]:
    """As `read_mesh`; read again when the file has changed."""
    scene = _load(path)
    found: dict[tuple[str, ...], list[Array]] = {}
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        faces = np.asarray(getattr(geometry, "faces", np.zeros((0, 3))))
        if not len(faces):
            continue
        points = product(np.asarray(geometry.vertices, dtype=float), matrix[:3, :3].T) + matrix[:3, 3]
        material = getattr(getattr(geometry.visual, "material", None), "name", None)
        names = tuple(dict.fromkeys(str(n) for n in (material, name, node) if n))
        found.setdefault(names, []).append(points[faces])
    parts = [MeshPart(names, np.concatenate(found[names])) for names in sorted(found)]
    total = sum(len(p.corners) for p in parts)
    if total > TRIANGLES_MAX:
        raise _BadMesh(f"expected at most {TRIANGLES_MAX} triangles, it has {total}")
    for part in parts:
        if not np.isfinite(part.corners).all():
            raise _BadMesh(f"expected finite corners, part {part.names[0]!r} has some that are none")
        if np.abs(part.corners).max() > SIZE_MAX:
            raise _BadMesh(
                f"expected coordinates within {SIZE_MAX:g}, part {part.names[0]!r} has larger ones"
            )
    parts = [MeshPart(p.names, kept) for p in parts if len(kept := _with_area(p.corners))]
    if not parts:
        raise _BadMesh("expected triangles, it has none" if not total else "expected triangles with an area")
    return tuple(parts)


def _load(path: Path) -> Any:
    """The file as a trimesh scene."""
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtra("mesh", "reading a mesh") from error
    kind = path.suffix.lower().lstrip(".")
    if f".{kind}" not in {f".{k}" for k in trimesh.available_formats()}:
        raise _BadMesh("expected a mesh file, as .obj, .ply or .glb")
    try:
        if kind == "obj":
            text, library = _own_materials(path.read_text(encoding="utf-8", errors="replace"))
            resolver = trimesh.resolvers.ZipResolver({"swath.mtl": io.BytesIO(library.encode())})
            stream = io.BytesIO(text.encode())
            return trimesh.load_scene(stream, file_type="obj", resolver=resolver, process=False)
        return trimesh.load_scene(path, process=False)
    except Exception as error:  # a reader of foreign files may raise anything
        reason = " ".join(str(error).split())
        raise _BadMesh(f"expected a mesh that can be read, {type(error).__name__}: {reason[:120]}") from error


def _own_materials(text: str) -> tuple[str, str]:
    """An OBJ file that uses materials alone to tell parts apart, and a library that has them all."""
    text = re.sub(r"^mtllib\b.*$", "", text, flags=re.M)
    if re.search(r"^usemtl\b", text, re.M):
        text = re.sub(r"^[og]\b.*$", "", text, flags=re.M)
    else:
        text = re.sub(r"^[og][ \t]+(?=\S)", "usemtl ", text, flags=re.M)
    names = dict.fromkeys(re.findall(r"^usemtl[ \t]+(.*?)[ \t\r]*$", text, re.M))
    return "mtllib swath.mtl\n" + text, "".join(f"newmtl {name}\n" for name in names)


def _with_area(corners: Array) -> Array:
    """Triangles without those that are a line or a point."""
    edge = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edge[:, 0], edge[:, 1]), axis=1)
    longest = np.maximum((edge**2).sum(axis=2).max(axis=1), 1e-300)
    kept: Array = corners[area > 1e-7 * longest]
    return kept
