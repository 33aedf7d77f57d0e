"""Attacks by recordings, arrays, tables of columns and saved runs."""

import bz2
import io
import json
import pickle
import shutil
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.attack import ACTED, WRITE, Attack, sparse
from tests.fuzz.attack_logs import CODE_RUNS, GIB

MAP = ("--out", "h.npz", "--scans", "/scan", "--poses", "/odom")
BUILD = ("height-map", "build", "b.mcap", *MAP)
BUILD_BAG = ("height-map", "build", "b.bag", *MAP)
BUILD_DB = ("height-map", "build", "b", *MAP)


# ---- MCAP


def mcap(
    text: str | bytes, form: str = "ros2msg", name: str = "sensor_msgs/msg/LaserScan"
) -> Callable[[Path], None]:
    """A whole recording in which the scans have another definition."""

    def make(folder: Path) -> None:
        from mcap.reader import make_reader
        from mcap.writer import Writer

        from tests.fuzz.kinds import KINDS

        KINDS["bag-mcap"].make(folder)
        data = text if isinstance(text, bytes) else text.encode()
        channels: dict[str, int] = {}
        with next((folder / "b").glob("*.mcap")).open("rb") as old, (folder / "b.mcap").open("wb") as file:
            writer = Writer(file)
            writer.start(profile="ros2", library="made")
            for schema, channel, message in make_reader(old).iter_messages():
                if channel.topic not in channels:
                    is_scan = schema.name.endswith("LaserScan")
                    told = (name, form, data) if is_scan else (schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(
                        channel.topic, "cdr", writer.register_schema(*told)
                    )
                writer.add_message(
                    channels[channel.topic], message.log_time, message.data, message.publish_time
                )
            writer.finish()
        shutil.rmtree(folder / "b")

    return make


def idl(constants: str = "", members: str = "long a;", before: str = "") -> str:
    """A definition of a scan in IDL."""
    inside = f"module LaserScan_Constants {{ {constants} }};" if constants else ""
    return f"module sensor_msgs {{ module msg {{ {before} {inside} struct LaserScan {{ {members} }}; }}; }};"


def _nested(levels: int, width: int) -> str:
    """A type of some of the next type, so many levels."""
    parts = ["\n".join(f"pkg/T0 a{k}" for k in range(width))]
    for level in range(levels):
        kind = "uint8" if level == levels - 1 else f"pkg/T{level + 1}"
        parts.append(f"MSG: pkg/T{level}\n" + "\n".join(f"{kind} a{k}" for k in range(width)))
    return f"\n{'=' * 80}\n".join(parts)


def _record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def _text(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


SCHEMA = _record(
    3, struct.pack("<H", 1) + _text(b"sensor_msgs/msg/LaserScan") + _text(b"ros2msg") + _text(b"uint8 x")
)
CHANNEL = _record(4, struct.pack("<HH", 1, 1) + _text(b"/scan") + _text(b"cdr") + struct.pack("<I", 0))
MAGIC = b"\x89MCAP0\r\n"


def chunk(records: bytes, how: bytes = b"", said: int | None = None) -> bytes:
    """A chunk. said: its size unpacked."""
    size = len(records) if said is None else said
    return _record(
        6, struct.pack("<QQQI", 0, 1, size, 0) + _text(how) + struct.pack("<Q", len(records)) + records
    )


def recorded(*records: bytes) -> Callable[[Path], Any]:
    """An MCAP file of records."""
    whole = (
        MAGIC
        + _record(1, _text(b"ros2") + _text(b"made"))
        + b"".join(records)
        + _record(2, bytes(20))
        + MAGIC
    )
    return lambda folder: (folder / "b.mcap").write_bytes(whole)


def _zstd(size: int) -> bytes:
    import zstandard

    packer = zstandard.ZstdCompressor().compressobj()
    return b"".join(packer.compress(bytes(1 << 20)) for _ in range(size >> 20)) + packer.flush()


def _lz4(size: int) -> bytes:
    import lz4.frame

    out = io.BytesIO()
    with lz4.frame.open(out, "wb") as file:
        for _ in range(size >> 20):
            file.write(bytes(1 << 20))
    return out.getvalue()


def _packed(pack: Callable[[int], bytes], how: bytes, said: int) -> Callable[[Path], Any]:
    return lambda folder: recorded(SCHEMA, CHANNEL, chunk(pack(4 * GIB), how, said))(folder)


def _chunk_in_chunk(folder: Path) -> None:
    inner = SCHEMA + CHANNEL
    for _ in range(3000):
        inner = chunk(inner)
    recorded(inner)(folder)


def _many_channels(folder: Path) -> None:
    channels = b"".join(
        _record(
            4, struct.pack("<HH", k % 65_000, 1) + _text(b"/t%d" % k) + _text(b"cdr") + struct.pack("<I", 0)
        )
        for k in range(1_000_000)
    )
    recorded(SCHEMA, channels)(folder)


# ---- rosbag 1


def _fields(**values: bytes) -> bytes:
    return b"".join(_text(name.encode() + b"=" + value) for name, value in values.items())


def _bag_record(data: bytes, **header: bytes) -> bytes:
    return _text(_fields(**header)) + _text(data)


def bag(*records: bytes, index: int = 0, chunks: int = 1) -> Callable[[Path], Any]:
    """A rosbag 1 of records behind its head."""
    counts = {"conn_count": struct.pack("<I", 1), "chunk_count": struct.pack("<I", chunks)}
    head = _bag_record(bytes(4000), op=b"\x03", index_pos=struct.pack("<Q", index), **counts)
    return lambda folder: (folder / "b.bag").write_bytes(b"#ROSBAG V2.0\n" + head + b"".join(records))


def _bag_chunk(data: bytes, how: bytes = b"none", said: int | None = None) -> bytes:
    size = len(data) if said is None else said
    return _bag_record(data, op=b"\x05", compression=how, size=struct.pack("<I", size))


def connection(text: bytes = b"uint8 x", kind: bytes = b"sensor_msgs/LaserScan") -> bytes:
    """A connection with the definition of its messages."""
    about = _fields(topic=b"/scan", type=kind, md5sum=b"0" * 32, message_definition=text)
    return _bag_record(about, op=b"\x07", conn=struct.pack("<I", 0), topic=b"/scan")


def retold(text: bytes | None = None, kind: bytes | None = None) -> Callable[[Path], None]:
    """A whole rosbag 1 without its index, in which the scans have another definition, or type."""

    def told(header: dict[bytes, bytes], body: bytes) -> bytes:
        if header[b"op"] == b"\x05":
            body = b"".join(told(*record) for record in _parts(body))
        elif header[b"op"] == b"\x07" and b"LaserScan" in body:
            about = _values(body)
            about[b"message_definition"] = text or about[b"message_definition"]
            about[b"type"] = kind or about[b"type"]
            body = b"".join(_text(name + b"=" + value) for name, value in about.items())
        if header[b"op"] == b"\x05":
            header[b"size"] = struct.pack("<I", len(body))
        return _text(b"".join(_text(name + b"=" + value) for name, value in header.items())) + _text(body)

    def make(folder: Path) -> None:
        from tests.fuzz.kinds import KINDS

        KINDS["bag-ros1"].make(folder)
        whole = (folder / "b.bag").read_bytes()
        at = whole.index(b"\n") + 1
        head, *rest = _parts(whole[at:])
        kept = [told(*record) for record in rest if record[0][b"op"] in b"\x05\x07"]
        head[0][b"index_pos"] = bytes(8)
        (folder / "b.bag").write_bytes(whole[:at] + told(*head) + b"".join(kept))

    return make


def _parts(data: bytes) -> list[tuple[dict[bytes, bytes], bytes]]:
    """Records: header and body."""
    found, at = [], 0
    while at + 4 <= len(data):
        begin = at + 4 + struct.unpack_from("<I", data, at)[0]
        end = begin + 4 + struct.unpack_from("<I", data, begin)[0]
        found.append((_values(data[at + 4 : begin]), data[begin + 4 : end]))
        at = end
    return found


def _values(data: bytes) -> dict[bytes, bytes]:
    found, at = {}, 0
    while at + 4 <= len(data):
        end = at + 4 + struct.unpack_from("<I", data, at)[0]
        name, _, value = data[at + 4 : end].partition(b"=")
        found[name] = value
        at = end
    return found


def _bz2_bomb(folder: Path) -> None:
    packer = bz2.BZ2Compressor()
    data = b"".join(packer.compress(bytes(1 << 24)) for _ in range(256)) + packer.flush()
    bag(_bag_chunk(data, b"bz2", 0xFFFFFFFF))(folder)


def _lz4_bomb(folder: Path) -> None:
    bag(_bag_chunk(_lz4(4 * GIB), b"lz4", 0xFFFFFFFF))(folder)


# ---- rosbag 2 of sqlite

TABLES = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)",
)
TOPIC = "INSERT INTO topics VALUES(1, '/scan', 'sensor_msgs/msg/LaserScan', 'cdr', '')"
METADATA = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: sqlite3
  duration: {nanoseconds: 1000000000}
  starting_time: {nanoseconds_since_epoch: 0}
  message_count: 20
  topics_with_message_count:
    - topic_metadata: {name: /scan, type: sensor_msgs/msg/LaserScan, serialization_format: cdr, offered_qos_profiles: ""}
      message_count: 20
  compression_format: "FORMAT"
  compression_mode: "MODE"
  relative_file_paths: [PATHS]
