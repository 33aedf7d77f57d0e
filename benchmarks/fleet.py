"""Drawn jobs of whole fields: each planned and driven, then looked at by code that neither uses.

usage: python benchmarks/fleet.py FIRST LAST [LEAST_HA MOST_HA]   seeds, the last one left out
"""

import sys
import time

from tests.fleet.check import looked_at
from tests.fleet.drawn import drawn_job

from swath.core.errors import InputError
from swath.fleet.driven import driven
from swath.fleet.schedule import schedule_of
from swath.fleet.worked import by_events

HEAD = (
    "seed ha comb cart holes parts t/ha passes CPU | min events driven off cm CPU "
    "| contact s left % lost hole s out s tramp, as planned | as driven"
)


def main() -> None:
    """Print a row for each job, and how many came out."""
    first, last, *hectares = sys.argv[1:]
    size = (float(hectares[0]), float(hectares[1])) if hectares else (0.6, 2.5)
    print(HEAD)
    done, refused, bad = 0, 0, 0
    for seed in range(int(first), int(last)):
        job = drawn_job(seed, size)
        begin = time.process_time()
        field = job.field
        what = f"{len(job.combines):4} {len(job.carts):4} {len(field.holes_m):5} {1 + len(field.parts_m):5}"
        what += f" {field.yield_t_ha:4.1f}"
        try:
            made = schedule_of(job)
            spent = time.process_time() - begin
            worked = driven(made)
        except InputError as error:
            cpu = time.process_time() - begin
            print(f"{seed:4}    - {what} {cpu:5.1f} | refused: {error}", flush=True)
            refused += 1
            continue
        drove = time.process_time() - begin - spent
        planned, found = looked_at(made), looked_at(made, worked)
        minutes = made.ends / 60.0, by_events(made).ends / 60.0, worked.ends / 60.0
        is_bad = any(
            f.contact or f.left > 0.005 or f.mass > 1e-9 or f.hole + f.outside + f.hasty > 0
            for f in (planned, found)
        )
        done, bad = done + 1, bad + is_bad
        both = " ".join(
            f"| {sum(f.contact.values()):5.1f} {100 * f.left:5.2f} {f.mass:5.0e} {f.hole:4.0f} "
            f"{f.outside:4.0f} {f.trampled:4.0f}" for f in (planned, found)
        )  # fmt: skip
        print(
            f"{seed:4} {made.plan.area / 1e4:4.1f} {what} {len(made.plan.passes):3} {spent:5.1f} | "
            f"{minutes[0]:5.1f} {minutes[1]:5.1f} {minutes[2]:5.1f} {100 * worked.stray:4.1f} {drove:4.1f} "
            f"{both} {'!' * is_bad}", *made.notes, flush=True,
        )  # fmt: skip
    print(f"{done} done, of them {bad} not as they should be; {refused} refused")


if __name__ == "__main__":
    main()
