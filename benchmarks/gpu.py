"""The ray kernel on a GPU against the CPU: ranges, rays a second, a scan and a short run at level `plants`.

    python benchmarks/gpu.py [--out FOLDER]

Scene as in `rays.py`: 10 x 10 m of wheat on hills, 30 % of it stubble, a scanner 4 m up, bundles of 37 rays.
The kernel is timed by CUDA events on rays that lie on the device; `with copies` is what
`RayCaster.cast_bundles` takes, which makes rays on the host, copies them there and hits back. `unlimited` is
the same kernel without its limit of registers. Needs no network, under four minutes; ends with a word where
there is no CUDA device.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

from _harness import write_json
from ray_scenes import make_scene, make_spots

from swath.kernels import start_warp
from swath.rays.engine import RayCaster

REACH = 60.0  # m
RAYS = 10_000_000
SAMPLE = 60_000  # rays compared with the CPU
RUN = ["run", "straight", "--set", "run.distance_m=15", "--set", "run.record=none", "--no-replay", "--quiet"]
SCAN = ["scan", "straight", "--format", "npz"]


def kernels(wp: Any) -> dict[str, tuple[Any, int]]:
    """The kernel as it is and without its limit of registers, each with its threads a block."""
    from swath.rays.kernel.cast import BLOCK, cast

    free = wp.Kernel(
        func=cast.func, key="cast_unlimited", module=wp.get_module("gpu_unlimited"),
        options={"enable_backward": False},
    )  # fmt: skip
    return {"as it is": (cast, BLOCK), "unlimited": (free, BLOCK)}


def timed(wp: Any, caster: RayCaster, made: tuple[Any, int], o: Any, d: Any) -> float:
    """Seconds of the kernel alone, the least of five, on rays that lie on the device."""
    from swath.field.solid.solids import NOTHING

    kernel, block = made
    kinds = (wp.float32, wp.uint8, wp.float32, wp.float32)
    out = [wp.empty(len(o), dtype=kind, device=caster.device) for kind in kinds]
    scene = [caster.scene.refresh(wp, cells=True), caster.scene.solid_arrays(wp, NOTHING)]
    inputs = [*scene, o, d, REACH, 0, *out]
    times = []
    for _ in range(6):
        begin, end = (wp.Event(device=caster.device, enable_timing=True) for _ in range(2))
        stream = wp.get_stream(caster.device)
        stream.record_event(begin)
        wp.launch(kernel, dim=len(o), inputs=inputs, device=caster.device, block_dim=block)
        stream.record_event(end)
        times.append(wp.get_event_elapsed_time(begin, end) / 1e3)
    return min(times[1:])


def rates(wp: Any, density: float) -> dict[str, Any]:
    """How many rays a second, and how many agree with the CPU."""
    scene = make_scene(density)
    gpu, cpu = RayCaster(scene, device="cuda"), RayCaster(scene, device="cpu")
    spots = make_spots(37, RAYS)
    origins, directions = (np.ascontiguousarray(np.reshape(v, (-1, 3))) for v in spots.rays())
    rng = np.random.default_rng(7)
    pick = rng.choice(len(directions), SAMPLE, replace=False)
    one, other = (c.cast(origins[pick], directions[pick], range_max=REACH) for c in (cpu, gpu))
    near = np.abs(one.distance - other.distance) < 1e-4
    near |= np.isnan(one.distance) & np.isnan(other.distance)
    row = {"density": density, "rays": len(directions), "within_0.1mm": float(near.mean())}
    row["same_organ"] = float((one.organ == other.organ).mean())
    for order, places in (("in order", slice(None)), ("shuffled", rng.permutation(len(directions)))):
        o, d = (wp.array(v[places], dtype=wp.vec3d, device=gpu.device) for v in (origins, directions))
        for name, made in kernels(wp).items():
            row[f"{name}, {order}"] = len(directions) / timed(wp, gpu, made, o, d) / 1e6
    for name, caster in (("GPU with copies", gpu), ("CPU, all cores", cpu)):
        caster.cast_bundles(spots, range_max=REACH)
        begin = time.perf_counter()
        caster.cast_bundles(spots, range_max=REACH)
        row[name] = len(directions) / (time.perf_counter() - begin) / 1e6
    return row


def swath(device: str, words: list[str], out: Path) -> float:
    """Seconds that a command takes with its rays on a device."""
    sets = ["--set", "combine.lidar.level=plants"]
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "swath", *words, *sets, "--out", str(out)],
        env={**os.environ, "SWATH_DEVICE": device}, check=False, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    return time.perf_counter() - begin


def whole(folder: Path) -> dict[str, Any]:
    """A scan and a run of 15 m on both devices: what they give and what they take."""
    found: dict[str, Any] = {}
    for device in ("cpu", "cuda"):
        swath(device, SCAN, folder / f"warm-{device}")  # compiles
        found[f"scan_s_{device}"] = swath(device, SCAN, folder / f"scan-{device}")
        found[f"run_s_{device}"] = swath(device, RUN, folder / f"run-{device}")
        summary = json.loads((folder / f"run-{device}" / "summary.json").read_text(encoding="utf-8"))
        found[f"lateral_rms_m_{device}"] = summary["lateral_rms_m"]
    a, b = (np.load(folder / f"scan-{device}" / "scan.npz")["ranges_m"] for device in ("cpu", "cuda"))
    found["scan_largest_difference_m"] = float(np.nanmax(np.abs(a - b)))
    found["scan_same_returns"] = float((np.isnan(a) == np.isnan(b)).mean())
    return found


def main() -> int:
    """Print and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    args = parser.parse_args()
    wp = start_warp()
    if not wp.is_cuda_available():
        print("no CUDA device here: nothing measured")
        return 0
    found: dict[str, Any] = {"device": wp.get_device("cuda:0").name, "warp": wp.__version__}
    print(found["device"])
    found["rays"] = [rates(wp, density) for density in (200.0, 600.0)]
    for row in found["rays"]:
        print("  ".join(f"{key} {value:.5g}" for key, value in row.items()), "(Mray/s)", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        found["whole"] = whole(Path(folder))
    print("  ".join(f"{key} {value:.5g}" for key, value in found["whole"].items()))
    write_json(args.out, "gpu", found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
