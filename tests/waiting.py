"""Waits for what another thread or process does: for the event itself, as long as a busy machine may need."""

import time

PATIENCE_S = 300.0  # what takes longer will not happen


def until(holds, what, pause_s=0.05):
    """What `holds()` returned, once that is true; AssertionError that names `what` where it never is.

    pause_s: longest time between two looks; 0 where a look waits itself
    """
    end, pause = time.monotonic() + PATIENCE_S, min(0.001, pause_s)
    while not (found := holds()):
        assert time.monotonic() < end, f"not within {PATIENCE_S:g} s: {what}"
        time.sleep(pause)
        pause = min(1.5 * pause, pause_s)
    return found


def ended(thread):
    """Wait for the end of a thread."""
    thread.join(PATIENCE_S)
    assert not thread.is_alive(), f"not over within {PATIENCE_S:g} s: {thread.name}"
