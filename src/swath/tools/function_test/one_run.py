"""Runs of a function test, in this process: what comes out of each is a line of a journal."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from swath.core.errors import shortened
from swath.judge.evaluators.edge_detection import EdgeDetection
from swath.judge.evaluators.lateral_error import LateralError
from swath.judge.summary import numbers_in
from swath.runtime.credibility import NEVER_CHECKED, outside_of
from swath.runtime.credibility import SUMMARY as CREDIBILITY
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.job import run_unrecorded
from swath.runtime.kept import KeptFields
from swath.runtime.met import SUMMARY as MET
from swath.runtime.met import MetHook
from swath.runtime.world import ASKED_BY
from swath.runtime.worlds import run_each
from swath.scenario.scenario import Scenario, load_scenario
from swath.tools.function_test.judging.integrity import SUMMARY as INTEGRITY
from swath.tools.function_test.judging.integrity import integrity_in
from swath.tools.function_test.judging.judged import verdict_of
from swath.tools.function_test.judging.ranking import EDGE_US
from swath.tools.function_test.judging.steering_accuracy import SUMMARY as STEERING
from swath.tools.function_test.judging.steering_accuracy import steering_in
from swath.tools.function_test.plan import PlannedRun
from swath.tools.function_test.shadow import SUMMARY as SHADOW
from swath.tools.function_test.shadow import ShadowHook
from swath.tools.function_test.stored_line import Result

NOT_METRICS = ("seed", "real_time_factor", "ray_count", "simulated_s", "wall_s")
ENDED = "ended"  # why a run ended: `reason`, `text`


def scenario_of(run: PlannedRun) -> Scenario:
    """The scenario of a run. Raises InputError."""
    return load_scenario(run.scenario, sets=run.sets, flags={f"seed {run.seed}": f"seed={run.seed}"})


def shadows_of(run: PlannedRun) -> dict[str, Scenario]:
    """The scenarios of the candidates that go along in shadow. Raises InputError."""
    return {name: scenario_of(replace(run, sets=sets)) for name, sets in run.shadows.items()}


class JudgesHook(RunHook):
    """Adds to the summary what the judges of a kind have of all machines of a run together."""

    READS_TRACKS = False

    def __init__(self, kind: Any, told: Callable[[Sequence[Any]], dict[str, Any]]) -> None:
        self._kind, self._told = kind, told

    def begin(self, run: ActiveRun) -> None:
        """Know the judges."""
        found = [run.evaluation.find(name, self._kind) for name in run.world.machines]
        self._judges = [judge for judge in found if judge is not None]

    def summarize(self, t: int) -> dict[str, Any]:
        """What they have."""
        return self._told(self._judges)


def hooks_of(run: PlannedRun) -> list[RunHook]:
    """What goes along with a run. Raises InputError."""
    shadows = shadows_of(run)
    judges = JudgesHook(EdgeDetection, integrity_in), JudgesHook(LateralError, steering_in)
    hooks: list[RunHook] = [*judges, *([ShadowHook(shadows)] if shadows else [])]
    return [*hooks, *([MetHook(run.met)] if run.met else [])]


Work = Callable[[Sequence[PlannedRun], KeptFields], Iterable[Result]]


def results_in(runs: Sequence[PlannedRun], fields: KeptFields) -> Iterator[Result]:
    """Drive and judge runs, several of them in step.

    Gives each as it ends, as the line of a journal that it comes to alone. The verdict is `pass`, `fail`,
    `not judged` where it would rest on a level outside its checked range, or `error` where the run could not
    be made or crashed.

    fields: of the runs before; reason: the first limit that failed, the range that was left, or the error
    """

    def alone(run: PlannedRun) -> dict[str, Any]:
        return run_unrecorded(scenario_of(run), fields, hooks=hooks_of(run))

    for number, ended, cpu_s in run_each(runs, lambda run: (scenario_of(run), hooks_of(run)), alone):
        run = runs[number]
        found = result_of(run, ended) if isinstance(ended, dict) else no_result(run, str(ended))
        yield {**found, "cpu_s": cpu_s}


def no_result(run: PlannedRun, why: str) -> dict[str, Any]:
    """The result of a run that came to nothing."""
    reason = shortened(" ".join(why.split()))
    nothing = {"metrics": {}, "expect": [], "incidents": [], "digest": "", "cpu_s": 0.0}
    return {**run.about, "verdict": "error", "reason": reason, **nothing}


def result_of(run: PlannedRun, summary: dict[str, Any]) -> dict[str, Any]:
    """The line of a journal that a run's summary comes to."""
    outside = outside_of(summary)
    verdict, reason = verdict_of(summary["expect"], outside)
    return {
        **run.about,
        "verdict": verdict,
        "reason": reason,
        "metrics": {k: v for k, v in numbers_in(summary).items() if k not in NOT_METRICS},
        "expect": summary["expect"],
        "incidents": [
            {k: e.get(k) for k in ("kind", "machine", "t_s", "distance_m")} for e in summary["incidents"]
        ],
        "digest": summary["digest"],
        ENDED: summary[ENDED],
        EDGE_US: _edge_us(summary.get("cost", {})),
        **({CREDIBILITY: outside} if outside else {}),
        **({NEVER_CHECKED: never} if (never := summary.get(CREDIBILITY, {}).get(NEVER_CHECKED)) else {}),
        **{key: summary[key] for key in (SHADOW, INTEGRITY, STEERING, MET, ASKED_BY) if key in summary},
    }


def _edge_us(cost: dict[str, dict[str, float]]) -> float | None:
    """Time of a step of the edge detectors [us], None where there is none."""
    found = [of for slot, of in cost.items() if slot.rpartition(".")[2] == "edge" and of["steps"]]
    return 1e6 * sum(of["seconds"] for of in found) / sum(of["steps"] for of in found) if found else None
