"""Attacks by measurements of machinery makers, tables, weather and clouds of points."""

import bz2
import gzip
import lzma
import struct
import zlib
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.attack import RAN, WRITE, Attack, sparse
from tests.fuzz.measured_kinds import (
    DBC,
    MEASURED,
    PLAYS,
    SCENARIO,
    WEATHER,
    frames,
    rows,
    write_fixes,
    write_mf4,
)

HIDDEN = f"""X1*1.0+0*sin(*(eval('[{WRITE},0.5][1]') for i in (1,)))"""  # where a guard looks at names alone
PLAIN = f"""X1*1.0+0*(({WRITE})or 1)"""  # where no guard looks
LAMBDA = f"""(lambda:(X1*1.0,eval('{WRITE}'))[0])()"""
STRAIGHT = {"a": 1.0, "b": 0.0}
IMPORT = ("field", "import", "log.mf4", "--out", "out")
GIB = 1 << 30


# ---- MF4: formulas


def converted(conversion: dict[str, Any], name: str = "log.mf4", **how: Any) -> Callable[[Path], Any]:
    """A log whose moisture has a conversion."""
    return lambda folder: write_mf4(folder / name, rows(Moisture={"conversion": deepcopy(conversion)}), **how)


def _nested(formula: str, depth: int) -> dict[str, Any]:
    made: dict[str, Any] = {"formula": formula}
    for k in range(depth):
        made = {"val_0": 99.0, "text_0": STRAIGHT, "default_addr": made} if k % 2 else {
            "lower_0": 0.0, "upper_0": 100.0, "text_0": made, "default_addr": STRAIGHT}  # fmt: skip
    return made


FLAGS = {"mask_0": 2, "lower_0": 0.0, "upper_0": 100.0, "text_0": {"formula": HIDDEN}, "mask_1": 1, "lower_1": 0.0,
         "upper_1": 1.0, "text_1": "on"}  # fmt: skip


def _of_the_time(folder: Path) -> None:
    """A formula of the master channel, which gives the times."""
    from asammdf import MDF, Signal
    from asammdf.blocks.conversion_utils import from_dict

    with MDF(version="4.10") as mdf:
        mdf.append([Signal(np.asarray(v), np.arange(len(v), dtype=float), name=n, unit=u) for n, v, u, _ in rows()],
                   common_timebase=True)  # fmt: skip
        group = mdf.groups[0]
        group.channels[mdf.masters_db[0]].conversion = from_dict({"formula": HIDDEN})
        mdf.save(folder / "log.mf4", overwrite=True)


def _of_an_array(folder: Path) -> None:
    many = np.tile(np.arange(60.0)[:, None], (1, 3))
    write_mf4(folder / "log.mf4", [*rows(), ("Many", many, "", {"conversion": {"formula": HIDDEN}})])


def _of_a_structure(folder: Path) -> None:
    places = np.zeros(60, [("Moisture2", "<f8"), ("y", "<i2")])
    write_mf4(folder / "log.mf4", [*rows(), ("Place", places, "", {"conversion": {"formula": HIDDEN}})])


def _of_frames(folder: Path) -> None:
    """A formula of the identifiers of frames."""
    from asammdf import MDF
    from asammdf.blocks.conversion_utils import from_dict

    MEASURED["mf4-frames"].make(folder)
    with MDF(folder / "log.mf4") as mdf:
        for group in mdf.groups:
            for channel in group.channels:
                if channel.name.endswith((".ID", ".DataLength", "Timestamp")):
                    channel.conversion = from_dict({"formula": HIDDEN})
        mdf.save(folder / "new.mf4", overwrite=True)
    (folder / "new.mf4").replace(folder / "log.mf4")


def _of_a_unit_text(folder: Path) -> None:
    """Code in every text that a channel has."""
    text = f"%s{{{WRITE}}}$({WRITE})`touch ACTED`"
    made = [
        (f"{n}{WRITE}", v, text, {"comment": f"<CNcomment><TX>{text}</TX></CNcomment>"})
        for n, v, _, _ in rows()
    ]
    write_mf4(folder / "log.mf4", [*rows(), *made])


def _played(folder: Path) -> None:
    write_fixes(folder / "fixes.mf4", Latitude={"conversion": _nested(HIDDEN, 2)})
    (folder / "mine.yaml").write_text(SCENARIO.replace("WEATHER", "").replace("MORE", PLAYS))