"""


def database(*statements: str, metadata: str = METADATA, paths: str = "b.db3", mode: str = "", form: str = ""
             ) -> Callable[[Path], None]:  # fmt: skip
    """A folder with a database, that says what `metadata` says."""

    def make(folder: Path) -> None:
        (folder / "b").mkdir()
        text = metadata.replace("PATHS", paths).replace("MODE", mode).replace("FORMAT", form)
        (folder / "b" / "metadata.yaml").write_text(text)
        made = sqlite3.connect(folder / "b" / "b.db3")
        for statement in statements:
            made.execute(statement)
        made.commit()
        made.close()

    return make


ENDLESS = (
    "CREATE VIEW messages AS WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) "
    "SELECT x AS id, 1 AS topic_id, x AS timestamp, x'00' AS data FROM n"
)
LARGE = "CREATE VIEW messages AS SELECT 1 AS id, 1 AS topic_id, 5 AS timestamp, zeroblob(990000000) AS data"
LOADING = (
    "CREATE VIEW messages AS SELECT 1 AS id, 1 AS topic_id, 5 AS timestamp, load_extension('./evil.so') AS data",
    f"CREATE TRIGGER t AFTER INSERT ON topics BEGIN SELECT writefile('{ACTED}', 'x'); END",
)


def _zstd_outside(folder: Path) -> None:
    """A packed part whose name leads out of the folder: it is unpacked beside itself."""
    database(*TABLES, TOPIC, paths="../../victim.db3.zstd, b.db3", mode="FILE", form="zstd")(folder)
    (folder.parent / "victim.db3.zstd").write_bytes(_zstd(1 << 20))


def _zstd_file_bomb(folder: Path) -> None:
    database(*TABLES, TOPIC, paths="b.db3.zstd", mode="FILE", form="zstd")(folder)
    (folder / "b" / "b.db3").unlink()
    (folder / "b" / "b.db3.zstd").write_bytes(_zstd(8 * GIB))


# ---- arrays, Parquet, saves


class Opened:
    """What runs code where it is unpickled."""

    def __reduce__(self) -> Any:
        return eval, (WRITE,)


def _pickled(folder: Path) -> None:
    made = {"ranges_m": np.array([Opened()], object), "angle_deg": np.zeros(3), "scan_time_s": np.zeros(1)}
    np.savez(folder / "s.npz", **made)


def _bare_pickle(folder: Path) -> None:
    with zipfile.ZipFile(folder / "s.npz", "w") as made:
        for name in ("ranges_m", "angle_deg", "scan_time_s", "x_m", "y_m"):
            made.writestr(f"{name}.npy", pickle.dumps(Opened()))


def array(header: str, data: bytes = b"") -> Callable[[Path], None]:
    """A .npz whose arrays have this head."""

    def make(folder: Path) -> None:
        text = header.encode() + b"\n"
        with zipfile.ZipFile(folder / "s.npz", "w", zipfile.ZIP_DEFLATED) as made:
            for name in ("ranges_m", "angle_deg", "scan_time_s", "x_m", "y_m"):
                made.writestr(
                    f"{name}.npy", b"\x93NUMPY\x02\x00" + struct.pack("<I", len(text)) + text + data
                )

    return make


def _member_says_less(folder: Path) -> None:
    """Members of 1 GB that say in the archive's directory that they have 1 kB."""
    array("{'descr': '<f8', 'fortran_order': False, 'shape': (134217728,), }", bytes(GIB))(folder)
    data = (folder / "s.npz").read_bytes()
    (folder / "s.npz").write_bytes(data.replace(struct.pack("<I", GIB + 74), struct.pack("<I", 1000)))


