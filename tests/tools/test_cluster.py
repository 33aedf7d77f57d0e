"""Function tests on dask: complete and the same bytes as the pool's, with a worker killed on the way."""

import os
import signal

import pytest

from swath.core.errors import InputError, MissingExtra
from swath.tools.function_test.cluster import cluster_client, run_on_cluster
from swath.tools.function_test.journal import finished, results_of, write_table
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.pool import run_all
from tests.tools.fake_work import fake_work

CASE = """
format: swath test case 1
objective: drives
source: estimated
scenario: straight
set: {run.distance_m: 6, combine.lidar.level: empirical}
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [5, 8, 10]}
seeds: 8
expect: {distance_m: {min: 6}}
"""


def table_of(folder, runs):
    return write_table(folder, results_of(folder / "journal", [run.id for run in runs])).read_bytes()


@pytest.mark.filterwarnings("ignore")
def test_a_killed_worker_loses_no_run_and_changes_no_byte(tmp_path, monkeypatch):
    """One worker is killed from outside, and one run kills every worker that it is given."""
    pytest.importorskip("distributed")
    (tmp_path / "drives.yaml").write_text(CASE, encoding="utf-8")
    runs = list(Plan(str(tmp_path / "drives.yaml")).runs())
    monkeypatch.setenv("FAKE_WORK_KILLS", runs[9].id)
    monkeypatch.setenv("FAKE_WORK_S", "0.05")
    done = []
    with cluster_client("local", 2) as client:
        pids = list(client.run(os.getpid).values())
        assert len(pids) == 2

        def kill_once(result):
            done.append(result)
            if len(done) == 4:
                os.kill(pids[0], signal.SIGKILL)

        run_on_cluster(runs, tmp_path / "journal", client, kill_once, work=fake_work)
    assert sorted(result["id"] for result in done) == sorted(run.id for run in runs)
    assert finished(tmp_path / "journal") == {run.id for run in runs}
    (error,) = [result for result in done if result["verdict"] == "error"]
    assert error["id"] == runs[9].id

    monkeypatch.setenv("FAKE_WORK_S", "0")
    pool = tmp_path / "pool"
    run_all(
        [run for run in runs if run.id != runs[9].id],
        pool / "journal",
        2,
        lambda result: None,
        work=fake_work,
    )
    rest = [run for run in runs if run.id != runs[9].id]
    assert table_of(tmp_path, rest) == table_of(pool, rest)


def test_other_places_are_refused_and_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "dask", None)
    with pytest.raises(MissingExtra, match=r"swath\[cluster\]"), cluster_client("local", 1):
        pass
    monkeypatch.undo()
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="address of a scheduler"), cluster_client("kubernetes", 1):
        pass
