"""Damage that knows a format: counts, lengths and links of its records, and what lies packed inside them."""

import gzip
import random
import struct
import zlib
from collections.abc import Callable, Iterator

Change = Callable[[bytes], bytes]
Spot = tuple[int, str]  # where a count, a length or a link stands, and how (struct)


# ---- where the numbers of a format stand


def _mf4_blocks(data: bytes) -> Iterator[int]:
    at = data.find(b"##")
    while at >= 0:
        if at % 8 == 0:
            yield at
        at = data.find(b"##", at + 2)


def _mf4(data: bytes) -> Iterator[Spot]:
    """Lengths of blocks, numbers of their links, the links, what comes behind them."""
    for at in _mf4_blocks(data):
        length, links = struct.unpack_from("<QQ", data.ljust(at + 24, b"\0"), at + 8)
        yield from ((at + 8, "<Q"), (at + 16, "<Q"))
        yield from ((at + 24 + 8 * k, "<Q") for k in range(min(links, 40)))
        behind = at + 24 + 8 * min(links, 40)
        yield from (
            (k, form) for k in range(behind, min(at + length, behind + 64), 2) for form in ("<B", "<I", "<Q")
        )


def _blf(data: bytes) -> Iterator[Spot]:
    yield from ((4, "<I"), (8, "<I"), (16, "<Q"), (24, "<Q"), (32, "<I"), (36, "<I"))
    at = data.find(b"LOBJ")
    while at >= 0:
        yield from (
            (at + k, form)
            for k, form in ((4, "<H"), (6, "<H"), (8, "<I"), (12, "<I"), (16, "<H"), (24, "<I"))
        )
        at = data.find(b"LOBJ", at + 4)


def _mcap(data: bytes) -> Iterator[Spot]:
    yield from _mcap_records(data, 8, len(data))


def _mcap_records(data: bytes, at: int, end: int) -> Iterator[Spot]:
    while at + 9 <= end:
        op, length = struct.unpack_from("<BQ", data, at)
        yield from ((at, "<B"), (at + 1, "<Q"))
        yield from ((at + 9 + k, form) for k in range(0, min(length, 40), 4) for form in ("<I", "<Q"))
        if op == 6 and at + 41 <= end:
            name = struct.unpack_from("<I", data, at + 37)[0]
            if name == 0:
                yield from _mcap_records(data, at + 49, min(end, at + 9 + length))
        at += 9 + length


def _bag(data: bytes) -> Iterator[Spot]:
    at = data.find(b"\n") + 1
    while at + 8 <= len(data):
        head = struct.unpack_from("<I", data, at)[0]
        yield (at, "<I")
        place = at + 4
        while place + 4 <= min(at + 4 + head, len(data)):
            yield (place, "<I")
            place += 4 + struct.unpack_from("<I", data, place)[0]
            yield from ((place - k, form) for k, form in ((1, "<B"), (4, "<I"), (8, "<Q")))
        if (behind := at + 4 + head) + 4 > len(data):
            return
        yield (behind, "<I")
        at = behind + 4 + struct.unpack_from("<I", data, behind)[0]


def _las(data: bytes) -> Iterator[Spot]:
    yield from ((94, "<H"), (96, "<I"), (100, "<I"), (104, "<B"), (105, "<H"), (107, "<I"))
    yield from ((k, "<Q") for k in (227, 235, 247))
    yield from ((k, form) for k in range(131, 227, 8) for form in ("<d", "<Q"))
    yield from ((k, form) for k in range(375, min(len(data), 700), 2) for form in ("<H", "<I", "<Q"))


def _tiff(data: bytes) -> Iterator[Spot]:
    order = "<" if data[:2] == b"II" else ">"
    at = struct.unpack_from(order + "I", data.ljust(8, b"\0"), 4)[0]
    yield (4, order + "I")
    if at + 2 <= len(data):
        yield (at, order + "H")
        for k in range(struct.unpack_from(order + "H", data, at)[0]):
            here = at + 2 + 12 * k
            yield from (
                (here + n, order + form) for n, form in ((0, "H"), (2, "H"), (4, "I"), (8, "I"), (12, "I"))
            )


def _glb(data: bytes) -> Iterator[Spot]:
    length = struct.unpack_from("<I", data.ljust(16, b"\0"), 12)[0]
    yield from ((k, "<I") for k in (4, 8, 12, 16, 20 + length, 24 + length))


def _footed(data: bytes) -> Iterator[Spot]:
    """Parquet: the length of its footer, and bytes of the footer."""
    yield (len(data) - 8, "<I")
    yield from ((k, "<B") for k in range(max(4, len(data) - 400), len(data) - 8))


def _sqlite(data: bytes) -> Iterator[Spot]:
    yield from ((16, ">H"), (18, ">B"), (21, ">B"), (28, ">I"), (32, ">I"), (44, ">I"), (56, ">I"))
    for page in range(0, len(data), 4096):
        yield from (
            (page + 100 * (not page) + k, form)
            for k, form in ((0, ">B"), (1, ">H"), (3, ">H"), (5, ">H"), (8, ">I"))
        )
        yield from ((page + k, ">H") for k in range(8, 40, 2))


SPOTS: dict[str, Callable[[bytes], Iterator[Spot]]] = {
    ".mf4": _mf4, ".blf": _blf, ".mcap": _mcap, ".bag": _bag, ".las": _las, ".laz": _las, ".tif": _tiff,
    ".glb": _glb, ".parquet": _footed, ".db3": _sqlite,
}  # fmt: skip


