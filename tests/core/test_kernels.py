"""Memory that Python and kernels share."""

import numpy as np
import pytest

from swath.kernels import address

ROOM = np.arange(12.0)
FIXED = ROOM.copy()
FIXED.setflags(write=False)


@pytest.mark.parametrize("array", [ROOM, ROOM[3:], ROOM[::2], ROOM[:0], ROOM.reshape(3, 4)[:, 1:], FIXED])
def test_an_address_is_that_of_the_first_number_also_of_what_has_gaps_or_is_read_only(array):
    assert address(array) == array.ctypes.data
