"""Worlds in step against runs one by one: simulated seconds per CPU second, one thread.

In interleaved rounds: `empirical`, `profile` with the detector `otsu`, which goes world by world, and
`profile` with a detector in numpy for all worlds at once (examples/many_worlds.py), each one world and many
in step. Then, of the last, where the CPU time goes: compiled code, numpy, digest, the interpreter.
"""

import argparse
import cProfile
import pstats
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent))

from _harness import machine, write_json
from examples.many_worlds import Split

PROFILE = {
    "combine.lidar.level": "profile",
    "combine.header.level": "profile",
    "combine.motion.level": "kinematic",
}
CASES: dict[str, dict[str, Any]] = {
    "empirical": {"combine.lidar.level": "empirical", "combine.edge": "otsu"},
    "profile, otsu": {**PROFILE, "combine.edge": "otsu"},
    "profile, detector of all worlds": {**PROFILE, "combine.edge": Split},
}


def driven(case: str, seed: int, worlds: int, seconds: float) -> tuple[float, float]:
    """CPU seconds of the assembly of worlds and of driving them, per simulated second of a world."""
    from swath.api import load_scenario
    from swath.core.process.collector import collected_rarely
    from swath.runtime.assembly import assemble
    from swath.runtime.worlds import drive_together

    sets = {**CASES[case], "run.max_duration_s": seconds, "run.distance_m": 400}
    started = time.process_time()
    made = [assemble(load_scenario("straight", sets=sets, seed=seed + k)) for k in range(worlds)]
    middle = time.process_time()
    with collected_rarely():
        ended = [found for _, found in drive_together(made)]
    simulated = sum(found["simulated_s"] for found in ended if isinstance(found, dict))
    return (middle - started) / simulated, (time.process_time() - middle) / simulated


def shares(run: Callable[[], Any]) -> dict[str, float]:
    """Shares of CPU time in compiled code, numpy, and Python."""
    from swath.kernels import Repeated

    prepare, profile = Repeated._prepare, cProfile.Profile(time.process_time)

    def seen(launches: Repeated) -> None:
        """A launch becomes a function that the profile knows."""
        prepare(launches)
        compiled = launches.launch

        def launch() -> Any:
            return compiled()

        launches.launch = launch

    Repeated._prepare = seen  # type: ignore[method-assign]
    try:
        profile.runcall(run)
    finally:
        Repeated._prepare = prepare  # type: ignore[method-assign]
    found = {"compiled kernels": 0.0, "numpy": 0.0, "digest": 0.0, "other built-in": 0.0, "Python": 0.0}
    for (file, _, name), (_, _, own, _, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        if name == "launch":
            kind = "compiled kernels"
        elif "openssl_sha256" in name or "digest" in name:
            kind = "digest"
        elif "numpy" in file or "numpy" in name or "ufunc" in name:
            kind = "numpy"
        else:
            kind = "other built-in" if file == "~" else "Python"
        found[kind] += own
    total = sum(found.values())
    return {kind: seconds / total for kind, seconds in found.items()}


def main(
    out_dir: Path | str = "out/bench", *, worlds: int = 64, seconds: float = 10.0, rounds: int = 3
) -> dict[str, Any]:
    """Measure, print, write worlds.json."""
    from rich.console import Console
    from rich.table import Table

    sizes = [(case, n) for case in CASES for n in (1, worlds)]
    found: dict[tuple[str, int], list[tuple[float, float]]] = {size: [] for size in sizes}
    for case in CASES:
        driven(case, 1, 1, 0.5)  # compiled from now on
    for k in range(rounds):
        for case, n in sizes if k % 2 == 0 else reversed(sizes):
            found[case, n].append(driven(case, 10 + 1000 * k, n, seconds))
    table = Table(
        title=f"`straight`, {seconds:g} s a world, one thread, medians of {rounds}", title_justify="left"
    )
    for column in ("", "worlds", "world-seconds per CPU-second", "ms a world-second", "assembly, ms a world"):
        table.add_column(column, justify="right" if column else "left")
    rows = []
    for (case, n), pairs in found.items():
        build, drive = (sorted(values)[len(pairs) // 2] for values in zip(*pairs, strict=True))
        rows.append({"case": case, "worlds": n, "rate": 1.0 / drive, "assembly_ms": 1e3 * build * seconds})
        table.add_row(
            case, str(n), f"{1.0 / drive:.0f}", f"{1e3 * drive:.1f}", f"{1e3 * build * seconds:.0f}"
        )
    Console(width=120).print(table)
    last = list(CASES)[-1]
    parts = shares(lambda: driven(last, 10, worlds, seconds))
    print(
        f"{last}, {worlds} worlds, assembly included: "
        + ", ".join(f"{k} {100 * v:.0f} %" for k, v in parts.items())
    )
    data = {"machine": machine(), "rows": rows, "shares": parts}
    write_json(Path(out_dir), "worlds", data)
    return data


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", default="out/bench")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    main(given.out, worlds=given.worlds, seconds=given.seconds, rounds=given.rounds)
