"""A job of driven machines copied in the middle, and on several threads: the same in the end."""

import os
import subprocess
import sys
from copy import deepcopy

import pytest

from swath.job.digest import digest_of
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.kinematic import Kinematic
from swath.job.machines import fleet_of
from swath.job.work import plan_of
from tests.job.jobs import job_file

TINY = [(0.0, 0.0), (160.0, 0.0), (160.0, 110.0), (0.0, 110.0)]


def echelon(motion):
    file = job_file(2, 2, boundary_m=TINY, team={"together": "echelon"})
    fleet = fleet_of(file)
    return Job(file, plan_of(file, fleet, None), fleet, motion())


@pytest.mark.parametrize("motion", [Events, Kinematic])
def test_a_job_goes_on_as_a_copy_to_the_same_digest(motion):
    whole = echelon(motion)
    whole.run()
    begun = echelon(motion)
    begun.run(until=0.5 * whole.time)
    assert not begun.is_over
    again = deepcopy(begun)
    assert digest_of(again) == digest_of(begun) != digest_of(whole)
    again.run()
    assert digest_of(again) == digest_of(whole)
    assert abs(sum(c.cut for c in again.combines) / again.at_truck - 1.0) < 1e-9
    assert sorted(again.pass_times) == list(range(len(again.plan.passes)))


def test_threads_do_not_change_the_digest():
    code = "from tests.job.test_saved import *; job = echelon(Kinematic); job.run(); print(digest_of(job))"
    found = set()
    for threads in ("1", "2"):
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS")
        env = {**os.environ, **dict.fromkeys(names, threads)}
        made = subprocess.run(
            [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
        )
        found.add(made.stdout)
    assert len(found) == 1
