"""The picture of the page on taking a field away: the file that `swath field export` writes, drawn by another program.

python -m docs.make.field_export [FILE]    default: docs/figures/field-export.png; trimesh and embree draw it
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from trimesh.ray.ray_pyembree import RayMeshIntersector

from swath.commands.main import main as swath

ROOT = Path(__file__).parents[2]
WIDTH, HEIGHT, FINE, HALF_ANGLE = 720, 400, 2, 0.36
EYE, TARGET = np.array([17.5, 5.0, 9.0]), np.array([4.5, 0.9, -1.5])  # of the file: y is up
SUN = np.array([-0.4, 0.8, 0.45])
SKY = np.array([0.80, 0.88, 0.95])


def picture(file: Path) -> np.ndarray:
    """Picture in sRGB, (HEIGHT, WIDTH, 3), of a GLB file, by light from one side and no shadows."""
    scene = trimesh.load_scene(file, process=False)
    names = list(scene.geometry)
    whole = trimesh.util.concatenate(
        [trimesh.Trimesh(g.vertices, g.faces, process=False) for g in scene.geometry.values()]
    )
    owner = np.repeat(np.arange(len(names)), [len(g.faces) for g in scene.geometry.values()])
    forward = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    u, v = np.meshgrid(np.linspace(-1, 1, WIDTH * FINE), np.linspace(1, -1, HEIGHT * FINE) * HEIGHT / WIDTH)
    aim = forward + np.tan(HALF_ANGLE) * (u[..., None] * right + v[..., None] * np.cross(right, forward))
    aim = (aim / np.linalg.norm(aim, axis=-1, keepdims=True)).reshape(-1, 3)
    places, rays, faces = RayMeshIntersector(whole).intersects_location(
        np.tile(EYE, (len(aim), 1)), aim, multiple_hits=False
    )
    materials = [scene.geometry[name].visual.material for name in names]
    colours = np.array(
        [
            [0.8] * 3 if m.baseColorFactor is None else np.asarray(m.baseColorFactor[:3]) / 255
            for m in materials
        ]
    )
    colours = np.where(
        colours <= 0.0031308, 12.92 * colours, 1.055 * np.maximum(colours, 1e-9) ** (1 / 2.4) - 0.055
    )
    shown = colours[owner[faces]]
    on_ground = owner[faces] == names.index("ground")
    low, high = scene.geometry["ground"].bounds[:, [0, 2]]
    cover = np.asarray(materials[names.index("ground")].baseColorTexture.convert("RGB")) / 255
    at = (places[on_ground][:, [0, 2]] - low) / (high - low) * (np.array(cover.shape[1::-1]) - 1)
    shown[on_ground] = cover[at[:, 1].astype(int), at[:, 0].astype(int)]
    lit = 0.55 + 0.45 * np.abs(whole.face_normals[faces] @ (SUN / np.linalg.norm(SUN)))
    found = np.tile(SKY, (len(aim), 1))
    found[rays] = shown * lit[:, None]
    fine = found.reshape(HEIGHT, FINE, WIDTH, FINE, 3).mean(axis=(1, 3))
    return np.rint(255 * np.clip(fine, 0, 1)).astype(np.uint8)


def main(file: Path = ROOT / "docs" / "figures" / "field-export.png") -> None:
    """Draw it."""
    with tempfile.TemporaryDirectory() as folder:
        glb = Path(folder) / "field.glb"
        words = [
            "field",
            "export",
            "straight",
            "--to",
            "glb",
            "--out",
            str(glb),
            "--at-s",
            "2",
            "--plants-m",
            "5",
        ]
        assert swath(words) == 0
        Image.fromarray(picture(glb)).quantize(96).save(file, optimize=True)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
