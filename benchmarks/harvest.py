"""A whole field: the rows of docs/fleet*.md, with the numbers that come out now.

SWATH_DATA=... python benchmarks/harvest.py
    [--driven [FIRST LAST] | --shared-out FIRST LAST | --spread PERCENT FIRST LAST
     | --sensors LAYOUT:CARTS[:RUN] ...]

--driven: bundled jobs, or layouts from a number to another: hours by events and by driven machines, whether
both rank the numbers of carts alike, seconds for which bodies of driven machines are over each other, and
standoffs that were not solved.
--shared-out: the same of layouts, passes shared out among combines before the job, with turns and waits as
with sensors.
--spread: hours by events of layouts from a number to another, with speeds of machines up to so much off.
--sensors: layouts with a number of carts at the level with sensors, the edge known and machines kinematic:
hours until the last grain is at the truck against events as machines come to the passes, events and
kinematic machines if each combine cuts the same passes, seconds of computing, contacts, the crop that is
left, the grain that is not at the truck. Some minutes each. RUN, 1 and more: machines up to OFF faster or
slower on the field, with other noise; passes, their order and the other two levels as without it.
"""

import math
import random
import statistics
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.fleet import measured_turns as turns
from tests.job.cheap import CheapRun, cheap_sets
from tests.job.jobs import finished, job_file
from tests.job.layouts import CARTS, both_levels, layout, layout_file, same_ranking
from tests.job.test_events import gain_of
from tests.job.test_plan import LOG

from swath.job.fleet import FleetFile, read_fleet
from swath.job.machines import fleet_of
from swath.job.recorded import predict, read_day
from swath.job.spread import DRAWS, spread_of
from swath.job.turns import limits_of
from swath.job.work import plan_of, work_off
from swath.judge.evaluators.contact import ContactWatch
from swath.signals import HeapState, MachineLoad
from swath.tools.fleet.whole import share_uncut


def say(case: str, found: str, expected: str) -> None:
    """One row."""
    print(f"{case:58s} {found:30s} {expected}", flush=True)


def headland_turns() -> None:
    """40 rolling turns made anew, each at its own shift, speed and excursion."""
    measured = turns.rolling_turns()
    stated = turns.medians([t.figures for t in measured])
    for made in (turns.in_closed_loop, turns.with_clothoids, turns.rolled_through):
        for antenna in (turns.ANTENNA, 1.0, 2.5) if made is turns.in_closed_loop else (turns.ANTENNA,):
            found = turns.medians([turns.driven_by(made, t, antenna)[0] for t in measured])
            for key in ("duration", "path", "depth"):
                off = 100.0 * (found[key] / stated[key] - 1.0)
                name = made.__name__.replace("_", " ")
                say(f"turns {name}, antenna {antenna:g} m, {key}", f"{found[key]:.2f} ({off:+.1f} %)",
                    f"{stated[key]:.2f}")  # fmt: skip
    dubins = turns.dubins_length(11.9, 6.1)
    say("Dubins turn of 6.1 m", f"{dubins:.1f} m ({100 * (dubins / 31.55 - 1):+.0f} %)", "31.6 m, 27 % short")


def recorded_day() -> None:
    """The first day of the 2014 log."""
    day = read_day(LOG, limits_of(3.9, 6.4, math.radians(15.0), 2.0))
    for known in (1, 2, 3):
        made = predict(day, 3600.0 * known)
        for name, found, stated in (
            ("cutting", made.cutting, made.cutting_recorded),
            ("between passes", made.turning, made.turning_recorded),
            ("in all", made.total, made.total_recorded),
        ):
            off = 100.0 * (found / stated - 1.0)
            say(
                f"2014, {known} h known, {name}",
                f"{found / 3600:.2f} h ({off:+.1f} %)",
                f"{stated / 3600:.2f} h",
            )


def whole_fields() -> None:
    """Gain on the go, numbers of carts, bundled jobs."""
    for flow, expected in ((8.7, "9-16 %"), (23.8, "26-44 %")):
        say(f"on the go against standing, {flow} kg/s, in lands", f"{100 * gain_of(flow):.1f} %", expected)
        combine = {"grain_kg_s": flow, "call_percent": 40.0, "speed_kmh": 15.0}
        both = [
            finished(job_file(combine=combine, unload={"mode": m})).time for m in ("on_the_go", "standing")
        ]
        say("  in a whole field of 18 ha, one cart", f"{100 * (both[1] / both[0] - 1):.1f} %", "-")
    for carts in (1, 2, 3):
        say(f"three combines, {carts} carts", f"{finished(job_file(3, carts)).time / 3600:.2f} h", "-")
    for name in ("harvest-field", "echelon"):
        file, _ = read_fleet(name)
        began = time.process_time()
        made = work_off(file)
        took = time.process_time() - began
        say(
            f"{name}: {made.area / 1e4:.1f} ha in {took:.2f} s", f"{made.duration / 3600:.2f} h",
            f"mass {made.mass_error:.0e}, {made.hectares_per_hour:.1f} ha/h, {made.litres_per_ha:.1f} l/ha",
        )  # fmt: skip


