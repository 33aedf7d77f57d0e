"""Triangle meshes from files (OBJ, PLY, STL, GLB, glTF, OFF), read by trimesh, in parts with names.

A part's name is that of its material, else of its object. An OBJ file's materials are taken from its own
`usemtl` lines (`o` and `g` lines where it has none), so its .mtl file and textures need not be there.
"""

import io
import json
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.apart.call import apart
from swath.core.errors import Extra, InputError
from swath.core.files.read_file import check_readable
from swath.core.portable import product
from swath.core.units import CM, MM
from swath.documents.packed import readable
from swath.documents.text_file import read_bytes

Array = NDArray[np.float64]
FORMATS = ("obj", "ply", "stl", "glb", "gltf", "off")
BYTES_MAX = 1 << 28  # of a file; TRIANGLES_MAX in an OBJ file are half of that
TRIANGLES_MAX = 2_000_000
SIZE_MAX = 1e6  # coordinates beyond this are taken for a broken file [file units]
NUMBERS_MAX = 12 * TRIANGLES_MAX  # corners, normals and the like, and indices of a glTF file
UNITS = {"m": 1.0, "cm": CM, "mm": MM, "inch": 0.0254}
FOOT_SHARE = 0.02  # the lowest part of a mesh, of its height, that its foot is the middle of
UP = {  # rows: x, y, z of the world from those of the file, right-handed
    "z": np.eye(3),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}


@dataclass(frozen=True)
class MeshPart:
    """Triangles with one material.

    names: what a sheet may call it by, first choice first
    corners: (n, 3, 3) in the units and axes of the file
    """

    names: tuple[str, ...]
    corners: Array


def read_mesh(path: Path, *, key: str, file: Path | None = None) -> tuple[MeshPart, ...]:
    """Parts of a mesh file, in the order of their names.

    Triangles without an area are left out. Raises InputError with this key (of the sheet or scenario `file`)
    for a file that is missing, cannot be read, or holds no triangle, a corner that is no number, or
    coordinates beyond SIZE_MAX; MissingExtra without trimesh.
    """
    try:
        stat = check_readable(path, key, "a mesh file").stat()
        with readable(key, "a mesh that can be read", path):
            return tuple(_read(path, stat.st_mtime_ns, stat.st_size))
    except InputError as error:
        raise InputError(key, str(path), error.expected, file=file) from error


def file_up(path: Path) -> str:
    """The axis that points up unless one is stated: y in GLB and glTF, which say so, else z."""
    return "y" if path.suffix.lower() in (".glb", ".gltf") else "z"


def base_middle(corners: Array) -> Array:
    """Middle of the lowest part of triangles (n, 3, 3), at the height of the lowest corner, (3,)."""
    flat = corners.reshape(-1, 3)
    low, high = flat[:, 2].min(), flat[:, 2].max()
    base = flat[flat[:, 2] <= low + FOOT_SHARE * (high - low)]
    return np.append(0.5 * (base.min(axis=0) + base.max(axis=0))[:2], low)


def _bad(expected: str) -> InputError:
    """What is wrong with a file, as an expectation."""
    return InputError("mesh", None, expected)


@lru_cache(maxsize=16)
@apart("mesh", "a mesh that can be read", libraries=("trimesh", "trimesh.exchange.load"), records=(MeshPart,))
def _read(path: Path, mtime_ns: int, size: int) -> tuple[MeshPart, ...]:
    """As `read_mesh`; read again when the file has changed."""
    if size > BYTES_MAX:
        raise _bad(f"expected at most {BYTES_MAX} bytes, it has {size}")
    scene = _load(path)
    found: dict[tuple[str, ...], list[Array]] = {}
    total = 0
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        faces = np.asarray(getattr(geometry, "faces", np.zeros((0, 3))))
        if not len(faces):
            continue
        total += len(faces)
        if total > TRIANGLES_MAX:
            raise _bad(f"expected at most {TRIANGLES_MAX} triangles, it has more")
        points = product(np.asarray(geometry.vertices, dtype=float), matrix[:3, :3].T) + matrix[:3, 3]
        material = getattr(getattr(geometry.visual, "material", None), "name", None)
        names = tuple(dict.fromkeys(str(n) for n in (material, name, node) if n))
        found.setdefault(names, []).append(points[faces])
    parts = [MeshPart(names, np.concatenate(found[names])) for names in sorted(found)]
    for part in parts:
        if not np.isfinite(part.corners).all():
            raise _bad(f"expected finite corners, part {part.names[0]!r} has some that are none")
        if np.abs(part.corners).max() > SIZE_MAX:
            raise _bad(f"expected coordinates within {SIZE_MAX:g}, part {part.names[0]!r} has larger ones")
    parts = [MeshPart(p.names, kept) for p in parts if len(kept := _with_area(p.corners))]
    if not parts:
        raise _bad("expected triangles, it has none" if not total else "expected triangles with an area")
    return tuple(parts)


def _load(path: Path) -> Any:
    """The file as a trimesh scene."""
    with Extra("mesh", "reading a mesh"):
        import trimesh
    kind = path.suffix.lower().lstrip(".")
    if kind not in FORMATS:
        raise _bad(f"expected a mesh file, one of .{', .'.join(FORMATS)}")
    if kind in ("glb", "gltf"):
        _check_accessors(path)
    if kind != "obj":
        return trimesh.load_scene(path, process=False)
    data = read_bytes(path, "mesh", "a mesh file", BYTES_MAX)
    text, library = _own_materials(data.decode("utf-8", errors="replace"))
    resolver = trimesh.resolvers.ZipResolver({"swath.mtl": io.BytesIO(library.encode())})
    return trimesh.load_scene(io.BytesIO(text.encode()), file_type="obj", resolver=resolver, process=False)


def _check_accessors(path: Path) -> None:
    """Refuse what declares more numbers than TRIANGLES_MAX need: one without data is filled with zeros."""
    data = read_bytes(path, "mesh", "a mesh file", BYTES_MAX)
    if data[:4] == b"glTF":
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    counts = [int(accessor["count"]) for accessor in json.loads(data).get("accessors", [])]
    if (total := math.fsum(counts)) > NUMBERS_MAX or min(counts, default=0) < 0:
        raise _bad(f"expected at most {NUMBERS_MAX} corners and indices, it declares {total:g}")


def _own_materials(text: str) -> tuple[str, str]:
    """An OBJ file that uses materials alone to distinguish parts, and a library that has them all."""
    lines = [line.strip() for line in text.splitlines()]
    words = {line.split(None, 1)[0] for line in lines if line}
    parts = ("o", "g")
    made = ["mtllib swath.mtl"]
    names: dict[str, None] = {}
    for line in lines:
        word, _, name = line.replace("\t", " ").partition(" ")
        name = name.strip()
        if word == "mtllib" or (word in parts and ("usemtl" in words or not name)):
            continue
        if word == "usemtl" or word in parts:
            names[name] = None
            line = f"usemtl {name}"
        made.append(line)
    return "\n".join(made) + "\n", "".join(f"newmtl {name}\n" for name in names)


def _with_area(corners: Array) -> Array:
    """Triangles without those that are a line or a point."""
    edge = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edge[:, 0], edge[:, 1]), axis=1)
    longest = np.maximum((edge**2).sum(axis=2).max(axis=1), 1e-300)
    kept: Array = corners[area > 1e-7 * longest]
    return kept
