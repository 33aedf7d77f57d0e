"""Imports, scenarios and a run where Python has none of its parts that are only for POSIX systems."""

import json
import os
import subprocess
import sys
from pathlib import Path

import swath
from swath.scenario.scenario import scenario_names

SOURCE = Path(swath.__file__).parent
MODULES = ("fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty")
FROM_OS = """
    O_CLOEXEC O_DIRECTORY O_NOFOLLOW O_NONBLOCK SCHED_FIFO WNOHANG chown fchmod fchown fork forkpty
    getegid geteuid getgid getgroups getloadavg getpgid getpgrp getpriority getsid getuid killpg lchown
    mkfifo mknod nice posix_fadvise posix_fallocate posix_spawn posix_spawnp pread preadv pwrite pwritev
    register_at_fork sched_getaffinity sched_getparam sched_getscheduler sched_param sched_setaffinity
    sched_setscheduler sendfile setpgid setsid statvfs sysconf ttyname uname wait wait3 wait4
"""
FROM_SIGNAL = """
    SIGALRM SIGBUS SIGCHLD SIGCONT SIGHUP SIGKILL SIGPIPE SIGQUIT SIGSTOP SIGUSR1 SIGUSR2 alarm
    pthread_kill pthread_sigmask setitimer sigpending sigtimedwait sigwait
"""
# The packages of others come first: they have branches of their own for Windows, taken by its name.
HIDDEN = f"""
import asyncio, concurrent.futures, multiprocessing.resource_tracker, os, platform, runpy, shutil, signal
import subprocess, sys, tempfile
import jinja2, matplotlib.pyplot, mcap.reader, mcap.writer, numpy, pyarrow.parquet, pydantic, rich.console
import rosbags.typesys, ruamel.yaml, warp
HIDDEN = {MODULES}
for name in HIDDEN:
    sys.modules[name] = None
for name in '''{FROM_OS}'''.split():
    vars(os).pop(name, None)
for name in '''{FROM_SIGNAL}'''.split():
    vars(signal).pop(name, None)
"""
IMPORT_ALL = """
import importlib, pkgutil, traceback, swath
for found in pkgutil.walk_packages(swath.__path__, "swath."):
    if found.name.startswith(("swath.data.", "swath.examples")):
        continue
    try:
        importlib.import_module(found.name)
    except ImportError as error:
        *_, at = (f for f in traceback.extract_tb(error.__traceback__) if "importlib" not in f.filename)
        missing = (error.name or "").partition(".")[0]
        if at.filename.startswith(swath.__path__[0]) and missing in (*HIDDEN, "swath"):
            raise  # else an extra is missing, or needs POSIX itself
from swath.scenario.scenario import load_scenario, scenario_names
print(sum(bool(load_scenario(name)) for name in scenario_names()), "scenarios")
"""
RUN = """
from swath.commands.main import main
code = main(["run", *sys.argv[1:]])
print(*sys.modules)
sys.exit(code)
"""
SHORT = {"run.distance_m": 1, "expect": {}}


def without_posix(code, *arguments, folder):
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(SOURCE.parent), os.environ.get("PYTHONPATH", "")]),
    }
    return subprocess.run(
        [sys.executable, "-c", HIDDEN + code, *arguments],
        capture_output=True, text=True, cwd=folder, env=environment, check=False,
    )  # fmt: skip


def test_every_module_is_imported_and_every_scenario_read(tmp_path):
    done = without_posix(IMPORT_ALL, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(len(scenario_names())), "scenarios"]


def test_a_run_is_the_same_as_with_them(tmp_path):
    arguments = [word for key, value in SHORT.items() for word in ("--set", f"{key}={json.dumps(value)}")]
    done = without_posix(RUN, "laser-pilot", *arguments, "--out", "run", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert not {"pandas", "scipy"} & {*done.stdout.splitlines()[-1].split()}  # 0.3 s each, of 2
    names = {file.name for file in (tmp_path / "run").iterdir()}
    assert names >= {
        *("report.html", "replay.html", "summary.json", "tracks.parquet", "run.mcap", "scenario.yaml")
    }
    there = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    here = swath.run("laser-pilot", tmp_path / "here", sets=SHORT, report=False)
    assert there["digest"] == here.summary["digest"]
