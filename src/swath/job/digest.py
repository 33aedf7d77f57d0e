"""The digest of what a job did."""

import hashlib
import struct

from swath.job.engine import Job
from swath.job.states import CartState, CombineState


def digest_of(job: Job) -> str:
    """Fingerprint of a job, 64 hexadecimal digits: every span of every timeline, grain, fuel and ways of all
    machines, times of the passes, and where they stand (SHA-256, FIPS 180-4).
    """
    numbers: list[float] = [job.time, job.at_truck]
    words: list[str] = []
    machines: list[CombineState | CartState] = [*job.combines, *job.carts]
    for m in machines:
        numbers += [*m.place, m.way, m.fuel, *(x for s in m.timeline.spans for x in (s.start, s.end))]
        words += [m.spec.name, *(f"{s.state} {s.pass_index}" for s in m.timeline.spans)]
    for c in job.combines:
        numbers += [c.cut, c.area, c.poured, c.tank, *(x for load in c.loads for x in load[:2])]
    for k in job.carts:
        numbers += [k.grain, k.delivered]
    for index, times in sorted(job.pass_times.items()):
        numbers += [index, *times]
    for way in job.ways:
        numbers += way.ravel().tolist()
    for track in getattr(job.motion, "tracks", ()):
        numbers += [x for pose in track for x in pose]
    made = hashlib.sha256("\n".join(words).encode())
    made.update(struct.pack(f"<{len(numbers)}d", *numbers))
    return made.hexdigest()
