"""Ctrl-C and SIGTERM: both stop what runs in order; where a stop would do harm, it comes a little later.

Python raises KeyboardInterrupt between any two steps of its own. Inside the binary of an FMU that is lost or
comes out as an error of the FMU, and while the end of a run is written it would leave half of it.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_depth = 0
_waiting: "type[KeyboardInterrupt] | None" = None  # comes at the end of the block
_asked: "type[KeyboardInterrupt] | None" = None  # the newest in the outermost `stoppable`


class Terminated(KeyboardInterrupt):
    """SIGTERM came: as Ctrl-C, but the exit code is another."""


@contextmanager
def stoppable() -> Iterator[None]:
    """Inside the block SIGTERM stops as Ctrl-C does, and both wait for `unstopped` blocks.

    Only signals that have their default are taken: a handler of the caller's own and one that is ignored
    stay. Outside the main thread, which alone gets signals, it does nothing.
    """
    if not _is_main_thread():
        yield
        return
    global _asked
    defaults = (signal.SIG_DFL, signal.default_int_handler)
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    taken = {n: handler for n, handler in before.items() if handler in defaults}
    if taken:
        _asked = None
    for number in taken:
        signal.signal(number, stop)
    usual = sys.unraisablehook
    if taken:
        hush_lost()
    try:
        yield
    finally:
        if taken:
            sys.unraisablehook = usual
        for number, handler in taken.items():
            signal.signal(number, handler)
        if taken:
            _asked = None  # told; what runs later in this process is not stopped by it


@contextmanager
def unstopped() -> Iterator[None]:
    """A stop that comes inside the block is raised at its end; a second one at once."""
    global _depth
    if not _is_main_thread():
        yield
        return
    _depth += 1
    try:
        yield
    finally:
        _depth -= 1
        if not _depth:
            _raise_waiting()


def raise_if_lost() -> None:
    """Raise a stop once more: Python drops what is raised in a finalizer or in a callback from C."""
    if _asked is not None and not _depth and _is_main_thread():
        raise _asked


def hush_lost() -> None:
    """Print nothing of a stop that Python drops: `raise_if_lost` raises it again."""
    usual = sys.unraisablehook

    def hook(dropped: "sys.UnraisableHookArgs", /) -> None:
        if _asked is None or dropped.exc_type is not _asked:
            usual(dropped)

    sys.unraisablehook = hook


def stop(number: int, frame: object) -> None:
    """The handler of both signals."""
    global _waiting, _asked
    kind = _asked = Terminated if number == signal.SIGTERM else KeyboardInterrupt
    if _depth and _waiting is None:
        _waiting = kind
        return
    _waiting = None
    raise kind


def _raise_waiting() -> None:
    global _waiting
    kind, _waiting = _waiting, None
    if kind is not None:
        raise kind


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
