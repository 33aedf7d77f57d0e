"""What rays run on."""

import os

from swath.core.compiled import start_warp

__all__ = ["start_warp", "thread_count"]


def thread_count() -> int:
    """Threads for rays: SWATH_THREADS, else all cores."""
    from swath.core.errors import InputError

    text = os.environ.get("SWATH_THREADS", "")
    if not text:
        return os.cpu_count() or 1
    if not text.isdecimal() or int(text) < 1:
        raise InputError("SWATH_THREADS", text, "expected a whole number >= 1")
    return int(text)
