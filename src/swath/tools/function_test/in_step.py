"""Runs of a function test as worlds in step (`runtime/worlds.py`), where their levels make that cheaper.

Each comes to the line of a journal that it comes to alone, and is handed out as it ends. One that comes to an
error is done alone: what is told of it is what that run says.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache

from swath.core.collector import collected_rarely
from swath.core.errors import InputError
from swath.core.stopping import stoppable
from swath.runtime.assembly import assemble
from swath.runtime.hooks import RunHook
from swath.runtime.kept import KeptFields
from swath.runtime.world import World
from swath.runtime.worlds import drive_together, gains_in_step, warn_of_batch
from swath.tools.function_test.journal import Result
from swath.tools.function_test.one_run import do_run, hooks_of, result_of, scenario_of
from swath.tools.function_test.plan import PlannedRun, looked_at

TOGETHER = 64  # worlds in step: more gain little, and are lost together where a process dies
Chunk = tuple[PlannedRun, ...]
Work = Callable[[PlannedRun, KeptFields], Result]


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
        float(text.partition("=")[2])
    except ValueError:
        return False
    return True


def results_in(chunk: Chunk, fields: KeptFields, work: Work = do_run) -> Iterator[Result]:
    """What each run of a chunk comes to. fields: of the runs before; work: does one alone."""
    left = dict(enumerate(chunk))
    blame: Exception | None = None
    if len(chunk) > 1:
        try:
            for number, result in _together(chunk):
                del left[number]
                yield result
        except Exception as error:  # a run to blame is left, and tells it alone
            blame = error
    for run in left.values():
        result = work(run, fields)
        blame = None if result["verdict"] == "error" else blame
        yield result
    if blame is not None:
        warn_of_batch(blame)


def _together(chunk: Chunk) -> Iterator[tuple[int, Result]]:
    """Drive and judge runs in step: number and result of each that comes to one."""
    made: list[tuple[int, World, list[RunHook]]] = []
    seconds, clock = [0.0] * len(chunk), _Clock()
    with stoppable(), collected_rarely():
        for number, run in enumerate(chunk):
            with suppress(Exception):
                hooks = hooks_of(run)
                made.append((number, assemble(scenario_of(run)), hooks))
            seconds[number] += clock.passed()
        running = {number for number, _, _ in made}
        try:
            for place, ended in drive_together([world for _, world, _ in made], [h for _, _, h in made]):
                number, since = made[place][0], clock.passed()
                for other in running:
                    seconds[other] += since / len(running)
                running.discard(number)
                if isinstance(ended, dict):
                    yield number, {**result_of(chunk[number], ended), "cpu_s": seconds[number]}
        finally:
            for _, world, _ in made:
                world.close()


class _Clock:
    """CPU time of this process."""

    def __init__(self) -> None:
        self._before = time.process_time()

    def passed(self) -> float:
        """Since it was asked last [s]."""
        before, self._before = self._before, time.process_time()
        return self._before - before
