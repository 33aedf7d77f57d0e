"""Speed laws on the crop of a measured field: spread of the throughput, pass by pass.

    swath field import LOG --out FIELD
    python -m benchmarks.map_speed FIELD [PASSES [LAW ...]]

The crop along each driven pass is that of the field's yield map. The laws run on the bench of their tests:
drive with a lag of 1 s, throughput measured 2.3 s late and with 2 % of noise; the scanner sees 10 m ahead
with a scatter of 15 %, the map 20 m with the correlation of the pass beside (0.68). All laws drive the same
passes with the same noise; printed are means and the difference to `feed_rate` with its interval of 95 % over
the passes. PASSES: how many, default 40.
"""

import sys
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from tests.control.feed_rig import Bench

from swath.control.speed import feed_rate, look_ahead
from swath.field_io.folder import read

LAWS = {
    "feed_rate": (feed_rate.FeedRate, feed_rate.Params, 0.0),
    "look_ahead": (look_ahead.LookAhead, look_ahead.Params, 10.0),
    "map_ahead": (look_ahead.MapAhead, look_ahead.MapParams, 10.0),
    "joined_ahead": (look_ahead.JoinedAhead, look_ahead.Params, 10.0),
}
CORRELATION, SCATTER, NODES_M = 0.68, 0.15, 15.0
STRAW = 0.8  # per grain
LENGTH_M, BEGIN_M = 400.0, 80.0


def crop_of(field: Any, track: Any) -> Any:
    """Grain and straw [kg/m2] every metre along a pass; None where the map has holes."""
    line = np.asarray(track.line)
    steps = np.hypot(*np.diff(line, axis=0).T)
    at = np.concatenate([[0.0], np.cumsum(steps)])
    if at[-1] < LENGTH_M + 40.0:
        return None
    s = np.arange(20.0, LENGTH_M + 20.0)
    grain = field.grain.sample(np.interp(s, at, line[:, 0]), np.interp(s, at, line[:, 1]))
    return None if np.isnan(grain).any() or grain.min() < 0.05 else (1.0 + STRAW) * grain


def chart_of(crop: Any, rng: Any) -> Any:
    """What a map of the pass beside says."""
    nodes = rng.standard_normal(int(len(crop) / NODES_M) + 3)
    noise = np.interp(np.arange(len(crop)) / NODES_M, np.arange(len(nodes)), nodes)
    noise /= noise.std()
    smooth = np.convolve(np.pad(crop, 12, mode="edge"), np.ones(25) / 25, mode="valid")
    left = sqrt(1.0 - CORRELATION**2) * crop.std()
    return np.maximum(crop.mean() + CORRELATION * (smooth - crop.mean()) + left * noise, 0.05)


def spread(law: str, crop: Any, seed: int) -> tuple[float, float]:
    """Coefficient of variation of the throughput [1] and mean speed [m/s] of one law on one pass."""
    kind, params, sight = LAWS[law]
    chart = chart_of(crop, np.random.default_rng(seed))
    at = np.arange(len(crop), dtype=float)
    wanted = float(crop.mean()) * 12.0 * 1.9
    bench = Bench(
        kind,
        params(throughput_kg_s=wanted, entry_speed_kmh=6.0, max_speed_kmh=12.0),
        lambda x: float(np.interp(x, at, crop)),
        sight=sight,
        noise=np.random.default_rng(1000 + seed),
        chart=None if law == "look_ahead" else lambda x: float(np.interp(x, at, chart)),
        scatter=SCATTER,
    )
    while bench.x < LENGTH_M - 40.0:
        bench.step()
    rows = np.array([r for r in bench.rows if r[1] > BEGIN_M])
    return rows[:, 5].std() / rows[:, 5].mean(), rows[:, 2].mean()


def main() -> None:
    field = read(Path(sys.argv[1]))
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 40
    crops = [c for c in (crop_of(field, t) for t in field.tracks) if c is not None]
    crops = crops[:: max(1, len(crops) // count)][:count]
    found = {
        law: np.array([spread(law, c, k) for k, c in enumerate(crops)])
        for law in LAWS
        if law in (sys.argv[3:] or LAWS)
    }
    varies = np.mean([c.std() / c.mean() for c in crops])
    base = found["feed_rate"][:, 0]
    print(f"{len(crops)} passes of {LENGTH_M:.0f} m, CV of the crop {varies:.1%}")
    for law, rows in found.items():
        less = rows[:, 0] - base
        half = 1.96 * less.std(ddof=1) / sqrt(len(less))
        print(
            f"{law:13} CV {rows[:, 0].mean():6.2%}  speed {rows[:, 1].mean():.2f} m/s  "
            f"against feed_rate {less.mean():+6.2%} +- {half:.2%}"
        )


if __name__ == "__main__":
    main()
