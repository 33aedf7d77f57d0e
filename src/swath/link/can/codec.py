"""Numbers to frames and back, by the message descriptions in `data/can/guidance.dbc`."""

from collections.abc import Mapping
from typing import Any

from swath.core.errors import Extra
from swath.documents.j1939 import dbc_file, parse, value_of

Values = dict[str, float | None]
LAST = {8: 0xFA, 16: 0xFAFF, 32: 0xFAFFFFFF}


class Codec:
    """Encodes and decodes the messages of a DBC file; None stands for `not available`."""

    def __init__(self) -> None:
        with Extra("can", "a CAN bus"):
            import cantools
        database: Any = cantools.database.load_file(str(dbc_file()))
        self._messages: dict[str, Any] = {m.name: m for m in database.messages}
        self._headers = {m.name: parse(m.frame_id) for m in database.messages}
        self._names = {header.pgn: name for name, header in self._headers.items()}

    def header(self, name: str) -> tuple[int, int]:
        """(PGN, priority) of a message."""
        return self._headers[name].pgn, self._headers[name].priority

    def encode(self, name: str, values: Mapping[str, float | None]) -> bytes:
        """The data of a message. Numbers are rounded to the resolution and kept within the range.

        A signal that is not given, None or nan is `not available`: all ones.
        """
        message = self._messages[name]
        raw = {s.name: _raw(s, values.get(s.name)) for s in message.signals}
        return bytes(message.encode(raw, scaling=False, padding=True, strict=False))

    def decode(self, pgn: int, data: bytes) -> tuple[str, Values] | None:
        """Name and values of a message; None when it is not one of ours or has the wrong length."""
        name = self._names.get(pgn)
        if name is None or len(data) != self._messages[name].length:
            return None
        message = self._messages[name]
        raw = message.decode(data, decode_choices=False, scaling=False)
        return name, {s.name: value_of(s, int(raw[s.name])) for s in message.signals}


def _raw(signal: Any, value: float | None) -> int:
    if value is None or value != value:
        return int(2**signal.length - 1)
    top = LAST.get(signal.length, 2**signal.length - 1)
    return int(min(max(round((value - signal.offset) / signal.scale), 0), top))
