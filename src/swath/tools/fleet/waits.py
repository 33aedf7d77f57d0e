"""Where combines wait for each other: at the end of a pass, not between passes, where carts come by."""

import random
from bisect import bisect_left
from collections.abc import Mapping, Sequence

from swath.control.job.crossings import NONE, Wait, done_at
from swath.control.job.passes import Route
from swath.tools.fleet.order import SHORT_OF, Meeting, Rule, Ways

LATER = 0.02  # of their time, that all may take longer for it
SHORT = 0.5  # m before the end of the pass
DRAWS = 8  # of stops
SHIFTED, LONGER = 100.0, 2.0  # s, by which a stop comes sooner or later, at most; and how often as long it is
Stops = Sequence[Sequence[tuple[float, float]]]


class Timing:
    """When all are at their ends, if each stops now and then for a cart: the mean of some draws.

    stops: of each, after which share of its way, and for how long [s], as far as that is known: a draw has
    each of them sooner or later, and shorter or longer
    least: when they are, if nobody waited for another one, and all took equally long [s]
    """

    def __init__(self, ways: Ways, stops: Stops) -> None:
        self._step = ways.step
        self._at = [list(zip(w.task.tolist(), w.way.tolist(), strict=True)) for w in ways.samples]
        self._of = {task: n for n, routes in enumerate(ways.routes) for task in routes}
        self._whole = [len(own) * ways.step for own in self._at]
        draw = random.Random(1)
        known = list(zip(stops, self._whole, strict=True))
        self._stops = [[_drawn(draw, own, whole) for own, whole in known] for _ in range(DRAWS)]
        stood = [stop.until for drawn in self._stops for own in drawn for stop in own]
        self.least = (sum(self._whole) + sum(stood) / DRAWS) / len(self._whole)

    def wait(self, rule: Rule) -> tuple[int, Wait]:
        """Of a rule: who waits, and how."""
        n, other = self._of[int(rule["task"])], self._of[int(rule["other"])]
        hold = rule["task"], rule.get("wait_m", rule["way_m"]) + 1e-3
        until = bisect_left(self._at[other], (rule["other"], rule["other_m"] - 1e-3)) - SHORT_OF
        k = max(bisect_left(self._at[n], hold) - 1, 0)
        return n, Wait(k * self._step, other, min(until, len(self._at[other]) - 1) * self._step)

    def end(self, waits: Sequence[tuple[int, Wait]]) -> float:
        """Mean [s]; inf where they wait for each other for good."""
        nothing, found = [0.0 for _ in self._at], []
        for stops in self._stops:
            both = [list(own) for own in stops]
            for n, wait in waits:
                both[n].append(wait)
            found.append(max(done_at(nothing, self._whole, nothing, [sorted(own) for own in both])))
        return sum(found) / DRAWS


def _drawn(draw: random.Random, stops: Sequence[tuple[float, float]], whole: float) -> list[Wait]:
    """Stops of a combine on a way of so many seconds."""
    found = []
    for share, time in stops:
        at = min(max(share * whole + draw.uniform(-SHIFTED, SHIFTED), 0.0), whole)
        found.append(Wait(at, NONE, time * draw.uniform(0.0, LONGER)))
    return found


def at_pass_ends(
    crossings: Sequence[Meeting], routes: Mapping[int, Route], timing: Timing
) -> tuple[list[Meeting], float]:
    """The crossings with waits between passes moved to the end of the pass before, where all come to their
    ends then, too, as planned; and when they do so [s]. routes: of all passes
    """
    made = [{key: [dict(rule) for rule in rules] for key, rules in found.items()} for found in crossings]
    lengths = {task: route.length for task, route in routes.items()}
    for rule in (rule for found in made for rule in found.get("instead", ())):
        if rule["way_m"] > lengths[int(rule["task"])]:
            rule["wait_m"] = round(lengths[int(rule["task"])] - SHORT, 3)
    rules = [rule for found in made for rule in found["first"]]
    waits = [timing.wait(rule) for rule in rules]
    end = timing.end(waits)
    most = (1.0 + LATER) * end
    ends = [round(lengths[int(rule["task"])] - SHORT, 3) for rule in rules]
    moved = [k for k, rule in enumerate(rules) if rule["way_m"] > lengths[int(rule["task"])]]
    groups = [moved] if moved else []
    while groups:
        group = groups.pop()
        there = list(waits)
        for k in group:
            there[k] = timing.wait({**rules[k], "wait_m": ends[k]})
        then = timing.end(there)
        if then <= most:
            waits, end = there, then
            for k in group:
                rules[k]["wait_m"] = ends[k]
        elif len(group) > 1:
            half = len(group) // 2
            groups += [group[half:], group[:half]]
    return made, end
