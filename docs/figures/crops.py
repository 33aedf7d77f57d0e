"""Draws docs/figures/crop-*.png: a strip of each crop as the tiles hold it, seen from the side."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb

from swath.core.random import Stream
from swath.field.crop import Crop
from swath.field.crop_sheet import Weeds, load_crop, weed_crop
from swath.field.memory_layout import Organ, PlantLibrary, Shape
from swath.field.prototypes import make_library
from swath.tools.scan.stand3d import COLOURS, NAMES

INK, GRID = "#33373d", "#d9dbde"
MESH = Path(__file__).resolve().parents[2] / "examples" / "meshes" / "sunflower.yaml"
WIDTH, DEPTH = 1.5, 0.45  # of the strip, across and into the picture [m]
VIEW_DOWN = np.radians(6.0)
PICTURES = {
    "wheat": ("wheat", None),
    "barley": ("barley", None),
    "rye": ("rye", None),
    "rape": ("rape", None),
    "maize": ("maize", None),
    "weed": ("stubble", Weeds(plants_per_m2=25, height_m=0.35)),
    "mesh": (str(MESH), None),
}


def strip(library: PlantLibrary, depth: float) -> tuple[np.ndarray, ...]:
    """Quads (n, 4, 2) in the picture, colours, from back to front. x runs across the rows."""
    quads, shade, organ, back = [], [], [], []
    right = np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, np.sin(VIEW_DOWN), np.cos(VIEW_DOWN)])
    into = np.array([0.0, np.cos(VIEW_DOWN), -np.sin(VIEW_DOWN)])
    count = int(np.ceil(WIDTH / library.tile_size))
    own = ((library.base >= 0) & (library.base < library.tile_size)).all(axis=1)
    for tile in range(count):
        first, after = library.stem_start[tile], library.stem_start[tile + 1]
        mine = np.flatnonzero(own & (library.owner >= first) & (library.owner < after))
        x = library.base[mine, 1] + tile * library.tile_size
        mine = mine[(x < WIDTH) & (library.base[mine, 0] < depth)]
        turn = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
        a, b, w = (v[mine].astype(float) @ turn.T for v in (library.a, library.b, library.width))
        a[:, 0] += tile * library.tile_size
        b[:, 0] += tile * library.tile_size
        side = np.cross(b - a, into)
        side *= (library.radius[mine] / np.maximum(np.linalg.norm(side, axis=1), 1e-9))[:, None]
        half = np.where((library.shape[mine] == Shape.CAPSULE)[:, None], side, w)
        tip = np.where((library.shape[mine] == Shape.TRIANGLE)[:, None], 0.0, half)
        corners = np.stack([a - half, a + half, b + tip, b - tip], axis=1)
        quads.append(np.stack([corners @ right, corners @ up], axis=-1))
        back.append((0.5 * (a + b)) @ into)
        shade.append(0.5 * (a + b)[:, 2] / library.height_max)
        organ.append(library.organ[mine])
    order = np.argsort(-np.concatenate(back))
    return tuple(np.concatenate(v)[order] for v in (quads, shade, organ, back))


def draw(path: Path, crop: Crop, weeds: Weeds | None) -> None:
    """One picture, in metres."""
    library = make_library(
        crop,
        density_max=crop.stand.density,
        row_spacing=crop.stand.row_spacing,
        seed=Stream(5, "picture"),
        tile_count=3,
        weeds=None if weeds is None else weed_crop(weeds),
    )
    depth = 0.8 if crop.habit in ("maize", "mesh") else DEPTH
    quads, height, organ, _ = strip(library, depth)
    table = np.array([to_rgb(COLOURS.get(k, "#999999")) for k in range(len(Organ))])
    rgb = table[organ] * (0.55 + 0.45 * np.clip(height, 0, 1))[:, None]
    top = max(library.height_max, 0.6) * 1.04
    wide = WIDTH + 0.35
    fig, ax = plt.subplots(figsize=(4.0, 4.0 * (top + 0.15) / wide + 0.55), layout="constrained")
    ax.add_collection(PolyCollection(quads, facecolors=rgb, edgecolors="none"))
    ax.set(xlim=(-0.2, WIDTH + 0.15), ylim=(-0.05, top + 0.1), aspect="equal", ylabel="height [m]", xticks=[])
    ax.spines[["top", "right", "bottom"]].set_visible(False)
    ax.yaxis.grid(True, color=GRID, lw=0.6)
    ax.set_axisbelow(True)
    for k, name in NAMES.items():
        if (organ == k).any():
            ax.plot([], [], "s", color=COLOURS[k], label=name)
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncol=5, frameon=False, fontsize=7.5,
              handletextpad=0.1, columnspacing=0.8)  # fmt: skip
    fig.savefig(path, dpi=88)
    plt.close(fig)


if __name__ == "__main__":
    plt.rcParams.update({"font.size": 8.5, "text.color": INK, "axes.labelcolor": INK, "ytick.color": INK})
    for name, (card, weeds) in PICTURES.items():
        draw(Path(__file__).parent / f"crop-{name}.png", load_crop(card), weeds)
