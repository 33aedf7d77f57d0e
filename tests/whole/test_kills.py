"""A few of the stopped runs of benchmarks/kills.py, which does many."""

import random
import signal

from benchmarks.kills import make_victim


def test_stopped_runs_leave_nothing_whole_that_is_not(tmp_path):
    victim, rng = make_victim(tmp_path, has_fmu=False), random.Random(5)
    for number in (signal.SIGKILL, signal.SIGTERM):
        victim.kill(number, rng, is_held=True)
    victim.run()
    victim.starter.close()
