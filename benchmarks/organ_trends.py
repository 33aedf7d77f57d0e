"""How often losses, quality and power of the organs go with a setting as manuals say, over drawn points.

    python benchmarks/organ_trends.py [COUNT]

A row per setting, a column per quality: the share of the points at which the trend holds, and its sign. Then
what was measured beside what the organs give; COUNT 0 prints this alone.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from tests.machine.organ_trends import QUALITIES, TRENDS, judged, steady
from tests.machine.test_walkers import ROTORS, WALKERS, capacity

BROKEN = QUALITIES.index("broken")


def lost(machine: object, levels: dict[str, str], nominal: float, feed: float) -> float:
    """Share of the grain lost at a feed over the nominal straw and chaff [kg/s]."""
    flows = (nominal / 0.65, nominal)
    return float(sum(steady(machine=machine, levels=levels, nominal=flows, feed=feed)[:3]))


def broken(moisture: float = 14.0, **over_own: float) -> float:
    """Percent of the grain in the tank at a moisture [%]."""
    return 100.0 * float(steady(keys={"feeder": {"grain_moisture_percent": moisture}}, **over_own)[BROKEN])


def published() -> None:
    """Print what was measured, and what the organs give."""
    wheat, barley = ([capacity(crop, *kind) for kind in (WALKERS, ROTORS)] for crop in ("wheat", "barley"))
    doubled = [lost(*kind, 1.0) / lost(*kind, 0.5) for kind in (WALKERS, ROTORS)]
    moist = min(range(10, 32), key=broken)
    rows = (
        ("walkers, straw and chaff at 3 % of loss, t/h", "13.9, 16.3 (PAMI)", f"{wheat[0]:.1f}"),
        ("rotors, the same", "20 to 24 (PAMI), smaller ones", f"{wheat[1]:.1f}"),
        ("barley over wheat, walkers; rotors (fitted)", "0.48 to 0.50; 0.7 (PAMI)",
         f"{barley[0] / wheat[0]:.2f}; {barley[1] / wheat[1]:.2f}"),
        ("loss, feed doubled to nominal, walkers; rotors", "2 times", f"{doubled[0]:.1f}; {doubled[1]:.1f}"),
        ("broken, feed doubled", "0.84 times (its source)", f"{broken(feed=1) / broken(feed=0.5):.2f}"),
        ("moisture at which least breaks, %", "26", f"{moist}"),
        ("broken, drum a tenth faster", "more", f"{broken(drum=1.1) / broken():.2f} times"),
        ("broken at the manual's settings, %", "below 3 in 69 of 72; axial below 1", f"{broken():.2f}"),
    )  # fmt: skip
    for what, measured, found in rows:
        print(f"{what:50s}{measured:36s}{found}")


def main(count: int = 100) -> float:
    """Print the tables; the least share."""
    if not count:
        published()
        return 1.0
    found = [judged(np.random.default_rng(seed)) for seed in range(count)]
    print(f"{'':10s}" + "".join(f"{q:>13s}" for q in QUALITIES))
    keys = {key: None for each in found for key in each}
    shares = {key: float(np.mean([each[key] for each in found if key in each])) for key in keys}
    for name, (signs, _) in TRENDS.items():
        row = [f"{shares[name, q]:8.2f} ({s})" for q, s in zip(QUALITIES, signs, strict=True)]
        print(f"{name:10s}" + "".join(f"{text:>13s}" for text in row))
    print(f"least {min(shares.values()):.2f} over {count} points, mean {np.mean(list(shares.values())):.4f}")
    published()
    return min(shares.values())


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
