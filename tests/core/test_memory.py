"""Memory of what was sent: let go at once, and used again."""

import gc
import weakref

import numpy as np

from swath.core.blocks import Block, Seen
from swath.core.rows import Spare, Trail, row_with
from swath.signals import SpeedCommand

NUMBERS = np.dtype([("a", np.float64), ("b", np.float64, (3,))])


def test_memory_is_used_again_once_no_view_of_it_is_left():
    spare = Spare()
    first = spare.empty((4096, 2), NUMBERS)
    view, at = first["b"][1:, 0], first.ctypes.data
    del first
    other = spare.empty((4096, 2), NUMBERS)  # the first is still looked at
    other["b"] = 1.0
    assert other.ctypes.data != at
    view[:] = 2.0
    assert (other["b"] == 1.0).all()
    del view
    assert spare.empty((4000, 2), NUMBERS).ctypes.data == at


def test_samples_are_let_go_without_a_collector():
    """Runs collect cycles rarely: one that held samples would hold all of them."""
    trail = Trail(row_with(SpeedCommand(0, 1.0)), 1, ("combine.speed", "command"))
    trail.append(0)
    seen, known = Seen([Block(trail, 0)]), weakref.ref(trail)
    assert seen.of_machine("combine").of(SpeedCommand) is not None
    assert seen.of(SpeedCommand, "combine") is not None
    gc.disable()
    try:
        del seen, trail
        assert known() is None
    finally:
        gc.enable()