# ---- MF4: blocks

NEXT, CONVERSION = 24, 56  # of a channel's block: its links


def _blocks(data: bytes, kind: bytes) -> list[int]:
    return [at for at in range(0, len(data) - 8, 8) if data[at : at + 4] == kind]


def patched(change: Callable[[bytearray], Any], kind: str = "mf4-channels") -> Callable[[Path], None]:
    """A whole MF4 file with its bytes changed."""

    def make(folder: Path) -> None:
        MEASURED[kind].make(folder)
        data = bytearray((folder / "log.mf4").read_bytes())
        data = change(data) or data
        (folder / "log.mf4").write_bytes(data)

    return make


def _put(
    kind: bytes, offset: int, form: str, value: int | None, which: int = 0
) -> Callable[[bytearray], None]:
    """A number in a block is another one; None: the block's own place."""

    def change(data: bytearray) -> None:
        at = _blocks(data, kind)[which]
        struct.pack_into(form, data, at + offset, at if value is None else value)

    return change


def _behind_links(
    kind: bytes, offset: int, form: str, value: int, which: int = 0
) -> Callable[[bytearray], None]:
    def change(data: bytearray) -> None:
        at = _blocks(data, kind)[which]
        links = struct.unpack_from("<Q", data, at + 16)[0]
        struct.pack_into(form, data, at + 24 + 8 * links + offset, value)

    return change


def _block(kind: bytes, links: list[int], body: bytes) -> bytes:
    return struct.pack("<4s4xQQ", kind, 24 + 8 * len(links) + len(body), len(links)) + struct.pack(
        f"<{len(links)}Q", *links
    ) + body  # fmt: skip


def _data_by(made: Callable[[int, int], bytes]) -> Callable[[bytearray], bytearray]:
    """The data of the first group are what `made` says, of its place and that of the data there were."""

    def change(data: bytearray) -> bytearray:
        data += bytes(-len(data) % 8)
        at = _blocks(data, b"##DG")[0]
        old = struct.unpack_from("<Q", data, at + 40)[0]
        struct.pack_into("<Q", data, at + 40, len(data))
        return data + made(len(data), old)

    return change


def _list_of_itself(here: int, old: int) -> bytes:
    return _block(b"##DL", [here, old], struct.pack("<B3xIQ", 1, 1, 2880))


def _bomb(_here: int, _old: int) -> bytes:
    packer = zlib.compressobj(9)
    packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(3 << 10)) + packer.flush()
    return _block(b"##DZ", [], struct.pack("<2sBxIQQ", b"DT", 0, 0, 3 * GIB, len(packed)) + packed)


def _hidden_bomb(_here: int, _old: int) -> bytes:
    """It says that it is small."""
    block = _bomb(0, 0)
    return block[:32] + struct.pack("<Q", 2880) + block[40:]


def _many_bombs(here: int, _old: int) -> bytes:
    """A list of 4000 times the same packed block of 1 MiB."""
    packed = zlib.compress(bytes(1 << 20), 9)
    one = _block(b"##DZ", [], struct.pack("<2sBxIQQ", b"DT", 0, 0, 1 << 20, len(packed)) + packed)
    one += bytes(-len(one) % 8)
    count = 4000
    place = here + 24 + 8 * (count + 1) + 16
    return _block(b"##DL", [0, *[place] * count], struct.pack("<B3xIQ", 1, count, 1 << 20)) + one


def _cycle_of_tables(data: bytearray) -> None:
    """A table of conversions that refers to itself."""
    at = next(k for k in _blocks(data, b"##CC") if struct.unpack_from("<Q", data, k + 16)[0] > 4)
    links = struct.unpack_from("<Q", data, at + 16)[0]
    for k in range(4, links):
        struct.pack_into("<Q", data, at + 24 + 8 * k, at)


def _deep_tables(data: bytearray) -> bytearray:
    """A conversion within a conversion, 20,000 deep."""
    data += bytes(-len(data) % 8)
    at = _blocks(data, b"##CN")[-1]
    body = struct.pack("<BBHHHdd", 8, 0, 0, 2, 2, 0.0, 0.0) + struct.pack("<dd", 0.0, 100.0)
    size = 24 + 8 * 6 + len(body)
    struct.pack_into("<Q", data, at + CONVERSION, len(data))
    for k in range(20_000):
        below = len(data) + size
        data += _block(b"##CC", [0, 0, 0, 0, below if k < 19_999 else 0, 0], body)
    return data


