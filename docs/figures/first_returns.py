"""Prints a table of first returns: upright stems with ears, rays against the closed form.

Run from the repository root: `python -m docs.figures.first_returns [ANGLE ...]`.
"""

import sys

import numpy as np
from tests.tools.first_returns import Moments, Stems, UprightStand, closed_form, ray_count

COUNTS = {0.0: 40_000, 0.02: 8_000, 0.05: 6_000, 0.10: 4_000}


def _cell(m: Moments) -> str:
    return f"{m.mean:.3f} / {m.std:.3f} / {m.ground:.3f}"


def main() -> None:
    """One row per angle, density and spot."""
    stands = {n: UprightStand(Stems(n)) for n in (200.0, 600.0)}
    print("| down | stems/m² | spot | plain form | with round ends | rays | rays − round ends |")
    print("|---|---|---|---|---|---|---|")
    for degrees in [int(text) for text in sys.argv[1:]] or (15, 30, 45, 60, 80):
        for density, stand in stands.items():
            for width, count in COUNTS.items():
                depression, stems = np.radians(degrees), stand.stems
                plain = closed_form(stems, depression, width)
                exact = closed_form(stems, depression, width, round_ends=True)
                seen = stand.look(depression, width, count)
                spot = f"{100 * width:.0f} cm, {ray_count(width, stems.stem)} rays" if width else "thin"
                apart = [100 * (seen.mean - exact.mean), 100 * (seen.std - exact.std)]
                left = f"{apart[0]:+.1f} cm / {apart[1]:+.1f} cm / {seen.ground - exact.ground:+.3f}"
                row = [f"{degrees}°", f"{density:g}", spot, _cell(plain), _cell(exact), _cell(seen), left]
                print("| " + " | ".join(row).replace("-0.0 cm", "0.0 cm").replace("+0.0 cm", "0.0 cm") + " |")


if __name__ == "__main__":
    main()
