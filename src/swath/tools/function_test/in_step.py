"""Which runs of a function test go as worlds in step (`runtime/worlds.py`), which is cheaper then."""

from collections.abc import Iterable, Iterator
from functools import cache

from swath.core.errors import InputError
from swath.documents.yaml_document import parse_value
from swath.runtime.worlds import gains_in_step
from swath.tools.function_test.plan import PlannedRun, looked_at

TOGETHER = 64  # worlds in step: more gain little, and are lost together where a process dies
Chunk = tuple[PlannedRun, ...]


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
