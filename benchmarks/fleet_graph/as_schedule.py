"""A decoded plan as a schedule of the house: exact bodies along whole paths, in the order of the plan.

So its order, its hours and its bodies are looked at by the same code as those of any other schedule.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from benchmarks.fleet_graph.decode import ALIGN_S, Decoder, Mover, Step
from benchmarks.fleet_graph.lanes import LINE_M

from swath.fleet.machines import Place
from swath.fleet.plan import Plan
from swath.fleet.schedule import Poured, Schedule
from swath.fleet.table import Path, segments, standing
from swath.fleet.ways import Track, behind, driven, joined, rolled, spent_along, times_along

PARTS = 3  # of an edge on which grain is cut or poured
ROLLED = ("way", "to combine", "to truck", "to its place", "way to unload")


def schedule_of(d: Decoder) -> Schedule:
    """The schedule of a plan that has an end."""
    lanes = d.lanes
    names = {m.spec.name for m in d.movers}
    machines = replace(
        lanes.machines,
        combines=tuple(c for c in lanes.machines.combines if c.name in names),
        carts=tuple(k for k in lanes.machines.carts if k.name in names),
    )
    plan = Plan(lanes.plan.passes, lanes.plan.area, lanes.left, lanes.plan.notes)
    made = Schedule(plan, machines, lanes.ground, dock=lanes.job.truck.dock_s)
    of_key: dict[tuple[int, int], list[int]] = {}
    for m in d.movers:
        body = m.spec.body
        start = lanes.nodes[m.home][1]
        made.table.stand(m.spec.name, standing(start, body, 0.0, "home"), -1.0)
        rows = _paths(d, m)
        whole, times, marks = None, [], []
        for step, path in rows:
            share = np.concatenate([[0.0], np.cumsum(path.spent)[:-1]]) / max(float(path.spent.sum()), 1e-9)
            first = len(times)
            times += (step.begins + (step.ends - step.begins) * share).tolist()
            marks.append((step, first, len(times)))
            whole = path if whole is None else whole.then(path)
        if whole is None:
            continue
        numbers = made.table.commit(m.spec.name, whole, times)
        for step, first, last in marks:
            own = numbers[first:last]
            if step.key != -1:
                of_key[m.number, step.key] = own
            if step.cell >= 0:
                made.cut.append((m.spec.name, step.mass, lanes.areas[step.cell]))
                for n in own:
                    made.grain[n] = step.mass / len(own)
    by_number = {m.number: m for m in d.movers}
    for p in d.poured:
        source = by_number[p.source]
        if p.target < 0:
            (n,) = of_key[p.source, p.key]
            made.poured.append(Poured(source.spec.name, "truck", p.amount, p.begins, p.ends, (n, n)))
            continue
        target = by_number[p.target]
        keys = sorted(k for q, k in of_key if q == p.target and k // 1000 == p.key // 1000 and k >= 0)
        mine, its = ([n for k in keys for n in of_key[q, k]] for q in (p.source, p.target))
        made.table.together += [*zip(mine, its, strict=True)]
        made.poured.append(
            Poured(source.spec.name, target.spec.name, p.amount, p.begins, p.ends, (mine[0], mine[-1]))
        )
    made.ends = d.ends
    return made


def _paths(d: Decoder, m: Mover) -> list[tuple[Step, Path]]:
    """Steps of a machine with their ground, each from where the one before ends."""
    body, drive = m.spec.body, m.spec.drive
    place: Place = d.lanes.nodes[m.home][1]
    out: list[tuple[Step, Path]] = []
    steps = [s for s in m.steps if s.edge >= 0 or s.ends > s.begins + 1e-6 or s.key != -1]
    i = 0
    while i < len(steps):
        if steps[i].edge < 0:
            s = steps[i]
            spent = {"waits": 0.0, "waits for cart": 0.0, "beside": ALIGN_S}.get(s.what, s.ends - s.begins)
            out.append((s, standing(place, body, spent, s.what)))
            i += 1
            continue
        j = i
        while j < len(steps) and steps[j].edge >= 0 and steps[j].what == steps[i].what:
            j += 1
        tracks: list[Track] = []
        for s in steps[i:j]:
            track = _dragged(_exact(d, s), place, body)
            tracks.append(track)
            place = track.end
        whole = joined(tracks)
        is_way = steps[i].what in ROLLED
        times = times_along(whole, drive) if is_way else None
        begin = 0
        for s, track in zip(steps[i:j], tracks, strict=True):
            last = len(track.places) - 1
            if times is not None:
                out.append((s, segments(track, times[begin : begin + last + 1], body, s.what)))
                begin += last
                continue
            index = np.unique(np.linspace(0, last, PARTS + 1).round().astype(int))
            path = segments(track, track.distance, body, s.what, track.distance[index])
            path.spent = spent_along(track, drive, path.first, path.last)
            if s.what == "cut":
                speed = m.spec.speed_in(s.mass / max(track.length, 1e-9))
                path.spent = np.maximum(path.spent, track.length / len(path) / speed)
            out.append((s, path))
        i = j
    out.append((Step(-1, m.node, m.time, m.time, "home"), standing(place, body, 0.0, "home")))
    return out


def _exact(d: Decoder, s: Step) -> Track:
    """The way along an edge, rolled anew where the graph has it to a centimetre."""
    edge = d.lanes.edges[s.edge]
    group, turned = d.lanes.groups[edge.group], d.lanes.turned.get((edge.a, edge.b))
    line = LINE_M * group.is_cart
    if edge.what != "way" or turned is None or abs(turned[0] + line - edge.track.length) > 0.1:
        return edge.track
    start, goal = d.lanes.nodes[edge.a][1], d.lanes.nodes[edge.b][1]
    if not group.is_cart:
        return rolled(start, goal, group.spec.drive, group.body)
    turn = rolled(start, goal.ahead(-LINE_M), group.spec.drive, group.body)
    return joined([turn, driven(turn.end, [(0.0, LINE_M)], group.body)])


def _dragged(track: Track, place: Place, body: Any) -> Track:
    """The same with the trailer as it comes, headings unwrapped on."""
    start = Place(*track.places[0, :2].tolist(), float(track.places[0, 2]), place.trailer)
    turns = 2.0 * math.pi * round((place.heading - start.heading) / (2.0 * math.pi))
    places = track.places + np.array([0.0, 0.0, turns, turns])
    if not body.has_trailer:
        return Track(places, track.distance, track.ways, track.bends)
    first = driven(Place(start.x, start.y, start.heading + turns, place.trailer), [(0.0, 1e-3)], body)
    out = behind(first, Track(places, track.distance, track.ways, track.bends), body)
    rows = out.places[-len(places) + 1 :]
    return Track(np.vstack([first.places[:1], rows]), track.distance, track.ways, track.bends)
