"""Which real passes narrow most how far the levels of a case may be off, and where that matters.

How far they are off at some conditions is not known. It is a Gaussian process of mean 0, with as much spread
as two levels of a part differ by there, and at least as they usually do; where a level was never checked, as
they differ at most. It is the sum of effects of conditions and of pairs of them (Duvenaud et al. 2011,
Advances in Neural Information Processing Systems 24). A pass measures it at its conditions, but for as much
as levels usually differ. Passes are chosen one after the other, each the one that leaves the least variance
over the working time, weighted by the share of what is not shown there (integrated mean squared error, Sacks
et al. 1989, doi:10.1214/ss/1177012413; of the discrepancy of a model, Kennedy and O'Hagan 2001,
doi:10.1111/1467-9868.00294).
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.foreign_code import allow_code
from swath.core.number_text import num
from swath.core.random import Stream
from swath.runtime.credibility import NEVER_CHECKED
from swath.scenario.overrides import layered
from swath.signals import F64
from swath.tools.function_test.case import Case, Point, Scalar, one_case
from swath.tools.function_test.estimate.estimate import distribution_of
from swath.tools.function_test.fidelity import CHEAP, DEAR, levels_of
from swath.tools.function_test.field_plan.seen import REFERENCE, SCANS, heights_of
from swath.tools.function_test.judging.first_batch import FIRST, name_first, telling_nothing
from swath.tools.function_test.judging.judged import beyond
from swath.tools.function_test.judging.margin import MARGIN, margin, margin_of
from swath.tools.function_test.judging.verdict import SHOWN
from swath.tools.function_test.odd.campaign import Conducted, open_campaign
from swath.tools.function_test.odd.coverage import driven_of
from swath.tools.function_test.plan import AS_SET, Plan, code_hash, looked_at
from swath.tools.function_test.pool import Done
from swath.tools.function_test.search.gaussian_process import matern
from swath.tools.function_test.session import Session, claim_folder, open_session
from swath.tools.function_test.stored_line import Result

ASKED, PAIRS = "plan-field.json", "pairs"
CASE_IS, OTHER = "as it is", "other"  # candidates: the case, and with other levels


@dataclass(frozen=True)
class Params:
    """What is estimated of how far levels are off.

    length: over which the effect of a condition changes [share of its range]; estimated
    most: share of the differences between levels that are smaller than what a level that was never checked
        there may be off by [1]; estimated
    retries: draws per condition until it lies inside the ODD; chosen
    """

    length: float = 0.25
    most: float = 0.9
    retries: int = 200


PARAMS = Params()


@dataclass(frozen=True)
class FieldPlan:
    """What is asked.

    source: a case, or the folder of a campaign over an ODD
    other: changes that bring in the other levels; none = the other level of the scanner
    metric: by which levels differ; `scans` = how high the echoes of scanners lie (`seen.ScanHeights`)
    runs: real passes; pairs: conditions at which levels are compared
    sets: changes of the scenario
    seed: of the draws
    """

    source: str
    other: tuple[str, ...] = ()
    metric: str = MARGIN
    runs: int = 8
    pairs: int = 64
    sets: tuple[str, ...] = ()
    seed: int = 1
    code: str = field(default_factory=code_hash)


@dataclass(frozen=True)
class Condition:
    """A place where a pass could be.

    apart: size of the difference of the metric between the levels
    unshown: share of its cells that are not shown
    unchecked: slots and quantities that are outside the range in which their level was checked
    broken: the one limit that both break and whose margin is that of both, "" = they are not so alike
    """

    point: Point
    apart: float
    unshown: float
    unchecked: Sequence[str]
    broken: str = ""


@dataclass(frozen=True)
class Pass:
    """A pass that is proposed. narrows: share of the doubt that it takes away, after those before it."""

    condition: Condition
    narrows: float


@dataclass(frozen=True)
class Planned:
    """A plan. usual: what levels usually differ by; other: changes that were compared.

    telling_nothing: what told nothing in the first runs, each with a line that says so
    """

    folder: Path
    asked: FieldPlan
    case: Case
    other: Sequence[str]
    conditions: Sequence[Condition]
    passes: Sequence[Pass]
    usual: float
    telling_nothing: Mapping[str, str] = field(default_factory=dict)

    @property
    def doubts_nothing(self) -> str:
        """Why no share of a doubt can be said, "" where it can: levels differ somewhere by more than a limit
        that both break.
        """
        if any(c.apart > 0.0 and not c.broken for c in self.conditions):
            return ""
        equal = sum(c.apart == 0.0 for c in self.conditions)
        return f"{self.asked.metric} is the same in {equal} of {len(self.conditions)} pairs"

    def narrowed(self, share: float) -> str:
        """A share of the doubt [%], "" where there is none."""
        return "" if self.doubts_nothing else num(100 * share)


def plan_field(folder: Path, asked: FieldPlan, workers: int, done: Done, client: Any = None) -> Planned:
    """Compare levels at conditions drawn by their exposure, and choose passes.

    Parameters
    ----------
    folder : of the results, which are gone on with.
    asked : what is asked.
    workers, client : processes here, or of dask.
    done : gets each new result.
    """
    found, case = _source(asked.source)
    if not case.file.vary:
        raise InputError("vary", None, "expected conditions that the case varies", file=case.document.file)
    for name, least in (("runs", 1), ("pairs", 8)):
        if getattr(asked, name) < least:
            raise InputError(f"--{name}", getattr(asked, name), f"expected {least} or more")
    other = asked.other or _other_level(case, asked.sets)
    claim_folder(folder / ASKED, asked, "a plan of the field")
    points = draw(case, found, asked.pairs, asked.seed)
    chosen = {case.name: tuple((max(case.seeds) + 1 + n, point) for n, point in enumerate(points))}
    source = str(found.session.plan.cases) if found else asked.source
    sets, own = asked.sets, (REFERENCE,) if asked.metric == SCANS else ()
    if own:
        sets = (*sets, f"evaluators={json.dumps([*looked_at(case.scenario, sets).evaluators, *own])}")
    plan = Plan(source, candidates={CASE_IS: (), OTHER: other}, sets=sets, level=AS_SET, chosen=chosen)
    with allow_code(own):
        plan.check()
        session = Session(folder / PAIRS, plan)
        session.write()
        session.do(workers, done, client, FIRST)
        some = session.results(FIRST)
        nothing = telling_nothing(some, [asked.metric], {", ".join(other): [OTHER]}, value_of)
        name_first({}, nothing)
        session.do(workers, done, client)
    conditions = conditions_of(session.results(), asked.metric, found, other)
    if broken := [c.broken for c in conditions if c.broken]:
        of = f"{len(broken)} of {len(conditions)} pairs: its margin is that of both"
        name_first(nothing, {of: f"both levels break {', '.join(sorted(set(broken)))} in {of}"})
    scale = spread(case, conditions)
    passes = choose(case, conditions, scale, asked.runs)
    return Planned(folder, asked, case, other, conditions, passes, _usual(conditions), nothing)


def _source(source: str) -> tuple[Conducted | None, Case]:
    if os.path.isdir(Path(source)) and (found := open_campaign(open_session(Path(source), same_code=False))):
        return found, found.session.plan.found[0]
    return None, one_case(source, expected="expected one case, or a dossier")


def _other_level(case: Case, sets: Sequence[str]) -> list[str]:
    found = levels_of(looked_at(case.scenario, layered(case.sets(case.grid_point(0)), sets)), "lidar")
    other = [f"{name}.level={DEAR if level == CHEAP else CHEAP}" for name, level in found.items()
             if level in (CHEAP, DEAR)]  # fmt: skip
    if not other:
        raise InputError(
            "--other", None, "expected a level to compare with, KEY=VALUE: no scanner has another"
        )
    return other


def draw(case: Case, found: Conducted | None, count: int, seed: int) -> list[dict[str, Scalar]]:
    """Conditions by their exposure, inside the ODD where there is one."""
    by = {name: distribution_of(varied) for name, varied in case.file.vary.items()}
    rng, points = Stream(seed, f"plan-field {case.name}").at(0), list[dict[str, Scalar]]()
    for _ in range(count * PARAMS.retries):
        if len(points) == count:
            return points
        drawn = {name: of.value(float(rng.random())) for name, of in by.items()}
        point = {k: float(f"{v:.3g}") if isinstance(v, float) else v for k, v in drawn.items()}
        if found is None or found.odd.domain.holds(point):
            points.append(point)
    raise InputError("odd", case.name, "expected conditions inside the ODD")


def conditions_of(
    results: Sequence[Result], metric: str, found: Conducted | None = None, other: Sequence[str] = ()
) -> list[Condition]:
    """What the pairs of runs show. other: changes whose slots count where they were never checked.

    InputError where they show nothing.
    """
    verdicts = {cell.places: cell.verdict for cell in found.cells} if found else {}
    out: list[Condition] = []
    for a, b in zip(results[::2], results[1::2], strict=True):
        if "error" in (a["verdict"], b["verdict"]):
            continue
        values = [value for r in (a, b) if (value := value_of(r, metric)) is not None]
        if not values:
            continue
        apart = inf if len(values) == 1 else float(np.mean(np.abs(values[1] - values[0])))
        never = {
            f"{slot} {name}"
            for slot, names in a.get(NEVER_CHECKED, {}).items()
            for name in names
            if any(text.startswith((f"{slot}.", f"{slot}=")) for text in other)
        }
        unchecked = sorted({f"{slot} {quantity}" for slot, quantity, _ in beyond(a)} | never)
        broken = _nearest_broken(a) & _nearest_broken(b) if metric == MARGIN else set()
        unshown = _unshown(a, found, verdicts)
        out.append(Condition(a["point"], apart, unshown, unchecked, ", ".join(sorted(broken))))
    known = [abs(c.apart) for c in out if c.apart < inf]
    if len(known) < 2:
        raise InputError("--metric", metric, "expected pairs of runs that have it, there are fewer than two")
    most = max(known)  # where one level has no value they differ as much as they do anywhere, or more
    return [replace(c, apart=most) if c.apart == inf else c for c in out]


def value_of(result: Result, metric: str) -> F64 | None:
    """What levels are compared by, of a run; None where it has none."""
    if metric == SCANS:
        found: Any = heights_of(result["metrics"])
    else:
        found = margin(result) if metric == MARGIN else result["metrics"].get(metric)
    return None if found is None else np.atleast_1d(np.asarray(found, float))


def _nearest_broken(result: Result) -> set[str]:
    """The limit by which a run breaks its limits farthest, or several alike; empty where it breaks none."""
    of = {f"{e['subject']}.{e['name']}": margin_of(e) for e in result["expect"]}
    least = min(of.values(), default=0.0)
    return {name for name, value in of.items() if value == least < 0.0}


def _unshown(result: Result, found: Conducted | None, verdicts: Mapping[tuple[int, ...], str]) -> float:
    """Share of the cells that a run belongs to that are not shown; 1 without an ODD."""
    if found is None:
        return 1.0
    places = found.coverage.main(driven_of(found.odd, result)).tolist()
    cells = [(p,) if p == q else (p, q) for i, p in enumerate(places) for q in places[i:]]
    judged = [verdicts[cell] for cell in cells if cell in verdicts]
    return sum(verdict != SHOWN for verdict in judged) / max(1, len(judged))


def places_of(case: Case, points: Sequence[Point]) -> F64:
    """Conditions as shares of their ranges, values without a range by number, (n, d)."""
    columns = []
    for name, varied in case.file.vary.items():
        values = [point[name] for point in points]
        if varied.range is None:
            known = [*dict.fromkeys((*map(str, varied.drawn_values), *map(str, values)))]
            columns.append([100.0 * known.index(str(v)) for v in values])  # none is near another
        else:
            low, high = varied.range
            columns.append([(float(v) - low) / (high - low) for v in values])
    return np.array(columns).T.reshape(len(points), -1)


def alike(a: F64, b: F64) -> F64:
    """Correlation of how far levels are off at conditions (n, d) and (m, d): of each alone and of pairs."""
    each = matern(np.abs(a[:, None, :] - b[None, :, :]) / PARAMS.length)
    count = each.shape[2]
    alone = each.mean(axis=2)
    if count == 1:
        return np.asarray(alone)
    pairs = (each.sum(axis=2) ** 2 - (each**2).sum(axis=2)) / (count * (count - 1))
    return np.asarray(0.5 * (alone + pairs))


def _usual(conditions: Sequence[Condition]) -> float:
    return float(np.median(np.abs([c.apart for c in conditions]))) or 1e-9


def spread(case: Case, conditions: Sequence[Condition]) -> F64:
    """How far the levels may be off at each condition, one standard deviation, (n,)."""
    apart = np.abs([c.apart for c in conditions])
    places = places_of(case, [c.point for c in conditions])
    near = np.prod(matern(np.abs(places[:, None] - places[None]) / PARAMS.length), axis=2)
    smooth = np.sqrt(near @ apart**2 / near.sum(axis=1))
    unchecked = np.array([bool(c.unchecked) for c in conditions])
    least = np.where(unchecked, np.quantile(apart, PARAMS.most), _usual(conditions))
    return np.asarray(np.maximum(smooth, least))


def choose(case: Case, conditions: Sequence[Condition], scale: F64, count: int,
           known: Sequence[Point] = ()) -> list[Pass]:  # fmt: skip
    """The passes, the one that narrows most first. scale: as `spread` gives it; known: driven already."""
    points = [*(c.point for c in conditions), *known]
    places = places_of(case, points)
    nearest = np.argmax(alike(places, places)[:, : len(conditions)], axis=1)
    scale = scale[nearest]
    covariance = scale[:, None] * alike(places, places) * scale
    weight = np.array([c.unshown for c in conditions])
    noise = _usual(conditions) ** 2
    passes: list[Pass] = []
    total = 0.0
    for number in range(len(known) + min(count, len(conditions))):
        own = covariance.diagonal()
        if number < len(known):
            best = len(conditions) + number
        else:
            some = slice(0, len(conditions))
            gain = (weight[:, None] * covariance[some, some] ** 2).sum(axis=0) / (own[some] + noise)
            total = total or float((weight * own[some]).sum()) or 1.0
            best = int(np.argmax(gain))
            passes.append(Pass(conditions[best], float(gain[best]) / total))
        column = covariance[:, best]
        covariance = covariance - np.outer(column, column) / (own[best] + noise)
    return passes
