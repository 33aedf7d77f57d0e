"""Function tests on dask: complete and the same bytes as the pool's, with a worker killed on the way."""

import os
import re
import signal
import socket
import ssl
from pathlib import Path

import pytest

from swath.core.errors import InputError, MissingExtra
from swath.core.foreign_code import NotNamed
from swath.tools.function_test.cluster import cluster_client, run_on_cluster
from swath.tools.function_test.journal import results_of, write_table
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.pool import run_all
from tests.tools.fake_work import fake_works, finished

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


@pytest.mark.draws
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

        run_on_cluster(runs, tmp_path / "journal", client, kill_once, work=fake_works)
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
        work=fake_works,
    )
    rest = [run for run in runs if run.id != runs[9].id]
    assert table_of(tmp_path, rest) == table_of(pool, rest)


@pytest.mark.filterwarnings("ignore")
def test_every_port_of_a_local_cluster_asks_for_its_certificate():
    """On this machine alone; a stranger that speaks TLS or not gets no job done, and no page."""
    pytest.importorskip("distributed")
    pytest.importorskip("cryptography")
    from distributed import Client

    with cluster_client("local", 1) as client:
        assert client.submit(int, "7").result() == 7
        ports = listening(processes(os.getpid()))
        assert len(ports) >= 3
        assert {address for address, _ in ports} == {"127.0.0.1"}
        for _, port in ports:
            assert not answers(port), port
        scheduler = client.scheduler.address
        for address in (scheduler, scheduler.replace("tls", "tcp")):
            with pytest.raises((OSError, TypeError, ValueError)):
                Client(address, timeout=2)


def processes(pid):
    """A process and all that it started."""
    below = Path(f"/proc/{pid}/task").glob("*/children")
    return [pid, *(p for some in below for child in some.read_text().split() for p in processes(int(child)))]


def listening(pids):
    """(address, port) on which some processes listen, of TCP."""
    own = {os.readlink(fd) for pid in pids for fd in Path(f"/proc/{pid}/fd").iterdir() if fd.is_symlink()}
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    places = [row[1].split(":") for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in own]
    return {(socket.inet_ntoa(bytes.fromhex(a)[::-1]), int(port, 16)) for a, port in places}


def answers(port):
    """Whether a port gives a stranger anything but an error, over TLS without a certificate or in plain."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    for wrap in (context.wrap_socket, lambda plain: plain):
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=3) as plain, wrap(plain) as peer:
                peer.sendall(b"GET /info/main/workers.html HTTP/1.0\r\n\r\n")
                told = peer.recv(100)
        except OSError:
            continue
        if told and not told.startswith((b"HTTP/1.1 404", b"HTTP/1.0 404")) and b"HTTP" in told:
            return True
    return False


def test_other_places_are_refused_and_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "dask", None)
    with pytest.raises(MissingExtra, match=r"swath\[cluster\]"), cluster_client("local", 1):
        pass
    monkeypatch.undo()
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="address of a scheduler"), cluster_client("kubernetes", 1):
        pass
    for address in ("tcp://127.0.0.1:1", "ucx://node:2"):
        with pytest.raises(NotNamed, match=f"--allow-address {address}"), cluster_client(address, 1):
            pass
    for address in (
        "tls://127.0.0.1:1",
        "tls://127.0.0.1",
        "tls://[::",
    ):  # without certificates in dask's settings
        with pytest.raises(InputError, match=f"--cluster = {re.escape(address)}"), cluster_client(address, 1):
            pass
