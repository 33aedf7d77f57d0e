"""Worker processes that a job may kill: the job is named, no other is lost or blamed.

Each worker has one job in hand. A worker that dies costs its job a strike and is replaced; the job is tried
once more, after those that are there already. Workers end with the call that started them, or with the block
`workers_kept` around several calls.
"""

import multiprocessing as mp
import os
import pickle
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, replace
from math import inf
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Generic, TypeVar

from swath.core.errors import SwathError
from swath.core.files.place import present_roots, within
from swath.core.foreign_code import Gate, present_gate, through
from swath.core.process.collector import collect_rarely
from swath.core.process.processes import forget_safe_path, safe_path, skip_folder_settings
from swath.core.process.stopping import hush_lost, stop

STRIKES = 2  # workers that a job may kill before it counts as an error
STOPS = (signal.SIGINT, signal.SIGTERM)
LAST_WORDS = 10.0  # a worker that is stopped is killed after so long [s]
AHEAD = 4  # jobs for each worker that are begun before those before them are through, where order counts
T = TypeVar("T")
R = TypeVar("R")
Begin = Callable[[], Callable[[T], R]]


@dataclass(frozen=True)
class Lost:
    """What comes of a job that ended its workers. exit_code: of the last one."""

    exit_code: int | None

    def __str__(self) -> str:
        return f"ended its process {STRIKES} times, exit code {self.exit_code}"


@dataclass
class _Job(Generic[T]):
    number: int
    what: T
    strikes: int = 0


class _Worker(Generic[T, R]):
    """A process with a pipe to it. job: what it has in hand; is_starting: it has not said that it began."""

    def __init__(self, begin: Begin[T, R]) -> None:
        context, of_driver = mp.get_context("spawn"), (present_gate(), present_roots())
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, begin, *of_driver), daemon=True)
        with safe_path():
            resource_tracker.ensure_running()  # it would let signals in again while the worker starts
            with _signals_held():
                self.process.start()
        theirs.close()
        self.job: _Job[T] | None = None
        self.is_starting = True

    @property
    def is_busy(self) -> bool:
        """Whether something is to come of it."""
        return self.is_starting or self.job is not None

    def give(self, job: _Job[T]) -> None:
        self.job = job
        with suppress(OSError):  # it has just died, which `receive` finds
            self.pipe.send(job.what)

    def receive(self) -> tuple[R] | None:
        """What it sent; None when the process died before."""
        with suppress(EOFError, OSError):
            return (self.pipe.recv(),) if self.pipe.poll() else None
        return None

    def ask_to_stop(self) -> None:
        """A run in hand ends in order, marked as incomplete."""
        self.pipe.close()
        if self.job is not None:
            self.process.terminate()

    def stop(self) -> None:
        self.pipe.close()
        self.process.join(timeout=LAST_WORDS)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


class _Queue(Generic[T]):
    """Jobs that are to be done; those that lost a worker wait until no other may begin."""

    def __init__(self, jobs: Iterable[T]) -> None:
        self._new, self._next = enumerate(jobs), deque[_Job[T]]()
        self.suspects = deque[_Job[T]]()
        self._begun = 0

    def has(self, most: float, wanted: int = 1) -> bool:
        """Whether there are so many; of new ones, `most` are taken at all."""
        while len(self._next) < wanted and self._begun < most:
            if (found := next(self._new, None)) is None:
                break
            self._begun += 1
            self._next.append(_Job(*found))
        return len(self._next) + len(self.suspects) >= wanted

    def take(self) -> _Job[T]:
        """The next one, if it has one."""
        return (self._next or self.suspects).popleft()


_kept: ContextVar[dict[bytes, list[_Worker[Any, Any]]] | None] = ContextVar("kept", default=None)


@contextmanager
def workers_kept() -> Iterator[None]:
    """Inside the block workers wait for the next call that begins them alike, with all that they hold."""
    if _kept.get() is not None:
        yield
        return
    pools: dict[bytes, list[_Worker[Any, Any]]] = {}
    token = _kept.set(pools)
    try:
        yield
    finally:
        _kept.reset(token)
        _end([worker for pool in pools.values() for worker in pool])


def _end(pool: Sequence[_Worker[Any, Any]]) -> None:
    for worker in pool:
        worker.ask_to_stop()
    for worker in pool:
        worker.stop()