BUILD_NPZ = ("height-map", "build", "s.npz", "--out", "h.npz")


def run_with(change: Callable[[Path], Any]) -> Callable[[Path], None]:
    """A run folder with its tracks changed."""

    def make(folder: Path) -> None:
        from tests.fuzz.kinds import KINDS

        KINDS["run-folder"].make(folder)
        change(folder / "run")

    return make


def _python_type(run: Path) -> None:
    """Columns of a type that older libraries unpickle."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(run / "tracks.parquet")
    about = {b"ARROW:extension:name": b"arrow.py_extension_type", b"ARROW:extension:metadata": pickle.dumps(Opened()),
             b"PARQUET:field_id": b"1"}  # fmt: skip
    fields = [pa.field(f.name, f.type, metadata=about) for f in table.schema]
    pandas = {
        b"pandas": json.dumps({"columns": [{"metadata": pickle.dumps(Opened()).hex()}]}).encode(),
        b"pickle": pickle.dumps(Opened()),
    }
    pq.write_table(
        pa.Table.from_arrays(table.columns, schema=pa.schema(fields, metadata=pandas)), run / "tracks.parquet"
    )


def _dictionary(run: Path) -> None:
    """The same text of 60 MB in each of 200 rows, stored once."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(run / "tracks.parquet").slice(0, 200)
    long = pa.array(["x" * (60 << 20)]).dictionary_encode()
    column = pa.DictionaryArray.from_arrays(pa.array([0] * len(table), pa.int32()), long.dictionary)
    at = table.schema.get_field_index("machine")
    pq.write_table(
        table.set_column(max(at, 0), "machine", column), run / "tracks.parquet", compression="zstd"
    )


