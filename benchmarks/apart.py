"""What it costs that files of others are read in a process of their own.

python benchmarks/apart.py [--mb 20] [--pairs 5]

A run's log as MF4, BLF, ASC, a bag and a GeoTIFF of about this size are read whole, by turns in this
process and apart. CPU-s of both processes together; `start` is that of a first small file of the kind
apart, less here.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

KINDS = ("mf4", "blf", "asc", "bag", "tif")
CHANNELS = 40


def make(folder: Path, mb: float) -> dict[str, Path]:
    """The files."""
    import numpy as np

    from swath.field.maps.raster import Raster
    from swath.tools.run_log.write import Recorded, _write_frames, _write_mf4

    rng = np.random.default_rng(5)
    files = {}
    for kind, per_sample in (("mf4", 12.0), ("blf", 24.0), ("asc", 70.0)):
        count = max(20, int(mb * 1e6 / per_sample / CHANNELS))
        t = np.arange(count) * 0.02
        channels = {f"c{k}": ("m/s", rng.normal(size=count).cumsum()) for k in range(CHANNELS)}
        files[kind] = folder / f"log.{kind}"
        write = _write_mf4 if kind == "mf4" else _write_frames
        write(iter([Recorded("made", t, channels)]), files[kind])
    files["bag"] = _bag(folder / "bag.mcap", mb)
    side = max(20, int((mb * 1e6 / 4.0) ** 0.5))
    values = rng.normal(100.0, 1.0, (side, side)).astype(np.float32)
    files["tif"] = folder / "map.tif"
    Raster(values, 499_700.0, 5_760_900.0, 1.0, 32632).to_geotiff(files["tif"], 32632, unit="m")
    return files


def _bag(path: Path, mb: float) -> Path:
    """Scans of 760 beams at 25 Hz and poses at 50 Hz."""
    import numpy as np

    from swath.core.frames import Pose
    from swath.record.mcap_file import McapFile

    rng = np.random.default_rng(5)
    file = McapFile(path)
    make = file.make
    for k in range(max(4, int(mb * 1e6 / 7600.0))):
        t, pose = k * 40_000_000, Pose.identity()
        scan = make("sensor_msgs/msg/LaserScan", header=make.header(t, "laser"), angle_increment=0.004,
                    ranges=rng.random(760, np.float32), intensities=rng.random(760, np.float32))  # fmt: skip
        file.write("/scan", t, scan)
        for half in (0, 20_000_000):
            made = make.odometry(make.header(t + half, "odom"), "base", pose, make.twist(1.0))
            file.write("/odom", t + half, made)
    file.close()
    return path


def read(kind: str, path: Path) -> int:
    """Read all of a file; what there was."""
    if kind == "tif":
        from swath.field.maps.raster import Raster

        return int(Raster.from_geotiff(path).values.size)
    if kind == "bag":
        from swath.record.read.files import open_log

        log = open_log(path)
        return sum(1 for _ in log.messages(log.topics()))
    from swath.field_io.logs.channels import open_channels

    channels = open_channels(path)
    assert channels is not None
    return sum(len(values) for _, _, values in channels.blocks(channels.units))


def timed(kind: str, path: Path, where: str) -> float:
    """CPU-s of a process that reads a file, and of its own."""
    code = f"from benchmarks.apart import one; one({kind!r}, {str(path)!r}, {where!r})"
    root = Path(__file__).parent.parent
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=root, check=True)
    return float(json.loads(done.stdout)["cpu_s"])


def one(kind: str, path: str, where: str) -> None:
    """In its own process."""
    import gc

    from swath.core.apart import call

    call.is_apart = where == "here"
    count = read(kind, Path(path))
    call.close_all()
    gc.collect()
    times = os.times()
    print(json.dumps({"cpu_s": sum(times[:4]), "count": count}))


def main() -> None:
    """Print a row for each kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--mb", type=float, default=20.0)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--kinds", default=",".join(KINDS))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        large, small = Path(folder, "large"), Path(folder, "small")
        large.mkdir()
        small.mkdir()
        files, firsts = make(large, args.mb), make(small, 0.01)
        print("kind    MB  here s  apart s  start s  ratio without the start")
        for kind in args.kinds.split(","):
            pairs = [[timed(kind, f[kind], w) for f in (files, firsts) for w in ("here", "apart")]
                     for _ in range(args.pairs)]  # fmt: skip
            here, apart, first, first_apart = (statistics.median(p) for p in zip(*pairs, strict=True))
            ratio = (apart - first_apart) / (here - first)
            size = files[kind].stat().st_size / 1e6
            print(
                f"{kind:5} {size:5.1f} {here:7.2f} {apart:8.2f} {first_apart - first:8.2f} {ratio:6.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
