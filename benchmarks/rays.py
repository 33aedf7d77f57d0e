"""Mray per CPU-second of our kernel and of flat Embree 4, interleaved, on one scene, one thread each.

Scene: 10 x 10 m of wheat on flat ground, every plant with stalk, ear and leaves. A scanner 4 m up looks 14 to
22 deg down; beams of 6 mrad with 1, 9 or 37 sub-rays, beams of a scan line side by side. Embree gets what one
would give it: capsules as six- or eight-sided prisms, welded, 114 triangles a plant.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from _harness import interleave, machine, median, resident_bytes, write_json

from swath.core.random import Stream
from swath.field.crop import load_crop
from swath.field.layout import PAGE_CUT_CELLS, PAGE_NODES, PAGE_TILES, STANDING, Pages, PlantLibrary
from swath.field.library import make_library
from swath.field.wind import Sway
from swath.rays.engine import RayCaster
from swath.rays.triangles import tile_triangles

SIDE = 10  # planted tiles along x and y, from tile (7, -5)
SIDES = 8  # of a prism


@dataclass
class Scene:
    """A field as rays need it."""

    pages: Pages
    library: PlantLibrary
    stand_yaw: float = 0.0
    wind: Sway | None = None


def make_scene(
    density: float, *, columns: int | None = None, bins: int | None = None, tiles: int = 16
) -> Scene:
    """Flat pages with 10 x 10 live tiles of mixed prototypes."""
    options = {k: v for k, v in (("columns", columns), ("bins", bins)) if v}
    library = make_library(
        load_crop("wheat"),
        density_max=density,
        row_spacing=0.125,
        seed=Stream(1, "bench"),
        tile_count=tiles,
        **options,
    )
    count = 16
    shape = (count, PAGE_TILES, PAGE_TILES)
    rng = np.random.default_rng(1)
    tx, ty = np.arange(4 * PAGE_TILES) - PAGE_TILES, np.arange(4 * PAGE_TILES) - 2 * PAGE_TILES
    alive = ((tx >= 7) & (tx < 7 + SIDE))[None, :] & ((ty >= -5) & (ty < -5 + SIDE))[:, None]
    blocks = alive.reshape(4, PAGE_TILES, 4, PAGE_TILES).swapaxes(1, 2).reshape(shape)
    pages = Pages(
        table=np.arange(count, dtype=np.int32).reshape(4, 4),
        table_x=-1,
        table_y=-2,
        ground=np.zeros((count, PAGE_NODES + 1, PAGE_NODES + 1), np.float32),
        straw=np.zeros((count, PAGE_NODES + 1, PAGE_NODES + 1), np.float32),
        tile_plane=np.zeros((*shape, 3), np.float32),
        tile_stand=np.tile(np.array([1, 0, 0, 1], np.float32), (*shape, 1)),
        tile_top=np.where(blocks, library.height_max, 0).astype(np.float32),
        tile_prototype=(rng.integers(0, tiles, shape) + (rng.integers(0, 4, shape) << 16)).astype(np.int32),
        cut_slot=np.full(count, -1 - STANDING, np.int32),
        cut=np.zeros((1, PAGE_CUT_CELLS, PAGE_CUT_CELLS), np.uint8),
        tile_bump=np.zeros(shape, np.float32),
    )
    return Scene(pages, library)


def make_rays(sub_rays: int, count: int = 100_000) -> tuple[np.ndarray, np.ndarray]:
    """About `count` rays: scan lines of 180 beams, 1/6 deg apart, each beam with its sub-rays."""
    lines = max(1, count // (180 * sub_rays))
    depression = np.radians(14 + 8 * (np.arange(lines) + 0.5) / lines)
    azimuth = np.radians((np.arange(180) - 89.5) / 6)
    ring = np.arange(sub_rays)
    offset = 0.003 * np.sqrt(ring / max(sub_rays - 1, 1))
    turn = ring * 2.399963  # sunflower
    a = azimuth[None, :, None] + offset * np.cos(turn) + 0 * depression[:, None, None]
    e = -depression[:, None, None] + offset * np.sin(turn) + 0 * azimuth[None, :, None]
    d = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)
    return np.tile([0.0, 0.0, 4.0], (len(d), 1)), d


def make_embree(scene: Scene) -> tuple[Any, int, int]:
    """(Embree scene, triangles, plants) of the same plants."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    library, pages = scene.library, scene.pages
    prototypes = [_weld(tile_triangles(library, k, sides=SIDES, rings=0)) for k in range(library.tile_count)]
    vertices, faces, total, plants = [], [], 0, 0
    size = library.tile_size
    for tx in range(7, 7 + SIDE):
        for ty in range(-5, -5 + SIDE):
            slot = pages.table[ty // 8 + 2, tx // 8 + 1]
            kind = int(pages.tile_prototype[slot, ty % 8, tx % 8])
            points, index = prototypes[kind & 0xFFFF]
            points = points.copy()
            for axis in (0, 1):
                if kind >> (16 + axis) & 1:
                    points[:, axis] = size - points[:, axis]
            vertices.append(points + np.array([tx * size, ty * size, 0.0], np.float32))
            faces.append(index + total)
            total += len(points)
            plants += len(library.stem_xy) // library.tile_count
    ground = np.array([[-20, -20, 0], [40, -20, 0], [40, 40, 0], [-20, 40, 0]], np.float32)
    vertices.append(ground)
    faces.append(np.array([[0, 1, 2], [0, 2, 3]], np.int32) + total)
    result = EmbreeScene()
    triangles = np.concatenate(faces).astype(np.int32)
    TriangleMesh(result, np.concatenate(vertices).astype(np.float32), triangles)
    return result, len(triangles), plants


def _weld(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corners = np.ascontiguousarray(triangles.reshape(-1, 3), np.float32)
    key = np.ascontiguousarray(np.round(corners * 1e6).astype(np.int32)).view("i4,i4,i4").ravel()
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    return corners[first], index.reshape(-1, 3).astype(np.int32)


def scene_bytes(scene: Scene) -> int:
    """Memory of all that our kernel reads: library, its packed primitives, pages."""
    held = [
        v for part in (scene.library, scene.pages) for v in vars(part).values() if isinstance(v, np.ndarray)
    ]
    packed = len(scene.library.radius) * 64
    return sum(v.nbytes for v in held) + packed


def measure(density: float, rounds: int, count: int) -> dict[str, Any]:
    """All sub-ray counts at one density."""
    scene = make_scene(density)
    caster = RayCaster(scene, threads=1)
    before = resident_bytes()
    embree, triangles, plants = make_embree(scene)
    o, d = make_rays(1, 1000)
    embree.run(o.astype(np.float32), d.astype(np.float32), query="DISTANCE")
    embree_bytes = resident_bytes() - before
    rows = []
    for sub_rays in (1, 9, 37):
        o, d = make_rays(sub_rays, count)
        o32, d32 = o.astype(np.float32), d.astype(np.float32)

        def ours(o: np.ndarray = o, d: np.ndarray = d) -> Any:
            return caster.cast(o, d, range_max=60.0)

        def theirs(o: np.ndarray = o32, d: np.ndarray = d32) -> Any:
            return embree.run(o, d, query="DISTANCE")

        times = interleave({"swath": ours, "embree": theirs}, rounds=rounds)
        rate = {name: len(d) / median(values) / 1e6 for name, values in times.items()}
        ratios = [b / a for a, b in zip(times["swath"], times["embree"], strict=True)]
        crop = [float(np.mean(t[t * -d[:, 2] < 3.98])) for t in (ours().distance, theirs())]  # above the soil
        rows.append(
            {
                "sub_rays": sub_rays,
                "rays": len(d),
                "swath_mray_per_cpu_s": rate["swath"],
                "embree_mray_per_cpu_s": rate["embree"],
                "ratio": median(ratios),
                "ratio_min": min(ratios),
                "ratio_max": max(ratios),
                "mean_crop_range_m": crop,  # swath, Embree: they must look at the same stand
            }
        )
    return {
        "plants_per_m2": density,
        "plants": plants,
        "embree_triangles": triangles,
        "swath_bytes": scene_bytes(scene),
        "embree_bytes": embree_bytes,
        "rows": rows,
    }


def main(out_dir: Path | str = "out/bench", *, rounds: int = 7, count: int = 100_000) -> dict[str, Any]:
    """Measures, prints a table, writes rays.json; returns its content."""
    from rich.console import Console
    from rich.table import Table

    results = [measure(density, rounds, count) for density in (200.0, 600.0)]
    data = {
        "what": "Mray per CPU-second (user + system), one thread each, median of interleaved rounds",
        "scene": "10 x 10 m wheat, scanner 4 m up, 14-22 deg down, 6 mrad beams; Embree: 8-sided prisms",
        "rounds": rounds,
        "machine": machine(),
        "results": results,
    }
    table = Table(title="Rays through wheat: Mray per CPU-second, one thread", title_justify="left")
    for name in ("plants/m2", "sub-rays", "swath", "Embree 4 flat", "ratio", "swath MB", "Embree MB"):
        table.add_column(name, justify="right")
    for result in results:
        memory = f"{result['swath_bytes'] / 1e6:.1f}", f"{result['embree_bytes'] / 1e6:.0f}"
        for row in result["rows"]:
            rates = f"{row['swath_mray_per_cpu_s']:.2f}", f"{row['embree_mray_per_cpu_s']:.2f}"
            table.add_row(
                f"{result['plants_per_m2']:.0f}", str(row["sub_rays"]), *rates, f"{row['ratio']:.2f}", *memory
            )
    Console().print(table)
    write_json(Path(out_dir), "rays", data)
    return data


if __name__ == "__main__":
    main(*sys.argv[1:2])