def _columns(run: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({f"c{k}": [0.0] for k in range(60_000)}), run / "tracks.parquet")


YIELD_LOG = ("yield-log", "run", "--out", "y.csv")
BRANCH = ("branch", "run", "--at", "0.4", "--out", "out", "--quiet")


def saved_with(change: Callable[[Path], Any]) -> Callable[[Path], None]:
    """A run folder with its saves changed."""

    def make(folder: Path) -> None:
        from tests.fuzz.kinds import KINDS

        KINDS["saves"].make(folder)
        (folder / "command.args").unlink()
        first, *others = (file for file in (folder / "run" / "saves").iterdir() if file.name != "field.bin")
        change(first)
        for save in others:
            save.write_bytes(first.read_bytes())

    return make


def _save_bomb(save: Path) -> None:
    whole = zlib.decompress(save.read_bytes())
    packer = zlib.compressobj(1)
    packed = packer.compress(whole[:64]) + b"".join(packer.compress(bytes(1 << 20)) for _ in range(4 << 10))
    save.write_bytes(packed + packer.flush())


def _deep_save(save: Path) -> None:
    whole = zlib.decompress(save.read_bytes())
    at = whole.find(b"{")
    save.write_bytes(zlib.compress(whole[:at] + b'{"a":' + b"[" * 2_000_000))


