"""`--cluster slurm` without SLURM: an sbatch on the PATH that keeps each job's text and runs it here."""

import gc
import os
import re
import subprocess
import sys
from importlib.util import find_spec

import pytest

from swath.core.errors import InputError
from swath.tools.function_test.cluster import cluster_client, run_on_cluster, slurm_cluster_class
from swath.tools.function_test.plan import Plan
from tests.tools.fake_work import fake_works, finished
from tests.tools.test_cluster import CASE

SETTINGS = {
    "queue": "crop", "account": "harvest", "memory": "2GB", "walltime": "02:00:00", "interface": "lo",
    "job-script-prologue": ["module load python"], "death-timeout": 60,
}  # fmt: skip
SBATCH = """#!/bin/sh
n=$$
cp "$1" "$SLURM_JOBS/$n.sh"
sed 's/^module load python$/:/' "$1" > "$SLURM_JOBS/.run-$n"
setsid bash "$SLURM_JOBS/.run-$n" > "$SLURM_JOBS/.log-$n" 2>&1 & echo $! > "$SLURM_JOBS/.pid-$n"
echo "Submitted batch job $n"
"""
KEYS = re.compile(r"\S*/\.dask-jobqueue\.worker\.\S+")
SCANCEL = '#!/bin/sh\nfor n in "$@"; do kill -- "-$(cat "$SLURM_JOBS/.pid-$n")"; done\n'


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """Settings as a site has them; the folder of the jobs that were submitted."""
    if find_spec("dask_jobqueue") is None:
        pytest.skip("dask-jobqueue is not installed")
    import dask

    slurm_cluster_class()  # its defaults of `jobqueue` are there before the settings
    jobs, programs = tmp_path / "jobs", tmp_path / "bin"
    for folder in (jobs, programs):
        folder.mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (programs / name).write_text(text, encoding="utf-8")
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    monkeypatch.setenv("SLURM_JOBS", str(jobs))
    with dask.config.set({f"jobqueue.slurm.{key}": value for key, value in SETTINGS.items()}):
        yield jobs


@pytest.mark.filterwarnings("ignore")
def test_jobs_have_the_settings_of_the_site_and_do_the_runs(slurm, tmp_path, monkeypatch):
    """The text of a job is that of dask-jobqueue for one process of one thread; the runs are done by it."""
    from distributed import Security

    (tmp_path / "drives.yaml").write_text(CASE, encoding="utf-8")
    runs = list(Plan(str(tmp_path / "drives.yaml"), seeds=2).runs())
    done = []
    monkeypatch.setenv("HOME", str(tmp_path))
    with cluster_client("slurm", 2) as client:
        keys = [path for path in tmp_path.iterdir() if path.name.startswith(".dask-jobqueue")]
        assert len(keys) == 3
        assert {path.stat().st_mode & 0o777 for path in keys} == {0o600}
        address = client.scheduler.address
        run_on_cluster(runs, tmp_path / "journal", client, done.append, work=fake_works)
    assert sorted(result["id"] for result in done) == sorted(run.id for run in runs)
    assert finished(tmp_path / "journal") == {run.id for run in runs}

    assert not any(path.exists() for path in keys)
    texts = [path.read_text(encoding="utf-8") for path in sorted(slurm.glob("*.sh"))]
    assert len(texts) == 2
    security = Security.temporary()
    with slurm_cluster_class()(cores=1, processes=1, security=security, shared_temp_directory="~") as cluster:
        expected = KEYS.sub("KEY", cluster.job_script().replace(cluster.scheduler_address, address))
    for text in texts:
        assert KEYS.sub("KEY", re.sub(r"--name \S+", "--name dummy-name", text)) == expected
    asked = dict(line.removeprefix("#SBATCH ").split(" ", 1) for line in expected.splitlines()
                 if line.startswith("#SBATCH -") and not line.startswith("#SBATCH --"))  # fmt: skip
    assert (asked["-p"], asked["-A"], asked["-t"], asked["-n"]) == ("crop", "harvest", "02:00:00", "1")
    assert "#SBATCH --cpus-per-task=1" in expected
    assert "module load python" in expected
    assert re.search(r"dask_worker tls://\S+ .*--nthreads 1 --memory-limit 1.86GiB", expected)


@pytest.mark.filterwarnings("ignore")  # of the cluster that was not made, when it is collected
def test_settings_that_are_missing_are_named(slurm):
    import dask

    with (
        dask.config.set({"jobqueue.slurm.memory": None}),
        pytest.raises(InputError, match=r"--cluster = slurm: expected settings of jobqueue\.slurm: .*memory"),
        cluster_client("slurm", 1),
    ):
        pass
    gc.collect()


def test_a_stop_by_key_stays_one_when_jobs_have_been_submitted(slurm):
    """The import of dask-jobqueue alone makes SIGINT leave the process without KeyboardInterrupt."""
    program = """
import signal
from swath.tools.function_test.cluster import cluster_client
with cluster_client("slurm", 1):
    pass
assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
try:
    signal.raise_signal(signal.SIGINT)
except KeyboardInterrupt:
    print("stopped")
"""
    texts = {key: value for key, value in SETTINGS.items() if isinstance(value, str)}
    settings = {f"DASK_JOBQUEUE__SLURM__{key.upper().replace('-', '_')}": text for key, text in texts.items()}
    environment = {**os.environ, **settings}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    assert done.stdout == "stopped\n", done.stderr
