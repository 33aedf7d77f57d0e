"""Level `otsu` past the closed-form canopy of the tests: accuracy, false alarms, cost of a scan.

    python benchmarks/edge_closed_form.py [--scans 300] [--seeds 3]

Roll and pitch of 1 deg, in bends 0.5; errors count
from 3 s on, when some metres are learned.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "control"))

from closed_loop import Course
from edge_drive import EdgeSensor, drive, errors

from swath.control.edge.otsu import Otsu

DEG, CM = np.pi / 180.0, 100.0
DENSITIES = (500, 300, 200, 100)  # stems/m2
RADIUS, BEND_AT = 40.0, 15.0  # m
NO_EDGE = ((0.85, 100.0), (0.85, -100.0), (0.15, 6.0))  # height of the stand, where it ends [m]


def straight(level: Any, density: float, scans: int, seeds: int) -> tuple[float, float, float]:
    """(RMSE of the offset [m], worst RMSE of the heading [rad], least availability) of runs."""
    runs = [
        errors(drive(level=level, stand={"density": density}, scans=scans, roll_sd=DEG, seed=seed), after=3.0)
        for seed in range(seeds)
    ]
    share, offset, _, heading = zip(*runs, strict=True)
    return float(np.sqrt(np.mean(np.square(offset)))), max(heading), min(share)


def bend(level: Any, radius: float, scans: int) -> float:
    """RMSE of the offset in a bend [m]."""
    course = Course(radius, BEND_AT, y=6.0)
    return float(errors(drive(course, level=level, scans=scans, roll_sd=0.5 * DEG), after=3.0)[1])


def false_alarms(level: Any, scans: int) -> int:
    """Scans with an edge where there is only crop or only stubble."""
    count = 0
    for tip, where in NO_EDGE:
        sense = EdgeSensor(Course(y=where), level=level, stand={"tip": tip}, roll_sd=DEG)
        for i in range(scans):
            edge = sense(sense.period * (i + 1), (0.08 * i, 0.1, 0.0), 2.0, 0.0)
            count += bool(edge.is_found)
    return count


def cost(level: Any, scans: int) -> float:
    """CPU time of the detector per scan, median [ms]."""
    spent: list[float] = []
    sense = EdgeSensor(Course(y=6.0), level=level, roll_sd=DEG)
    step = sense.level.step

    def timed(*args: Any) -> Any:
        started = time.process_time()
        out = step(*args)
        spent.append(time.process_time() - started)
        return out

    sense.level.step = timed
    for i in range(scans):
        sense(sense.period * (i + 1), (0.08 * i, 0.1, 0.0), 2.0, 0.0)
    return 1e3 * float(np.median(spent))


def column(level: Any, scans: int, seeds: int) -> list[str]:
    """The cells of a level."""
    runs = {density: straight(level, density, scans, seeds) for density in DENSITIES}
    return [
        " / ".join(f"{CM * runs[density][0]:.1f}" for density in DENSITIES) + " cm",
        " / ".join(f"{runs[density][1] / DEG:.1f}" for density in (500, 100)) + " deg",
        " / ".join(f"{100 * runs[density][2]:.0f}" for density in (200, 100)) + " %",
        " / ".join(f"{CM * bend(level, radius, scans):.1f}" for radius in (RADIUS, -RADIUS)) + " cm",
        f"{false_alarms(level, scans)} of {len(NO_EDGE) * scans} scans",
        f"{cost(level, scans):.2f} ms",
    ]


def main() -> None:
    """Print a row for each measure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scans", type=int, default=300)
    parser.add_argument("--seeds", type=int, default=3)
    args = parser.parse_args()
    names = (
        "offset RMSE at 500 / 300 / 200 / 100 stems/m2",
        "worst heading RMSE of a run at 500 / 100 stems/m2",
        "least availability of a run at 200 / 100 stems/m2",
        "bend of 40 m to the left / right, roll and pitch 0.5 deg",
        "found where there is only crop or only stubble",
        "processor time per scan (200 beams)",
    )
    print("| | otsu |\n|---|---|")
    for name, cell in zip(names, column(Otsu, args.scans, args.seeds), strict=True):
        print(f"| {name} | {cell} |")


if __name__ == "__main__":
    main()
