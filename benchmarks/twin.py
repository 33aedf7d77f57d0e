"""Twins of drawn worlds: whether intervals hold, and whether what the bank does not know is noticed.

    python -m benchmarks.twin judging --bank DIR --out DIR [--worlds 40 --checks 40 --others 20]
    python -m benchmarks.twin building ...                 the pool to look at while something is built

Each world is a run of `straight` of 14 m with `plants`, 12.5 scans a second, read from its folder as a
recording is; where the scanner really sits is not told. A bank that is not there is made (700 runs).

| axis | worlds | others |
|---|---|---|
| all that is asked of, and what else a bank varies | as in the bank (`swath.tools.twin.bank`) | likewise |
| LiDAR level | plants | `empirical` (3 of 20) |
| stand | even | patches of 30 % in density, 15 % in height (2 of 20) |
| crop | wheat | barley, rye, maize, rape, soy, as high as the wheat would be (5 of 20) |
| spot over the sheet's | 0.6 to 1.6 | 2 to 3, 0.2 to 0.35 (5 of 20) |
| air | dust to 0.2 per m, puffs to 0.5 | dust 0.4 to 1, puffs 1 to 3, fog 15 to 40 m, rain 60 to 150 (5) |

Printed: of each unknown the median error over the prior's standard deviation, the share of the intervals that
hold the truth, and of how many it was known; of the others whether they are unlike the bank (intervals were
widened), or intervals wider than those of 95 % of the worlds (mean of density, height, pitch, stubble, over
the prior's), or the check refuses another run along them.
"""

import argparse
import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from swath.field.crop_sheet import load_crop
from swath.runtime.job import run_job
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario
from swath.sensing.lidar_sheet import load_lidar
from swath.tools.function_test.progress import progress
from swath.tools.function_test.session import read_asked
from swath.tools.height_map.build import open_source
from swath.tools.height_map.source import Source, Wanted
from swath.tools.tune.parameters import as_sets, sets_at
from swath.tools.twin.bank import ASKED, Bank, BankAsked, make_bank
from swath.tools.twin.check import ALPHA, agreement
from swath.tools.twin.fit import Twin, write_twin
from swath.tools.twin.looks import read_looks

SEEDS = {"building": 51_000, "judging": 87_000}
USUAL = BankAsked(
    "sick-lms511-hr", (0.0, 2.7, 2.4, 0.0, 16.0, 0.0), np.radians(-60.0), np.radians(0.5), 241, (0.0,)
)
MAIN = ("stems_per_m2", "height_factor", "stubble_height_m", "mount.pitch_deg")
LIDAR, STAND = "combine.lidar", "field.stand"
CROPS = ("barley", "rye", "maize", "rape", "soy")
LENGTH_M = 14.0


def world_of(asked: BankAsked, seed: int, number: int) -> tuple[Any, dict[str, Any]]:
    """Shares of what is asked of, and settings, of a world."""
    shares = replace(asked, seed=seed).drawn(number)
    values = sets_at([*asked.parameters, *asked.beside], shares)
    return shares[: len(asked.parameters)], values


