"""Columns of a block that are packed together have the bytes that each has alone, and come back."""

import numpy as np
import pytest

from swath.record.packed_columns import bits_of, pack, pack_all, unpack

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


def test_bits_of_a_whole_number_are_those_that_it_has_as_a_real_one():
    edges = [s * 2**k + d for k in range(63) for d in (-1, 0, 1) for s in (-1, 1)]
    numbers = np.array([-(2**63), 2**63 - 1, *edges, *np.random.default_rng(2).integers(-9, 9, 99)], np.int64)
    assert bits_of(numbers).tolist() == np.frexp(np.abs(numbers).astype(float))[1].tolist()
    assert bits_of(np.array([0, 1, -1, 255, 256])).tolist() == [0, 1, 1, 8, 9]
