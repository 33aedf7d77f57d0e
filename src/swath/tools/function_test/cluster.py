"""The runs of a function test on a cluster: dask.distributed hands them out, workers write their journals.

A result is on the disk that all machines see before the run counts as done, so a worker that is lost with
all that it did loses no finished run. Each worker has one run in hand and none waits beside it: a worker
that dies puts no other run under suspicion.
"""

import os
import signal
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock, current_thread, main_thread
from typing import Any

from swath.core.errors import Extra, InputError, MissingExtra, SwathError
from swath.core.files.place import present_roots, within
from swath.core.foreign_code import Gate, need_named, present_gate, through
from swath.runtime.kept import KeptFields
from swath.runtime.workers import STRIKES
from swath.tools.function_test.journal import Journal, results_of
from swath.tools.function_test.one_run import Work, no_result, results_in
from swath.tools.function_test.plan import PlannedRun, code_hash

Result = dict[str, Any]
LOOK_S = 2.0  # between looks at whether there are workers left
PATIENCE = 150  # looks without a worker until a test gives up: a queue may start new ones
KINDS = "local, slurm or the address of a scheduler, such as tls://node1:8786"
QUIET: dict[str, Any] = {
    f"distributed.{part}.http.routes": [] for part in ("scheduler", "worker", "nanny")
}  # no pages


@contextmanager
def cluster_client(kind: str, workers: int) -> Iterator[Any]:
    """A client of dask. kind: `local`, `slurm` (dask-jobqueue with its own settings) or an address.

    Who reaches a scheduler or a worker runs code there, so all talk TLS: `local` and `slurm` with
    certificates made for this client alone, an address with those of dask's settings.

    workers: processes of `local`, jobs of `slurm`. MissingExtra without the extra, InputError for another
    kind, NotNamed for an address without TLS that is not allowed.
    """
    try:
        import dask
        from distributed import Client, LocalCluster, Security

        security = Security.temporary() if kind in ("local", "slurm") else None
    except ImportError:
        raise MissingExtra("cluster", "--cluster") from None
    if security is None and "://" not in kind:
        raise InputError("--cluster", kind, f"expected {KINDS}")
    if security is None and not kind.startswith("tls://"):
        need_named("--cluster", kind)
    with dask.config.set({"distributed.scheduler.allowed-failures": STRIKES - 1, **QUIET}):
        cluster = None
        if kind == "local":
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=None, security=security
            )
        elif kind == "slurm":
            cluster = _slurm(workers, security)
        try:
            try:
                client = Client(kind if cluster is None else cluster, security=security)
            except (OSError, TypeError, ValueError) as error:  # nobody answers, no certificates, no address
                raise InputError("--cluster", kind, f"expected {KINDS}: {error}") from error
            with client:
                yield client
        finally:
            if cluster is not None:
                cluster.close()
            for part in ("ca_file", "cert", "key"):  # of SLURM's workers; files that go when they are closed
                if (file := getattr(cluster, f"_job_{part}", None)) is not None:
                    file.close()


def run_on_cluster(
    runs: Iterable[PlannedRun],
    folder: Path,
    client: Any,
    done: Callable[[Result], None],
    *,
    work: Work = results_in,
) -> None:
    """Do runs on the workers of a client; `done` is called with each result, which is in a journal by then.

    folder: of the journals, seen by all; work: does a chunk, can be imported. SwathError where
    no worker is left for some minutes: what is finished is kept, and the same command goes on.
    """
    from distributed import wait

    journal = Journal(folder, f"driver-{socket.gethostname()}-{os.getpid()}")
    left, pending, alone = iter(runs), dict[Any, PlannedRun](), 0
    is_over = False
    try:
        while pending or not is_over:
            count = len(client.nthreads())
            while len(pending) < count and (run := next(left, None)) is not None:
                of_driver = code_hash(), present_gate(), present_roots()
                job = client.submit(_do, run, str(folder), work, *of_driver, key=f"run-{run.id}", pure=False)
                pending[job] = run
            is_over = bool(count) and len(pending) < count
            alone = 0 if count else alone + 1
            if alone > PATIENCE:
                raise SwathError("no worker is left; the same command resumes with what is not finished")
            if not pending:
                time.sleep(0.0 if is_over else LOOK_S)
                continue
            try:
                ended = wait(list(pending), timeout=LOOK_S, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                continue
            for job in ended:
                done(_result(job, pending.pop(job), folder, journal))
    finally:
        client.cancel(list(pending))
        journal.close()


def _result(job: Any, run: PlannedRun, folder: Path, journal: Journal) -> Result:
    """What a job came to; one that ended its workers is an error of its run."""
    from distributed import KilledWorker

    try:
        found: Result = job.result()
    except KilledWorker:
        there = next(iter(results_of(folder, [run.id])), None)
        if there is not None:
            return there
        found = no_result(run, f"ended its process {STRIKES} times")
        journal.add(found)
    finally:
        job.release()
    return found


def _do(run: PlannedRun, folder: str, work: Work, code: str, gate: Gate, roots: tuple[Path, ...]) -> Result:
    """On a worker: do a run and write it down. code, gate, roots: of the driver."""
    if code_hash() != code:
        raise SwathError(f"the worker {socket.gethostname()} has another version of swath than the driver")
    with _LOCK, through(gate), within(*roots):
        journal, fields = _tools(folder)
        (result,) = work([run], fields)
        return journal.add(result)


_LOCK = Lock()  # a worker may have several threads, its journal and its fields are for one


@cache
def _tools(folder: str) -> tuple[Journal, KeptFields]:
    """Tools of this worker process."""
    os.environ.setdefault("SWATH_THREADS", "1")
    return Journal(Path(folder), f"worker-{socket.gethostname()}-{os.getpid()}"), KeptFields()


def _slurm(jobs: int, security: Any) -> Any:
    """Jobs of SLURM, one worker process each, as dask's `jobqueue.slurm` settings describe them.

    The workers' keys are files for their owner alone, in its home folder unless `shared-temp-directory` says
    where.
    """
    import dask

    slurm_cluster = slurm_cluster_class()
    place = dask.config.get("jobqueue.slurm.shared-temp-directory", None) or "~"
    try:
        cluster = slurm_cluster(processes=1, cores=1, security=security, shared_temp_directory=place)
    except ValueError as error:
        raise InputError("--cluster", "slurm", f"expected settings of jobqueue.slurm: {error}") from error
    cluster.scale(jobs=jobs)
    return cluster


def slurm_cluster_class() -> Any:
    """The class of dask-jobqueue. Its import sets a handler of SIGINT: the one of before is put back."""
    handler = signal.getsignal(signal.SIGINT)
    try:
        with Extra("cluster", "--cluster slurm"):
            from dask_jobqueue import SLURMCluster
    finally:
        if current_thread() is main_thread():
            signal.signal(signal.SIGINT, handler)
    return SLURMCluster
