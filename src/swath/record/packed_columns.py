"""Columns of real numbers as bytes that compress well, without losing a bit.

Bytes of one weight stand together, the lowest of all numbers first (`planes`). Numbers whose course in time
is smooth are second differences before, of their bits read as whole numbers (`smooth`): a pose at 200 Hz then
takes two thirds. Of 32-bit numbers a look at the first of them says whether it pays. Of rotation matrices the
third column is the cross product of the others but for the last bits: only these are kept (`rotation`).
"""

import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

PLANES, SMOOTH, ROTATION = "planes", "smooth", "rotation"
WAYS = (PLANES, SMOOTH, ROTATION)
LEAST = 40  # numbers of a column from which on it is packed
LOOK = 512  # numbers that are looked at
ROUGH_BITS = 51.0  # differences of this size on average [bit] save nothing: a mantissa has 53


def pack(column: NDArray[Any]) -> tuple[str, bytes]:
    """How a column (n, ...) of numbers is packed, "" = not at all, and its bytes."""
    column = column.astype(column.dtype.newbyteorder("<"), order="C", copy=False)
    if column.size < LEAST or column.dtype.itemsize not in (4, 8):
        return "", column.tobytes()
    if column.dtype.itemsize == 4:
        first = column.reshape(-1)[:LOOK]
        pays = len(zlib.compress(_planes(first), 1)) < len(zlib.compress(first.tobytes(), 1))
        return (PLANES, _planes(column)) if pays else ("", column.tobytes())
    if _are_rotations(column):
        residual = _whole(column[:, :, 2]) - _whole(_third(column))
        return ROTATION, _planes(np.concatenate([_steps(column[:, :, :2]).ravel(), residual.ravel()]))
    steps = _steps(column)
    is_smooth = bits_of(steps).mean() < ROUGH_BITS
    return (SMOOTH, _planes(steps)) if is_smooth else (PLANES, _planes(column))


def pack_all(columns: Sequence[NDArray[Any]]) -> list[tuple[str, bytes]]:
    """`pack` of each; columns of as many single 8-byte numbers as the first has are looked at together."""
    count = len(columns[0])
    alike = [i for i, c in enumerate(columns) if c.ndim == 1 and len(c) == count and c.dtype.itemsize == 8]
    if count < LEAST or len(alike) < 2:
        return [pack(column) for column in columns]
    numbers = np.stack([_whole(columns[i].astype(columns[i].dtype.newbyteorder("<"))) for i in alike])
    steps = _differences(numbers.copy())
    is_smooth = bits_of(steps).mean(axis=1) < ROUGH_BITS
    chosen = np.where(is_smooth[:, None], steps, numbers).view(np.uint8).reshape(-1, count, 8)
    planes = np.ascontiguousarray(chosen.transpose(0, 2, 1))
    packed = {
        i: (SMOOTH if smooth else PLANES, plane.tobytes())
        for i, smooth, plane in zip(alike, is_smooth.tolist(), planes, strict=True)
    }
    return [packed.get(i) or pack(column) for i, column in enumerate(columns)]


def unpack(data: bytes, how: str, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """A column of a type and shape (n, ...) from its bytes. ValueError where these are not as many."""
    planes = np.frombuffer(data, np.uint8).reshape(dtype.itemsize, -1)
    numbers: NDArray[Any] = np.ascontiguousarray(planes.T)
    if how == ROTATION:
        split = 6 * shape[0]
        column = np.empty(shape, dtype)
        column[:, :, :2] = _courses(numbers[:split], dtype, (shape[0], 3, 2))
        residual = numbers[split:].view("<i8").reshape(shape[0], 3)
        column[:, :, 2] = (residual + _whole(_third(column))).view(dtype)
        return column
    if how == SMOOTH:
        return _courses(numbers, dtype, shape)
    return numbers.view(dtype).reshape(shape)


def _steps(column: NDArray[Any]) -> NDArray[Any]:
    """Second differences along each number's course, (course, n), of the bits as whole numbers."""
    return _differences(np.ascontiguousarray(column.reshape(len(column), -1).T).view("<i8").copy())


def _differences(courses: NDArray[Any]) -> NDArray[Any]:
    """Second differences along the rows, in place."""
    for _ in range(2):
        courses[:, 1:] = courses[:, 1:] - courses[:, :-1]
    return courses


def bits_of(numbers: NDArray[Any]) -> NDArray[Any]:
    """How many bits whole numbers have without their sign: the exponent of the real number that each is."""
    exponent = np.abs(numbers).astype(float).view(np.uint64) >> 52 & 0x7FF
    return np.where(exponent, exponent.view(np.int64) - 1022, 0)


def _courses(steps: NDArray[np.uint8], dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """A column from the bytes of its second differences, (numbers, 8)."""
    courses = np.cumsum(np.cumsum(steps.view("<i8").reshape(-1, shape[0]), axis=1), axis=1)
    return np.ascontiguousarray(courses.T).view(dtype).reshape(shape)


def _planes(numbers: NDArray[Any]) -> bytes:
    return numbers.view(np.uint8).reshape(-1, numbers.dtype.itemsize).T.tobytes()


def _are_rotations(column: NDArray[Any]) -> bool:
    """Whether the cross product says about what a matrix (n, 3, 3) holds, with the same bits everywhere."""
    if column.shape[1:] != (3, 3) or column.dtype.kind != "f" or not (np.abs(column) < 2.0).all():
        return False
    return bool(np.allclose(column[:, :, 2], _third(column), atol=1e-9))


def _third(matrix: NDArray[Any]) -> NDArray[Any]:
    """The cross product of the first two columns of matrices (n, 3, 3), single products and differences."""
    (ax, ay, az), (bx, by, bz) = matrix[:, :, 0].T, matrix[:, :, 1].T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _whole(numbers: NDArray[Any]) -> NDArray[Any]:
    """The bits as whole numbers."""
    return np.ascontiguousarray(numbers).view("<i8")
