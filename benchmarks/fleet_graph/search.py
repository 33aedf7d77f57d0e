"""The best of many plans of a job, with a fixed seed and a budget in plans; some with machines parked."""

import math
import random
import time
from dataclasses import dataclass, field, replace

from benchmarks.fleet_graph.as_schedule import schedule_of
from benchmarks.fleet_graph.decode import Choices, Decoder, NoEnd
from benchmarks.fleet_graph.lanes import Lanes
from benchmarks.fleet_graph.reserved import INF, Reserved

from swath.fleet.files import JobFile
from swath.fleet.schedule import Schedule
from swath.fleet.search import least_time
from swath.fleet.worked import Worked, by_events

CALLS, LEVELS = (0.2, 0.3, 0.4, 0.5, 0.65), (0.35, 0.5, 0.65, 0.8, 0.95)
COSTS, LATE = (0.0, 30.0, 60.0, 120.0, 240.0), (0.0, 0.0, -60.0, 30.0, 90.0)
BIAS = (-100.0, -40.0, 40.0, 100.0)


@dataclass
class Found:
    """hours: by `by_events`, inf without a plan; decoded: by the plan; plans, ended: how many; circles: of
    schedules; graph_s, plans_s: CPU; bound [h]; why: plans have no end.
    """

    hours: float = math.inf
    decoded: float = math.inf
    choices: Choices | None = None
    worked: Worked | None = None
    schedule: Schedule | None = None
    plans: int = 0
    ended: int = 0
    circles: int = 0
    graph_s: float = 0.0
    plans_s: float = 0.0
    bound: float = 0.0
    why: dict[str, int] = field(default_factory=dict)


def best_of(job: JobFile, plans: int, lanes: Lanes | None = None) -> Found:
    """The best plan; one that would be it is looked at by the house's own code."""
    out, t = Found(), time.process_time()
    lanes = lanes or Lanes(job)
    reserved = Reserved(lanes)
    out.graph_s = time.process_time() - t
    out.bound = least_time(job, lanes.machines, lanes.ground) / 3600.0
    t = time.process_time()
    most = len(lanes.machines.combines), len(lanes.machines.carts)
    top: list[tuple[float, int, Choices]] = []
    draw = random.Random(1)

    def look(p: Choices) -> None:
        out.plans += 1
        worst = top[min(3, len(top) - 1)][0] * 3600.0 if len(top) > 3 else INF
        decoder = Decoder(lanes, reserved, p, worst)
        try:
            hours = decoder.run()
        except NoEnd as e:
            why = "".join(c for c in str(e) if not c.isdigit())
            out.why[why] = out.why.get(why, 0) + 1
            return
        out.ended += 1
        if hours < out.decoded:
            schedule = schedule_of(decoder)
            try:
                worked = by_events(schedule)
            except ValueError:
                out.circles += 1
                return
            if worked.ends / 3600.0 < out.hours:
                out.hours, out.decoded, out.choices = worked.ends / 3600.0, hours, p
                out.worked, out.schedule = worked, schedule
        top.append((round(hours, 6), out.plans, p))
        top.sort(key=lambda row: row[:2])
        del top[12:]

    fleets = [most]
    fleets += [(most[0], n) for n in range(most[1] - 1, 0, -1)] + [
        (n, most[1]) for n in range(most[0] - 1, 0, -1)
    ]
    for n, (c, k) in enumerate(fleets):
        for lane in (150.0, 500.0) if n == 0 else (150.0,):
            for call in (0.3, 0.5) if k and n == 0 else (0.4,):
                if out.plans < plans:
                    look(Choices(c, k, call=call, lane=lane))
    while out.plans < plans:
        base = top[draw.choice((0, 0, 0, 1, 2)) % len(top)][2] if top else Choices(*most)
        look(_changed(base, draw, most, len(lanes.plan.passes)))
    out.plans_s = time.process_time() - t
    return out


def _changed(p: Choices, draw: random.Random, most: tuple[int, int], passes: int) -> Choices:
    """One or two choices otherwise."""
    for _ in range(draw.choice((1, 1, 2))):
        key = draw.choice(
            ("call", "full", "leave", "lane", "other", "bias", "bias", "bias", "cart", "late", "fleet")
        )
        if key == "call":
            p = replace(p, call=draw.choice(CALLS))
        elif key in ("full", "leave"):
            p = replace(p, **{key: draw.choice(LEVELS)})
        elif key in ("lane", "other"):
            p = replace(p, **{key: draw.choice(COSTS) * (3.0 if key == "lane" else 1.0)})
        elif key == "bias":
            who, number = draw.randrange(p.combines), draw.randrange(passes)
            rest = {b for b in p.bias if b[:2] != (who, number)}
            p = replace(p, bias=frozenset(rest | {(who, number, draw.choice(BIAS))}))
        elif key == "cart":
            p = replace(p, cart=p.cart ^ {draw.randrange(1, 40)})
        elif key == "late":
            p = replace(p, late=tuple(draw.choice(LATE) for _ in range(p.combines)))
        elif draw.random() < 0.3:
            n = draw.randint(1, most[0])
            k = draw.randint(1, most[1]) if most[1] else 0
            p = replace(p, combines=n, carts=k, late=p.late[:n] if len(p.late) >= n else ())
    return p
