"""A few of the faults of benchmarks/kills.py, which does many: nothing is lost, the same command goes on."""

import shutil
import sys

import pytest
from benchmarks.kills import FAULTS, SIGNALS, Starter, study

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="faults are of Linux, and built"
)


@pytest.fixture(scope="module")
def starter(tmp_path_factory):
    made = Starter(tmp_path_factory.mktemp("starter"))
    yield made
    made.close()


@pytest.mark.draws
@pytest.mark.parametrize(("name", "count"), [("run", len(SIGNALS) + len(FAULTS)), ("test run", 2)])
def test_a_stopped_command_loses_nothing_and_goes_on(name, count, starter):
    """Of a run every fault once. What fails says its seed and number."""
    seed = 5
    ended = list(study(name, starter, count, seed))
    assert len(ended) == count
    assert any(kind == how for _, kind, how in ended)