def in_workers(
    jobs: Iterable[T], begin: Begin[T, R], workers: int, *, in_order: bool = False
) -> Iterator[tuple[T, R | Lost]]:
    """Do jobs on worker processes, each with what comes of it, as they end or in order.

    begin: called in each worker, gives the function that does a job; all of these can be pickled
    Jobs are taken from the iterable when a worker is free. SwathError where no worker can begin.
    """
    queue, kept = _Queue(jobs), _kept.get()
    alike = pickle.dumps((begin, present_gate(), present_roots()))
    pool: list[_Worker[T, R]] = [] if kept is None else kept.pop(alike, [])
    through: dict[int, tuple[T, R | Lost]] = {}
    count = 0
    try:
        while True:
            most = count + AHEAD * workers if in_order else inf
            pool = [worker for worker in pool if worker.is_busy or worker.process.is_alive()]
            for worker in pool:
                if not worker.is_busy and queue.has(most):
                    worker.give(queue.take())
            while len(pool) < workers and queue.has(most, 1 + len([w for w in pool if w.is_starting])):
                pool.append(_Worker(begin))
            while (number := count if in_order else next(iter(through), -1)) in through:
                count += 1
                yield through.pop(number)
            for worker in _ready(pool):
                found, job = worker.receive(), worker.job
                if found is not None and isinstance(found[0], OSError):
                    raise found[0]
                worker.job, worker.is_starting = None, False
                if found is None:
                    pool.remove(worker)
                    worker.stop()
                if job is None:
                    _check_begun(worker, found)
                elif found is not None:
                    through[job.number] = job.what, found[0]
                elif job.strikes + 1 < STRIKES:
                    queue.suspects.append(replace(job, strikes=job.strikes + 1))
                else:
                    through[job.number] = job.what, Lost(worker.process.exitcode)
            if not through and not any(w.is_busy for w in pool) and not queue.has(inf):
                if kept is not None:
                    kept[alike], pool = pool, []
                return
    finally:
        _end(pool)


def _ready(pool: Sequence[_Worker[T, R]]) -> list[_Worker[T, R]]:
    """Workers that have something to tell or died; waits for the first."""
    busy = [w for w in pool if w.is_busy]
    signs = wait([w.pipe for w in busy] + [w.process.sentinel for w in busy]) if busy else []
    return [w for w in busy if w.pipe in signs or w.process.sentinel in signs]


def _check_begun(worker: _Worker[T, R], found: object) -> None:
    if found is None:
        raise SwathError(
            f"a worker process ended before it began (exit code {worker.process.exitcode}). Where a script "
            "starts it, that script needs `if __name__ == '__main__':` around what it does"
        )


@contextmanager
def _signals_held() -> Iterator[None]:
    """A process that is started inside the block gets no stop before it lets them in."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before, came = signal.pthread_sigmask(signal.SIG_BLOCK, STOPS), list[int]()
    handlers: dict[int, Any] = {}
    if (
        threading.current_thread() is threading.main_thread()
    ):  # another thread lets them in, and Python lets this one know
        found = {number: signal.getsignal(number) for number in STOPS}
        handlers = {number: handler for number, handler in found.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number in came:
            signal.raise_signal(number)


def _serve(pipe: Connection, begin: Begin[Any, Any], gate: Gate, roots: tuple[Path, ...]) -> None:
    """What a worker does until its pipe is closed.

    Ctrl-C is the driver's business; SIGTERM, which often goes to all processes of a group, ends its run in
    order and the worker without a word. gate, roots: of the driver
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop_once)
    hush_lost()
    forget_safe_path()
    skip_folder_settings()
    try:
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPS)
        with through(gate), within(*roots):
            _work(pipe, begin)
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGTERM)


def _stop_once(number: int, frame: object) -> None:
    """The driver may send a SIGTERM that the group got already: it must not cut the end of a run short."""
    signal.signal(number, signal.SIG_IGN)
    stop(number, frame)


def _work(pipe: Connection, begin: Begin[Any, Any]) -> None:
    collect_rarely()
    os.environ.setdefault("SWATH_THREADS", "1")  # one core a job, as many jobs as cores
    with suppress(OSError):  # the driver is gone
        try:
            work = begin()
            pipe.send(True)
            while True:
                try:
                    job = pipe.recv()
                except EOFError:
                    return
                made = work(job)
                pipe.send(made)
        except OSError as error:  # a full disk, which is the driver's to tell
            pipe.send(error)
