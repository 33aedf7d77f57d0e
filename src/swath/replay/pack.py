"""Arrays and plain values as one text: what a page carries in itself.

A JSON head (length as uint32, little endian, then UTF-8) that names type, shape and place of every array,
then the arrays. Bytes of equal weight lie together (all first bytes of a float32 array, then all second ones
...), which deflates better than the plain order. All of it is deflated once and written as base64.
"""

import base64
import json
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

KINDS = ("uint8", "int8", "uint16", "int16", "uint32", "float32")  # a typed array of the browser each
LEVEL = 6  # of deflate: 9 takes three times as long for 1 % less


def packed(values: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Plain values and named arrays as bytes. TypeError for an array that browsers have no type for."""
    places: dict[str, Any] = {}
    parts: list[bytes] = []
    at = 0
    for name, array in arrays.items():
        if str(array.dtype) not in KINDS:
            raise TypeError(f"{name}: {array.dtype} is none of {', '.join(KINDS)}")
        data = shuffled(array)
        places[name] = {"type": str(array.dtype), "shape": list(array.shape), "at": at}
        parts.append(data)
        at += len(data)
    head = json.dumps({**values, "arrays": places}, allow_nan=False, separators=(",", ":")).encode()
    return zlib.compress(b"".join([len(head).to_bytes(4, "little"), head, *parts]), LEVEL)


def as_text(data: bytes) -> str:
    """Base64, for a page."""
    return base64.b64encode(data).decode("ascii")


def shuffled(array: NDArray[Any]) -> bytes:
    """The bytes of an array, those of equal weight together."""
    flat = np.ascontiguousarray(array.astype(array.dtype.newbyteorder("<"), copy=False)).reshape(-1)
    return flat.view(np.uint8).reshape(-1, array.dtype.itemsize).T.tobytes()


def unpacked(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What `packed` took, for whoever reads a page without a browser."""
    plain = zlib.decompress(data)
    length = int.from_bytes(plain[:4], "little")
    values = json.loads(plain[4 : 4 + length])
    arrays = {}
    for name, place in values.pop("arrays").items():
        kind = np.dtype(place["type"]).newbyteorder("<")
        count = int(np.prod(place["shape"], dtype=int))
        start = 4 + length + place["at"]
        rows = np.frombuffer(plain, np.uint8, count * kind.itemsize, start).reshape(kind.itemsize, count)
        arrays[name] = np.ascontiguousarray(rows.T).view(kind).reshape(place["shape"])
    return values, arrays