OFF = 0.01  # share by which speeds of machines differ in other runs with sensors
PAIRS = (
    ("cart", "cart"),
    ("cart", "combine"),
    ("combine", "combine"),
    ("cart", "truck"),
    ("combine", "truck"),
)


def driven_row(name: str, file: FleetFile, is_shared_out: bool = False) -> tuple[float, float]:
    """Events against driven machines for one job; returns the hours of both."""
    cheap, dear, touched, unsolved = both_levels(file, is_shared_out)
    seconds = " ".join(f"{touched.get(pair, 0.0):5.1f}" for pair in PAIRS)
    off = 100.0 * (dear / cheap - 1.0)
    print(f"{name:34s} {cheap:7.3f} {dear:7.3f} {off:+6.1f} {unsolved:9d}  {seconds}", flush=True)
    return cheap, dear


def driven(first: int = 0, last: int = -1, *, is_shared_out: bool = False) -> None:
    """Events against driven machines: the bundled jobs, or layouts."""
    heads = ", ".join(map("-".join, PAIRS))
    print(f"{'job':34s}  events  driven      %  unsolved  seconds over each other: {heads}")
    if last < first:
        for name in ("small-field", "echelon", "harvest-field"):
            driven_row(name, read_fleet(name)[0])
        return
    for seed in range(first, last + 1):
        name = f"layout {seed}, {layout(seed)['combines']} combines"
        pairs = [driven_row(f"{name}, {n} carts", layout_file(seed, n), is_shared_out) for n in CARTS]
        ranks = "same ranking" if same_ranking(*zip(*pairs, strict=True)) else "ANOTHER RANKING"
        print(f"{name}: {ranks}", flush=True)


def spreads(percent: float, first: int, last: int) -> None:
    """Hours by events where speeds of machines are up to so many percent off, of layouts."""
    print(f"{'layout:carts':14s}  events   least    mean    most  standard deviation, of {DRAWS} draws")
    for seed in range(first, last + 1):
        for carts in CARTS:
            file = layout_file(seed, carts)
            fleet, time = fleet_of(file), finished(file).time
            found = spread_of(file, plan_of(file, fleet, None), fleet, percent)
            least, most = min(found.durations), max(found.durations)
            off = 100.0 * statistics.pstdev(found.durations) / found.mean
            print(
                f"{seed}:{carts:<12d} {time:7.0f} {least:7.0f} {found.mean:7.0f} {most:7.0f} {off:5.1f} %",
                flush=True,
            )


def with_sensors(jobs: list[str]) -> None:
    """Events against machines with radio, receivers, grain streams and heaps that know the crop edge."""
    heads = "same passes: events  kinematic  sensors   % of these three    computing  contacts"
    print(f"{'layout:carts':14s}  events  {heads}  least clearance   left  not brought   end")
    for job in jobs:
        seed, carts, *of_run = map(int, job.split(":"))
        file = layout_file(seed, carts)
        same, kinematic, _, _ = both_levels(file, is_shared_out=True)
        others = finished(file).time, 3600.0 * same, 3600.0 * kinematic
        began = time.process_time()
        sets = cheap_sets(file.combines, file.carts, broken_off=25)
        faster = {}
        for n in of_run:
            sets.append(f"seed={n + 1}")
            draw = random.Random(1000 * n + 10 * seed + carts)
            faster = {m: 1.0 + draw.uniform(-OFF, OFF) for m in (*file.combines, *file.carts)}
        run = CheapRun(file, sets=sets, evaluators=(ContactWatch,), faster=faster)
        took, left = time.process_time() - began, share_uncut(run.world.field, run.plan)
        found = [run.evaluation.metrics(name) for name in run.world.machines]
        contacts = max(m["contact_count"] for m in found)
        least = min(m["least_clearance_m"] for m in found)
        kept = sum(run.of(c, MachineLoad).tank_grain for c in file.combines)
        kept += sum(run.of(c, HeapState).grain for c in file.carts)
        seconds = run.brought_at
        off = " ".join(f"{100.0 * (seconds / of - 1.0):+6.1f}" for of in others)
        of_others = "{:7.0f} {:20.0f} {:10.0f}".format(*others)
        print(
            f"{job:14s} {of_others} {seconds:8.0f} {off} {took:8.0f} s"
            f" {contacts:9.0f} {least:14.2f} m {100 * left:6.3f} % {kept:9.0f} kg  {run.world.graph.ended}",
            flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:2] == ["--sensors"]:
        with_sensors(sys.argv[2:])
        sys.exit()
    if sys.argv[1:2] == ["--shared-out"]:
        driven(*map(int, sys.argv[2:4]), is_shared_out=True)
        sys.exit()
    if sys.argv[1:2] == ["--spread"]:
        spreads(float(sys.argv[2]), *map(int, sys.argv[3:5]))
        sys.exit()
    if sys.argv[1:2] == ["--driven"]:
        driven(*map(int, sys.argv[2:4]))
        sys.exit()
    whole_fields()
    headland_turns()
    recorded_day()
