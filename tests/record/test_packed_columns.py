"""Columns of a block that are packed together have the bytes that each has alone, and come back."""

import numpy as np
import pytest

from swath.record.packed_columns import pack, pack_all, unpack

N = 101


@pytest.mark.parametrize("count", [N, 39, 2, 1])
def test_columns_packed_together_are_those_packed_alone_and_come_back(count):
    rng, t = np.random.default_rng(3), np.arange(N)
    matrices = np.stack([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in t])
    numbers = (t * 5_000_000, np.sin(0.01 * t), rng.normal(size=N), np.full(N, np.nan), t % 2 == 0)
    ranges, steps = rng.random((N, 241)), np.round(20.0 * rng.random((N, 241)))
    arrays = (rng.normal(size=(N, 3)), ranges.astype(np.float32), steps.astype(np.float32), matrices)
    columns = [*(c[:count] for c in (*numbers, *arrays)), rng.normal(size=241)]
    packed = pack_all(columns)
    assert packed == [pack(column) for column in columns]
    for column, (how, data) in zip(columns, packed, strict=True):
        whole = unpack(data, how, column.dtype, column.shape) if how else np.frombuffer(data, column.dtype)
        assert whole.tobytes() == column.tobytes()
