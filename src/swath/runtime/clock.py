"""The clock on the wall, and the scheduling class of this process."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Clock(Protocol):
    """A clock that never goes back. A test brings its own."""

    def now(self) -> int:
        """Time [ns]."""
        ...

    def sleep(self, duration: int) -> None:
        """Come back after `duration` [ns], or later."""
        ...


class WallClock:
    """The monotonic clock of the system. A sleep ends with a busy wait of `spin` [ns]."""

    def __init__(self, spin: int = 500_000) -> None:
        self._spin = spin

    def now(self) -> int:
        """Time [ns]."""
        return time.monotonic_ns()

    def sleep(self, duration: int) -> None:
        """Come back after `duration` [ns], or later: the system may wake us late."""
        until = time.monotonic_ns() + duration
        if duration > self._spin:
            time.sleep((duration - self._spin) * 1e-9)
        while time.monotonic_ns() < until:
            pass


@contextmanager
def scheduling(priority: int | None) -> Iterator[str]:
    """SCHED_FIFO with a priority (1 to 99) inside the block, where the system allows it.

    Yields what was had: `default`, `fifo 50`, or `fifo 50 refused: why`. None asks for nothing.
    """
    if priority is None:
        yield "default"
        return
    wanted = f"fifo {priority}"
    if not hasattr(os, "sched_setscheduler"):
        yield f"{wanted} refused: not known to this system"
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        yield f"{wanted} refused: {error.strerror}"
        return
    try:
        yield wanted
    finally:
        os.sched_setscheduler(0, *before)
