"""Jobs written down otherwise, or with a little more of something."""

import math
from dataclasses import replace

import numpy as np


def placed(job, change):
    """A job all of whose points are moved by a function of rings."""
    field = job.field
    ((x, y),) = change([(job.truck.x_m, job.truck.y_m)])
    field = replace(
        field, boundary_m=change(field.boundary_m),
        parts_m=[change(r) for r in field.parts_m], holes_m=[change(r) for r in field.holes_m],
        ways_m=[change(w) for w in field.ways_m],
    )  # fmt: skip
    gate = job.truck.gate_m and change([job.truck.gate_m])[0]
    return replace(job, field=field, truck=replace(job.truck, x_m=x, y_m=y, gate_m=gate))


def rings(job, change):
    """The same for outlines alone."""
    return replace(placed(job, change), truck=job.truck)


def split(ring, every=17.0):
    """Points added on the sides."""
    points = []
    for (x, y), (u, v) in zip(ring, [*ring[1:], ring[0]], strict=True):
        n = max(1, math.ceil(math.dist((x, y), (u, v)) / every))
        points += [(x + k / n * (u - x), y + k / n * (v - y)) for k in range(n)]
    return points


def turned(job, degrees, east=0.0):
    """Turned on the map, and moved [m]."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return placed(job, lambda ring: [(c * x - s * y + east, s * x + c * y) for x, y in ring])


def mirrored(job):
    """In a mirror, with its pipes."""
    other = "clockwise" if job.plan.headland == "counterclockwise" else "counterclockwise"
    combines = {name: replace(c, pipe="right") for name, c in job.combines.items()}
    job = replace(job, plan=replace(job.plan, headland=other), combines=combines)
    return placed(job, lambda ring: [(x, -y) for x, y in ring])


def other_machines(job):
    """Other names, in another order."""
    combines, carts = (
        {f"{letter}{9 - i}": m for i, m in reversed([*enumerate(own.values())])}
        for own, letter in ((job.combines, "z"), (job.carts, "k"))
    )
    return replace(job, combines=combines, carts=carts)


def nudged(job, far, seed=1):
    """Corners moved by a distance [m], each in its own direction."""
    rng = np.random.default_rng(seed)

    def change(ring):
        angle = rng.uniform(0.0, 2.0 * math.pi, len(ring)).tolist()
        return [(x + far * math.cos(a), y + far * math.sin(a)) for (x, y), a in zip(ring, angle, strict=True)]

    return rings(job, change)


SAME = {
    "reversed": lambda job: rings(job, lambda r: [*r][::-1]),
    "another first point": lambda job: rings(job, lambda r: [*r[2:], *r[:2]]),
    "points every 17 m": lambda job: rings(job, split),
    "turned by 37 deg": lambda job: turned(job, 37.0),
    "moved by 100 km": lambda job: turned(job, 0.0, 100_000.0),
    "mirrored": mirrored,
    "machines": other_machines,
}
NEARLY = {f"corners by {far:g} mm": lambda job, far=far: nudged(job, far / 1000.0) for far in (1, 5, 20)}


def one_more(job, section):
    """With a machine more like the last one."""
    own = getattr(job, section)
    last = [*own.values()][-1]
    return replace(job, **{section: {**own, "added": last}})


def each(job, section, **factors):
    """Keys of all machines of a section times a factor."""
    own = {
        name: replace(m, **{key: factor * getattr(m, key) for key, factor in factors.items()})
        for name, m in getattr(job, section).items()
    }
    return replace(job, **{section: own})


MORE = {  # what must not cost time: a function, and whether a job has what it changes
    "one combine more": (lambda job: one_more(job, "combines"), lambda job: True),
    "one cart more": (lambda job: one_more(job, "carts"), lambda job: job.carts),
    "trucks twice as large": (
        lambda job: replace(job, truck=replace(job.truck, volume_m3=2.0 * job.truck.volume_m3)),
        lambda job: job.truck.volume_m3,
    ),
    "wider headers": (
        lambda job: each(job, "combines", header_width_m=1.1),
        lambda job: all(c.header_width_m for c in job.combines.values()),
    ),
    "faster carts": (lambda job: each(job, "carts", speed_kmh=1.3), lambda job: job.carts),
    "carts filled to more": (
        lambda job: each(job, "carts", fill_percent=100.0 / 95.0),
        lambda job: job.carts,
    ),
}
