"""Damage: to bytes of any file, and to numbers and words of text."""

import random
import re

EVIL = (
    b"0", b"-1", b"1e308", b"-1e308", b"1e999", b"nan", b"inf", b"99999999999999999999", b"4294967295", b"0x",
    b"null", b"true", b"[]", b"{}", b"''", b"*a", b"&a [*a]", b"\x00", b"\xff\xfe", b"\n\n", b" " * 5000,
    b"x" * 5000, b"..", b"/etc/passwd", b"a\\0b", b'"\\u0000"', b'"\\ud800"', b"<a>" * 200, b"[" * 500,
    b"{a: " * 100, b"-" * 1000, b"," * 3000, b"\xe2\x80\xae", b"1" + b"0" * 400,
    b"!!python/object:os.system x",
)  # fmt: skip
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_]{2,}")


def mutated(data: bytes, rng: random.Random, text: bool) -> bytes:
    """The bytes with one to four changes."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        change = rng.choice((*BYTES, *TEXT, *TEXT) if text else (*BYTES, *BYTES, *TEXT))
        data = change(data, rng)
    return data


def _span(data: bytes, rng: random.Random, longest: int = 64) -> tuple[int, int]:
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + rng.randrange(1, longest))


def _flip(data: bytes, rng: random.Random) -> bytes:
    made = bytearray(data)
    for _ in range(rng.choice((1, 2, 8))):
        if made:
            made[rng.randrange(len(made))] ^= 1 << rng.randrange(8)
    return bytes(made)


def _overwrite(data: bytes, rng: random.Random) -> bytes:
    start, end = _span(data, rng, 9)
    return data[:start] + bytes(rng.choice((0, 255, 127, 128)) for _ in range(end - start)) + data[end:]


def _integer(data: bytes, rng: random.Random) -> bytes:
    """A count, a size or an offset of a binary format."""
    size = rng.choice((2, 4, 4, 8))
    value = rng.choice((0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, len(data), 10**6, 10**9)) % 2 ** (
        8 * size
    )
    start = rng.randrange(min(len(data), rng.choice((64, 512, 10**9))) + 1)
    return data[:start] + value.to_bytes(size, rng.choice(("little", "big"))) + data[start + size :]


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _delete(data: bytes, rng: random.Random) -> bytes:
    start, end = _span(data, rng)
    return data[:start] + data[end:]


def _repeat(data: bytes, rng: random.Random) -> bytes:
    start, end = _span(data, rng)
    return data[:end] + data[start:end] * rng.choice((1, 3, 100)) + data[end:]


def _insert(data: bytes, rng: random.Random) -> bytes:
    start, _ = _span(data, rng)
    return data[:start] + rng.choice(EVIL) + data[start:]


def _move(data: bytes, rng: random.Random) -> bytes:
    (a, b), at = _span(data, rng, 300), rng.randrange(len(data) + 1)
    return data[:at] + data[a:b] + data[at:]


def _replace(data: bytes, rng: random.Random, pattern: re.Pattern[bytes]) -> bytes:
    at = rng.randrange(len(data) + 1)
    found = pattern.search(data, at) or pattern.search(data)
    if found is None:
        return data
    return data[: found.start()] + rng.choice(EVIL) + data[found.end() :]


def _number(data: bytes, rng: random.Random) -> bytes:
    return _replace(data, rng, NUMBER)


def _word(data: bytes, rng: random.Random) -> bytes:
    return _replace(data, rng, WORD)


def _line(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(3)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(j, lines[i])
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


BYTES = (_flip, _overwrite, _integer, _integer, _cut, _delete, _repeat, _insert, _move)
TEXT = (_number, _number, _word, _line)