def _named_types(save: Path) -> None:
    """Every type that it names is one that acts."""
    whole = zlib.decompress(save.read_bytes())
    for name in (b"MachineState", b"record", b"array", b"number"):
        whole = whole.replace(b'"' + name + b'"', b'"os.system"')
    save.write_bytes(zlib.compress(whole))


RECORDINGS: dict[str, Attack] = {
    "msg-name": Attack(
        mcap(f"uint8 x: int = {WRITE}\nuint8 y"), BUILD, f"{CODE_RUNS}: name of a field", is_quick=True
    ),
    "msg-type": Attack(mcap(f"a/b({WRITE}) x\nuint8 y"), BUILD, f"{CODE_RUNS}: type of a field"),
    "msg-constant": Attack(mcap(f"int32 X={WRITE}\nuint8 y"), BUILD, f"{CODE_RUNS}: constant"),
    "msg-text": Attack(
        mcap(f'string X=\'+{WRITE}+\'\nstring Y="""+{WRITE}+"""\nstring Z=\\\'+{WRITE}#\nuint8 y'),
        BUILD,
        f"{CODE_RUNS}: text of a constant",
    ),
    "msg-default": Attack(
        mcap(f"int32 x {WRITE}\nstring s '\"+{WRITE}+\"'\nuint8 y"), BUILD, f"{CODE_RUNS}: default"
    ),
    "msg-schema-name": Attack(
        mcap("uint8 x", name=f"sensor_msgs/msg/L:\n {WRITE}\nclass L"),
        BUILD,
        f"{CODE_RUNS}: name of a definition",
        is_quick=True,
    ),
    "msg-quote": Attack(
        mcap("uint8 x", name=f'sensor_msgs/msg/L"""+{WRITE}+"""'),
        BUILD,
        f"{CODE_RUNS}: name of a definition, in quotes",
    ),
    "msg-dependency": Attack(
        mcap(f"pkg/T a\n{'=' * 80}\nMSG: pkg/T):\n {WRITE}\nclass T(\nuint8 x"),
        BUILD,
        f"{CODE_RUNS}: name of a definition that another needs",
    ),
    "msg-keyword": Attack(
        mcap("uint8 class\nuint8 __init__\nuint8 __class__\nuint8 self\nuint8 None"),
        BUILD,
        f"{CODE_RUNS}: words of Python",
    ),
    "msg-itself": Attack(
        mcap(f"sensor_msgs/LaserScan a\n{'=' * 80}\nMSG: sensor_msgs/LaserScan\nsensor_msgs/LaserScan a"),
        BUILD,
        "never end: a type of itself",
        is_quick=True,
    ),
    "msg-bomb": Attack(mcap(_nested(30, 4)), BUILD, "time, memory: 4^30 fields", is_quick=True),
    "msg-deep": Attack(mcap(_nested(3000, 1)), BUILD, "end badly: 3000 types deep"),
    "msg-array": Attack(mcap("float64[4000000000] a"), BUILD, "memory: an array of 4e9"),
    "msg-fields": Attack(
        mcap("\n".join(f"float64 a{k}" for k in range(100_000))), BUILD, "time: 100,000 fields"
    ),
    "msg-blanks": Attack(mcap("uint8 x" + " " * 3_000_000 + "\n" + "#" * 3_000_000), BUILD, "time: blanks"),
    "idl-code": Attack(
        mcap(idl(f"const string X = \"'+{WRITE}+'\";"), "ros2idl"), BUILD, f"{CODE_RUNS}: constant of IDL"
    ),
    "idl-names": Attack(
        mcap(idl(f"const long X = {WRITE.replace(' ', '')};"), "ros2idl"),
        BUILD,
        f"{CODE_RUNS}: a call in a constant",
    ),
    "idl-annotation": Attack(
        mcap(
            idl(
                "",
                f'@default (value={WRITE}) @verbatim (language="python", text="{WRITE}") long a;'.replace(
                    '"ACTED","a"', "'ACTED','a'"
                ).replace('"x"', "'x'"),
            ),
            "ros2idl",
        ),
        BUILD,
        f"{CODE_RUNS}: annotation",
    ),
    "idl-product": Attack(
        mcap(idl("const long X = " + "*".join(["99999999999999"] * 30_000) + ";"), "ros2idl"),
        BUILD,
        "time: a product of 30,000 numbers",
    ),
    "idl-shifts": Attack(
        mcap(idl("const long X = 1" + " << 100000000" * 60 + ";"), "ros2idl"),
        BUILD,
        "memory: sixty shifts",
        is_quick=True,
    ),
    "idl-minus": Attack(
        mcap(idl("const long X = " + "-" * 40 + "1;"), "ros2idl"), BUILD, "never end: forty signs"
    ),
    "idl-modules": Attack(
        mcap("module a {" * 3000 + "};" * 3000, "ros2idl"), BUILD, "never end: 3000 modules deep"
    ),
    "idl-sequences": Attack(
        mcap(idl("", "sequence<" * 40 + "long" + ">" * 40 + " a;"), "ros2idl"),
        BUILD,
        "never end: forty sequences deep",
    ),
    "idl-comment": Attack(mcap(idl() + "/*" * 300_000, "ros2idl"), BUILD, "time: comments that do not end"),
    "mcap-zstd": Attack(_packed(_zstd, b"zstd", 4 * GIB), BUILD, "memory: 4 GB in a chunk"),
    "mcap-zstd-hidden": Attack(
        _packed(_zstd, b"zstd", 1000), BUILD, "memory: 4 GB in a chunk that says 1 kB"
    ),
    "mcap-lz4-hidden": Attack(_packed(_lz4, b"lz4", 1000), BUILD, "memory: 4 GB in a chunk that says 1 kB"),
    "mcap-chunk-in-chunk": Attack(_chunk_in_chunk, BUILD, "end badly: 3000 chunks deep"),
    "mcap-length": Attack(
        recorded(SCHEMA, CHANNEL, struct.pack("<BQ", 5, 1 << 60) + bytes(40)),
        BUILD,
        "memory: a message of 2^60 bytes",
        is_quick=True,
    ),
    "mcap-text": Attack(
        recorded(_record(3, struct.pack("<HI", 1, 0xFFFFFFFF) + bytes(40))), BUILD, "memory: a name of 4 GB"
    ),
    "mcap-channels": Attack(_many_channels, BUILD, "time: a million channels"),
    "bag-code": Attack(
        retold(f"uint8 x: int = {WRITE}".encode()),
        BUILD_BAG,
        f"{CODE_RUNS}: name of a field of a rosbag 1",
    ),
    "bag-type": Attack(
        retold(kind=f'a/B"""\n{WRITE}\n"""'.encode()),
        BUILD_BAG,
        f"{CODE_RUNS}: type of a rosbag 1",
    ),
    "bag-bz2": Attack(_bz2_bomb, BUILD_BAG, "memory: 4 GB in a chunk"),
    "bag-lz4": Attack(_lz4_bomb, BUILD_BAG, "memory: 4 GB in a chunk"),
    "bag-loop": Attack(bag(bytes(8) * 3_000_000), BUILD_BAG, "time: records of no bytes"),
    "bag-index": Attack(
        bag(connection(), index=13, chunks=0xFFFFFFFF), BUILD_BAG, "never end: an index that is its head"
    ),
    "bag-record": Attack(
        bag(struct.pack("<I", 0xFFFFFFF0) + bytes(100)), BUILD_BAG, "memory: a record of 4 GB"
    ),
    "db3-endless": Attack(database(TABLES[0], TOPIC, ENDLESS), BUILD_DB, "never end: messages without end"),
    "db3-large": Attack(database(TABLES[0], TOPIC, LARGE), BUILD_DB, "memory: a message of 1 GB"),
    "db3-loading": Attack(
        database(TABLES[0], TOPIC, *LOADING), BUILD_DB, f"{CODE_RUNS}: a library, a trigger"
    ),
    "db3-slow": Attack(
        database(TABLES[0], TOPIC, ENDLESS + " WHERE x < 0"), BUILD_DB, "never end: a search without a find"
    ),
    "db3-type": Attack(
        database(
            *TABLES,
            TOPIC.replace("sensor_msgs/msg/LaserScan", f"a/msg/B:\n {WRITE.replace(chr(34), chr(39) * 2)}"),
        ),
        BUILD_DB,
        f"{CODE_RUNS}: type of a topic",
    ),
    "bag-paths": Attack(
        database(*TABLES, TOPIC, paths="/etc/passwd, ../../../../etc/hostname"),
        BUILD_DB,
        "read files elsewhere",
    ),
    "bag-unpacked-elsewhere": Attack(_zstd_outside, BUILD_DB, "write beside a file elsewhere"),
    "bag-zstd": Attack(_zstd_file_bomb, BUILD_DB, "fill the disk: 8 GB in 1 MB"),
    "bag-yaml": Attack(
        database(*TABLES, metadata=f"!!python/object/apply:eval ['{WRITE}']\n"),
        BUILD_DB,
        f"{CODE_RUNS}: a tag of YAML",
        is_quick=True,
    ),
    "npz-pickle": Attack(_pickled, BUILD_NPZ, f"{CODE_RUNS}: objects in an array", is_quick=True),
    "npz-bare-pickle": Attack(_bare_pickle, BUILD_NPZ, f"{CODE_RUNS}: a pickle that is no array"),
    "npz-head": Attack(array("(" * 9000), BUILD_NPZ, "end the process: 9000 brackets"),
    "npz-call": Attack(
        array(f"{{'descr': {WRITE}, 'fortran_order': False, 'shape': (1,)}}"),
        BUILD_NPZ,
        f"{CODE_RUNS}: the head of an array",
    ),
    "npz-long-head": Attack(array("[" + "1," * 30_000_000 + "]"), BUILD_NPZ, "memory: a head of 60 MB"),
    "npz-shape": Attack(
        array("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"),
        BUILD_NPZ,
        "memory: 8 TB",
        is_quick=True,
    ),
    "npz-says-less": Attack(_member_says_less, BUILD_NPZ, "memory: 5 GB that say 5 kB"),
    "parquet-pickle": Attack(run_with(_python_type), YIELD_LOG, f"{CODE_RUNS}: a type of Python's"),
    "parquet-dictionary": Attack(run_with(_dictionary), YIELD_LOG, "memory: 12 GB of text, stored once"),
    "parquet-columns": Attack(run_with(_columns), YIELD_LOG, "time: 60,000 columns"),
    "parquet-endless": Attack(
        run_with(lambda run: sparse(run / "tracks.parquet", b"PAR1", 8 * GIB)),
        YIELD_LOG,
        "memory: a file of 8 GB of zeros",
    ),
    "save-bomb": Attack(saved_with(_save_bomb), BRANCH, "memory: saves of 4 GB", (0, 1, 2, 3)),
    "save-deep": Attack(
        saved_with(_deep_save), BRANCH, "end the process: brackets 2 million deep", (0, 1, 2, 3)
    ),
    "save-types": Attack(saved_with(_named_types), BRANCH, f"{CODE_RUNS}: types of a save", (0, 1, 2, 3)),
}
