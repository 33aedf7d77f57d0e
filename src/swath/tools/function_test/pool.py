"""Worker processes that a run may kill: the run is named, no other run is lost or blamed.

Each worker has one run in hand. A worker that dies costs its run a strike and is replaced; the run is tried
once more, after all others. Workers write their own journals, so a driver that is killed loses nothing
either.
"""

import multiprocessing as mp
import os
import signal
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from swath.tools.function_test.journal import Journal
from swath.tools.function_test.one_run import do_run, no_result
from swath.tools.function_test.plan import PlannedRun

STRIKES = 2  # workers that a run may kill before it counts as an error
Done = Callable[[dict[str, Any]], None]
Work = Callable[[PlannedRun], dict[str, Any]]


class _Worker:
    """A process with a pipe to it. run: what it has in hand"""

    def __init__(self, folder: Path, name: str, work: Work) -> None:
        context = mp.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, folder, name, work), daemon=True)
        self.process.start()
        theirs.close()
        self.run: PlannedRun | None = None

    def give(self, run: PlannedRun) -> None:
        self.run = run
        with suppress(OSError):  # it has just died, which `take_back` finds
            self.pipe.send(run)

    def take_back(self) -> tuple[PlannedRun, dict[str, Any] | None]:
        """The run in hand and its result; None when the process died before it had one."""
        run, self.run = self.run, None
        assert run is not None
        try:
            return run, self.pipe.recv() if self.pipe.poll() else None
        except (EOFError, OSError):
            return run, None

    def stop(self) -> None:
        self.pipe.close()
        self.process.join(timeout=2.0)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


class _Queue:
    """Runs that are to be done; those that lost a worker come last."""

    def __init__(self, runs: Sequence[PlannedRun]) -> None:
        self._waiting, self._suspects = deque(runs), deque[PlannedRun]()
        self._strikes: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._waiting) + len(self._suspects)

    def take(self) -> PlannedRun:
        """The next one."""
        return (self._waiting or self._suspects).popleft()

    def put_back(self, run: PlannedRun) -> bool:
        """Try a run again that lost its worker; False where it has lost too many."""
        self._strikes[run.id] = self._strikes.get(run.id, 0) + 1
        if self._strikes[run.id] < STRIKES:
            self._suspects.append(run)
            return True
        return False


def run_all(
    runs: Sequence[PlannedRun], folder: Path, workers: int, done: Done, *, work: Work = do_run
) -> None:
    """Do runs on worker processes; `done` is called with each result, which is in a journal by then.

    folder: of the journals; workers: how many processes; work: does a run, a function that can be imported
    """
    journal = Journal(folder, f"driver-{os.getpid()}")  # for runs whose worker did not live to write
    queue, pool, number = _Queue(runs), list[_Worker](), 0
    try:
        while queue or any(w.run for w in pool):
            pool = [w for w in pool if w.run or w.process.is_alive()]
            while len(pool) < workers and len([w for w in pool if not w.run]) < len(queue):
                pool.append(_Worker(folder, f"{os.getpid()}-{number}", work))
                number += 1
            for worker in pool:
                if worker.run is None and queue:
                    worker.give(queue.take())
            for worker in _ready(pool):
                run, result = worker.take_back()
                if result is None:
                    pool.remove(worker)
                    worker.stop()
                    if queue.put_back(run):
                        continue
                    exit_code = worker.process.exitcode
                    result = no_result(run, f"ended its process {STRIKES} times, exit code {exit_code}")
                    journal.add(result)
                done(result)
    finally:
        for worker in pool:
            worker.stop()
        journal.close()


def _ready(pool: Sequence[_Worker]) -> list[_Worker]:
    """Workers that have finished a run or died; waits for the first."""
    busy = [w for w in pool if w.run is not None]
    signs = wait([w.pipe for w in busy] + [w.process.sentinel for w in busy])
    return [w for w in busy if w.pipe in signs or w.process.sentinel in signs]


def _serve(pipe: Connection, folder: Path, name: str, work: Work) -> None:
    """What a worker does until its pipe is closed. Ctrl-C is the driver's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("SWATH_THREADS", "1")  # one core a run, as many runs as cores
    journal = Journal(folder, name)
    while True:
        try:
            run = pipe.recv()
        except (EOFError, OSError):
            return
        result = work(run)
        journal.add(result)
        with suppress(OSError):  # the driver is gone; the journal has it
            pipe.send(result)
