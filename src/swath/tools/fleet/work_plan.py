"""Who cuts which pass, in which order, and who waits for whom where ways of combines meet.

With lands of their own combines take the passes that they take at `events`. Which these are turns over by a
few seconds, and whether two of them then come against each other on neighbouring passes, where one has to
wait for the whole pass of the other one, is not asked there. So several ways of sharing out are made, from
speeds that differ a little, and planned to the end. Driven is the one that is over first by events, with what
combines wait for each other if they stop now and then, as they do for carts.
"""

import random
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf
from typing import Any, NamedTuple

from swath.control.job.crossings import Crossing, GivesWay
from swath.control.job.passes import RUN_OUT, Pass
from swath.control.steer.path import Segment
from swath.core.errors import InputError
from swath.core.units import KMH
from swath.job.fleet import FleetFile
from swath.job.machines import Combine, Fleet
from swath.job.plan import FieldPlan, Shared
from swath.tools.fleet import echelon, lands
from swath.tools.fleet.combine_turns import shared
from swath.tools.fleet.order import NO_ORDER, RUN_UP, Meeting, Member, Rule

TRIES, MOST_TRIES = 12, 48  # ways of sharing out; as many at most as long as none can be driven
SPREAD = 0.12  # of the speeds, from those of the machines
GOOD = 1.03  # of the time without waits and with equal ways: no other way of sharing out is looked for
ENDLESS = 1e9  # kg
ROOM = 0.95  # of a tank, for passes beside which no cart can be
OVER = 0.05  # of a tank, more than that: it is full in a pass beside which no cart can be
TOO_MUCH = "expected room for a cart beside passes before a tank is full: {:.0f} kg too much"
NO_PASS = "expected a pass for every combine with sensors or --shared-out"
MOST = 3  # combines, carts


class WorkPlan(NamedTuple):
    """shared: passes in the order in which they are begun; rows: these as the scenario has them; team: start
    and settings of each combine
    """

    shared: Shared
    rows: list[dict[str, Any]]
    team: list[Member]


