"""Draws docs/figures/groups.png: a group of beams from above, and what it sees in slopes."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import Circle, Polygon, Rectangle

from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.memory_layout import PlantLibrary
from swath.field.prototypes import make_library
from swath.rays.packets.traversal import PacketIndex, make_index

INK, GRID, PIECE, RAY = "#33373d", "#d9dbde", "#b9b4a6", "#c0223b"
UPRIGHT = 3.0  # vectors are so much higher than wide
VECTORS = ("#c0223b", "#2f6f9f", "#7d9352")
EYE, DOWN, STEP, SPOT = np.array([-6.0, 0.5, 2.6]), np.radians(17.0), np.radians(1 / 3), 0.006
BEAMS = np.arange(-4, 5) * STEP


def frame() -> np.ndarray:
    """Rows e0 (mean direction), e1 (along the fan), e2."""
    e0 = np.array([np.cos(DOWN), 0.0, -np.sin(DOWN)])
    e1 = np.array([0.0, 1.0, 0.0])
    return np.stack([e0, e1, np.cross(e0, e1)])


def spot(beam: float, count: int = 37) -> np.ndarray:
    """Slopes (count, 2) of a beam's sub-rays."""
    ring = np.arange(count)
    radius, angle = 0.5 * SPOT * np.sqrt((ring + 0.5) / count), ring * 2.399963
    return np.c_[np.tan(beam) + radius * np.cos(angle), radius * np.sin(angle)]


def vectors(places: np.ndarray, lanes: int = 16) -> list[np.ndarray]:
    """Slopes (n, 2) of rays vector by vector, as `pack` in rays/packets/native/rays.cpp makes them."""
    count, (wide, high) = len(places) / lanes, np.ptp(places, axis=0)
    side = max(1, round(np.sqrt(count * high / (UPRIGHT * wide))))  # vectors of a column
    by_u = places[np.argsort(places[:, 0])]
    columns = [by_u[i : i + side * lanes] for i in range(0, len(by_u), side * lanes)]
    by_v = [column[np.argsort(column[:, 1])] for column in columns]
    return [column[i : i + lanes] for column in by_v for i in range(0, len(column), lanes)]


def pieces(library: PlantLibrary, index: PacketIndex) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends (m, 2, 3) [m], half widths, columns (ix, iy) of the pieces of tile 0."""
    last = index.start[index.columns * index.columns * index.bins]
    coarse = index.coarse[:last].astype(float)
    ends = coarse[:, :6].reshape(-1, 2, 3) * index.step
    cell = np.repeat(np.arange(len(index.start) - 1), np.diff(index.start))[:last] // index.bins
    return ends, coarse[:, 6] * index.step, np.c_[cell % index.columns, cell // index.columns]


def from_above(ax: Any, index: PacketIndex, ends: np.ndarray, column: np.ndarray) -> None:
    """Columns, slabs and the beams' paths through the upper half of the crop."""
    side, n = index.side, index.columns
    slab = (column[:, 0] == 3) & (np.abs((column[:, 1] + 0.5) * side - 0.5) < 0.30)
    ax.add_collection(PatchCollection([Rectangle((3 * side, 0.2), side, 0.6)], facecolor="#f6dfe3", lw=0))
    ax.add_collection(LineCollection(ends[..., :2], colors=PIECE, lw=0.7))
    ax.add_collection(LineCollection(ends[slab][..., :2], colors=INK, lw=1.0))
    for k in range(n + 1):
        ax.plot([k * side] * 2, [0, 1], color=GRID, lw=0.8)
        ax.plot([0, 1], [k * side] * 2, color=GRID, lw=0.8)
    for beam in BEAMS:
        path = (np.array([0.0, 1.0]) - EYE[0]) / np.cos(beam)
        half = 0.5 * SPOT * path / np.cos(DOWN)
        y = EYE[1] + path * np.sin(beam)
        ax.add_patch(Polygon(np.c_[[0, 1, 1, 0], [*(y - half), *(y + half)[::-1]]], fc=RAY, alpha=0.35, lw=0))
    ax.set(
        xlim=(0, 1), ylim=(0, 1), aspect="equal", xlabel="x [m], the beams come from the left", ylabel="y [m]"
    )
    ax.set_title("A group of beams over the columns of a tile", fontsize=9)


def in_slopes(ax: Any, ends: np.ndarray, width: np.ndarray, column: np.ndarray) -> None:
    """Pieces of one slab as they are seen from the sensor, spots, vectors; the pieces that touch one spot."""
    local = (ends - EYE) @ frame().T
    seen = local[..., 1:] / local[..., :1]
    wide = width / local[..., 0].min(axis=1)
    middle = np.tan(BEAMS[4])
    near = (column[:, 0] == 3) & (np.abs(seen[..., 1]).min(axis=1) < 0.010)
    d = seen[:, 1] - seen[:, 0]
    length = np.linalg.norm(d, axis=1)
    along = d / np.maximum(length, 1e-9)[:, None]
    off = np.array([middle, 0.0]) - seen.mean(axis=1)
    across = np.abs(off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0])
    touches = near & (across < wide + 0.5 * SPOT)
    touches &= np.abs((off * along).sum(axis=1)) < 0.5 * length + wide + 0.5 * SPOT
    for mask, colour in ((near & ~touches, PIECE), (touches, INK)):
        strips = []
        for s, t, w in zip(seen[mask], along[mask], wide[mask], strict=True):
            n = w * np.array([-t[1], t[0]])
            strips.append(Polygon([s[0] - n - w * t, s[0] + n - w * t, s[1] + n + w * t, s[1] - n + w * t]))
        ax.add_collection(PatchCollection(strips, facecolor=colour, alpha=0.45, lw=0))
    for beam in BEAMS:
        ax.add_patch(Circle((np.tan(beam), 0), 0.5 * SPOT, fill=False, ec=RAY, lw=0.8))
    for n, places in enumerate(vectors(np.concatenate([spot(beam) for beam in BEAMS]))):
        ax.plot(*places.T, ".", ms=2.2, color=VECTORS[n % len(VECTORS)])
    ax.set(
        xlim=(-0.0105, 0.0105),
        ylim=(-0.0085, 0.0085),
        aspect="equal",
        xlabel="slope along the fan",
        ylabel="slope across",
    )
    ax.set_title("The pieces of the marked slab in slopes: dark ones may touch the middle spot", fontsize=9)
    ax.ticklabel_format(style="sci", scilimits=(-3, -3))


def main() -> None:
    """Draw."""
    library = make_library(
        load_crop("wheat"), density_max=300.0, row_spacing=0.125, seed=Stream(1, "figure"), tile_count=1
    )
    index = make_index(library)
    ends, width, column = pieces(library, index)
    fig, axes = plt.subplots(1, 2, figsize=(11, 4.6), width_ratios=(1, 1.35), layout="constrained")
    from_above(axes[0], index, ends, column)
    in_slopes(axes[1], ends, width, column)
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
    fig.savefig(Path(__file__).with_name("groups.png"), dpi=130)


if __name__ == "__main__":
    main()
