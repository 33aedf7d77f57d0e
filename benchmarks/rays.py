"""Rays through wheat on hills, some of it cut: packets, the plain kernel, flat Embree 4, interleaved.

Mray per CPU-second (user + system), one thread each, shuffled order, median of rounds. Scene: 10 x 10 m of
wheat on a slope with waves, 30 % of it cut to stubble; a scanner 4 m up looks 14 to 22 deg down, beams of
6 mrad side by side. Embree gets what one would give it: capsules as eight-sided prisms, welded, 114
triangles a plant, not `robust`, built at high quality and called from C++ (embree.py), ray by ray and in
packets of 4, 8 and 16 neighbours, with and without its flag for coherent rays: the best of these is what
packets are held against. Then lone scan lines of 400 single rays, a camera, a whole scanner through the
sensor's own code, and how speed goes with sub-rays, density, size of the field and share of cut crop: table,
JSON and plot.
"""

import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

from _harness import interleave, machine, median, resident_bytes, write_json
from embree import Embree
from ray_scenes import make_beams, make_picture, make_scene, make_spots, make_triangles, organs

from swath.field.memory_layout import shared_rows
from swath.rays.engine import RayCaster

REACH = 60.0
LINES = 40  # lone lines in a job


def scene_bytes(caster: RayCaster) -> int:
    """Memory of all that our kernels read: library, its packed primitives, both indices, pages."""
    library, pages = caster.field.library, caster.field.pages
    parts = (library, library.primitives(), pages)
    held = [v for part in parts for v in vars(part).values() if isinstance(v, np.ndarray)]
    rows = 64 * len(library.radius)
    if shared_rows(library) is not None:  # the arrays of the library are views of them
        rows -= sum(getattr(library, name).nbytes for name in ("a", "b", "radius", "width", "base"))
    return sum(v.nbytes for v in held) + rows + caster.index_bytes


def embree_jobs(embree: Embree, origins: np.ndarray, directions: np.ndarray) -> dict[str, Any]:
    """Embree with every width of packets, `w4c` with its flag for coherent rays."""
    rays = origins.reshape(-1, 3).astype(np.float32), directions.reshape(-1, 3).astype(np.float32)
    return {
        f"w{width}{'c' if coherent else ''}": lambda w=width, c=coherent: embree.cast(
            *rays, REACH, w, coherent=c
        )
        for width in embree.widths
        for coherent in ((False, True) if width > 1 else (False,))
    }


def ratios(times: dict[str, list[float]], rays: int) -> dict[str, Any]:
    """Rates, and packets over rtcIntersect1 and over the best of Embree, medians of the rounds."""
    rate = {k: rays / median(t) / 1e6 for k, t in times.items()}
    best = max((k for k in times if k.startswith("w")), key=lambda k: rate[k])
    over = {k: median([e / a for a, e in zip(times["packets"], times[k], strict=True)]) for k in ("w1", best)}
    return {"mray_per_cpu_s": rate, "best_embree": best, "over_w1": over["w1"], "over_best": over[best]}


def compare(density: float, rounds: int, count: int) -> dict[str, Any]:
    """Ours against Embree at one density, bundles of 1, 9 and 37, and a lone line."""
    scene = make_scene(density)
    caster = RayCaster(scene, threads=1)
    o, d = make_beams(9, 2000)
    caster.cast_bundles((o, d), range_max=REACH)
    vertices, triangles, plants = make_triangles(scene)
    before = resident_bytes()
    embree = Embree(vertices, triangles)
    embree.cast(o.reshape(-1, 3).astype(np.float32), d.reshape(-1, 3).astype(np.float32), REACH, 1)
    held = resident_bytes() - before
    rows = [compare_bundles(caster, embree, subs, rounds, count) for subs in (1, 9, 37)]
    line = compare_line(caster, embree, rounds)
    embree.release()
    return {
        "plants_per_m2": density,
        "plants": plants,
        "embree": embree.how,
        "embree_triangles": len(triangles),
        "swath_bytes": scene_bytes(caster),
        "embree_bytes": held,
        "rows": rows,
        "line": line,
    }


