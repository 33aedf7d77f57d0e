"""CoLa, the command language of SICK's sensors: frames and values, as text (A) and binary (B).

    A   02 text 03, words between blanks, numbers as hexadecimal text, or decimal with a sign
    B   02 02 02 02, length (4 bytes), content, XOR of the content; numbers big-endian, a blank after the name

Source: SICK, Telegram Listing Ranging Sensors (8014631); operating instructions LMS4000 (8023198), tables 12
to 17.
"""

import struct
from collections.abc import Sequence
from functools import reduce
from operator import xor
from typing import Any

import numpy as np

STX, ETX, STX_B = b"\x02", b"\x03", b"\x02\x02\x02\x02"
LONGEST = 1 << 16  # of a frame that is taken [bytes]
FORMATS = {"u8": ">B", "u16": ">H", "u32": ">I", "i8": ">b", "i16": ">h", "i32": ">i", "f32": ">f"}
SIZES = {kind: struct.calcsize(form) for kind, form in FORMATS.items()}

Item = tuple[str, Any]  # kind, of FORMATS or `text`, `u16s`, `u8s`; value


class Garbage(Exception):
    """Bytes that are no telegram."""


class Splitter:
    """Telegrams out of a stream of bytes. skipped: bytes so far that belonged to none."""

    def __init__(self) -> None:
        self._rest = b""
        self.skipped = 0

    def feed(self, data: bytes) -> list[tuple[bytes, bool]]:
        """More bytes; the telegrams that are complete, without their frames, and whether each is binary."""
        self._rest += data
        found = []
        while (one := self._next()) is not None:
            found.append(one)
        return found

    def _next(self) -> tuple[bytes, bool] | None:
        while True:
            start = self._rest.find(STX)
            if start:  # nothing before a frame is one
                self._drop(len(self._rest) if start < 0 else start)
            if len(self._rest) < 4:
                return self._text() if self._rest and self._rest[:2] != STX * 2 else None
            if self._rest[:4] != STX_B:
                if self._rest[1:2] == STX:
                    self._drop(1)
                    continue
                return self._text()
            if len(self._rest) < 8:
                return None
            length = int.from_bytes(self._rest[4:8], "big")
            if length > LONGEST:
                self._drop(4)
                continue
            if len(self._rest) < 9 + length:
                return None
            content, check = self._rest[8 : 8 + length], self._rest[8 + length]
            if checksum(content) != check:
                self._drop(4)
                continue
            self._rest = self._rest[9 + length :]
            return content, True

    def _text(self) -> tuple[bytes, bool] | None:
        while self._rest:
            end = self._rest.find(ETX)
            if end < 0:
                if len(self._rest) > LONGEST:
                    self._drop(len(self._rest))
                return None
            content = self._rest[1:end]
            if STX in content:  # the one before never ended
                self._drop(1 + content.index(STX))
                if self._rest[:2] == STX * 2:
                    return self._next()
                continue
            self._rest = self._rest[end + 1 :]
            return content, False
        return None

    def _drop(self, count: int) -> None:
        self._rest, self.skipped = self._rest[count:], self.skipped + count


def checksum(content: bytes) -> int:
    """XOR of all bytes."""
    return reduce(xor, content, 0)


def framed(content: bytes, *, binary: bool) -> bytes:
    """A telegram in its frame."""
    if not binary:
        return STX + content + ETX
    return STX_B + len(content).to_bytes(4, "big") + content + bytes([checksum(content)])


def telegram(command: str, name: str, items: Sequence[Item] = (), *, binary: bool) -> bytes:
    """A telegram such as `sRA LMDscandata` in its frame."""
    head = f"{command} {name}".encode()
    if not binary:
        return framed(b" ".join([head, *(_text(kind, value) for kind, value in items)]), binary=False)
    content = b"".join(_binary(kind, value) for kind, value in items)
    return framed(head + (b" " if items else b"") + content, binary=True)


def _text(kind: str, value: Any) -> bytes:
    if kind == "text":
        return str(value).encode("ascii", "replace")
    if kind == "string":
        return f"{len(value):X} {value}".encode("ascii", "replace")
    if kind in ("u16s", "u8s"):
        return " ".join(map("%X".__mod__, value.tolist())).encode()
    if kind == "f32":
        return struct.pack(">f", value).hex().upper().encode()
    return f"{int(value) & ((1 << 8 * SIZES[kind]) - 1):X}".encode()


def _binary(kind: str, value: Any) -> bytes:
    if kind == "text":
        return str(value).encode("ascii", "replace")
    if kind == "string":
        return len(value).to_bytes(2, "big") + str(value).encode("ascii", "replace")
    if kind in ("u16s", "u8s"):
        made: bytes = value.astype(">u2" if kind == "u16s" else ">u1").tobytes()
        return made
    return struct.pack(FORMATS[kind], value)


class Values:
    """Reads the values of a telegram one after another. Garbage where they are not there."""

    def __init__(self, content: bytes, *, binary: bool) -> None:
        self._binary = binary
        head = content.split(b" ", 2)
        if len(head) < 2 or not head[0].isalpha() or len(head[0]) != 3:
            raise Garbage(f"no command in {content[:20]!r}")
        try:
            self.command, self.name = head[0].decode("ascii"), head[1].decode("ascii")
        except UnicodeDecodeError as error:
            raise Garbage(f"no command in {content[:20]!r}") from error
        rest = head[2] if len(head) > 2 else b""
        self._bytes, self._at = rest, 0
        self._words = [] if binary else rest.split()

    def read(self, kind: str) -> Any:
        """A number of a kind of FORMATS."""
        if self._binary:
            return struct.unpack(FORMATS[kind], self._take(SIZES[kind]))[0]
        word = self._word()
        try:
            if kind == "f32":
                return struct.unpack(">f", int(word, 16).to_bytes(4, "big"))[0]
            bits = 8 * SIZES[kind]
            value = int(word, 10) if word[:1] in (b"+", b"-") else int(word, 16)
            if not -(1 << bits - 1) <= value < 1 << bits:
                raise Garbage(f"{word!r} is more than {kind}")
            return value - (1 << bits) if kind[0] == "i" and value >= 1 << bits - 1 else value
        except (ValueError, OverflowError) as error:
            raise Garbage(f"expected a number, not {word[:20]!r}") from error

    def text(self, length: int) -> str:
        """Text of a known length."""
        raw = self._take(length) if self._binary else self._word()
        return raw.decode("ascii", "replace")

    def numbers(self, kind: str, count: int) -> np.ndarray:
        """Numbers `u16` or `u8`, shape (count,)."""
        if self._binary:
            size = SIZES[kind]
            return np.frombuffer(self._take(size * count), f">u{size}").astype(np.int64)
        words = self._words[self._at : self._at + count]
        if len(words) < count:
            raise Garbage(f"expected {count} numbers, there are {len(words)}")
        self._at += count
        try:
            return np.array([int(word, 16) for word in words], np.int64)
        except (ValueError, OverflowError) as error:
            raise Garbage("expected numbers") from error

    def _take(self, count: int) -> bytes:
        if self._at + count > len(self._bytes):
            raise Garbage(f"expected {count} bytes more, there are {len(self._bytes) - self._at}")
        self._at += count
        return self._bytes[self._at - count : self._at]

    def _word(self) -> bytes:
        if self._at >= len(self._words):
            raise Garbage("expected more values")
        self._at += 1
        return self._words[self._at - 1]
