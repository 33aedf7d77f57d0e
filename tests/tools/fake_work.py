"""Work of a function test without any simulation, for worker processes."""

import os
import signal
import time

from swath.runtime.kept import KeptFields
from swath.tools.function_test.journal import Journal, read_journals
from swath.tools.function_test.one_run import no_result, results_in


def do_run(run, fields):
    """The result of a run that is done alone."""
    (result,) = results_in([run], fields)
    return result


def finished(folder):
    """Names of the runs that are in a journal."""
    return {result["id"] for result in read_journals(folder)}


def here(work):
    """In the place of `run_all`: the result of each run is what `work` makes of it, in this process."""

    def run_here(runs, folder, workers, done):
        journal = Journal(folder, "here")
        try:
            for run in runs:
                done(journal.add(work(run)))
        finally:
            journal.close()

    return run_here


def driven_here():
    """As `here`: each run is driven."""
    fields = KeptFields()
    return here(lambda run: do_run(run, fields))


def fake_work(run, fields):
    """A result that passes; the run named in FAKE_WORK_KILLS kills its process."""
    if run.id == os.environ.get("FAKE_WORK_KILLS"):
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(float(os.environ.get("FAKE_WORK_S", "0")))
    return {**no_result(run, ""), "verdict": "pass", "metrics": {"distance_m": 6.0}, "digest": "d"}


def fake_works(runs, fields):
    """Those of some at once."""
    return [fake_work(run, fields) for run in runs]


def begin_fake():
    """For workers: ten times the job."""
    return lambda job: 10 * job


def begin_told():
    """What it is done by."""
    return lambda job: os.getpid()


def no_begin():
    """For workers that cannot begin."""
    raise RuntimeError("as a script without a main guard")


def analytic_value(length, depth, stems, speed):
    """A smooth value of four parameters, limited to 0.3."""
    return 0.12 * length * (0.4 + 0.5 * depth) + 0.0002 * abs(stems - 350) + 0.0006 * speed**2 * depth


def analytic_work(run):
    """A result whose edge_rmse_m is a formula of its point; with ANALYTIC_ERRORS some crash."""
    point = run.point
    if os.environ.get("ANALYTIC_ERRORS") and point["speed_kmh"] > 9:
        return no_result(run, "crashed")
    value = analytic_value(point["length_m"] - 20, point["depth_m"], point["stems"], point["speed_kmh"])
    entry = {"subject": "combine", "name": "edge_rmse_m", "limit": {"max": 0.3}, "value": value,
             "result": "fail" if value > 0.3 else "pass"}  # fmt: skip
    return {**no_result(run, ""), "verdict": entry["result"], "metrics": {"edge_rmse_m": value},
            "expect": [entry], "digest": f"{value}"}  # fmt: skip