def other_of(values: dict[str, Any], number: int, rng: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """What is beyond a bank, and its settings."""
    wheat, turn = load_crop("wheat"), number // 4
    if number % 4 == 0 and turn < 3:
        return "empirical", {f"{LIDAR}.level": "empirical"}
    if number % 4 == 0:
        patches = {"density_variation": {"sd_percent": 30, "length_m": 2},
                   "height_variation": {"sd_percent": 15, "length_m": 2}}  # fmt: skip
        return "patches", {f"{STAND}.level": "maps", **{f"{STAND}.{k}": v for k, v in patches.items()}}
    if number % 4 == 1:
        crop = load_crop(CROPS[turn % 5])
        high = values[f"{STAND}.height_factor"] * wheat.stand.height / crop.stand.height
        dense = values[f"{STAND}.stems_per_m2"] * crop.stand.density / wheat.stand.density
        own = {"crop": CROPS[turn % 5], "height_factor": round(high, 4), "stems_per_m2": round(dense, 2)}
        return CROPS[turn % 5], {f"{STAND}.{k}": v for k, v in own.items()}
    if number % 4 == 2:
        spot = rng.uniform(2.0, 3.0) if turn % 2 else rng.uniform(0.2, 0.35)
        return f"spot x{spot:.2f}", {f"{LIDAR}.spot_factor": round(spot, 3)}
    air = [("extinction_per_m", (0.4, 1.0)), ("near_returns", (1.0, 3.0)), ("fog_mor_m", (15.0, 40.0)),
           ("rain_mm_h", (60.0, 150.0)), ("extinction_per_m", (0.4, 1.0))][turn % 5]  # fmt: skip
    value = round(rng.uniform(*air[1]), 3)
    key = f"field.weather.{air[0]}" if air[0] == "fog_mor_m" else f"{LIDAR}.weather.{air[0]}"
    return f"{air[0]} {value:g}", {key: value}


def driven(folder: Path, asked: BankAsked, values: dict[str, Any], seed: int) -> Source:
    """A run as a recording. Its scanner is where nobody told."""
    if not (folder / "summary.json").is_file():
        shutil.rmtree(folder, ignore_errors=True)
        run = {"seed": seed, "run.distance_m": LENGTH_M, f"{LIDAR}.rate_hz": 12.5}
        fixed = {key: value for key, value in {**asked.fixed, **run}.items() if key not in values}
        sets = layered(asked.sets, as_sets({**fixed, **values}))
        run_job(load_scenario(asked.scenario, sets=sets), folder)
    return open_source(folder, Wanted())


def fitted(out: Path, bank: Bank, source: Source) -> Twin:
    """The twin of a recording."""
    seen = read_looks([source], load_lidar(bank.asked.sheet), bank.asked.view)
    return write_twin(out, bank, seen, [source], [LENGTH_M])


def judged(args: argparse.Namespace) -> None:
    asked = read_asked(args.bank / ASKED, BankAsked, "a bank") or USUAL
    with progress(asked.runs) as done:
        bank = make_bank(args.bank, asked, args.workers, done)
    seed, out = SEEDS[args.pool], args.out / args.pool
    twins, truth, spent = [], [], []
    for number in range(args.worlds):
        shares, values = world_of(asked, seed, number)
        source = driven(out / f"world-{number}", asked, values, seed + number)
        since = time.process_time()
        twins.append(fitted(out / f"twin-{number}", bank, source))
        spent.append(time.process_time() - since)
        truth.append(shares)
    told(asked, twins, np.array(truth))
    print(f"a fit: {np.median(spent):.1f} CPU-s, {max(spent):.1f} at most")
    wide = np.array([width(twin) for twin in twins])
    most = float(np.quantile(wide, 0.95))
    unlike = sum(twin.unlike.over > 1.0 for twin in twins)
    print(f"intervals that were widened: of {unlike} of {len(twins)}")
    refused = 0
    for number in range(args.checks):
        _, values = world_of(asked, seed, number)
        share = checked(out / f"check-{number}", asked, twins[number], values, seed + number)
        refused += share <= ALPHA
        print(f"world {number}: chance {100 * share:.0f} %", flush=True)
    print(f"another run along the same world: refused {refused} of {args.checks}")
    noticed = [other(out, bank, seed, number, most, args) for number in range(args.others)]
    print(f"others: wider or refused {sum(noticed)} of {len(noticed)}")


def other(out: Path, bank: Bank, seed: int, number: int, most: float, args: argparse.Namespace) -> bool:
    """Whether a world beyond the bank is noticed."""
    shares, values = world_of(bank.asked, seed + 500, number)
    name, more = other_of(values, number, np.random.default_rng(seed + number))
    changed = {**{k: v for k, v in values.items() if k not in more}, **more}
    twin = fitted(
        out / f"other-twin-{number}",
        bank,
        driven(out / f"other-{number}", bank.asked, changed, seed + number),
    )
    held = np.mean([twin.answer.low[n] <= shares[n] <= twin.answer.high[n] for n in main_of(bank.asked)])
    is_wide = twin.answer.is_stray or twin.unlike.over > 1.0 or width(twin) > most
    share = float("nan")
    if not is_wide:
        share = checked(out / f"other-check-{number}", bank.asked, twin, changed, seed + number)
    kinds = {"like none": twin.answer.is_stray, "unlike": twin.unlike.over > 1.0, "wider": is_wide,
             "refused": share <= ALPHA, "not noticed": True}  # fmt: skip
    says = next(word for word, is_so in kinds.items() if is_so)
    print(f"{name}: {says}, chance {100 * share:.0f} %; intervals that hold {100 * held:.0f} %", flush=True)
    return is_wide or share <= ALPHA


def checked(out: Path, asked: BankAsked, twin: Twin, values: dict[str, Any], seed: int) -> float:
    """The chance that another run along the same world is as far off."""
    found = agreement(twin, driven(out / "run", asked, values, seed + 250_000))
    print(f"{100 * found.alike:.1f} % as unlike, unknowns {100 * found.same:.0f} %: ", end="")
    return found.chance


def main_of(asked: BankAsked) -> Iterator[int]:
    return (n for n, p in enumerate(asked.parameters) if p.key.endswith(MAIN))


def width(twin: Twin) -> float:
    """Mean width of the main intervals, as shares of the ranges."""
    return float(np.mean([twin.answer.high[n] - twin.answer.low[n] for n in main_of(twin.asked)]))


def told(asked: BankAsked, twins: list[Twin], truth: Any) -> None:
    names = "low", "high", "mean", "is_known"
    low, high, mean, known = (np.array([getattr(t.answer, k) for t in twins]) for k in names)
    held, sd = (low <= truth) & (truth <= high), 1.0 / np.sqrt(12.0)
    for n, p in enumerate(asked.parameters):
        error = np.median(np.abs(mean[:, n] - truth[:, n])) / sd
        shares = f"interval holds {100 * held[:, n].mean():3.0f} %, known {100 * known[:, n].mean():3.0f} %"
        print(f"{p.key:42} error {error:.2f} of the prior's sd, {shares}")
    print(f"all: intervals hold {100 * held.mean():.1f} %; of what is known {100 * held[known].mean():.1f} %")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pool", choices=SEEDS)
    parser.add_argument("--bank", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    for flag, count in (("worlds", 40), ("checks", 40), ("others", 20), ("workers", 2)):
        parser.add_argument(f"--{flag}", type=int, default=count)
    judged(parser.parse_args())
