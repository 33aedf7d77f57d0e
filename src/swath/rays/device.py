"""What rays run on."""

import os

from swath.core.errors import SwathError
from swath.kernels import start_warp

__all__ = ["ray_device", "start_warp", "thread_count"]


def thread_count() -> int:
    """Threads for rays: SWATH_THREADS, else all cores."""
    text = os.environ.get("SWATH_THREADS", "")
    if not text:
        return os.cpu_count() or 1
    if not text.isdecimal() or int(text) < 1:
        raise SwathError(f"SWATH_THREADS = {text}: expected a whole number >= 1")
    return int(text)


def ray_device() -> str:
    """Where rays through crop are walked: SWATH_DEVICE, else `cpu`; SwathError if it is not there."""
    name = os.environ.get("SWATH_DEVICE") or "cpu"
    if name != "cpu":
        known = [device.alias for device in start_warp().get_devices()]
        if name not in known:
            raise SwathError(f"SWATH_DEVICE = {name}: expected one of this machine's {', '.join(known)}")
    return name
