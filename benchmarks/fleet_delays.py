"""Delays drawn into whole fields as they are driven: nothing overlaps, no grain is lost, everything ends.

    python -m benchmarks.fleet_delays 0 20 --delays 500 --runs 2 --hectares 0.6 2.5

The first 20 drawn jobs of `tests/fleet/drawn.py` from a seed on with several machines that have a plan, one
plan each. A delay stops a machine at a place of its path, drawn over all its segments, so at the truck and
beside others, too: of 10 s on average, one of fifty of up to ten minutes. `tests/fleet/check.py` looks at
the bodies. Prints a row for each run.
"""

import argparse
import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.fleet.driven import _Drive, _Mover
from swath.fleet.schedule import Schedule, schedule_of
from swath.fleet.worked import Worked

MEAN_S, LONG_S, LONG = 10.0, 600.0, 0.02  # of delays, of long ones at most, share of long ones


class Delayed(_Drive):
    """late: of each machine, in order, the number of its segment, how far it has come in it then, share, and
    how long it stands there [s].
    """

    def __init__(self, schedule: Schedule, late: dict[str, list[tuple[int, float, float]]]) -> None:
        super().__init__(schedule)
        self.late = {name: late.get(name, [])[::-1] for name in self.movers}
        self.until = dict.fromkeys(self.movers, 0.0)

    def goal(self, name: str, m: _Mover) -> float:
        """Where it is, while it is delayed."""
        late = self.late[name]
        while late and late[-1][0] < m.k:  # left behind in one step
            self.until[name] = max(self.until[name], self.time) + late.pop()[2]
        if (
            late
            and late[-1][0] == m.k
            and m.at >= m.begins[m.k] + late[-1][1] * (m.ends[m.k] - m.begins[m.k])
        ):
            self.until[name] = max(self.until[name], self.time) + late.pop()[2]
        if self.time >= self.until[name]:
            return super().goal(name, m)
        self.last = self.time  # one that stands for a known time
        return m.at


def with_delays(schedule: Schedule, count: int, rng: np.random.Generator) -> tuple[Worked, float]:
    """The schedule driven with so many delays, and how long they are in sum [s]."""
    own = {name: sum(s.machine == name for s in schedule.table.segments) for name in schedule.table.last}
    names = sorted(own)
    share = np.array([own[n] - 1 for n in names], float)
    late: dict[str, list[tuple[int, float, float]]] = {n: [] for n in names}
    for i in rng.choice(len(names), count, p=share / share.sum()).tolist():
        long = rng.random() < LONG
        seconds = rng.uniform(0.0, LONG_S) if long else rng.exponential(MEAN_S)
        late[names[i]].append((int(rng.integers(own[names[i]] - 1)), rng.random(), float(seconds)))
    drive = Delayed(schedule, {n: sorted(rows) for n, rows in late.items()})
    worked = drive.run()
    assert not any(drive.late.values())
    return worked, math.fsum(s for rows in late.values() for *_, s in rows)


def planned(seed: int, hectares: tuple[float, float]) -> Iterator[tuple[int, Schedule]]:
    """Drawn jobs from a seed on in which several machines have a plan."""
    from tests.fleet.drawn import drawn_job

    while True:
        job = drawn_job(seed, hectares)
        if len(job.combines) + len(job.carts) > 1:
            try:
                yield seed, schedule_of(job)
            except InputError as error:
                print(f"{seed:4} has no plan: {error}", flush=True)
        seed += 1


def main() -> None:
    """See above."""
    from tests.fleet.check import looked_at

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seed", type=int, help="the first one")
    parser.add_argument("jobs", type=int)
    parser.add_argument("--delays", type=int, default=500, help="of a job")
    parser.add_argument("--runs", type=int, default=2, help="of a job")
    parser.add_argument("--hectares", type=float, nargs=2, default=(0.6, 2.5), metavar=("LEAST", "MOST"))
    args = parser.parse_args()
    wrong: list[str] = []
    count = 0
    jobs = planned(args.seed, tuple(args.hectares))
    for _, (seed, schedule) in zip(range(args.jobs), jobs, strict=False):
        here: Any = schedule.machines
        for run in range(args.runs):
            head = f"{seed:4} {len(here.combines)}+{len(here.carts)} run {run}"
            begin, rng = time.process_time(), np.random.default_rng([seed, run])
            try:
                worked, seconds = with_delays(schedule, args.delays // args.runs, rng)
            except InputError as error:
                wrong.append(head)
                print(f"{head}: {error}", flush=True)
                continue
            count += args.delays // args.runs
            found = looked_at(schedule, worked)
            text = f"{head}: {args.delays // args.runs} delays, {seconds / 60.0:.0f} min in sum"
            text += f"; {schedule.ends / 3600.0:.2f} h planned, {worked.ends / 3600.0:.2f} h driven"
            text += f"; contact {math.fsum(found.contact.values()):.1f} s, off ground {found.outside:.0f} s"
            text += f", left {100.0 * found.left:.2f} %, mass {found.mass:.0e}"
            print(f"{text}; {time.process_time() - begin:.0f} CPU-s", flush=True)
            if found.contact or found.outside or found.hole or found.mass > 1e-9:
                wrong.append(head)
    print(f"{count} delays in runs that end; not as they should be: {wrong or 'none'}")


if __name__ == "__main__":
    main()
