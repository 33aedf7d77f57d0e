"""Rays through wheat on a card: the group walk there, many scans at once, and how it agrees with the CPU.

The scene of `rays.py`. At least `BEAMS` beams a launch, rays and field resident on the card: Mray per second
of the walk (with the meeting of solids and, for nearest and median, the choice among the hits), median of
rounds, synchronised. "call" is the whole call from numpy to numpy: rays up, results down. Compared with the
CPU's groups: ranges within 0.1 mm, on every `LOOK`-th scan line. Without a card it measures nothing.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from _harness import machine, median, write_json
from ray_scenes import make_beams, make_scene

from swath.core.compiled import start_warp
from swath.rays.engine import Hits, RayCaster
from swath.rays.groups.cast import Task, no_hits
from swath.rays.groups.lanes import bundle_lanes, image_lanes
from swath.rays.warps.cast import WarpWalk

REACH = 60.0
BEAMS = 100_000  # of a launch; single rays are ten times as many
LINE = 180  # beams of a scan line
LOOK = 20
AIM = 1000.0  # Mray/s at 600 plants/m2 with 37 sub-rays


def seconds(work: Callable[[], Any], wait: Callable[[], None], rounds: int) -> float:
    """Median wall time of one call, after one that is not counted."""
    times = []
    for _ in range(rounds + 1):
        started = time.perf_counter()
        work()
        wait()
        times.append(time.perf_counter() - started)
    return median(times[1:])


def ask(caster: RayCaster, o: np.ndarray, d: np.ndarray, need: int) -> Hits:
    """All hits of beams (n, s, 3), or those that are number `need`; single rays as an image of lines."""
    if d.shape[1] == 1:
        return caster.cast_image(o[0, 0], d.reshape(-1, LINE, 3), range_max=REACH)
    if need:
        return caster.cast_order(o, d, need, range_max=REACH)
    return caster.cast_bundles(o, d, range_max=REACH)


def measure(
    caster: RayCaster, here: RayCaster, subs: int, need: int, beams: int, rounds: int
) -> dict[str, Any]:
    """Speed of beams of `subs` sub-rays: all hits, or the one that is number `need`; and against the CPU."""
    wp, walk = start_warp(), caster._group_walk
    assert isinstance(walk, WarpWalk)
    o, d = make_beams(subs, beams * subs, LINE)
    rays = o.reshape(-1, 3), d.reshape(-1, 3)
    lanes = bundle_lanes(len(o), d[0]) if subs > 1 else image_lanes(len(o) // LINE, LINE, (0.002, 0.003))
    hits = no_hits(len(o) if need else len(rays[0]))
    scene = caster.scene.refresh(wp)
    batch = walk.load(wp, Task(rays, subs, lanes, REACH, need, need > 0, hits))
    spent = seconds(lambda: walk.walk(wp, scene, None, batch), wp.synchronize, rounds)
    batch.fetch()
    call = seconds(lambda: ask(caster, o, d, need), lambda: None, 3)
    part = [a.reshape(-1, LINE, subs, 3)[::LOOK].reshape(-1, subs, 3) for a in (o, d)]
    a = hits[0].reshape(len(o) // LINE, -1)[::LOOK].ravel()
    b = ask(here, part[0], part[1], need).distance.ravel()
    same = (np.abs(a - b) < 1e-4) | (np.isnan(a) & np.isnan(b))
    return {
        "sub_rays": subs,
        "hits": {0: "all", 1: "nearest"}.get(need, "median"),
        "rays": len(rays[0]),
        "mray_per_s": len(rays[0]) / spent / 1e6,
        "mray_per_s_of_the_call": len(rays[0]) / call / 1e6,
        "within_0.1_mm_of_cpu": float(same.mean()),
        "compared": len(a),
    }


def main(out_dir: Path | str = "out/bench", *, rounds: int = 21) -> dict[str, Any] | None:
    """Measures, prints a table, writes gpu.json; None without a card."""
    wp = start_warp()
    if not wp.is_cuda_available():
        print("Rays on a card: no CUDA device here, nothing measured.")
        return None
    from rich.console import Console
    from rich.table import Table

    card = wp.get_device("cuda:0").name
    results = []
    for density in (200.0, 600.0):
        field = make_scene(density)
        caster, here = RayCaster(field, device="cuda:0"), RayCaster(field)
        ask(caster, *make_beams(9, 2000, LINE), 0)  # compiles, and carries the field there
        for subs, needs, beams in ((1, (0,), 10 * BEAMS), (9, (0, 5, 1), BEAMS), (37, (0, 19, 1), BEAMS)):
            for need in needs:
                row = measure(caster, here, subs, need, beams, rounds)
                results.append({"plants_per_m2": density} | row)
    data = {"what": __doc__, "card": card, "rounds": rounds, "machine": machine(), "results": results}
    table = Table(title=f"Rays through wheat on {card}", title_justify="left")
    for name in ("plants/m2", "sub-rays", "hits", "Mray/s", "aim", "of the call", "within 0.1 mm of the CPU"):
        table.add_column(name, justify="right")
    for row in results:
        is_aim = (row["plants_per_m2"], row["sub_rays"], row["hits"]) == (600.0, 37, "all")
        table.add_row(
            f"{row['plants_per_m2']:.0f}",
            str(row["sub_rays"]),
            row["hits"],
            f"{row['mray_per_s']:.0f}",
            f"{AIM:.0f}" if is_aim else "",
            f"{row['mray_per_s_of_the_call']:.0f}",
            f"{100.0 * row['within_0.1_mm_of_cpu']:.3f} %",
        )
    Console().print(table)
    write_json(Path(out_dir), "gpu", data)
    return data


if __name__ == "__main__":
    main(*sys.argv[1:2])
