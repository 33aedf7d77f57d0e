"""Memory that Python and kernels share."""

import os
import re
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np
import pytest

from swath import kernels
from swath.kernels import _own_temporary, address, start_warp
from tests.waiting import PATIENCE_S

ROOM = np.arange(12.0)
FIXED = ROOM.copy()
FIXED.setflags(write=False)


@pytest.mark.parametrize("array", [ROOM, ROOM[3:], ROOM[::2], ROOM[:0], ROOM.reshape(3, 4)[:, 1:], FIXED])
def test_an_address_is_that_of_the_first_number_also_of_what_has_gaps_or_is_read_only(array):
    assert address(array) == array.ctypes.data


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="users as of POSIX")
@pytest.mark.parametrize(("mode", "is_taken"), [(0o700, True), (0o755, True), (0o777, False), (0o702, False)])
def test_kernels_come_from_no_folder_that_others_may_write(tmp_path, monkeypatch, mode, is_taken):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    planted = tmp_path / f"swath-warp-{os.getuid()}"
    planted.mkdir()
    planted.chmod(mode)
    assert (_own_temporary() == planted) == is_taken
    link = tmp_path / "elsewhere"
    planted.rename(link)
    planted.symlink_to(link)
    assert _own_temporary() != planted


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="users as of POSIX")
@pytest.mark.parametrize("name", ["1.0", "1.0/wp_mine", "1.0/wp_mine/mine.o"])
def test_no_folder_or_file_of_a_kernel_cache_is_written_by_others(tmp_path, monkeypatch, name):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    planted = tmp_path / f"swath-warp-{os.getuid()}"
    (planted / "1.0" / "wp_mine").mkdir(parents=True, mode=0o755)
    planted.chmod(0o755)
    (planted / "1.0/wp_mine/mine.o").touch(0o644)
    assert _own_temporary() == planted
    inside = planted / name
    inside.chmod(inside.stat().st_mode | 0o002)
    assert _own_temporary() != planted
    inside.chmod(inside.stat().st_mode & ~0o002)
    inside.rename(tmp_path / "elsewhere")
    inside.symlink_to(tmp_path / "elsewhere")
    assert _own_temporary() != planted


def test_warp_starts_once_for_threads_that_ask_at_once():
    code = (
        "import os, threading; from swath.kernels import start_warp; begin = threading.Barrier(4)\n"
        "before = os.fstat(2); asked = [threading.Thread(target=lambda: (begin.wait(), start_warp()))"
        " for _ in range(4)]\n"
        "[t.start() for t in asked]; [t.join() for t in asked]\n"
        "assert os.path.samestat(before, os.fstat(2))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_process_that_was_forked_while_a_thread_loads_kernels_can_load_its_own():
    held, over = threading.Event(), threading.Event()

    def hold():
        with kernels._loading:
            held.set()
            over.wait(PATIENCE_S)

    thread = threading.Thread(target=hold)
    thread.start()
    assert held.wait(PATIENCE_S)
    child = os.fork()
    if child == 0:
        os._exit(0 if kernels._loading.acquire(blocking=False) else 1)
    over.set()
    thread.join()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_a_kernel_that_many_threads_ask_for_at_once_is_loaded_once():
    wp, begin, loaded = start_warp(), threading.Barrier(8), []

    @wp.kernel(module="unique")
    def twice(numbers: wp.array(dtype=wp.float64)):
        numbers[0] = wp.float64(2.0) * numbers[0]

    def load():
        begin.wait()
        loaded.append(twice.module.load(wp.get_device("cpu")))

    threads = [threading.Thread(target=load) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(loaded) == 8
    assert len({id(each) for each in loaded}) == 1


def test_all_kernels_are_compiled_with_one_set_of_flags():
    """Warp compiles its headers anew for each other set: seconds of a first run."""
    source = Path(kernels.__file__).parent
    own = re.compile(r"cpu_compiler_flags|\boptimization_level|\bmode\b[\"']: [\"'](debug|release)")
    found = {path for path in source.rglob("*.py") if own.search(path.read_text(encoding="utf-8"))}
    assert found == {Path(kernels.__file__)}