def work_plan(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> WorkPlan:
    """The plan of a job with sensors. InputError for what this level cannot do."""
    _check(file, plan, fleet)
    combines, team = fleet.combines, [Member(RUN_UP, {}, RUN_OUT)]
    if len(combines) > 1 and file.team.together != "echelon":
        return _least(file, plan, fleet)
    made = shared(plan, echelon.assigned(plan, len(combines)), combines)
    rows = passes_of(made, combines, file)
    told = told_passes(rows)
    if len(combines) > 1:
        team = echelon.members(told, combines, file)
    return WorkPlan(made._replace(told=told), rows, team)


def share_out(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> Shared:
    """As with sensors, for the other levels. InputError as `work_plan`."""
    return work_plan(file, plan, fleet).shared


def _least(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> WorkPlan:
    """With lands of their own: of several ways of sharing out the one that is over first, of those for which
    the tanks have room.
    """
    found: list[tuple[float, float, WorkPlan]] = []
    known: list[list[dict[str, Any]]] = []
    combines, all_cut = fleet.combines, False
    most, refused = OVER * min(c.tank for c in fleet.combines), inf
    for n, (tried_plan, tried) in enumerate(_tries(file, plan, fleet)):
        if n >= TRIES and found:
            break
        taken = lands.taken_by_events(file, tried_plan, tried)
        if len(set(taken.by)) < len(combines):
            continue
        all_cut = True
        over = _too_much(taken, _may_stand(taken.plan, taken.by, file), combines, file.field.yield_t_ha)
        if over > most:
            refused = min(refused, over)
            continue
        made = lands.with_turns(taken, tried.combines)
        rows = passes_of(made, combines, file)
        if rows in known:
            continue
        known.append(rows)
        told = told_passes(rows)
        team = lands.team_of(told, combines)
        if team is None:
            continue
        made = made._replace(told=told, crossings=[_crossing(k) for k in team.crossings])
        found.append((over, team.waits, WorkPlan(made, rows, team.members)))
        if over <= 0.0 and team.end <= GOOD * team.least:
            break
    if not all_cut:
        raise InputError("combines", len(combines), NO_PASS)
    if not known:
        raise InputError("plan.order", file.plan.order, TOO_MUCH.format(refused))
    if not found:
        raise InputError("plan", None, NO_ORDER)
    least = min(over for over, _, _ in found)
    fits = [(waits, work) for over, waits, work in found if over == least]
    hours = [lands.hours_of(file, work.shared, fleet) + waits for waits, work in fits]
    return fits[hours.index(min(hours))][1]


def _tries(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> Iterator[tuple[FieldPlan, Fleet]]:
    """Plan and combines as they are, then with other speeds, every other time with tanks that never fill: who
    stands for carts comes to other passes than planned; and lands of neighbouring passes begun from the other
    end: the second pass has the first one on its left there, or it has not. Not so where lands are driven
    round and round, or the passes are those of a file.
    """
    yield plan, fleet
    draw = random.Random(1)
    keeps_direction = file.plan.order == "lands" or file.field.file is not None or file.field.log is not None
    for n in range(1, MOST_TRIES):
        combines = [
            _varied(c, 0.0 if n == 1 else draw.uniform(-SPREAD, SPREAD), n % 2 == 1) for c in fleet.combines
        ]
        passes = [
            p.reversed() if p.kind != "headland" and not keeps_direction and n >> p.land & 1 else p
            for p in plan.passes
        ]
        yield replace(plan, passes=tuple(passes)), replace(fleet, combines=tuple(combines))


def _varied(combine: Combine, faster: float, never_full: bool) -> Combine:
    """A combine that is faster by a share."""
    tank, call = (ENDLESS, ENDLESS) if never_full else (combine.tank, combine.call)
    return replace(combine, speed=combine.speed * (1.0 + faster), tank=tank, call=call)


def _too_much(
    of: lands.Taken, stand: Sequence[bool], combines: Sequence[Combine], yield_t_ha: float
) -> float:
    """Most grain [kg] for which a tank has no room where a combine cuts several passes, one after the other,
    beside which no cart can be.
    """
    most = 0.0
    for number, combine in enumerate(combines):
        load = 0.0
        for p, by, stands in zip(of.plan.passes, of.by, stand, strict=True):
            if by == number:
                blind = not (p.cart_beside or stands)
                load = load + p.area * yield_t_ha / 10.0 if blind else 0.0
                most = max(most, load - ROOM * combine.tank)
    return most


def _may_stand(plan: FieldPlan, by: Sequence[int], file: FleetFile) -> list[bool]:
    """Whether a cart can stand beside each pass beside which none can drive: those of the outermost round, if
    cut clockwise, and the last one of a combine, which gives its last grain there.
    """
    lasts = {number: i for i, number in enumerate(by)}
    clockwise = file.plan.headland == "clockwise"
    return [
        not p.cart_beside
        and ((p.kind == "headland" and p.round_index == 0 and clockwise) or lasts[by[i]] == i)
        for i, p in enumerate(plan.passes)
    ]


def passes_of(of: Shared, combines: Sequence[Combine], file: FleetFile) -> list[dict[str, Any]]:
    """Passes with the turns behind them, to the next one of the same combine."""
    rows = []
    plan, by, turns = of.plan, of.by, of.turns
    stand = _may_stand(plan, by, file)
    for i, p in enumerate(plan.passes):
        combine = combines[by[i]]
        grain = p.area * file.field.yield_t_ha / 10.0 / p.length
        row: dict[str, Any] = {
            "line_m": [rounded(q) for q in p.line.tolist()],
            "cart_beside": bool(p.cart_beside),
            "speed_kmh": round(combine.speed_in(grain) / KMH, 4),
            "width_m": round(p.area / p.length, 3),
        }
        if stand[i]:
            row["cart_standing"] = True
        if by[i]:
            row["combine"] = by[i]
        if i in turns:
            row["turn"] = [
                {"length_m": q.length, "curvature_per_m": q.first, "to_per_m": q.last}
                for q in turns[i]
                if q.length > 1e-6
            ]
        rows.append(row)
    return rows


def told_passes(rows: list[dict[str, Any]]) -> list[Pass]:
    """The passes as a machine is told them."""
    return [
        Pass(
            tuple((x, y) for x, y in row["line_m"]), row["cart_beside"], row["speed_kmh"],
            tuple(Segment(**segment) for segment in row.get("turn", [])), row.get("combine", 0),
            row.get("cart_standing", False),
        )
        for row in rows
    ]  # fmt: skip


def _crossing(of: Meeting) -> Crossing:
    first, instead = (tuple(_rule(rule) for rule in of.get(key, ())) for key in ("first", "instead"))
    return Crossing(first, instead)


def _rule(of: Rule) -> GivesWay:
    return GivesWay(int(of["task"]), of["way_m"], int(of["other"]), of["other_m"], of.get("wait_m"))


def rounded(point: Any) -> list[float]:
    """As a scenario has it: to a micrometre."""
    return [round(float(v), 6) for v in point]


def _check(file: FleetFile, plan: FieldPlan, fleet: Fleet) -> None:
    for key, found in (("combines", fleet.combines), ("carts", fleet.carts)):
        if len(found) > MOST:
            raise InputError(key, len(found), f"expected {MOST} at most with sensors or --shared-out")
    if plan.holes:
        raise InputError("field", None, "expected a field without holes, with sensors or --shared-out")
    if file.unload.mode != "on_the_go":
        raise InputError("unload.mode", file.unload.mode, "expected on_the_go, with sensors or --shared-out")
