"""Writes the example meshes of this folder: two sunflowers and a person, all made of plain shapes.

    python examples/meshes/make_meshes.py

Materials tell the parts apart: sunflower.yaml says what organ each of them is.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent
Triangles = list[tuple[np.ndarray, np.ndarray, np.ndarray]]


def tube(points: np.ndarray, radii: list[float], sides: int) -> Triangles:
    """A stalk: a prism along points (n, 3)."""
    turn = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(sides)], axis=1)
    loops = [p + r * ring for p, r in zip(points, radii, strict=True)]
    found: Triangles = []
    for low, high in pairwise(loops):
        for k in range(sides):
            n = (k + 1) % sides
            found += [(low[k], low[n], high[n]), (low[k], high[n], high[k])]
    return found


def blade(foot: np.ndarray, azimuth: float, length: float, width: float, droop: float) -> Triangles:
    """A leaf on its stalk: a kite of four triangles that hangs down towards its tip."""
    out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    aside = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    base = foot + 0.25 * length * (out + 0.3 * up)
    middle = base + 0.4 * length * (out - 0.4 * droop * up)
    tip = base + 0.75 * length * (0.8 * out - droop * up)
    left, right = middle + 0.5 * width * aside, middle - 0.5 * width * aside
    petiole = (foot - 0.4 * aside, foot + 0.4 * aside, base)
    return [petiole, (base, middle, left), (base, right, middle), (left, middle, tip), (right, tip, middle)]


def disc(centre: np.ndarray, facing: np.ndarray, radius: float, depth: float, sides: int) -> Triangles:
    """A head: a flat cone towards `facing` and a deeper one behind."""
    side = np.cross(facing, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    other = np.cross(facing, side)
    turn = 2.0 * np.pi * np.arange(sides) / sides
    rim = centre + radius * (np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other)
    front, back = centre + 0.15 * depth * facing, centre - depth * facing
    pairs = [(rim[k], rim[(k + 1) % sides]) for k in range(sides)]
    return [(a, b, front) for a, b in pairs] + [(b, a, back) for a, b in pairs]


def sunflower(seed: int) -> dict[str, Triangles]:
    """A ripe plant in centimetres, z up, its foot at the origin."""
    rng = np.random.default_rng(seed)
    height = 165.0 + 10.0 * rng.standard_normal()
    heading = rng.uniform(-np.pi, np.pi)
    out = np.array([np.cos(heading), np.sin(heading), 0.0])
    share = np.array([0.0, 0.4, 0.75, 0.95, 1.0])
    bend = np.array([0.0, 0.5, 2.0, 6.0, 13.0])
    line = share[:, None] * np.array([0.0, 0.0, height]) + bend[:, None] * out
    line[-1, 2] -= 3.0
    leaves: Triangles = []
    for k in range(12):
        at = 0.25 + 0.055 * k
        foot = np.array([np.interp(at, share, line[:, i]) for i in range(3)])
        azimuth = heading + 2.4 * k + 0.3 * rng.standard_normal()
        leaves += blade(foot, azimuth, rng.uniform(18, 26), rng.uniform(9, 14), rng.uniform(0.8, 1.6))
    facing = 0.6 * out - np.array([0.0, 0.0, 0.8])
    head = disc(line[-1] + 2.0 * facing, facing, rng.uniform(8.5, 10.5), 4.0, 12)
    return {"stalk": tube(line, [1.4, 1.2, 1.0, 0.8, 0.8], 6), "dry_leaf": leaves, "head": head}


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Triangles:
    """Twelve triangles, facing outwards."""
    corner = np.array(
        [[x, y, z] for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
    )
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return [
        (corner[a], corner[b], corner[c])
        for f in faces
        for a, b, c in ((f[0], f[1], f[2]), (f[0], f[2], f[3]))
    ]


def person() -> dict[str, Triangles]:
    """Someone 1.78 m tall who stands and looks along x, in metres, z up."""
    clothes = box((-0.10, -0.19, 0.05), (0.10, -0.02, 0.88)) + box((-0.10, 0.02, 0.05), (0.10, 0.19, 0.88))
    clothes += box((-0.13, -0.22, 0.88), (0.13, 0.22, 1.46))
    clothes += box((-0.06, -0.33, 0.80), (0.06, -0.23, 1.44)) + box((-0.06, 0.23, 0.80), (0.06, 0.33, 1.44))
    boots = box((-0.10, -0.19, 0.0), (0.18, -0.02, 0.05)) + box((-0.10, 0.02, 0.0), (0.18, 0.19, 0.05))
    return {"clothes": clothes, "boots": boots, "skin": box((-0.10, -0.08, 1.50), (0.10, 0.08, 1.78))}


def write_obj(path: Path, parts: dict[str, Triangles], digits: int) -> None:
    """Wavefront OBJ; materials by name alone."""
    lines, number = [f"# made by {Path(__file__).name}"], 0
    for name, triangles in parts.items():
        lines.append(f"usemtl {name}")
        for corners in triangles:
            lines += ["v " + " ".join(f"{v:.{digits}f}" for v in corner) for corner in corners]
            lines.append(f"f {number + 1} {number + 2} {number + 3}")
            number += 3
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main(folder: Path = FOLDER) -> None:
    """All files."""
    write_obj(folder / "sunflower-a.obj", sunflower(1), 2)
    write_obj(folder / "sunflower-b.obj", sunflower(2), 2)
    write_obj(folder / "person.obj", person(), 3)


if __name__ == "__main__":
    main()