def compare_bundles(caster: RayCaster, embree: Embree, subs: int, rounds: int, count: int) -> dict[str, Any]:
    """`count` rays in bundles."""
    spots = make_spots(subs, count)
    o, d = spots.rays()
    flat = o.reshape(-1, 3), d.reshape(-1, 3)
    jobs = {"plain": lambda: caster.cast(*flat, range_max=REACH), **embree_jobs(embree, o, d)}
    if subs == 1:
        lines = d.reshape(-1, 180, 3)
        jobs["packets"] = lambda: caster.cast_image(o[0, 0], lines, range_max=REACH)
    else:
        jobs["packets"] = lambda: caster.cast_bundles(spots, range_max=REACH)
    times = interleave(jobs, rounds=rounds)
    ours, theirs = jobs["plain"](), jobs["w1"]()
    near = np.abs(jobs["packets"]().distance.ravel() - ours.distance) < 1e-4
    return {
        "sub_rays": subs,
        "rays": len(flat[0]),
        **ratios(times, len(flat[0])),
        "within_0.1_mm_of_plain": float(np.mean(near)),
        "mean_range_m": [float(np.nanmean(ours.distance)), float(np.mean(theirs[theirs < REACH]))],
        "hits": organs(ours),
    }


def compare_line(caster: RayCaster, embree: Embree, rounds: int) -> dict[str, Any]:
    """Scan lines of 400 single rays, 1/6 deg apart, each cast by itself: LINES of them, 14 to 22 deg down."""
    o, d = make_spots(1, 400 * LINES, beams=400).rays()
    lines = d.reshape(LINES, 1, -1, 3)
    parts = [embree_jobs(embree, o[: line.shape[1]], line) for line in lines]
    parts = [
        part | {"packets": _line_job(caster, o[0, 0], line)} for part, line in zip(parts, lines, strict=True)
    ]
    jobs = {name: (lambda name=name: [part[name]() for part in parts]) for name in parts[0]}
    times = interleave(jobs, rounds=rounds)
    found = ratios(times, d.size // 3)
    return found | {"ms": {k: 1e3 * median(t) / LINES for k, t in times.items()}}


def _line_job(caster: RayCaster, origin: np.ndarray, line: np.ndarray) -> Any:
    return lambda: caster.cast_image(origin, line, range_max=REACH)


def camera(rounds: int, out_dir: Path, density: float = 200.0) -> dict[str, Any]:
    """640 x 480 single rays over plants 3 to 30 m away; the picture as a file."""
    import matplotlib.image

    scene = make_scene(density, cut=0.2, tiles=(26, 10))
    caster = RayCaster(scene, threads=1)
    embree = Embree(*make_triangles(scene)[:2])
    origin, d = make_picture()
    jobs = {
        "packets": lambda: caster.cast_image(origin, d, range_max=REACH),
        **embree_jobs(embree, np.tile(origin, (d.size // 3, 1)), d),
    }
    times = interleave(jobs, rounds=rounds)
    embree.release()
    hits = jobs["packets"]()
    shade = np.nan_to_num(
        hits.reflectance * (0.35 + 0.65 * hits.cosine) * np.exp(-0.02 * np.nan_to_num(hits.distance))
    )
    out_dir.mkdir(parents=True, exist_ok=True)
    matplotlib.image.imsave(out_dir / "rays-camera.png", shade, cmap="gray", vmin=0, vmax=shade.max())
    return {
        "pixels": [480, 640],
        "plants_per_m2": density,
        **ratios(times, d.size // 3),
        "crop_range_m": [float(v) for v in np.nanquantile(hits.distance[hits.organ > 2], [0.01, 0.5, 0.99])],
    }


def lines_per_second(rounds: int) -> float:
    """Scan lines of 401 beams with 37 sub-rays per CPU-second, 600 plants/m2."""
    caster = RayCaster(make_scene(600.0), threads=1)
    spots = make_spots(37, 401 * 37 * 4, beams=401)
    times = interleave({"lines": lambda: caster.cast_bundles(spots, range_max=REACH)}, rounds=rounds)
    return len(spots.origins) / 401 / median(times["lines"])


def scanner(rounds: int) -> dict[str, Any]:
    """An LMS5xx-class scanner, 541 beams at 50 Hz with 37 sub-rays at 600 plants/m2, on all cores."""
    import lidar

    work, beams = lidar.make("plants", [-45.1, 45.1], 1 / 6, density=600.0)
    times, cpu = [], []
    for _ in range(rounds + 1):
        started, spent = time.perf_counter(), time.process_time()
        work()
        times.append((time.perf_counter() - started) / lidar.SCANS)
        cpu.append((time.process_time() - spent) / lidar.SCANS)
    wall = median(times[1:])
    return {
        "beams": beams,
        "sub_rays": 37,
        "cores": os.cpu_count(),
        "wall_ms_per_scan": 1e3 * wall,
        "least_wall_ms": 1e3 * min(times[1:]),
        "cpu_ms_per_scan": 1e3 * median(cpu[1:]),
        "real_time_factor_at_50_hz": 0.02 / wall,
    }


def sweep(rounds: int, count: int) -> tuple[dict[str, list[list[float]]], float]:
    """Mray per CPU-second of packets over sub-rays, density, side of the field [m] and share of cut crop.

    Also the speed with half of the field cut over that of uncut crop, median of the rounds.
    """
    found: dict[str, list[list[float]]] = {}
    jobs, sizes = {}, {}

    def add(name: str, x: float, scene: Any, subs: int) -> None:
        caster, spots = RayCaster(scene, threads=1), make_spots(subs, count)
        jobs[name, x] = lambda: caster.cast_bundles(spots, range_max=REACH)
        sizes[name, x] = spots.shape[0] * subs

    base = make_scene(600.0)
    for subs in (2, 4, 9, 19, 37, 61):
        add("sub-rays", subs, base, subs)
    for density in (50.0, 100.0, 200.0, 400.0, 600.0, 800.0):
        add("plants per m2", density, make_scene(density), 37)
    for side in (5, 10, 20, 30):
        add("side of the field", side, make_scene(600.0, first=(7, -side // 2), tiles=(side, side)), 37)
    for cut in (0.0, 0.25, 0.5, 0.75, 1.0):
        add("share cut", cut, make_scene(600.0, cut=cut), 37)
    times = interleave(jobs, rounds=rounds)
    for (name, x), t in times.items():
        found.setdefault(name, []).append([x, sizes[name, x] / median(t) / 1e6])
    whole, half = times["share cut", 0.0], times["share cut", 0.5]
    return found, median([a / b for a, b in zip(whole, half, strict=True)])


def draw(data: dict[str, Any], path: Path) -> None:
    """Four panels."""
    import matplotlib.pyplot as plt

    names = list(data["sweep"])
    fig, axes = plt.subplots(1, len(names), figsize=(13, 3.2), sharey=True, layout="constrained")
    for ax, name in zip(axes, names, strict=True):
        x, y = np.array(data["sweep"][name]).T
        ax.plot(x, y, "o-", color="#c0223b", label="packets")
        if name == "sub-rays":
            for row in data["results"][-1]["rows"][1:]:
                rate = row["mray_per_cpu_s"]
                ax.plot(row["sub_rays"], rate["plain"], "s", color="#33373d")
                ax.plot(row["sub_rays"], rate[row["best_embree"]], "^", color="#8a8f98")
            ax.plot([], [], "s", color="#33373d", label="plain kernel")
            ax.plot([], [], "^", color="#8a8f98", label="Embree 4, its best")
            ax.legend(frameon=False)
        ax.set(xlabel={"side of the field": "side of the field [m]"}.get(name, name))
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylim(0, 1.08 * max(y for way in data["sweep"].values() for _, y in way))
    axes[0].set_ylabel("Mray per CPU-second")
    fig.suptitle("600 plants/m2, 37 sub-rays, 30 % cut, where not on the axis", fontsize=9, color="#33373d")
    fig.savefig(path, dpi=130)
    plt.close(fig)


def main(out_dir: Path | str = "out/bench", *, rounds: int = 7, count: int = 60_000) -> dict[str, Any]:
    """Measures, prints a table, writes rays.json, rays.png and rays-camera.png; returns the data."""
    from rich.console import Console
    from rich.table import Table

    out = Path(out_dir)
    results = [compare(density, rounds, count) for density in (200.0, 600.0)]
    swept, half_cut = sweep(rounds, count // 2)
    data: dict[str, Any] = {
        "what": "Mray per CPU-second (user + system), one thread each, median of interleaved rounds",
        "rounds": rounds,
        "machine": machine(),
        "results": results,
        "camera": camera(rounds, out),
        "lines_of_401_x_37_per_cpu_s": lines_per_second(rounds),
        "scanner": scanner(rounds),
        "sweep": swept,
        "rate_half_cut_over_uncut": half_cut,
    }
    table = Table(title="Rays through wheat: Mray per CPU-second, one thread", title_justify="left")
    names = (
        "plants/m2",
        "sub-rays",
        "rtcIntersect1",
        "its best",
        "as",
        "plain",
        "packets",
        "/ one by one",
        "/ best",
    )
    for name in names:
        table.add_column(name, justify="right")
    for result in results:
        for row in [*result["rows"], result["line"] | {"sub_rays": "lone line"}]:
            rate, best = row["mray_per_cpu_s"], row["best_embree"]
            shown = (
                rate["w1"],
                rate[best],
                best,
                rate.get("plain"),
                rate["packets"],
                row["over_w1"],
                row["over_best"],
            )
            texts = (v if isinstance(v, str) else "" if v is None else f"{v:.2f}" for v in shown)
            table.add_row(f"{result['plants_per_m2']:g}", str(row["sub_rays"]), *texts)
    console = Console()
    console.print(table)
    console.print(
        f"Embree 4: {results[-1]['embree']}; `as`: width of its packets, c = with its flag for coherent rays"
    )
    ours, theirs = ([r[k] / 1e6 for r in results] for k in ("swath_bytes", "embree_bytes"))
    console.print(
        f"Memory at 200 / 600 plants/m2: {ours[0]:.1f} / {ours[1]:.1f} MB, "
        f"Embree {theirs[0]:.0f} / {theirs[1]:.0f} MB"
    )
    line = results[-1]["line"]["ms"]
    console.print(
        f"Lone line of 400 single rays: {line['packets']:.2f} ms, rtcIntersect1 {line['w1']:.2f} ms"
    )
    c, s = data["camera"], data["scanner"]
    console.print(
        f"Camera 640 x 480: {c['mray_per_cpu_s']['packets']:.2f} Mray/s, {c['over_w1']:.2f} x rtcIntersect1, "
        f"{c['over_best']:.2f} x Embree at its best ({c['best_embree']})"
    )
    console.print(f"Lines of 401 x 37 per CPU-second: {data['lines_of_401_x_37_per_cpu_s']:.0f}")
    console.print(
        f"Scanner of {s['beams']} x 37 at 50 Hz on {s['cores']} cores: "
        f"{s['real_time_factor_at_50_hz']:.2f} x real time "
        f"({s['wall_ms_per_scan']:.1f} ms, {s['cpu_ms_per_scan']:.1f} CPU ms a scan)"
    )
    console.print(f"Half the field cut: {data['rate_half_cut_over_uncut']:.2f} of the speed of uncut crop")
    write_json(out, "rays", data)
    draw(data, out / "rays.png")
    return data


if __name__ == "__main__":
    main(*sys.argv[1:2])
