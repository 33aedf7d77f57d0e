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
OFTEN, LONGEST = 500.0, 200.0  # s between two stops of a combine, in the mean, and of a stop, at most


class Timing:
    """When all are at their ends, if each stops now and then, as for a cart: the mean of some draws.

    least: if nobody waited for another one, and their ways were equally long [s]
    """

    def __init__(self, ways: Ways) -> None:
        self._step = ways.step
        self._at = [list(zip(w.task.tolist(), w.way.tolist(), strict=True)) for w in ways.samples]
        self._of = {task: n for n, routes in enumerate(ways.routes) for task in routes}
        self._whole = [len(own) * ways.step for own in self._at]
        draw = random.Random(1)
        self._stops = [[_stops(draw, whole) for whole in self._whole] for _ in range(DRAWS)]
        stood = [max(sum(stop.until for stop in own) for own in stops) for stops in self._stops]
        self.least = sum(self._whole) / len(self._whole) + sum(stood) / DRAWS

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


def _stops(draw: random.Random, whole: float) -> list[Wait]:
    """Of a combine on a way of so many seconds."""
    found, at = [], draw.expovariate(1.0 / OFTEN)
    while at < whole:
        found.append(Wait(at, NONE, draw.uniform(0.0, LONGEST)))
        at += draw.expovariate(1.0 / OFTEN)
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
