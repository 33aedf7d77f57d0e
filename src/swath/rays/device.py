"""Warp, started quietly and with a kernel cache that this user may write to."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any


@cache
def start_warp() -> Any:
    """The `warp` module, initialised.

    The kernel cache is Warp's own (WARP_CACHE_PATH or the user's cache folder); when that cannot be written,
    a folder of this user in the system's temporary folder.
    """
    import warp as wp

    if hasattr(wp.config, "log_level"):  # newer than 1.10
        wp.config.log_level = wp.LOG_ERROR
    else:
        wp.config.quiet = True
    if "WARP_CACHE_PATH" not in os.environ and not _is_writable(_user_cache()):
        folder = (
            Path(tempfile.gettempdir()) / f"swath-warp-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
        )
        wp.config.kernel_cache_dir = str(folder)
    with _quiet_stderr():  # without a GPU driver the native part says so there
        wp.init()
    return wp


def thread_count() -> int:
    """Threads for rays: SWATH_THREADS, else all cores."""
    from swath.core.errors import InputError

    text = os.environ.get("SWATH_THREADS", "")
    if not text:
        return os.cpu_count() or 1
    if not text.isdecimal() or int(text) < 1:
        raise InputError("SWATH_THREADS", text, "expected a whole number >= 1")
    return int(text)


@contextmanager
def _quiet_stderr() -> Iterator[None]:
    try:
        kept = os.dup(2)
    except OSError:  # there is no stderr
        yield
        return
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _user_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path(os.path.expanduser("~"), ".cache"))