# ---- frames


def _in_blf(change: Callable[[bytes], list[bytes]]) -> Callable[[Path], None]:
    """A BLF file whose containers hold what `change` makes of the objects there were; with its DBC."""

    def make(folder: Path) -> None:
        MEASURED["frames-blf"].make(folder)
        data = (folder / "log.blf").read_bytes()
        head = struct.unpack_from("<I", data, 4)[0]
        size = struct.unpack_from("<8xI", data, head)[0]
        inner = zlib.decompress(data[head + 32 : head + size])
        with (folder / "log.blf").open("wb") as file:
            file.write(data[:head])
            for part in change(inner):
                file.write(container(part))

    return make


def container(whole: bytes, said: int | None = None) -> bytes:
    """Objects packed as a container of a BLF file."""
    body = struct.pack("<H6xL4x", 2, len(whole) if said is None else said) + zlib.compress(whole, 9)
    return struct.pack("<4sHHLL", b"LOBJ", 16, 1, 16 + len(body), 10) + body + bytes((16 + len(body)) % 4)


def _sized(size: int) -> Callable[[bytes], list[bytes]]:
    """The second object says another size."""

    def change(inner: bytes) -> list[bytes]:
        at = inner.find(b"LOBJ", 8)
        return [inner[: at + 8] + struct.pack("<L", size) + inner[at + 12 :]]

    return change


def _never_whole(inner: bytes) -> list[bytes]:
    """An object of 4 GB that goes on through 800 containers."""
    head = struct.pack("<4sHHLL", b"LOBJ", 32, 1, 0xFFFFFFF0, 1)
    return [inner + head, *[bytes(1 << 22)] * 800]


def _header_size(folder: Path) -> None:
    MEASURED["frames-blf"].make(folder)
    data = bytearray((folder / "log.blf").read_bytes())
    struct.pack_into("<I", data, 4, 0xFFFFFFF0)
    (folder / "log.blf").write_bytes(data)


def _empty_objects(inner: bytes) -> list[bytes]:
    """Two hundred million objects without content, in 1000 containers."""
    one = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 16, 115) * 200_000
    return [inner, *[one] * 1000]


HEAD = "date Mon Jul 15 10:00:00.000 am 2024\nbase hex  timestamps absolute\ninternal events logged\n"


def asc(body: str = "", dbc: str = DBC, head: str = HEAD) -> Callable[[Path], None]:
    """Frames as text, those of the kind and further lines; with a DBC file."""

    def make(folder: Path) -> None:
        lines = [
            f"{t:.6f} 1  {i:X}{'x' if i > 0x7FF else ''}  Rx   d {len(data)} "
            + " ".join(f"{b:02X}" for b in data)
            for t, i, data in frames()
        ]
        (folder / "log.asc").write_text(head + "\n".join(lines) + "\n" + body)
        (folder / "log.dbc").write_text(dbc)

    return make


def _endless_line(folder: Path) -> None:
    (folder / "log.dbc").write_text(DBC)
    sparse(folder / "log.asc", HEAD.encode() + b"0.1 1 100 Rx d 8 ", 4 * GIB)


def _endless_database(folder: Path) -> None:
    asc()(folder)
    sparse(folder / "log.dbc", DBC.encode() + b'CM_ "', 4 * GIB)


def _of_the_grain(line: str) -> str:
    """The DBC file with another line for the flow of grain."""
    return DBC.replace(' SG_ GrainFlow : 0|16@1+ (0.001,0) [0|65] "kg/s" OTHER', line)


MULTIPLEXED = """BO_ 259 Loop: 8 ECU
 SG_ A m0M : 0|8@1+ (1,0) [0|0] "" OTHER
 SG_ B m0M : 8|8@1+ (1,0) [0|0] "" OTHER
 SG_ C m0 : 16|8@1+ (1,0) [0|0] "" OTHER

"""
CODE = f"');{WRITE};('"
TALKING = (
    DBC.replace("CM_ SG_ 258 GrainFlow", f'CM_ SG_ 258 GrainFlow "{CODE}";\nCM_ SG_ 258 Moisture')
    + f'BA_DEF_ SG_ "{CODE}" STRING;\nBA_DEF_DEF_ "{CODE}" "{CODE}";\nBA_ "Bus" "{CODE}";\n'
    + f'VAL_ 258 Moisture 1 "{CODE}" 2 "{{{WRITE}}}" ;\nEV_ {WRITE}: 0 [0|1] "" 0 1 DUMMY_NODE_VECTOR0 ECU;\n'
)
ASC_IMPORT = ("field", "import", "log.asc", "--out", "out")
BLF_IMPORT = ("field", "import", "log.blf", "--out", "out")


