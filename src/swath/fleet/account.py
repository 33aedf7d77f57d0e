"""What a job used and held: grain in tanks and boxes over time, ways, diesel."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swath.fleet.machines import Cart, Combine
from swath.fleet.table import Segment
from swath.fleet.worked import CUT, IDLE, Worked, state_of
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.fuel import DIESEL, combine_fuel, tractor_fuel

Array = NDArray[np.float64]
SHORT = 1e-3  # s, least time that grain takes to flow
AT_ONCE = 4000  # times that bodies are looked at together


@dataclass(frozen=True)
class Used:
    """way: driven [m]; litres: of diesel"""

    way: float
    litres: float


def stays(w: Worked) -> Iterator[tuple[Segment, float, float]]:
    """Each segment with the times of its entry and of leaving it; the last of a machine ends with the job
    [s].
    """
    over = max(w.ends, w.cut, *w.into.tolist()) if len(w.into) else 0.0
    for s in w.schedule.table.segments:
        yield s, float(w.into[s.number]), float(w.into[s.next]) if s.next >= 0 else over


def grain(w: Worked) -> dict[str, tuple[Array, Array]]:
    """Of each machine, and of `truck`: times [s] and what it holds then [kg], straight between."""
    flows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in (*w.spans, "truck")}
    for s, into, _ in stays(w):
        if s.number in w.schedule.grain:
            flows[s.machine].append((into, into + s.spent, w.schedule.grain[s.number]))
    for p in w.poured:
        flows[p.source].append((p.begins, p.ends, -p.amount))
        flows[p.target].append((p.begins, p.ends, p.amount))
    starts = {c.name: c.start for c in w.schedule.machines.combines}
    return {name: _summed(starts.get(name, 0.0), rows) for name, rows in flows.items()}


def _summed(start: float, flows: list[tuple[float, float, float]]) -> tuple[Array, Array]:
    """Times and levels of even flows (begin, end [s], amount [kg])."""
    if not flows:
        return np.zeros(1), np.array([start])
    begin, end, amount = np.array(flows).T
    end = np.maximum(end, begin + SHORT)
    rate = amount / (end - begin)
    times, place = np.unique(np.concatenate([[0.0], begin, end]), return_inverse=True)
    change = np.zeros(len(times))
    np.add.at(change, place[1:], np.concatenate([rate, -rate]))
    gained = np.cumsum(np.cumsum(change)[:-1] * np.diff(times))
    return times, start + np.concatenate([[0.0], gained])


def used(w: Worked) -> dict[str, Used]:
    """Of each machine. Engines run while a machine waits, and stop where it has nothing to do for good."""
    held = grain(w)
    machines = w.schedule.machines.by_name
    pours = {n: p for p in w.poured if p.target != "truck" for n in range(p.during[0], p.during[1] + 1)}
    way = dict.fromkeys(w.spans, 0.0)
    burnt = dict.fromkeys(w.spans, 0.0)
    for s, into, out in stays(w):
        m = machines[s.machine]
        length = float(
            s.path.track.distance[s.path.last[s.index]] - s.path.track.distance[s.path.first[s.index]]
        )
        way[s.machine] += length
        if s.next < 0 and state_of(s) == IDLE:
            continue
        moves = min(s.spent, out - into) if length > 0.0 else 0.0
        load = float(np.interp(0.5 * (into + out), *held[s.machine]))
        speed = length / moves if moves > 0.0 else 0.0
        p = pours.get(s.number)
        is_pouring = p is not None and p.source == s.machine and p.begins < out and p.ends > into
        come = w.schedule.grain.get(s.number, 0.0)
        for time, v in ((moves, speed), (out - into - moves, 0.0)):
            if time > 0.0:
                cuts = state_of(s) == CUT and v > 0.0
                burnt[s.machine] += time * _rate(m, load, v, come / time if cuts else 0.0, cuts, is_pouring)
    return {name: Used(way[name], burnt[name] / DIESEL) for name in w.spans}


def _rate(m: Combine | Cart, load: float, speed: float, come: float, cuts: bool, is_pouring: bool) -> float:
    """Fuel of a machine [kg/s]."""
    if isinstance(m, Cart):
        return tractor_fuel(m.sheet, load, speed)
    out = m.auger if is_pouring else 0.0
    return combine_fuel(
        m.sheet, drivetrain_of(m.sheet), tank=load, speed=speed, grain=come, cuts=cuts, out=out
    )


def contact(w: Worked) -> dict[tuple[str, str], float]:
    """How long driven bodies are over each other [s], of each two machines that ever are."""
    machines, found = w.schedule.machines.by_name, {}
    for (a, at_a), (b, at_b) in combinations(w.places.items(), 2):
        one, two = machines[a].body, machines[b].body
        near = np.flatnonzero(np.hypot(*(at_a[:, :2] - at_b[:, :2]).T) < one.reach + two.reach)
        parts = (near[i : i + AT_ONCE] for i in range(0, len(near), AT_ONCE))
        count = sum(int(_over(one.outlines(at_a[n]), two.outlines(at_b[n])).sum()) for n in parts)
        if count:
            found[a, b] = count * float(w.clock[1] - w.clock[0])
    return found


def _over(one: Array, two: Array) -> NDArray[np.bool_]:
    """Whether any convex outlines (n, r, 4, 2), anticlockwise, overlap those of another body, (n,): no side
    of either has all of the other one outside.
    """
    apart = np.zeros((len(one), one.shape[1], two.shape[1]), bool)
    for a, b, pairs in ((one, two, apart), (two, one, apart.swapaxes(1, 2))):
        side = np.roll(a, -1, axis=2) - a
        normal = np.stack([side[..., 1], -side[..., 0]], axis=-1)
        at = (normal * a).sum(axis=-1)
        far = np.einsum("nrsk,nqck->nrqsc", normal, b).min(axis=-1)
        pairs |= (far >= at[:, :, None]).any(axis=-1)
    return ~apart.all(axis=(1, 2))


def litres_per_ha(w: Worked) -> float:
    """Diesel of all machines over what is cut."""
    area = math.fsum(area for _, _, area in w.schedule.cut)
    return math.fsum(u.litres for u in used(w).values()) / max(area / 1e4, 1e-9)
