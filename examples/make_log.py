"""A yield log as a combine's monitor writes it, of a field made up here: to try an import without a log.

    python examples/make_log.py harvest.csv
    swath field import harvest.csv --out my-field

Eight passes of 180 m, 9 m header, one record a second. What the flow sensor says comes 12 s after the cut.
"""

import csv
import sys
from math import cos, radians, sin

HEADER_M, SPEED_M_S, LENGTH_M, PASSES, DELAY_S = 9.0, 2.0, 180, 8, 12
LAT, LON = 52.1, 11.3
METRE_LAT = 1.0 / 111_250.0  # degrees, at 52 degrees north
METRE_LON = 1.0 / (111_320.0 * cos(radians(LAT)))


def grain_kg_m2(x: float, y: float) -> float:
    return 0.75 + 0.15 * sin(x / 15.0) * cos(y / 25.0)


def main(path: str) -> None:
    places = []  # x, y [m], does it cut
    for k in range(PASSES):
        up = k % 2 == 0
        along = [SPEED_M_S * i for i in range(int(LENGTH_M / SPEED_M_S))]
        x = HEADER_M * k
        places += [(x, y if up else LENGTH_M - y, True) for y in along]
        end, sign = (LENGTH_M, 1.0) if up else (0.0, -1.0)
        for i in range(1, 10):  # the turn: half a circle over the headland
            angle = i / 10 * 3.14159
            places.append(
                (x + 0.5 * HEADER_M * (1 - cos(angle)), end + sign * 0.5 * HEADER_M * sin(angle), False)
            )
    flow = [grain_kg_m2(x, y) * SPEED_M_S * HEADER_M if cuts else 0.0 for x, y, cuts in places]
    with open(path, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(
            [
                "time [s]",
                "lat [deg]",
                "lon [deg]",
                "elevation [m]",
                "speed [m/s]",
                "header_width [m]",
                "grain_flow [kg/s]",
            ]
        )
        for t, (x, y, _) in enumerate(places):
            late = flow[t - DELAY_S] if t >= DELAY_S else 0.0
            row = (t, LAT + y * METRE_LAT, LON + x * METRE_LON, 80 + 0.01 * y, SPEED_M_S, HEADER_M, late)
            writer.writerow(
                [f"{value:.10g}" if i in (1, 2) else f"{value:.4g}" for i, value in enumerate(row)]
            )


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "harvest.csv")
