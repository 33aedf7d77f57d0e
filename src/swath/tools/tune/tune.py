"""`swath tune`: settings of a scenario that serve cases best, and proof on runs that were never looked at.

Every setting is measured by the same runs (`tuned`). What is best there may be best by luck, or only there:
so the best one is held against what was shipped twice, by seeds that no setting was measured by, `fresh` at
the conditions that it was tuned in and `unseen` at others. Which runs there are depends on what is asked and
on the results so far: a tuning that was stopped takes the runs that are in a journal and goes on.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError, near_miss, raise_all
from swath.core.files.whole_file import write_whole
from swath.core.random import Stream
from swath.documents.yaml_document import dump
from swath.runtime.workers import workers_kept
from swath.signals import F64
from swath.tools.function_test.candidates import SHIPPED
from swath.tools.function_test.case import Case, Point, Scalar, find_cases
from swath.tools.function_test.compare import VERDICTS, Comparison, better_of, compare
from swath.tools.function_test.journal import write_table
from swath.tools.function_test.judging.first_batch import metric_of, name_first, telling_nothing
from swath.tools.function_test.judging.judged import UNJUDGED
from swath.tools.function_test.judging.margin import MARGIN, judged_margin
from swath.tools.function_test.judging.paired import not_excluded
from swath.tools.function_test.plan import Plan, code_hash
from swath.tools.function_test.pool import Done
from swath.tools.function_test.session import Session, claim_folder
from swath.tools.function_test.stored_line import Result
from swath.tools.tune.optimiser import FEWEST, MOST, Measured, Tried, front, optimise, searched_by, winner
from swath.tools.tune.parameters import Parameter, as_sets, read_parameter, sets_at

TUNE, CANDIDATES, WINNER = "tune.json", "candidates.yaml", "winner.yaml"
TUNED = "tuned"  # candidate: the winner; folder: of the runs that settings were measured by
ALONE = "alone"  # folder of runs in which one of several slots is changed
FRESH, UNSEEN = "fresh", "unseen"  # folders of the proof: seeds are others; conditions, too
PARTS = {FRESH: "tuned conditions, other seeds", UNSEEN: "other conditions, other seeds"}
ALPHA = 0.01  # chance of calling better in either part what is not
BETTER, NO_BETTER, TUNED_ONLY, WORSE = (
    "better", "no better than shipped", "better in the tuned cases only", "worse than shipped",
)  # fmt: skip
CODES = {BETTER: 0, WORSE: 1, NO_BETTER: 3, TUNED_ONLY: 4}
Cases = Mapping[str, tuple[tuple[int, Point], ...]]  # seed and point of each run, by name of the case


@dataclass(frozen=True)
class Tune:
    """What a tuning asks.

    cases: bundled ones or files
    params: as after `--param`
    aims: metrics, one or two, with `:lower` or `:higher` where the catalogue does not say it
    proven: cases of the proof alone
    tries: settings; each: runs of a setting; proof: runs of shipped and of the winner in each part
    sets, level: as in a plan
    seed: of the draws
    """

    cases: tuple[str, ...]
    params: tuple[str, ...]
    aims: tuple[str, ...] = (MARGIN,)
    proven: tuple[str, ...] = ()
    tries: int = 60
    each: int = 8
    proof: int = 32
    sets: tuple[str, ...] = ()
    level: str = ""
    seed: int = 1
    code: str = field(default_factory=code_hash)

    @cached_property
    def parameters(self) -> list[Parameter]:
        """What is tuned."""
        return [read_parameter(text) for text in self.params]

    @cached_property
    def slots(self) -> dict[str, list[str]]:
        """Keys that are tuned, by the slot of a machine, or section of the scenario, that they belong to."""
        found: dict[str, list[str]] = {}
        for parameter in self.parameters:
            found.setdefault(".".join(parameter.key.split(".")[:2]), []).append(parameter.key)
        return found

    @cached_property
    def directions(self) -> dict[str, str]:
        """`lower` or `higher` of each aim. InputError where neither is known to be better."""
        found = {}
        for aim in self.aims:
            name, _, said = aim.partition(":")
            found[name] = said or better_of(name)
            if found[name] not in ("lower", "higher"):
                raise InputError("--aim", aim, f"expected {name}:lower or {name}:higher, what is better")
        return found


@dataclass(frozen=True)
class Proof:
    """A part of the proof. found: pairs of shipped and the winner; failed: their runs that break a limit."""

    found: Comparison
    failed: tuple[int, int]

    @property
    def says(self) -> str:
        """Better where an aim is shown to be and nothing is shown to be worse; a limit that is broken more
        often is never bought.
        """
        shown = [self.found.says(name) for name in self.found.metrics]
        if "worse" in (*shown, self.found.says(VERDICTS)):
            return WORSE
        return BETTER if "better" in shown and self.failed[1] <= self.failed[0] else NO_BETTER


@dataclass(frozen=True)
class Tuned:
    """A tuning in its folder.

    Attributes
    ----------
    folder : Path
        Where it lies.
    tune : Tune
        What it asks.
    tried : sequence of Tried
        Settings, in order.
    shipped : Measured
        What was shipped, by the runs that the settings were measured by.
    best : int
        Number of the winner.
    proofs : mapping of str to Proof
        The parts of the proof that there are.
    telling_nothing : mapping of str to str
        Limits, aims and slots that told nothing in the first runs, each with a line that says so.
    """

    folder: Path
    tune: Tune
    tried: Sequence[Tried]
    shipped: Measured
    best: int
    proofs: Mapping[str, Proof]
    telling_nothing: Mapping[str, str] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """Of the unseen conditions; where nothing could be held out, of the fresh seeds."""
        says = {name: proof.says for name, proof in self.proofs.items()}
        whole = says.get(UNSEEN, says[FRESH])
        if WORSE in says.values():
            return WORSE
        return TUNED_ONLY if whole != BETTER and says.get(FRESH) == BETTER else whole

    @property
    def exit_code(self) -> int:
        """0 better, 1 worse, 3 no better than shipped, 4 better in the tuned cases only."""
        return CODES[self.verdict]

    @property
    def winner(self) -> dict[str, Scalar]:
        """Scenario keys and values of the winner."""
        return sets_at(self.tune.parameters, self.tried[self.best].shares)

    @property
    def front(self) -> list[int]:
        """Numbers of the settings that none beats in every aim; of one aim the winner."""
        return front(self.tried) if len(self.tune.aims) > 1 else [self.best]


def runs_of(tune: Tune) -> int:
    """How many runs a tuning has at most."""
    alone = len(tune.slots) if len(tune.slots) > 1 else 0
    return (tune.tries + 1 + alone) * tune.each + 2 * 2 * tune.proof


@workers_kept()
def run_tune(folder: Path, tune: Tune, workers: int, done: Done, client: Any = None) -> Tuned:
    """Tune, and hold the winner against what was shipped; `done` is called with each new result.

    client: of dask, None = on `workers` processes here. InputError for what cannot be tuned
    """
    draws = _check(tune)
    claim_folder(folder / TUNE, tune, "a tuning")
    settings: dict[str, list[str]] = {SHIPPED: []}
    nothing: dict[str, str] = {}

    def do(part: str, cases: Cases, candidates: Mapping[str, Any]) -> list[Result]:
        return _session(folder / part, tune, cases, candidates).made(workers, done, client)

    def of_slots(first: list[Result], new: Mapping[str, list[str]]) -> dict[str, Any]:
        """What is tuned, with the candidates that change nothing else; several slots are run alone for it."""
        whole = {" and ".join(tune.slots): new}
        if len(tune.slots) == 1 or telling_nothing(first, changed=whole).keys() >= whole.keys():
            return whole
        sets = next(iter(new.values()))
        alone = {
            slot: [text for text in sets if text.partition("=")[0] in keys]
            for slot, keys in tune.slots.items()
        }
        first += do(ALONE, draws[TUNED], alone)
        return {slot: [slot] for slot in alone}

    def measure(some: F64) -> list[Measured]:
        new = {f"t{len(settings) + n}": as_sets(sets_at(tune.parameters, at)) for n, at in enumerate(some)}
        settings.update(new)
        results = do(TUNED, draws[TUNED], new)
        if len(settings) == 1 + len(new):
            first = [*before, *results]
            name_first(nothing, telling_nothing(first, tune.directions, of_slots(first, new), _value))
        return [measured([r for r in results if r["candidate"] == name], tune.directions) for name in new]

    before = do(TUNED, draws[TUNED], {SHIPPED: []})
    _check_aims(tune, before)
    name_first(nothing, telling_nothing(before))
    tried = optimise(tune.parameters, len(tune.aims), tune.tries, tune.seed, measure)
    best = winner(tried)
    whole = _session(folder / TUNED, tune, draws[TUNED], settings)
    whole.write()
    whole.table()
    found = Tuned(folder, tune, tried, measured(before, tune.directions), best, {})
    write_whole(folder / CANDIDATES, dump(_candidates(found)))
    proofs = {}
    for part in PARTS:
        if cases := draws[part]:
            results = do(part, cases, {SHIPPED: [], TUNED: as_sets(found.winner)})
            proofs[part] = _proof(folder / part, results, tune.directions)
    return Tuned(folder, tune, tried, found.shipped, best, proofs, nothing)


def measured(results: Sequence[Result], directions: Mapping[str, str]) -> Measured:
    """What the runs of a setting come to. A run that lacks an aim breaks its limits, and so does an error."""
    values = []
    lacks = np.zeros(len(results), dtype=bool)
    for name, better in directions.items():
        each = np.array([_value(result, name) for result in results])
        lacks |= ~np.isfinite(each)
        mean = float(np.mean(each[np.isfinite(each)])) if np.isfinite(each).any() else nan
        values.append(-mean if better == "higher" else mean)
    margins = np.array([judged_margin(result, "") for result in results])
    margins = np.where(lacks | ~np.isfinite(margins), -1.0, margins)
    broken = np.minimum(margins, 0.0)
    return Measured(tuple(values), float(broken.mean() if (broken < 0.0).any() else margins.min()))


def _value(result: Result, name: str) -> float:
    value = metric_of(result, name)
    return nan if value is None else float(value)


def _proof(folder: Path, results: Sequence[Result], directions: Mapping[str, str]) -> Proof:
    """The verdict of `swath test compare` on the means of the aims, with an interval of 99 %."""
    rows = [
        {**r, "metrics": {**r["metrics"], MARGIN: v if isfinite(v := _value(r, MARGIN)) else None}}
        for r in results
    ]
    write_table(folder, rows)
    found = compare(f"{folder}:{SHIPPED}", f"{folder}:{TUNED}", list(directions), ALPHA)
    broken = Counter(r["candidate"] for r in results if r["verdict"] not in ("pass", UNJUDGED))
    return Proof(replace(found, directions=directions), (broken[SHIPPED], broken[TUNED]))


def _candidates(found: Tuned) -> dict[str, dict[str, Scalar]]:
    """The file that `swath test run --with` takes: shipped, the winner, and the rest of the front."""
    parameters = found.tune.parameters
    rest = {f"front-{n + 1}": sets_at(parameters, found.tried[n].shares)
            for n in found.front if n != found.best}  # fmt: skip
    return {SHIPPED: {}, TUNED: found.winner, **rest}


def _session(folder: Path, tune: Tune, cases: Cases, candidates: Mapping[str, Sequence[str]]) -> Session:
    paths = {case.name: source for source in (*tune.cases, *tune.proven) for case in find_cases(source)}
    sources = tuple(dict.fromkeys(paths[name] for name in cases))
    plan = Plan(sources, candidates=candidates, sets=tune.sets, level=tune.level, chosen=cases)
    return Session(folder, plan)


def draws_of(tune: Tune) -> dict[str, Cases]:
    """Which runs measure the settings (`tuned`), and which prove the winner (`fresh`, `unseen`)."""
    cases, others = find_cases(tune.cases), find_cases(tune.proven) if tune.proven else []
    tuned, fresh, unseen = {}, {}, {}
    split = {case.name: _conditions(case, tune, both=True) for case in cases}
    for case, count, proof in zip(cases, _shares(tune.each, len(cases)),
                                  _shares(tune.proof, len(cases)), strict=True):  # fmt: skip
        here, _ = split[case.name]
        tuned[case.name] = _runs(case.seeds, here[:count], count)
        fresh[case.name] = _runs(_other_seeds(case, 0, proof), here[:count], proof)
    rest = [(case, split[case.name][1]) for case in cases if split[case.name][1]]
    rest = [(case, _conditions(case, tune, both=False)[0]) for case in others] or rest
    for (case, there), proof in zip(rest, _shares(tune.proof, len(rest)), strict=True):
        unseen[case.name] = _runs(_other_seeds(case, tune.proof, proof), there, proof)
    return {TUNED: tuned, FRESH: fresh, UNSEEN: unseen}


def _conditions(case: Case, tune: Tune, *, both: bool) -> tuple[list[Point], list[Point]]:
    """Conditions of a case to tune in, and others: drawn where there are ranges, else halves of the grid."""
    most = max(tune.each, tune.proof)
    if any(varied.range for varied in case.file.vary.values()):
        found: list[list[Point]] = [list(case.drawn(most, 2 * tune.seed + n)) for n in (0, 1)]
    else:
        grid = case.grid()
        order = Stream(tune.seed, f"tune {case.name}").at(0).permutation(len(grid))
        half = -(-len(grid) // 2) if both else len(grid)
        found = [[grid[int(n)] for n in some] for some in (order[:half], order[half:])]
    first, second = ([point for point in some if not case.known(point)] for some in found)
    return (first or list(found[0]), second)


def _shares(total: int, among: int) -> list[int]:
    """A number of runs over cases, 1 each at least."""
    return [max(1, total // among + (n < total % among)) for n in range(among)]


def _runs(seeds: Sequence[int], points: Sequence[Point], count: int) -> tuple[tuple[int, Point], ...]:
    return tuple((seeds[n % len(seeds)], points[n % len(points)]) for n in range(count))


def _other_seeds(case: Case, first: int, count: int) -> Sequence[int]:
    """Seeds that the case does not name."""
    return range(max(case.seeds) + 1 + first, max(case.seeds) + 1 + first + count)


def _check(tune: Tune) -> dict[str, Cases]:
    """The draws of a tuning. InputError for what cannot be tuned, MissingExtra."""
    ranges = {"tries": (FEWEST, MOST, "settings"), "each": (1, inf, "runs"), "proof": (10, inf, "runs")}
    raise_all([
        InputError(f"--{name}", value, f"expected {low}{f' to {high}' if high < inf else ' or more'} {unit}")
        for name, (low, high, unit) in ranges.items() if not low <= (value := getattr(tune, name)) <= high
    ])  # fmt: skip
    searched_by()
    keys = [p.key for p in tune.parameters]
    if not keys or len(set(keys)) < len(keys):
        raise InputError("--param", ", ".join(keys) or None, "expected one or more, each key once")
    if not 1 <= len(tune.aims) <= 2 or len(tune.directions) < len(tune.aims):
        raise InputError("--aim", ", ".join(tune.aims), "expected one aim or two")
    draws = draws_of(tune)
    ends = {f"{end:g}": as_sets(sets_at(tune.parameters, np.full(len(keys), end))) for end in (0.0, 1.0)}
    _session(Path(), tune, {**draws[TUNED], **draws[UNSEEN]}, {SHIPPED: [], **ends}).plan.check()
    return draws


def _check_aims(tune: Tune, results: Sequence[Result]) -> None:
    known = {MARGIN, *(n for result in results for n, v in result["metrics"].items() if v is not None)}
    errors = [result["reason"] for result in results if result["verdict"] == "error"]
    if len(errors) == len(results):
        raise InputError("cases", None, f"expected runs; every one came to an error, the first: {errors[0]}")
    for name in tune.directions:
        if name not in known:
            raise InputError(
                "--aim", name, f"expected a metric with a value in a run{near_miss(name, sorted(known))}"
            )


def command_of(tune: Tune, folder: Path) -> str:
    """The command that does it again."""
    from swath.core.process.shell import command

    standard = asdict(Tune((), ()))
    flags = {"--tries": "tries", "--each": "each", "--proof": "proof", "--level": "level", "--seed": "seed"}
    words: list[object] = ["tune", *tune.cases]
    for flag, some in (("--param", tune.params), ("--set", tune.sets), ("--prove", tune.proven),
                       ("--aim", tune.aims if tune.aims != (MARGIN,) else ())):  # fmt: skip
        words += [word for text in some for word in (flag, text)]
    for flag, name in flags.items():
        if (value := getattr(tune, name)) != standard[name]:
            words += [flag, value]
    return command(*words, "--out", folder)


def write_winner(found: Tuned) -> Path:
    """The scenario of the first case at its first condition, with what was tuned."""
    from swath.tools.function_test.one_run import scenario_of

    name, runs = next(iter(draws_of(found.tune)[TUNED].items()))
    session = _session(found.folder, found.tune, {name: runs[:1]}, {TUNED: as_sets(found.winner)})
    return write_whole(found.folder / WINNER, scenario_of(next(session.plan.runs())).resolved())


def as_json(found: Tuned) -> str:
    """What was found, for other programs."""
    differences = {
        part: {name: {"mean_difference": d.estimate, "mean_low": d.low, "mean_high": d.high, "pairs": d.count,
                      "says": proof.found.says(name), "worst_tenth_mean": proof.found.worst_tenth(name),
                      "harm_not_excluded": not_excluded(d.count)}
               for name, d in proof.found.differences.items()}
        for part, proof in found.proofs.items()
    }  # fmt: skip
    plain = {"verdict": found.verdict, "winner": found.winner, "proof": differences}
    return json.dumps({**plain, "telling_nothing": [*found.telling_nothing.values()]}, indent=2)
