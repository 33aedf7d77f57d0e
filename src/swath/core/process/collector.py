"""How often Python looks for circles of references, in a process that swath has for itself; free memory."""

import atexit
import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


def collect_rarely() -> None:
    """Look when half a million objects are new, and not at the end.

    What a start imports, some 300,000 objects, stays until the end: to go through it again and again takes
    0.1 s, to take it to pieces before the process ends 0.4 s. A run makes hardly any circles.
    """
    gc.set_threshold(500_000, 20, 100)
    atexit.register(gc.freeze)


@contextmanager
def collected_rarely() -> Iterator[None]:
    """Inside the block, in somebody else's process: then it looks as often as before."""
    before = gc.get_threshold()
    gc.set_threshold(500_000, 20, 100)
    try:
        yield
    finally:
        gc.set_threshold(*before)


def give_back() -> None:
    """Free memory goes back to the system, which the C library of Linux does not always do by itself."""
    if sys.platform == "linux":
        import ctypes

        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none
        if trim is not None:
            trim(0)
