"""Where combines wait for each other: at the end of a pass, not between passes, where carts come by."""

from bisect import bisect_left
from collections.abc import Sequence
from math import inf

from swath.tools.fleet.order import Rule, Ways

LATER = 0.02  # of their time, that all may take longer for it
SHORT = 0.5  # m before the end of the pass


def at_pass_ends(rules: list[list[Rule]], ways: Ways) -> list[list[Rule]]:
    """The rules with waits between passes moved to the end of the pass before, where all come to their ends
    then, too.
    """
    made = [list(own) for own in rules]
    most = (1.0 + LATER) * time_of(made, ways)
    for own, routes in zip(made, ways.routes, strict=True):
        for k, rule in enumerate(own):
            route = routes[int(rule["task"])]
            if rule["way_m"] <= route.length:
                continue
            own[k] = {**rule, "way_m": round(route.length - SHORT, 3)}
            if time_of(made, ways) > most:
                own[k] = rule
    return made


def time_of(rules: Sequence[Sequence[Rule]], ways: Ways) -> float:
    """When all are at their ends, if they drive whenever they may [s]; inf where they wait for each other for
    good.
    """
    step, at = ways.step, [list(zip(w.task.tolist(), w.way.tolist(), strict=True)) for w in ways.samples]
    of = {task: n for n, routes in enumerate(ways.routes) for task in routes}
    waits = [
        sorted(
            (max(bisect_left(at[n], (r["task"], r["way_m"] + 1e-3)) - 1, 0), of[int(r["other"])],
             bisect_left(at[of[int(r["other"])]], (r["other"], r["other_m"] - 1e-3)))
            for r in own
        )
        for n, own in enumerate(rules)
    ]  # fmt: skip
    left: dict[tuple[int, int], float | None] = {}

    def reached(n: int, sample: int) -> float:
        before = bisect_left(waits[n], (sample, -1, -1)) - 1
        return sample * step if before < 0 else leaves(n, before) + (sample - waits[n][before][0]) * step

    def leaves(n: int, k: int) -> float:
        if (n, k) in left:
            known = left[n, k]
            return inf if known is None else known  # it waits for itself
        left[n, k] = None
        sample, other, until = waits[n][k]
        come = leaves(n, k - 1) + (sample - waits[n][k - 1][0]) * step if k else sample * step
        made = max(come, reached(other, min(until, len(at[other]) - 1)))
        left[n, k] = made
        return made

    return max(reached(n, len(at[n])) for n in range(len(at)))