# ---- tables, weather, clouds

DRIVE = ("run", "mine.yaml", "--set", "run.max_duration_s=0.1", "--out", "out", "--quiet")


def weather(write: Callable[[Path], Any], name: str = "weather.csv") -> Callable[[Path], None]:
    """A scenario with a weather file that `write` makes."""

    def make(folder: Path) -> None:
        text = SCENARIO.replace("WEATHER", WEATHER.replace("weather.csv", name)).replace("MORE", "")
        (folder / "mine.yaml").write_text(text)
        write(folder / name)

    return make


def _packed_zeros(pack: Callable[[bytes], bytes], times: int, head: bytes) -> Callable[[Path], Any]:
    """A packed table: members of 64 MiB of spaces one after the other."""
    return lambda path: path.write_bytes(pack(head) + pack(b" " * (64 << 20)) * times)


def _columns(path: Path) -> None:
    names = ",".join(["hour", *(f"a{k}" for k in range(2_000_000))])
    path.write_text(f"{names}\n1\n")


def _open_quote(path: Path) -> None:
    sparse(path, b'hour,temperature_c\n0,"', 0, b"1,1\n" * (1 << 18))
    with path.open("ab") as file:
        for _ in range(300):
            file.write(b"1,1\n" * (1 << 18))


def _cloud(change: Callable[[bytearray], Any], name: str = "c.las") -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        MEASURED["cloud-laz" if name.endswith("z") else "cloud-las"].make(folder)
        data = bytearray((folder / name).read_bytes())
        data = change(data) or data
        (folder / name).write_bytes(data)
        (folder / f"other{name[1:]}").write_bytes(data)

    return make


def _number(form: str, offset: int, value: float) -> Callable[[bytearray], None]:
    return lambda data: struct.pack_into(form, data, offset, value)


def _laz_bomb(folder: Path) -> None:
    """A hundred million times the same point."""
    import laspy

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-3), np.zeros(3)
    with laspy.open(folder / "c.laz", mode="w", header=header) as file:
        part = laspy.ScaleAwarePointRecord.zeros(5_000_000, header=header)
        for _ in range(20):
            file.write_points(part)
    (folder / "other.laz").write_bytes((folder / "c.laz").read_bytes())


SCANS = ("compare", "scans", "c.las", "other.las", "--out", "out")
LAZ_SCANS = ("compare", "scans", "c.laz", "other.laz", "--out", "out")
CODE_RUNS = "code of the file runs"

