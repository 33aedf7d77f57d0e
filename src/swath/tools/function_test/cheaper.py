"""Which levels may be cheap in a case: those with which its runs come to the same verdicts and numbers.

Each level of each slot is put alone in the place of the one that the case has; what agrees and saves time is
put together, and the least saving is left out until all together agree, too.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite

from swath.core.errors import InputError, SwathError
from swath.runtime.kept import KeptFields
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario
from swath.scenario.slots import REGISTRY
from swath.tools.function_test.judging.first_batch import name_first, telling_nothing
from swath.tools.function_test.one_run import results_in
from swath.tools.function_test.plan import Plan, PlannedRun
from swath.tools.function_test.stored_line import Result

WITHIN = 0.1  # of a limit: by more, a number with the cheap level is another one
LEAST_SAVED = 0.02  # of the time: less is the noise of a clock


@dataclass(frozen=True)
class Tried:
    """Runs of a case with other levels. sets: as after `--set`; cpu_s: of all runs, processor time.

    same: runs with the verdict that they had; as_before: with the same bytes
    apart: largest difference of a limited number over its limit
    why: it cannot be had, or disagrees; "" where it agrees
    """

    sets: tuple[str, ...]
    cpu_s: float
    same: int = 0
    apart: float = 0.0
    why: str = ""
    as_before: int = 0


@dataclass(frozen=True)
class Cheaper:
    """base: the case as it is; tried: one level each; together: those that are kept, all at once."""

    base: Tried
    tried: tuple[Tried, ...]
    together: Tried

    def saved(self, tried: Tried) -> float:
        """Share of the processor time."""
        return 1.0 - tried.cpu_s / max(self.base.cpu_s, 1e-9)


def find_cheaper(
    source: str,
    *,
    runs: int = 4,
    within: float = WITHIN,
    sets: Sequence[str] = (),
    progress: Callable[[str], None] = lambda text: None,
) -> Cheaper:
    """Try other levels in a case.

    Parameters
    ----------
    source : str
        A bundled case, or its file.
    runs : int
        How many runs of its grid are compared, those of the first seed first.
    within : float
        Difference of a limited number that still agrees, over the size of its limit.
    sets : sequence of str
        Changes of the scenario, as after `--set`.
    progress : callable
        Gets a line before each trial.

    Returns
    -------
    Cheaper
        What was tried, and what may be cheap together.

    Raises
    ------
    InputError
        Where the case cannot be had, or comes to no verdict as it is.
    """
    if runs < 1 or not within >= 0.0:
        raise InputError("--runs" if runs < 1 else "--within", min(runs, within), "expected more than that")
    plan = Plan(source, sets=tuple(sets))
    planned = sorted(plan.runs(), key=lambda run: run.seed)[:runs]
    progress("as it is")
    _done(planned[:1], ())  # the first one loads what all use
    before = _done(planned, ())
    if broken := next((r for r in before if r["verdict"] == "error"), None):
        raise InputError("case", source, f"expected runs that come to an end: {broken['reason']}")
    limited = [*_limited(before[0])]
    name_first({}, telling_nothing(before, limited, value_of=lambda run, name: _limited(run).get(name)))
    base = Tried((), _time(before), len(before))
    tried = []
    for change in _changes(planned[0]):
        progress(change)
        tried.append(_against(before, planned, (change,), within))
    kept = [t for t in tried if not t.why and t.cpu_s < (1.0 - LEAST_SAVED) * base.cpu_s]
    best = {t.sets[0].partition("=")[0]: t for t in sorted(kept, key=lambda t: -t.cpu_s)}
    chosen = sorted(best.values(), key=lambda t: t.cpu_s)
    together = base
    while chosen:
        progress("together: " + " ".join(t.sets[0] for t in chosen))
        together = _against(before, planned, tuple(t.sets[0] for t in chosen), within)
        if not together.why:
            break
        chosen, together = chosen[:-1], base
    return Cheaper(base, tuple(tried), together)


def _changes(run: PlannedRun) -> Iterator[str]:
    """Every other level of every slot, and of the terrain."""
    scenario = load_scenario(run.scenario, sets=run.sets)
    terrain = scenario.field.terrain
    slots = {} if terrain is None else {"field.terrain": ("terrain", terrain.level)}
    for name, machine in scenario.machines.items():
        slots |= {f"{name}.{slot}": (c.kind.name, c.level) for slot, c in machine.slots.items()}
    for key, (kind, present) in slots.items():
        for level in REGISTRY.names(kind):
            if level != present:
                yield f"{key}.level={level}"


def _against(
    before: Sequence[Result], planned: Sequence[PlannedRun], sets: tuple[str, ...], within: float
) -> Tried:
    """The runs with some levels changed, beside those without."""
    try:
        load_scenario(planned[0].scenario, sets=layered(planned[0].sets, sets))
    except SwathError as error:
        return Tried(sets, 0.0, why=f"cannot be had: {error}")
    after = _done(planned, sets)
    same = sum(a["verdict"] == b["verdict"] for a, b in zip(before, after, strict=True))
    apart = max((_apart(a, b) for a, b in zip(before, after, strict=True)), default=0.0)
    worst = next((a for a in after if a["verdict"] == "error"), None)
    why = f"cannot be had: {worst['reason']}" if worst else ""
    why = why or ("other verdicts" if same < len(before) else "")
    why = why or ("other numbers" if not apart <= within else "")
    as_before = sum(a["digest"] == b["digest"] for a, b in zip(before, after, strict=True))
    return Tried(sets, _time(after), same, apart, why, as_before)


def _limited(result: Result) -> dict[str, float | None]:
    """Numbers of a run that a limit is on."""
    return {f"{entry['subject']}.{entry['name']}": entry["value"] for entry in result["expect"]}


def _done(planned: Sequence[PlannedRun], sets: tuple[str, ...]) -> list[Result]:
    runs = [replace(run, sets=layered(run.sets, sets)) for run in planned]
    by_id = {result["id"]: result for result in results_in(runs, KeptFields())}
    return [by_id[run.id] for run in runs]


def _time(results: Sequence[Result]) -> float:
    return sum(float(result["cpu_s"]) for result in results)


def _apart(a: Result, b: Result) -> float:
    """Largest difference of a limited number of two runs, over the size of its limit."""
    found = 0.0
    for one, other in zip(a["expect"], b["expect"], strict=False):
        values = [one["value"], other["value"]]
        if None in values or not all(isfinite(v) for v in values):
            found = max(found, 0.0 if values[0] == values[1] else float("inf"))
            continue
        size = max(1e-9, *(abs(one["limit"].get(end, 0.0)) for end in ("min", "max")))
        found = max(found, abs(values[0] - values[1]) / size)
    return found
