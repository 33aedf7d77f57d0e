"""Threads that share a cast: the caller does its part and waits for nobody who has not begun."""

import threading

import pytest

from swath.rays.device import ThreadPool
from tests.waiting import PATIENCE_S, ended


def test_a_busy_thread_is_not_waited_for():
    pool, held, release, here = ThreadPool(2), threading.Event(), threading.Event(), []

    def hold():
        if threading.current_thread() is not caller:
            held.set()
            release.wait(PATIENCE_S)
        else:
            held.wait(PATIENCE_S)

    caller = threading.Thread(target=lambda: pool.repeat(hold, 2))
    caller.start()
    assert held.wait(PATIENCE_S)
    pool.repeat(lambda: here.append(threading.current_thread()), 2)
    assert here == [threading.current_thread()]
    release.set()
    ended(caller)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_parts_cover_all_once_and_errors_come_back(threads):
    pool, parts = ThreadPool(threads), []
    pool.split(1000, 7, lambda first, size: parts.append((first, size)))
    ends = [first + size for first, size in sorted(parts)]
    assert [first for first, _ in sorted(parts)] == [0, *ends[:-1]]
    assert ends[-1] == 1000

    def fail(first, size):
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        pool.split(1000, 7, fail)
