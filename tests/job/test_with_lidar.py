"""The scenario of a job as it is written, with scanners, receivers and radio: the first seconds of it."""

import pytest

from swath.signals import CropEdge, JobState
from tests.job.cheap import CheapRun
from tests.job.test_two_combines import file_of
from tests.job.test_whole_field import JOB

FOR_S = 14.0


def digest_of(file, threads, monkeypatch):
    monkeypatch.setenv("SWATH_THREADS", threads)
    done = CheapRun(file, until_s=FOR_S, sets=[])
    assert done.of("combine_0", CropEdge).is_found
    assert done.of("combine_0", JobState).by_edge
    return done.digest.hex


@pytest.mark.parametrize("file", [JOB, file_of(1, 23.0)], ids=["one combine", "echelon"])
def test_the_same_digest_for_one_and_two_threads(file, monkeypatch):
    assert digest_of(file, "1", monkeypatch) == digest_of(file, "2", monkeypatch)
