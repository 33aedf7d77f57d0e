"""The fingerprint of a run: the same bytes for the same scenario and seed, on any number of threads.

A chained SHA-256 (FIPS 180-4): value_k = sha256(value_{k-1} || sample bytes). The chain keeps 32 bytes
between samples, so that a run saved in the middle and resumed ends on the digest of an uninterrupted one.
"""

import hashlib
import struct
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from swath.signals import Signal

_LAYOUTS: dict[tuple[str, str, Any], tuple[bytes, tuple[str, ...]]] = {}


class Digest:
    """Observer of a graph that folds every sample of every slot, in order, into one value.

    Wall clock, threads and the files that are written do not enter. NaNs count as one value.
    """

    def __init__(self) -> None:
        self.value = bytes(32)

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Take in what `slot` published at t [ns]."""
        for output, signal in outputs.items():
            self.add(sample_bytes(slot, output, t, signal))

    def add(self, sample: bytes) -> None:
        """Take in the bytes of one sample."""
        self.value = hashlib.sha256(self.value + sample).digest()

    @property
    def hex(self) -> str:
        """The digest so far, 64 hexadecimal digits."""
        return self.value.hex()

    def save(self) -> dict[str, Any]:
        """State between two samples."""
        return {"value": np.frombuffer(self.value, dtype=np.uint8).copy()}

    def load(self, state: Mapping[str, Any]) -> None:
        """Go on from a saved state."""
        self.value = np.asarray(state["value"], dtype=np.uint8).tobytes()


def sample_bytes(slot: str, output: str, t: int, signal: Signal) -> bytes:
    """Canonical bytes of a sample published at t [ns]."""
    head, names = _layout(slot, output, type(signal))
    return b"".join([head, struct.pack("<q", t), *(encode(getattr(signal, name)) for name in names)])


def _layout(slot: str, output: str, kind: Any) -> tuple[bytes, tuple[str, ...]]:
    key = (slot, output, kind)
    if key not in _LAYOUTS:
        names = tuple(f.name for f in fields(kind))
        _LAYOUTS[key] = "/".join((slot, output, kind.__name__, *names)).encode() + b"\n", names
    return _LAYOUTS[key]


def encode(value: Any) -> bytes:
    """Canonical bytes of a field: a letter for its kind, then little-endian content."""
    if isinstance(value, bool | np.bool_):
        return b"t" if value else b"f"
    if isinstance(value, int | np.integer):
        return b"i" + struct.pack("<q", int(value))
    if isinstance(value, float | np.floating):
        return b"d" + struct.pack("<d", float(value) if value == value else np.nan)
    if isinstance(value, np.ndarray):
        return _encode_array(value)
    if value is None:
        return b"n"
    if isinstance(value, str):
        data = value.encode()
        return b"s" + struct.pack("<q", len(data)) + data
    if is_dataclass(value):
        return b"(" + b"".join(encode(getattr(value, f.name)) for f in fields(value)) + b")"
    if isinstance(value, tuple | list):
        return b"[" + struct.pack("<q", len(value)) + b"".join(encode(v) for v in value)
    raise TypeError(f"a sample field of type {type(value).__name__} has no canonical bytes")


def _encode_array(array: np.ndarray) -> bytes:
    kind = array.dtype.newbyteorder("<")
    plain = np.ascontiguousarray(array, dtype=kind)
    if kind.kind == "f":
        lost = np.isnan(plain)
        if lost.any():
            plain = np.where(lost, np.array(np.nan, dtype=kind), plain)
    return f"a{kind.str}{array.shape}".encode() + plain.tobytes()
