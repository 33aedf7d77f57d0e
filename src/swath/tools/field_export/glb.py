"""A scene as binary glTF 2.0 (GLB), by trimesh: y up, as the format says; Blender turns it back to z up."""

import io
from typing import Any

import numpy as np

from swath.core.errors import Extra
from swath.record.scan_messages import encoded
from swath.signals import F64
from swath.tools.field_export.scene import BODY, FieldScene, Ground, body_corners, ground_surface

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # rows: x, y, z of the file
MACHINE = "#6FA34B"


def need_trimesh() -> Any:
    """The module. MissingExtra without it."""
    with Extra("mesh", "writing a GLB file"):
        import trimesh
    return trimesh


def glb_bytes(scene: FieldScene) -> bytes:
    """The file.

    One node for the ground, with its picture, one for each organ, straw and body, by their names.
    """
    from PIL import Image

    found = need_trimesh().Scene()
    picture = Image.open(io.BytesIO(picture_bytes(scene.ground)))
    _add(found, "ground", *ground_surface(scene.ground), baseColorTexture=picture)
    for surface in scene.surfaces:
        _add(found, surface.name, surface.vertices, surface.faces, baseColorFactor=_linear(surface.colour))
    for body in scene.bodies:
        corners = body_corners(body.solids)
        colour = _linear(MACHINE if body.name in scene.machines else BODY)
        faces = np.arange(3 * len(corners)).reshape(-1, 3)
        _add(found, body.name, corners.reshape(-1, 3), faces, baseColorFactor=colour)
    made: bytes = found.export(file_type="glb")
    return made


def glb_size(scene: FieldScene) -> int:
    """Size of the file without the ground's picture [bytes]: 12 of each vertex, 12 of each triangle."""
    count = len(scene.ground.x) ** 2 * 5 // 3 + sum(len(s.vertices) for s in scene.surfaces)
    faces = 2 * len(scene.ground.x) ** 2 + sum(len(s.faces) for s in scene.surfaces)
    bodies = sum(len(body_corners(b.solids)) for b in scene.bodies)
    return 12 * (count + faces) + 48 * bodies


def _add(scene: Any, name: str, vertices: F64, faces: Any, uv: F64 | None = None, **look: Any) -> None:
    """A node. uv: where vertices lie in a picture; look: of its material."""
    trimesh = need_trimesh()
    rough = {"metallicFactor": 0.0, "roughnessFactor": 1.0, "doubleSided": True}
    material = trimesh.visual.material.PBRMaterial(name=name, **look, **rough)
    visual = trimesh.visual.TextureVisuals(uv=np.zeros((0, 2)) if uv is None else uv, material=material)
    if uv is None:
        visual.uv = None
    made = trimesh.Trimesh(vertices @ Y_UP.T, faces, process=False, validate=False, visual=visual)
    scene.add_geometry(made, node_name=name, geom_name=name)


def picture_bytes(ground: Ground) -> bytes:
    """What lies on the ground as a PNG, north up."""
    return encoded(ground.colours, "PNG")


def _linear(colour: str) -> list[float]:
    """Colour `#RRGGBB` in sRGB as the linear numbers of glTF (IEC 61966-2-1), with alpha."""
    share = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return [*linear.tolist(), 1.0]
