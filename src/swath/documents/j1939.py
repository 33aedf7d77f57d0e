"""Identifiers and names of J1939, on which ISO 11783 is built.

A 29-bit identifier (ISO 11783-3, SAE J1939-21): 3 bits priority, 18 bits that hold the parameter group number
(PGN), 8 bits source address. A PDU format below 240 makes a message for one destination, whose address then
stands in the low byte of those 18 bits and is no part of the PGN.
"""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

GLOBAL = 255  # destination: everybody
REQUEST = 0xEA00  # ask for a parameter group, 3 bytes: its PGN
ADDRESS_CLAIMED = 0xEE00  # ISO 11783-5: whose address the source is, 8 bytes: its NAME
TRANSPORT, TRANSPORT_DATA = 0xEC00, 0xEB00  # SAE J1939-21: begins a message of several frames; 7 bytes of it
BEGINS = (16, 32)  # first byte of the former: request to send, and announcement to all
TRACTOR_ECU = 240  # preferred addresses, ISO 11783-1
NAVIGATION = 28
HARVESTER = 7  # device classes, ISO 11783-1
NO_CLASS = 0


@dataclass(frozen=True)
class Header:
    """What an identifier says."""

    pgn: int
    priority: int
    source: int
    destination: int = GLOBAL

    @property
    def identifier(self) -> int:
        """The 29 bits."""
        low = self.destination if _is_addressed(self.pgn) else 0
        return self.priority << 26 | (self.pgn | low) << 8 | self.source


def parse(identifier: int) -> Header:
    """The header of a 29-bit identifier."""
    pgn, source = identifier >> 8 & 0x3FFFF, identifier & 0xFF
    if _is_addressed(pgn):
        return Header(pgn & 0x3FF00, identifier >> 26 & 7, source, pgn & 0xFF)
    return Header(pgn, identifier >> 26 & 7, source)


@dataclass
class Transported:
    """A message of several frames on its way. packets: that make it; data, count: of those so far."""

    pgn: int
    priority: int
    size: int
    packets: int
    data: bytes = b""
    count: int = 0


class Transport:
    """Messages of several frames out of their frames (SAE J1939-21, to one destination or to all).

    lost: messages so far of which a frame lacked
    """

    def __init__(self) -> None:
        self._on_way: dict[tuple[int, int], Transported] = {}
        self.lost = 0

    def take(self, identifier: int, data: bytes) -> tuple[int, bytes] | None:
        """Take a frame; identifier and data of the message that is whole with it, as if it were one frame."""
        header = parse(identifier)
        way = header.source, header.destination
        if header.pgn == TRANSPORT:
            if len(data) == 8 and data[0] in BEGINS:
                self.lost += way in self._on_way
                size, pgn = int.from_bytes(data[1:3], "little"), int.from_bytes(data[5:8], "little")
                self._on_way[way] = Transported(pgn, header.priority, size, data[3])
            return None
        message = self._on_way.get(way)
        if message is None or not data:
            return None
        message.count += 1
        if data[0] != message.count:
            del self._on_way[way]
            self.lost += 1
            return None
        message.data += data[1:]
        if message.count < message.packets:
            return None
        del self._on_way[way]
        whole = Header(message.pgn, message.priority, header.source, header.destination)
        return whole.identifier, message.data[: message.size]


def name(*, device_class: int, identity: int) -> bytes:
    """NAME of a control function (ISO 11783-5): agriculture, function not available, address not negotiable.

    The manufacturer code is 0: a real one is given out by SAE.
    """
    number = identity & 0x1FFFFF | 255 << 40 | device_class << 49 | 2 << 60
    return number.to_bytes(8, "little")


def device_class(name_bytes: bytes) -> int:
    """Device class in a NAME."""
    return int.from_bytes(name_bytes, "little") >> 49 & 0x7F


def _is_addressed(pgn: int) -> bool:
    return pgn >> 8 & 0xFF < 240


# From these raw values on there is no number (SAE J1939-71, table of ranges): errors, then not available.
FIRST_INVALID = {8: 0xFB, 16: 0xFB00, 32: 0xFB000000}


def dbc_file() -> Path:
    """Where the descriptions of the messages of a harvest machine on ISO 11783 are."""
    return Path(str(files("swath.data") / "can" / "guidance.dbc"))


def value_of(signal: Any, raw: float) -> float | None:
    """The number of a signal of cantools, None where its raw value says that there is none."""
    if raw >= FIRST_INVALID.get(signal.length, 2**signal.length):
        return None
    return float(raw * signal.scale + signal.offset)
