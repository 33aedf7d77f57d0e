"""The fingerprint of a run: the same bytes for the same scenario and seed, on any number of threads.

A chained SHA-256 (FIPS 180-4): value_k = sha256(value_{k-1} || bytes of samples), over blocks that end with
the first sample that fills them. What is kept between two samples is the value and the block so far: a run
saved in the middle and resumed ends on the digest of an uninterrupted one.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from struct import Struct
from typing import Any

import numpy as np

from swath.signals import Signal

BLOCK_BYTES = 64 * 1024
TIME, INTEGER, FLOAT = Struct("<q"), Struct("<cq"), Struct("<cd")
_LAYOUTS: dict[tuple[str, str, Any], tuple[bytes, tuple[str, ...]]] = {}


class Digest:
    """Observer of a graph that folds every sample of every slot, in order, into one value.

    Wall clock, threads and the files that are written do not enter. NaNs count as one value.
    """

    def __init__(self) -> None:
        self._value = bytes(32)
        self._block = bytearray()

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Take in what `slot` published at t [ns]."""
        for output, signal in outputs.items():
            self.add(sample_bytes(slot, output, t, signal))

    def add(self, sample: bytes) -> None:
        """Take in the bytes of one sample."""
        self._block += sample
        if len(self._block) >= BLOCK_BYTES:
            self._value = hashlib.sha256(self._value + self._block).digest()
            self._block.clear()

    @property
    def hex(self) -> str:
        """The digest so far, 64 hexadecimal digits."""
        return hashlib.sha256(self._value + self._block).hexdigest()

    def save(self) -> dict[str, Any]:
        """State between two samples."""
        return {"value": np.frombuffer(self._value + self._block, dtype=np.uint8).copy()}

    def load(self, state: Mapping[str, Any]) -> None:
        """Go on from a saved state."""
        kept = np.asarray(state["value"], dtype=np.uint8).tobytes()
        self._value, self._block = kept[:32], bytearray(kept[32:])


def sample_bytes(slot: str, output: str, t: int, signal: Signal) -> bytes:
    """Canonical bytes of a sample published at t [ns]."""
    head, names = _layout(slot, output, type(signal))
    parts = [head, TIME.pack(t)]
    for name in names:
        value = getattr(signal, name)
        encoder = ENCODERS.get(type(value))
        parts.append(encode(value) if encoder is None else encoder(value))
    return b"".join(parts)


def _layout(slot: str, output: str, kind: Any) -> tuple[bytes, tuple[str, ...]]:
    key = (slot, output, kind)
    if key not in _LAYOUTS:
        names = tuple(f.name for f in fields(kind))
        _LAYOUTS[key] = "/".join((slot, output, kind.__name__, *names)).encode() + b"\n", names
    return _LAYOUTS[key]


def encode(value: Any) -> bytes:
    """Canonical bytes of a field: a letter for its kind, then little-endian content."""
    if encoder := ENCODERS.get(type(value)):
        return encoder(value)
    if isinstance(value, np.generic):
        return encode(value.item())
    if is_dataclass(value):
        return b"(" + b"".join(encode(getattr(value, f.name)) for f in fields(value)) + b")"
    for kind, encoder in ENCODERS.items():
        if isinstance(value, kind):
            return encoder(value)
    raise TypeError(f"a sample field of type {type(value).__name__} has no canonical bytes")


def _encode_float(value: float) -> bytes:
    return FLOAT.pack(b"d", value if value == value else np.nan)


def _encode_text(value: str) -> bytes:
    data = value.encode()
    return INTEGER.pack(b"s", len(data)) + data


def _encode_items(value: tuple[Any, ...] | list[Any]) -> bytes:
    return INTEGER.pack(b"[", len(value)) + b"".join(encode(v) for v in value)


def _encode_array(array: np.ndarray) -> bytes:
    kind = array.dtype.newbyteorder("<")
    plain = np.ascontiguousarray(array, dtype=kind)
    if kind.kind == "f":
        lost = np.isnan(plain)
        if lost.any():
            plain = np.where(lost, np.array(np.nan, dtype=kind), plain)
    return f"a{kind.str}{array.shape}".encode() + plain.tobytes()


ENCODERS: dict[type, Callable[[Any], bytes]] = {
    bool: lambda value: b"t" if value else b"f",
    int: lambda value: INTEGER.pack(b"i", value),
    float: _encode_float,
    np.ndarray: _encode_array,
    type(None): lambda value: b"n",
    str: _encode_text,
    tuple: _encode_items,
    list: _encode_items,
}
