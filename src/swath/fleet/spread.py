"""How much the hours of a job differ where its machines, crop and times of pouring do by a little.

Each draw is a job of its own, planned and decided anew: a few seconds turn over which cart comes to which
combine, and how often it drives to the truck.
"""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.foreign_code import file_of
from swath.core.number_text import num
from swath.core.random import Stream
from swath.documents.contents import file_hash
from swath.documents.json_file import read_object
from swath.fleet.files import JobFile
from swath.fleet.schedule import schedule_of
from swath.fleet.worked import by_events

DRAWS = 24
MOST = 20.0  # %
FILE = "draws.json"


def drawn(job: JobFile, number: int, share: float) -> JobFile:
    """A job whose machines' speeds, whose yield and whose times at the truck differ by up to a share."""
    random = Stream(number, "spread").at()

    def factor() -> float:
        return 1.0 + share * (2.0 * float(random.random()) - 1.0)

    combines = {}
    for name, c in job.combines.items():
        f = factor()
        combines[name] = replace(
            c, speed_kmh=f * c.speed_kmh, turn_speed_kmh=f * c.turn_speed_kmh,
            transport_speed_kmh=f * c.transport_speed_kmh,
            grain_kg_s=None if c.grain_kg_s is None else f * c.grain_kg_s,
        )  # fmt: skip
    carts = {
        name: replace(k, speed_kmh=factor() * k.speed_kmh, unload_l_s=factor() * k.unload_l_s)
        for name, k in job.carts.items()
    }
    field = replace(job.field, yield_t_ha=factor() * job.field.yield_t_ha)
    truck = replace(job.truck, dock_s=factor() * job.truck.dock_s, away_min=factor() * job.truck.away_min)
    return replace(job, combines=combines, carts=carts, field=field, truck=truck)


def spread_of(
    job: JobFile, base: Path | None, percent: float, out: Path | None = None,
    told: Callable[[str], None] = lambda _: None,
) -> tuple[list[float], list[str]]:  # fmt: skip
    """Hours of the draws [s], and why draws that are refused are. InputError unless 0 < percent <= MOST.

    out: folder that keeps what is done: a job that was stopped goes on. told: called for each draw
    """
    if not 0.0 < percent <= MOST:
        raise InputError("--spread", percent, f"expected more than 0 and at most {num(MOST)} percent")
    kept = _kept(out, key := _key(job, base, percent))
    for number in range(len(kept), DRAWS):
        told(f"draw {number + 1} of {DRAWS}")
        try:
            kept.append(by_events(schedule_of(drawn(job, number, percent / 100.0), base)).ends)
        except InputError as error:
            kept.append(str(error))
        if out is not None:
            write_whole(out / FILE, json.dumps({"job": key, "draws": kept}) + "\n")
    return [k for k in kept if isinstance(k, float)], [k for k in kept if isinstance(k, str)]


def _key(job: JobFile, base: Path | None, percent: float) -> str:
    """Of a job with its dispatcher's and machines' files as they are now."""
    sheets = [*(c.machine for c in job.combines.values()), *(k.machine for k in job.carts.values())]
    files = [file_of(name, base) for name in (job.fleet.dispatcher, job.truck.machine, *sheets)]
    texts = [file_hash(file) for file in files if os.path.isfile(file)]
    return sha256(f"{job} {percent} {texts}".encode()).hexdigest()


def _kept(out: Path | None, key: str) -> list[float | str]:
    """Draws of this job that a folder has."""
    file = None if out is None else out / FILE
    if file is None or not os.path.isfile(file):
        return []
    try:
        found = read_object(file, "draws", "draws of a job")
        return list(found["draws"]) if found["job"] == key else []
    except (InputError, KeyError, TypeError):
        return []
