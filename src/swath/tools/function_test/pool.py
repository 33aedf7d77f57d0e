"""The runs of a function test on worker processes.

Workers write their own journals, so a driver that is killed loses nothing. Runs go as worlds in step
(`runtime/worlds.py`) where that is cheaper.
"""

import os
import time
from collections.abc import Callable, Iterable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.documents.yaml_document import parse_value
from swath.runtime.kept import KeptFields
from swath.runtime.workers import Lost, in_workers
from swath.runtime.worlds import gains_in_step
from swath.tools.function_test.journal import Journal, results_of
from swath.tools.function_test.one_run import Work, no_result, results_in
from swath.tools.function_test.plan import PlannedRun, looked_at

TOGETHER = 64  # worlds in step: more gain little, and are lost together where a process dies
Chunk = tuple[PlannedRun, ...]
Done = Callable[[dict[str, Any]], None]


def run_all(
    runs: Iterable[PlannedRun], folder: Path, workers: int, done: Done, *, work: Work = results_in
) -> None:
    """Do runs on worker processes; `done` is called with each result, which is in a journal by then.

    folder: of the journals; workers: how many processes; work: does a chunk, can be imported
    """
    if lost := _do(in_chunks(runs, workers), folder, workers, done, work):
        there = {result["id"]: result for result in results_of(folder, [run.id for run in lost])}
        for result in there.values():
            done(result)
        _do(((run,) for run in lost if run.id not in there), folder, workers, done, work)


def _do(chunks: Iterable[Chunk], folder: Path, workers: int, done: Done, work: Work) -> list[PlannedRun]:
    """Do runs in chunks; those of chunks that ended their workers, one of which is to blame, come back."""
    journal = Journal(folder, f"driver-{os.getpid()}")  # for runs whose worker did not live to write
    lost: list[PlannedRun] = []
    began = time.monotonic_ns()
    try:
        jobs = ((folder, began, chunk) for chunk in chunks)
        for (_, _, chunk), results in in_workers(jobs, partial(_begin, work), workers):
            if not isinstance(results, Lost):
                for result in results:
                    done(result)
            elif len(chunk) > 1:
                lost += chunk
            else:
                result = no_result(chunk[0], str(results))
                done(journal.add(result))
    finally:
        journal.close()
    return lost


def _begin(work: Work) -> Callable[[tuple[Path, int, Chunk]], list[dict[str, Any]]]:
    """What a worker process does with each chunk, into its journal in the folder of the runs, which is opened
    anew where others began: their plan may name other files.
    """
    journals, fields = dict[tuple[Path, int], Journal](), KeptFields()

    def journaled(job: tuple[Path, int, Chunk]) -> list[dict[str, Any]]:
        folder, began, chunk = job
        if (folder, began) not in journals:
            for journal in journals.values():
                journal.close()
            journals.clear()
            journals[folder, began] = Journal(folder, f"worker-{os.getpid()}")
        return [journals[folder, began].add(result) for result in work(chunk, fields)]

    return journaled


def in_chunks(runs: Iterable[PlannedRun], workers: int) -> Iterator[Chunk]:
    """What a worker does at a time: one run, or several of a case in step, shared evenly among workers."""
    waiting: list[PlannedRun] = []
    for run in runs:
        if waiting and (run.case != waiting[0].case or len(waiting) == TOGETHER * workers):
            yield from _shared(waiting, workers)
            waiting = []
        if _gains(run.scenario, tuple(text for text in run.sets if not is_number(text))):
            waiting.append(run)
        else:
            yield (run,)
    yield from _shared(waiting, workers)


def _shared(runs: list[PlannedRun], workers: int) -> Iterator[Chunk]:
    size = -(-len(runs) // workers)
    return (tuple(runs[at : at + size]) for at in range(0, len(runs), size or 1))


@cache
def _gains(scenario: str, sets: tuple[str, ...]) -> bool:
    """Whether runs go in step; numbers among their changes choose no level."""
    try:
        return gains_in_step(looked_at(scenario, sets))
    except InputError:  # told as the result of the run
        return False


def is_number(text: str) -> bool:
    """Whether a change, as after `--set`, sets a number."""
    try:
        value = parse_value(text.partition("=")[2], text)
    except InputError:  # told as the result of the run
        return False
    return isinstance(value, int | float) and not isinstance(value, bool)
