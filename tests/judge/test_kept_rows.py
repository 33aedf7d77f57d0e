"""Rows of a whole run come back to the last bit, take less room than they would, and none of the memory."""

import tracemalloc

import numpy as np
import pytest

from swath.core.packed_state import pack, unpack
from swath.judge.evaluator import BLOCK, KeptRows


@pytest.mark.parametrize("count", [0, 1, BLOCK - 1, BLOCK, 3 * BLOCK + 17])
def test_rows_come_back_to_the_last_bit(count):
    rows = np.random.default_rng(1).normal(size=(count, 3))
    rows[count // 2 :, 1] = np.nan
    kept = KeptRows(3)
    for row in rows:
        kept.add(row)
    assert bool(kept) == (count > 0)
    assert kept.table().shape == (count, 3)
    assert kept.table().tobytes() == rows.tobytes()
    assert unpack(pack(kept)).table().tobytes() == rows.tobytes()


def test_a_long_way_takes_less_than_half_of_its_numbers():
    t = np.arange(10 * BLOCK) * 0.01
    way = np.stack([t, 1.94 * t, 10.0 + 1.9 * t, 0.1 * np.sin(0.3 * t)], axis=1)
    kept = KeptRows(4)
    kept.add([])
    for row in way:
        kept.add(row)
    assert len(pack(kept)) < 0.5 * way.nbytes


def test_memory_does_not_grow_with_the_way_and_saved_rows_go_on():
    kept, rows = KeptRows(4), np.random.default_rng(2).normal(size=(40 * BLOCK, 4))
    for row in rows[: 4 * BLOCK]:
        kept.add(row)
    tracemalloc.start()
    for row in rows[4 * BLOCK : 39 * BLOCK]:
        kept.add(row)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 50_000  # of 2.3 MB
    again = unpack(pack(kept))
    for both in (kept, again):
        for row in rows[39 * BLOCK :]:
            both.add(row)
        assert both.table().tobytes() == rows.tobytes()
