"""The runs of a function test on worker processes.

Workers write their own journals, so a driver that is killed loses nothing.
"""

import os
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from swath.runtime.kept import KeptFields
from swath.runtime.workers import Lost, in_workers
from swath.tools.function_test.journal import Journal
from swath.tools.function_test.one_run import do_run, no_result
from swath.tools.function_test.plan import PlannedRun

Done = Callable[[dict[str, Any]], None]
Work = Callable[[PlannedRun, KeptFields], dict[str, Any]]


def run_all(
    runs: Iterable[PlannedRun], folder: Path, workers: int, done: Done, *, work: Work = do_run
) -> None:
    """Do runs on worker processes; `done` is called with each result, which is in a journal by then.

    folder: of the journals; workers: how many processes; work: does a run, a function that can be imported
    """
    journal = Journal(folder, f"driver-{os.getpid()}")  # for runs whose worker did not live to write
    try:
        for run, result in in_workers(runs, partial(_begin, folder, work), workers):
            if isinstance(result, Lost):
                result = no_result(run, str(result))
                journal.add(result)
            done(result)
    finally:
        journal.close()


def _begin(folder: Path, work: Work) -> Callable[[PlannedRun], dict[str, Any]]:
    """What a worker process does with each run."""
    journal, fields = Journal(folder, f"worker-{os.getpid()}"), KeptFields()

    def journaled(run: PlannedRun) -> dict[str, Any]:
        result = work(run, fields)
        journal.add(result)
        return result

    return journaled
