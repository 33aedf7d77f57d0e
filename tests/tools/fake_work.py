"""Work of a function test without any simulation, for worker processes."""

import os
import signal

from swath.tools.function_test.one_run import no_result


def fake_work(run, fields):
    """A result that passes; the run named in FAKE_WORK_KILLS kills its process."""
    if run.id == os.environ.get("FAKE_WORK_KILLS"):
        os.kill(os.getpid(), signal.SIGKILL)
    return {**no_result(run, ""), "verdict": "pass", "metrics": {"distance_m": 6.0}, "digest": "d"}


def begin_fake():
    """For workers: ten times the job."""
    return lambda job: 10 * job


def no_begin():
    """For workers that cannot begin."""
    raise RuntimeError("as a script without a main guard")