def renumbered(data: bytes, rng: random.Random, suffix: str) -> bytes:
    """One number of the format is another one: none, one, the most, a place in the file, its own."""
    spots = list(SPOTS[suffix](data))
    made = bytearray(data)
    for at, form in rng.sample(spots, min(len(spots), rng.choice((1, 1, 1, 2)))):
        size = struct.calcsize(form)
        if not 0 <= at <= len(made) - size:
            continue
        if form[1] == "d":
            value = rng.choice((0.0, -1.0, float("nan"), float("inf"), 1e308, 1e-308))
        else:
            old = struct.unpack_from(form, made, at)[0]
            other = rng.choice(spots)[0]
            most = 2 ** (8 * size)
            near = (0, 1, 2, most - 1, most // 2, old + 1, old - 1, old * 2, 1 << 40, 1 << 31, 10**9)
            value = rng.choice((*near, at, at - 8, at - 16, at - 24, other, len(data))) % most
        struct.pack_into(form, made, at, value)
    return bytes(made)


# ---- what lies packed inside


def _in_blf(data: bytes, rng: random.Random, change: Change) -> bytes:
    """A container of a BLF file unpacked, changed and packed again, its sizes right."""
    places = []
    at = struct.unpack_from("<I", data.ljust(8, b"\0"), 4)[0]
    while data[at : at + 4] == b"LOBJ" and at + 32 <= len(data):
        head, _, size, kind = struct.unpack_from("<HHII", data, at + 4)
        if kind == 10:
            places.append((at, size))
        at += max(size + size % 4, 16)
    if not places:
        return change(data)
    at, size = rng.choice(places)
    body = data[at + 16 : at + size]
    method = body[0]
    whole = zlib.decompress(body[16:]) if method == 2 else body[16:]
    made = renumbered(whole, rng, ".blf") if rng.random() < 0.5 else change(whole)
    packed = zlib.compress(made) if method == 2 else made
    new = body[:8] + struct.pack("<I", len(made)) + body[12:16] + packed
    head = data[at : at + 8] + struct.pack("<II", 16 + len(new), 10)
    return data[:at] + head + new + bytes((16 + len(new)) % 4) + data[at + size + size % 4 :]


def _in_mf4(data: bytes, rng: random.Random, change: Change) -> bytes:
    """A packed block of an MF4 file unpacked, changed and packed again at the end, its links with it."""
    places = [at for at in _mf4_blocks(data) if data[at : at + 4] == b"##DZ"]
    if not places:
        return renumbered(data, rng, ".mf4")
    at = rng.choice(places)
    length = struct.unpack_from("<Q", data, at + 8)[0]
    whole = zlib.decompress(data[at + 48 : at + length])
    made = change(whole)
    packed = zlib.compress(made)
    said = rng.choice((len(made), len(made), len(made), 0, 1, 1 << 40))
    head = data[at : at + 8] + struct.pack("<QQ", 48 + len(packed), 0) + data[at + 24 : at + 32]
    data += bytes(-len(data) % 8)
    new = len(data)
    moved = data.replace(struct.pack("<Q", at), struct.pack("<Q", new))
    return moved + head + struct.pack("<QQ", said, len(packed)) + packed


def _in_mcap(data: bytes, rng: random.Random, change: Change) -> bytes:
    """Messages of a chunk of an MCAP file changed, its sizes right, its sum left out."""
    places, at = [], 8
    while at + 9 <= len(data):
        op, length = struct.unpack_from("<BQ", data, at)
        if op == 6:
            places.append(at)
        at += 9 + length
    if not places:
        return renumbered(data, rng, ".mcap")
    at = rng.choice(places)
    length, begin, end, _, _, name = struct.unpack_from("<QQQQII", data, at + 1)
    how = data[at + 41 : at + 41 + name].decode(errors="replace")
    packed = data[at + 49 + name : at + 9 + length]
    unpack, pack = _packers(how)
    whole = unpack(packed)
    made = change(whole)
    if rng.random() < 0.5:  # of the same length, so that the index holds
        made = made[: len(whole)].ljust(len(whole), b"\0")
    new = pack(made)
    body = struct.pack("<QQQI", begin, end, len(made), 0) + data[at + 37 : at + 41 + name]
    body += struct.pack("<Q", len(new)) + new
    return data[:at] + struct.pack("<BQ", 6, len(body)) + body + data[at + 9 + length :]


def _packers(how: str) -> tuple[Change, Change]:
    if how == "zstd":
        import zstandard

        return zstandard.decompress, zstandard.compress
    if how == "lz4":
        import lz4.frame

        return lz4.frame.decompress, lz4.frame.compress
    return bytes, bytes


def _in_gz(data: bytes, rng: random.Random, change: Change) -> bytes:
    return gzip.compress(change(gzip.decompress(data)))


INSIDE: dict[str, Callable[[bytes, random.Random, Change], bytes]] = {
    ".blf": _in_blf, ".mf4": _in_mf4, ".mcap": _in_mcap, ".gz": _in_gz,
}  # fmt: skip


def damaged(data: bytes, rng: random.Random, suffix: str, change: Change) -> bytes:
    """The bytes of a file with damage that knows its format. change: any damage of bytes."""
    if suffix in INSIDE and (suffix not in SPOTS or rng.random() < 0.5):
        return INSIDE[suffix](data, rng, change)
    return renumbered(data, rng, suffix)
