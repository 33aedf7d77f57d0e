"""`make bench`: every benchmark, one after the other; tables on the screen, JSON under the out folder."""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import batch
import branch
import cutting
import drive
import fmi
import fmu_export
import lidar
import live
import machine
import rays
import replay
import ros2
import watch

BENCHMARKS = {
    "rays": rays.main,
    "cutting": cutting.main,
    "drive": drive.main,
    "batch": batch.main,
    "machine": machine.main,
    "lidar": lidar.main,
    "replay": replay.main,
    "fmi": fmi.main,
    "branch": branch.main,
    "live": live.main,
    "watch": watch.main,
    "ros2": ros2.main,
    "fmu_export": fmu_export.main,
}


def main() -> None:
    """Run all, or those named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*BENCHMARKS, []], help="which ones (default: all)")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), help="folder of the JSON files")
    args = parser.parse_args()
    for name in args.names or BENCHMARKS:
        BENCHMARKS[name](args.out)
    print(f"JSON files: {args.out}")


if __name__ == "__main__":
    main()
