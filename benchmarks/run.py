"""`make bench`: every benchmark, one after the other; tables on the screen, JSON under the out folder.

The first, `versions`, is the cost of whole runs of 0.1.0 and of this version in one interleaved run.
"""

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
import versions
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


VERSIONS = "versions"


def main() -> None:
    """Run all, or those named."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    names = [VERSIONS, *BENCHMARKS]
    parser.add_argument("names", nargs="*", choices=[*names, []], help="which ones (default: all)")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), help="folder of the JSON files")
    parser.add_argument("--base", type=Path, help="versions: checkout of 0.1.0 (default: of the history)")
    parser.add_argument("--base-python", help="versions: its Python (default: of an environment of its own)")
    parser.add_argument("--rounds", type=int, default=3, help="versions: rounds (default: %(default)s)")
    args = parser.parse_args()
    for name in args.names or names:
        if name != VERSIONS:
            BENCHMARKS[name](args.out)
            continue
        given = {
            "--base": args.base,
            "--base-python": args.base_python,
            "--rounds": args.rounds,
            "--out": args.out,
        }
        versions.main(
            [text for key, value in given.items() if value is not None for text in (key, str(value))]
        )
    print(f"JSON files: {args.out}")


if __name__ == "__main__":
    main()
