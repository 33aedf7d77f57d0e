"""Drawn jobs of whole fields: each worked off, then looked at by code that the schedule does not use.

usage: python benchmarks/fleet.py FIRST LAST [LEAST_HA MOST_HA]   seeds, the last one left out
"""

import sys
import time

from tests.fleet.check import looked_at
from tests.fleet.drawn import drawn_job

from swath.core.errors import InputError
from swath.fleet.schedule import schedule_of

HEAD = (
    "seed ha comb cart holes parts t/ha | min passes | contact s  left %  lost   hole s  out s  tramp | CPU"
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
        try:
            made = schedule_of(job)
        except InputError as error:
            print(f"{seed:4}    - {what} {field.yield_t_ha:4.1f} | refused: {error}", flush=True)
            refused += 1
            continue
        spent = time.process_time() - begin
        found = looked_at(made)
        contact = sum(found.contact.values())
        is_bad = contact > 0 or found.left > 0.005 or found.mass > 1e-9 or found.hole + found.outside > 0
        done, bad = done + 1, bad + is_bad
        print(
            f"{seed:4} {made.plan.area / 1e4:4.1f} {what} {field.yield_t_ha:4.1f} | {made.ends / 60:3.0f} "
            f"{len(made.plan.passes):6} | {contact:9.1f} {100 * found.left:7.2f} {found.mass:6.0e} "
            f"{found.hole:6.0f} {found.outside:6.0f} {found.trampled:6.0f} | {spent:5.1f} {'!' * is_bad}",
            *made.notes, flush=True,
        )  # fmt: skip
    print(f"{done} done, of them {bad} not as they should be; {refused} refused")


if __name__ == "__main__":
    main()