LOGS: dict[str, Attack] = {
    "mf4-default": Attack(
        converted({"val_0": 1.0, "text_0": "one", "default_addr": {"formula": HIDDEN}}),
        IMPORT,
        f"{CODE_RUNS}: formula for what a table of values lacks",
        is_quick=True,
    ),
    "mf4-range-default": Attack(
        converted(
            {"lower_0": 90.0, "upper_0": 99.0, "text_0": STRAIGHT, "default_addr": {"formula": HIDDEN}}
        ),
        IMPORT,
        f"{CODE_RUNS}: formula for what a table of ranges lacks",
        is_quick=True,
    ),
    "mf4-flags": Attack(converted(FLAGS), IMPORT, f"{CODE_RUNS}: formula in a table of bits"),
    "mf4-deep": Attack(converted(_nested(HIDDEN, 5)), IMPORT, f"{CODE_RUNS}: formula five tables deep"),
    "mf4-quoted": Attack(
        converted(
            {
                "lower_0": 90.0,
                "upper_0": 99.0,
                "text_0": STRAIGHT,
                "default_addr": f'f(x) = "{HIDDEN.replace("X1", "{X}")}"'.encode(),
            }
        ),
        IMPORT,
        f"{CODE_RUNS}: text that a library takes for a formula",
    ),
    "mf4-plain": Attack(converted({"formula": PLAIN}), IMPORT, f"{CODE_RUNS}: what a second evaluator takes"),
    "mf4-lambda": Attack(converted({"formula": LAMBDA}), IMPORT, f"{CODE_RUNS}: a function in a formula"),
    "mf4-power": Attack(converted({"formula": "X1+9**9**9**9"}), IMPORT, "never end: powers of powers"),
    "mf4-long-formula": Attack(
        converted({"formula": "X1" + "+1*(X1" * 50_000 + ")" * 50_000}),
        IMPORT,
        "end the process: brackets 50,000 deep",
    ),
    "mf4-time": Attack(_of_the_time, IMPORT, f"{CODE_RUNS}: formula of the times"),
    "mf4-array": Attack(_of_an_array, IMPORT, f"{CODE_RUNS}: formula of an array"),
    "mf4-structure": Attack(_of_a_structure, IMPORT, f"{CODE_RUNS}: formula of a structure"),
    "mf4-identifiers": Attack(_of_frames, IMPORT, f"{CODE_RUNS}: formula of identifiers of frames"),
    "mf4-texts": Attack(_of_a_unit_text, IMPORT, f"{CODE_RUNS}: names, units, comments"),
    "mf4-older": Attack(
        converted({"formula": HIDDEN}, "log.mdf", version="3.30"),
        ("field", "import", "log.mdf", "--out", "out"),
        f"{CODE_RUNS}: formula of MDF 3",
    ),
    "mf4-compared": Attack(
        converted(_nested(HIDDEN, 1)),
        ("calibrate", "engine", "lexion-700-class", "log.mf4", "--out", "out"),
        f"{CODE_RUNS}: in a calibration",
    ),
    "mf4-played": Attack(_played, DRIVE, f"{CODE_RUNS}: in a log that a scenario names", RAN, is_quick=True),
    "mf4-loop-channel": Attack(
        patched(_put(b"##CN", NEXT, "<Q", None)), IMPORT, "never end: a channel is followed by itself"
    ),
    "mf4-loop-group": Attack(patched(_put(b"##DG", NEXT, "<Q", None)), IMPORT, "never end: a group, too"),
    "mf4-loop-channels": Attack(
        patched(_put(b"##CG", NEXT, "<Q", None)), IMPORT, "never end: channels' group"
    ),
    "mf4-loop-data": Attack(
        patched(_data_by(_list_of_itself)), IMPORT, "never end: a list of data goes on with itself"
    ),
    "mf4-loop-history": Attack(
        patched(_put(b"##FH", NEXT, "<Q", None)), IMPORT, "never end: the file's history"
    ),
    "mf4-loop-composition": Attack(
        patched(_put(b"##CN", 32, "<Q", None)), IMPORT, "never end: a channel within itself"
    ),
    "mf4-loop-source": Attack(
        patched(_put(b"##CN", 48, "<Q", None)), IMPORT, "end badly: a channel as its source"
    ),
    "mf4-loop-table": Attack(
        patched(_cycle_of_tables, "mf4-conversions"), IMPORT, "never end: a conversion within itself"
    ),
    "mf4-deep-tables": Attack(patched(_deep_tables), IMPORT, "end the process: conversions 20,000 deep"),
    "mf4-cycles": Attack(patched(_behind_links(b"##CG", 8, "<Q", 1 << 60)), IMPORT, "memory: 2^60 records"),
    "mf4-record-0": Attack(patched(_behind_links(b"##CG", 24, "<I", 0)), IMPORT, "records of no bytes"),
    "mf4-record-long": Attack(
        patched(_behind_links(b"##CG", 24, "<I", 0xFFFFFFFF)), IMPORT, "records of 4 GB"
    ),
    "mf4-marks": Attack(
        patched(_behind_links(b"##CG", 28, "<I", 0xFFFFFFF0), "mf4-odd"),
        IMPORT,
        "memory: 4 GB of marks a record",
    ),
    "mf4-mark-far": Attack(
        patched(_behind_links(b"##CN", 16, "<I", 0xFFFFFFF0, -1), "mf4-odd"),
        IMPORT,
        "read beyond: a mark out of the record",
    ),
    "mf4-bits": Attack(patched(_behind_links(b"##CN", 8, "<I", 0xFFFFFFF8, 1)), IMPORT, "a number of 4 Gbit"),
    "mf4-offset": Attack(
        patched(_behind_links(b"##CN", 4, "<I", 0xFFFFFFF0, 1)), IMPORT, "a number beyond the record"
    ),
    "mf4-links": Attack(
        patched(_put(b"##CC", 16, "<Q", 1 << 40), "mf4-conversions"), IMPORT, "memory: 2^40 links"
    ),
    "mf4-text": Attack(patched(_put(b"##TX", 8, "<Q", 1 << 60)), IMPORT, "memory: a text of 2^60 bytes"),
    "mf4-bomb": Attack(patched(_data_by(_bomb)), IMPORT, "memory: a packed block of 3 GB"),
    "mf4-hidden-bomb": Attack(
        patched(_data_by(_hidden_bomb)), IMPORT, "memory: a block of 3 GB that says 3 kB"
    ),
    "mf4-many-bombs": Attack(
        patched(_data_by(_many_bombs)), IMPORT, "memory: 4000 links to one packed block"
    ),
    "blf-size-0": Attack(_in_blf(_sized(0)), BLF_IMPORT, "never end: an object of no bytes"),
    "blf-size-1": Attack(_in_blf(_sized(1)), BLF_IMPORT, "never end: an object of one byte"),
    "blf-never-whole": Attack(_in_blf(_never_whole), BLF_IMPORT, "memory: an object of 4 GB in parts"),
    "blf-many-bombs": Attack(
        _in_blf(lambda inner: [inner, *[bytes(32 << 20)] * 300]),
        BLF_IMPORT,
        "time: 300 containers of 32 MB of zeros",
    ),
    "blf-empty-objects": Attack(_in_blf(_empty_objects), BLF_IMPORT, "time: 2e8 objects"),
    "blf-head": Attack(_header_size, BLF_IMPORT, "memory: a head of 4 GB"),
    "asc-endless-line": Attack(_endless_line, ASC_IMPORT, "memory: a line of 4 GB"),
    "asc-length": Attack(
        asc("70.0 1  100  Rx   d 9999999999 " + "00 " * 8 + "\n"), ASC_IMPORT, "memory: 1e10 bytes"
    ),
    "asc-numbers": Attack(
        asc("9" * 2_000_000 + " 1  100  Rx   d 1 00\n" + "1e308 1 100 Rx d 1 00\nnan 1 100 Rx d 1 00\n"),
        ASC_IMPORT,
        "end badly: times that are none",
    ),
    "asc-date": Attack(
        asc(head=HEAD.replace("2024", "9" * 5000)), ASC_IMPORT, "end badly: a year of 5000 digits"
    ),
    "dbc-cycle": Attack(
        asc(
            "70.0 1  103  Rx   d 8 " + "00 " * 8 + "\n",
            DBC.replace("CM_ SG_", MULTIPLEXED + "CM_ SG_", 1)
            + "SG_MUL_VAL_ 259 A B 0-0;\nSG_MUL_VAL_ 259 B A 0-0;\nSG_MUL_VAL_ 259 C A 0-0;\n",
        ),
        ASC_IMPORT,
        "never end: signals that choose each other",
        is_quick=True,
    ),
    "dbc-ranges": Attack(
        asc("", DBC + "SG_MUL_VAL_ 257 Load Page 0-4000000000;\n"),
        ASC_IMPORT,
        "memory: 4e9 numbers of pages",
        is_quick=True,
    ),
    "dbc-scale": Attack(
        asc("", _of_the_grain(' SG_ GrainFlow : 0|16@1+ (1e400,-1e400) [0|65] "kg/s" OTHER')),
        ASC_IMPORT,
        "end badly: an endless factor",
    ),
    "dbc-digits": Attack(
        asc("", _of_the_grain(f' SG_ GrainFlow : 0|16@1+ ({"9" * 300_000},0) [0|65] "kg/s" OTHER')),
        ASC_IMPORT,
        "time: a factor of 300,000 digits",
    ),
    "dbc-long": Attack(
        asc("", _of_the_grain(' SG_ GrainFlow : 7|300000000@0+ (1,0) [0|65] "kg/s" OTHER')),
        ASC_IMPORT,
        "memory: a signal of 300 Mbit, the other order",
    ),
    "dbc-message": Attack(
        asc("", DBC.replace("BO_ 258 Grain: 8", "BO_ 258 Grain: 4000000000")),
        ASC_IMPORT,
        "memory: a message of 4 GB",
        is_quick=True,
    ),
    "dbc-code": Attack(asc("", TALKING), ASC_IMPORT, f"{CODE_RUNS}: comments, attributes, names of values"),
    "dbc-names": Attack(
        asc("", DBC.replace("GrainFlow", "__import__").replace("Moisture", "__class__")),
        ASC_IMPORT,
        f"{CODE_RUNS}: names of Python's own",
    ),
    "dbc-values": Attack(
        asc("", DBC + "VAL_ 258 Moisture " + " ".join(f'{k} "a"' for k in range(1_500_000)) + " ;\n"),
        ASC_IMPORT,
        "memory: 1.5 million names of values",
    ),
    "dbc-signals": Attack(
        asc(
            "",
            DBC.replace(
                "CM_ SG_",
                "BO_ 300 Many: 64 ECU\n"
                + "".join(f' SG_ S{k} : {k % 500}|8@1+ (1,0) [0|0] "" OTHER\n' for k in range(100_000))
                + "\nCM_ SG_",
                1,
            ),
        ),
        ASC_IMPORT,
        "time: 100,000 signals of a message",
    ),
    "dbc-endless": Attack(_endless_database, ASC_IMPORT, "memory: a database of 4 GB"),
    "weather-endless-line": Attack(
        weather(lambda path: sparse(path, b"hour,temperature_c\n0,", 4 * GIB)),
        DRIVE,
        "memory: a line of 4 GB",
        RAN,
    ),
    "weather-endless-head": Attack(
        weather(lambda path: sparse(path, b"hour,temperature_c", 4 * GIB)),
        DRIVE,
        "memory: a head of 4 GB",
        RAN,
    ),
    "weather-gz": Attack(
        weather(_packed_zeros(gzip.compress, 64, b"hour,temperature_c\n0,"), "weather.csv.gz"),
        DRIVE,
        "memory: 4 GB packed into 4 MB",
        RAN,
    ),
    "weather-bz2": Attack(
        weather(_packed_zeros(bz2.compress, 64, b"hour,temperature_c\n0,"), "weather.csv.bz2"),
        DRIVE,
        "memory: 4 GB packed into 4 kB",
        RAN,
    ),
    "weather-columns": Attack(weather(_columns), DRIVE, "time: two million columns", RAN),
    "weather-quote": Attack(weather(_open_quote), DRIVE, "memory: a quote that never ends", RAN),
    "weather-zero": Attack(
        weather(lambda path: path.symlink_to("/dev/zero")),
        DRIVE,
        "never end: a link to /dev/zero",
        RAN,
        is_quick=True,
    ),
    "log-gz": Attack(
        lambda folder: _packed_zeros(gzip.compress, 64, b"lat,lon,flow\n1,")(folder / "log.csv.gz"),
        ("field", "import", "log.csv.gz", "--out", "out"),
        "memory: 4 GB packed into 4 MB",
    ),
    "log-xz": Attack(
        lambda folder: _packed_zeros(lzma.compress, 64, b"lat,lon,flow\n1,")(folder / "log.csv.xz"),
        ("field", "import", "log.csv.xz", "--out", "out"),
        "memory: 4 GB packed into 1 MB",
    ),
    "scans-gz": Attack(
        lambda folder: _packed_zeros(gzip.compress, 64, b"t_s,range_m,azimuth_deg\n1,")(folder / "s.csv.gz"),
        ("height-map", "build", "s.csv.gz", "--out", "g.npz"),
        "memory: 4 GB packed into 4 MB",
    ),
    "las-count": Attack(_cloud(_number("<Q", 247, 1 << 60)), SCANS, "memory: 2^60 points"),
    "las-records": Attack(
        _cloud(_number("<I", 100, 0xFFFFFFFF)), SCANS, "time: 4e9 records of variable length"
    ),
    "las-point": Attack(_cloud(_number("<H", 105, 0)), SCANS, "points of no bytes"),
    "las-scale": Attack(_cloud(_number("<d", 131, 1e300)), SCANS, "end badly: an endless scale"),
    "laz-chunk": Attack(
        _cloud(
            lambda data: data.replace(struct.pack("<I", 50_000), struct.pack("<I", 0xFFFFFFFE), 1), "c.laz"
        ),
        LAZ_SCANS,
        "memory: chunks of 4e9 points",
    ),
    "laz-bomb": Attack(_laz_bomb, LAZ_SCANS, "memory: 1e8 points in a small file"),
}
