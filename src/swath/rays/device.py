"""What rays run on: threads of the CPU, or another device of Warp."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from swath.core.errors import SwathError
from swath.core.units import digits_in
from swath.kernels import start_warp

__all__ = ["ThreadPool", "ray_device", "start_warp", "thread_count"]


class ThreadPool:
    """Threads that share the work of one cast; one thread is the caller's own."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._executor = ThreadPoolExecutor(threads - 1) if threads > 1 else None

    def repeat(self, work: Callable[[], None], times: int) -> None:
        """Call `work` at most so many times at once, of which this thread does one.

        Each call takes what is left until there is nothing left: a thread that the system has not woken by
        the time that this one is done is not waited for.
        """
        others = [self._executor.submit(work) for _ in range(times - 1)] if self._executor is not None else []
        try:
            work()
        finally:
            for other in others:
                if not other.cancel():
                    other.result()

    def split(self, count: int, least: int, work: Callable[[int, int], None]) -> None:
        """Call `work(first, size)` for parts of `count` items, none smaller than `least` but the last."""
        if self._executor is None or count < 2 * least:
            work(0, count)
            return
        size = max(least, -(-count // (8 * self.threads)))
        starts = iter(range(0, count, size))

        def take() -> None:
            for first in starts:
                work(first, min(size, count - first))

        self.repeat(take, self.threads)


def thread_count() -> int:
    """Threads for rays: SWATH_THREADS, else all cores."""
    text = os.environ.get("SWATH_THREADS", "")
    if not text:
        return os.cpu_count() or 1
    if (count := digits_in(text)) < 1:
        raise SwathError(f"SWATH_THREADS = {text}: expected a whole number >= 1")
    return count


def ray_device(name: str | None = None) -> str:
    """Name of the device on which rays through crop are cast: `cpu`, `cuda:0`, `cuda:1` ...

    name: as asked for, `cuda` is the first GPU; default SWATH_DEVICE, else `cpu`. SwathError where there is
    none of that name.
    """
    asked = name or os.environ.get("SWATH_DEVICE") or "cpu"
    if asked == "cpu":
        return asked
    known = [device.alias for device in start_warp().get_devices()]
    found = "cuda:0" if asked == "cuda" else asked
    if found not in known:
        key = "device" if name else "SWATH_DEVICE"
        raise SwathError(f"{key} = {asked}: expected one of this machine's {', '.join(known)}")
    return found
